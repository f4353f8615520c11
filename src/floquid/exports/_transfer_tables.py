"""Transfer functions → tables of other programs: comma-separated values, MATLAB, Touchstone, JSON."""

from __future__ import annotations

import re
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import describe, input_error
from floquid._json import for_json
from floquid.exports._mat import PLAIN, mat_cells, mat_file
from floquid.inputs import TransferFunctions
from floquid.io import as_path, atomic_path
from floquid.transfer import MeasuredTransfer, TransferFit

TRANSFER_FORMATS = (".csv", ".mat", ".sNp")
"""The suffixes that `export_transfer` knows, N the number of ports."""


def export_transfer(found: TransferFunctions, path: str | PathLike[str]) -> None:
    """Write transfer functions to a table in the format of its suffix.

    - `.csv`: a row a frequency; of each function the real and the imaginary part, with deviations, in columns that name
      harmonic, path and unit; the first names the sampling interval where G is of samples.
    - `.mat`: MATLAB version 5: `values` and `std` (harmonics, outputs, inputs, frequencies), `frequencies_hz`,
      `harmonics`, `outputs`, `inputs` and their units, `step` where it is that of samples.
    - `.sNp`: Touchstone version 1 of one harmonic of as many outputs as inputs, N: port k has input k and output k.
      Voltages in and currents out are admittances (Y), all else is written as impedances (Z), in the units that the
      comments name. Programs for circuits read it, scikit-rf among them. It has no deviations.

    `found` is what `transfer` or `measure_transfer` gave, `path` the file to write; it is replaced, whole or not at
    all. Raises InputError where it is something else, the suffix is unknown, the functions have no such form, or the
    file cannot be written there.
    """
    of = "export_transfer"
    if not isinstance(found, TransferFunctions):
        got = f"is {describe(found)}"
        raise input_error("found", of, "be TransferFunctions", got, "Pass what `analysis.transfer()` gives.")
    file = as_path(path, of=of)
    suffix = file.suffix.lower()
    ports = re.fullmatch(r"\.s(\d+)p", suffix)
    if suffix == ".csv":
        content = transfer_rows(found).encode()
    elif suffix == ".mat":
        content = _mat(found)
    elif ports:
        content = _touchstone(found, int(ports[1]), of).encode()
    else:
        got = f"{file} has the suffix {suffix!r}"
        raise input_error("path", of, "end in a known suffix", got, f"Use one of {', '.join(TRANSFER_FORMATS)}.")
    with atomic_path(file, of=of) as temporary:
        temporary.write_bytes(content)


def _mat(found: TransferFunctions) -> bytes:
    """The file for MATLAB."""
    content: dict[str, object] = {
        "frequencies_hz": found.frequencies_hz,
        "harmonics": found.harmonics.astype(np.float64),
        "values": found.values,
        "std": found.std,
        "step": found.step,
    }
    for name, channels in (("output", found.outputs), ("input", found.inputs)):
        content[f"{name}s"] = mat_cells([channel.name for channel in channels])
        content[f"{name}_units"] = mat_cells([channel.unit.translate(PLAIN) for channel in channels])
    return mat_file(content, "transfer functions")


def _touchstone(found: TransferFunctions, ports: int, of: str) -> str:
    """The table of one square harmonic, frequencies ascending."""
    if len(found.outputs) != ports or len(found.inputs) != ports:
        got = f"are from {len(found.inputs)} inputs to {len(found.outputs)} outputs"
        remedy = "Choose outputs by `channels`, write .csv or .mat, or end the name in .sNp with N the ports."
        raise input_error("found", of, f"have {ports} outputs and inputs for .s{ports}p", got, remedy)
    if len(found.harmonics) != 1:
        got, remedy = f"has {found.harmonics.tolist()}", "One file a harmonic: `harmonics=0`."
        raise input_error("found", of, "have one harmonic for a Touchstone file", got, remedy)
    there = np.isfinite(found.values[0]).all(axis=(0, 1)) & (found.frequencies_hz >= 0.0)
    order = np.flatnonzero(there)[np.argsort(found.frequencies_hz[there], kind="stable")]
    if not len(order):
        got, remedy = "have none", "Write .csv or .mat, which have NaN where one is missing."
        raise input_error("found", of, "have a frequency at which all paths were found", got, remedy)
    kinds = [{channel.unit for channel in channels} for channels in (found.inputs, found.outputs)]
    kind = "Y" if kinds == [{"V"}, {"A"}] else "Z"
    lines = [f"! G({int(found.harmonics[0]):+d}): response at f + m/T, m = {int(found.harmonics[0])}, to an input at f"]
    lines += [
        f"! port {k + 1}: from {source.name} [{source.unit}] to {output.name} [{output.unit}]"
        for k, (source, output) in enumerate(zip(found.inputs, found.outputs, strict=True))
    ]
    lines.append(f"# Hz {kind} RI R 1")
    for place in order.tolist():
        matrix = found.values[0, :, :, place]
        # Two ports are written column by column, others row by row, at most four numbers a line.
        rows = (
            [matrix.T.ravel()] if ports == 2 else [part for row in matrix for part in np.split(row, range(4, ports, 4))]
        )
        texts = ["  ".join(f"{value.real:.12g} {value.imag:.12g}" for value in row) for row in rows]
        lines += [f"{found.frequencies_hz[place]:.12g}  {texts[0]}", *(f"    {text}" for text in texts[1:])]
    return "\n".join(lines).translate(PLAIN).encode("ascii", "replace").decode() + "\n"


def transfer_rows(found: TransferFunctions) -> str:
    """The transfer functions `found` as a table of comma-separated values, with a line of names and units.

    A row is a frequency; of each function there are the real and the imaginary part. The first head has the sampling
    interval where G is of samples.
    """
    sampled = "" if found.step is None else f" of samples every {found.step!r} s"
    heads, columns = [f"frequency [Hz]{sampled}"], [found.frequencies_hz]
    for place, harmonic in enumerate(found.harmonics.tolist()):
        for row, output in enumerate(found.outputs):
            for column, source in enumerate(found.inputs):
                name, unit = f"G({harmonic:+d}) {source.name} to {output.name}", found.unit(row, column)
                heads += [f"{name} real [{unit}]", f"{name} imag [{unit}]"]
                columns += _parts(found.values[place, row, column])
                if found.std is not None:
                    heads += [f"{name} real std [{unit}]", f"{name} imag std [{unit}]"]
                    columns += _parts(found.std[place, row, column])
    lines = [",".join(f'"{head}"' for head in heads)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in np.transpose(columns)]
    return "\n".join(lines) + "\n"


def _parts(values: NDArray[np.complex128]) -> list[NDArray[np.float64]]:
    """Real and imaginary part, both NaN of what is missing: its imaginary part may be 0."""
    return [np.where(np.isfinite(values), part, np.nan) for part in (values.real, values.imag)]


def transfer_entries(found: TransferFunctions) -> dict[str, Any]:
    """The transfer functions `found` for `json.dump`; values are (harmonics, outputs, inputs, frequencies, 2)."""
    content = {
        "format": "floquid-transfer/1",
        "frequencies_hz": found.frequencies_hz,
        "harmonics": found.harmonics,
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in found.outputs],
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in found.inputs],
        "values": found.values,
        "std": found.std,
        "step": found.step,
    }
    return for_json(content)


def measured_entries(found: MeasuredTransfer) -> dict[str, Any]:
    """Facts about measured transfer functions `found`, beside their values, for `json.dump`."""
    return for_json(
        {
            "method": found.method,
            "noise": found.noise,
            "coherence": found.coherence,
            "nonlinear": found.nonlinear,
        }
    )


def fit_entries(fit: TransferFit) -> dict[str, Any]:
    """Facts about the modes of a `fit` to transfer functions, for `json.dump`; the upper mode of each pair."""
    upper, std = list(fit.model.upper_modes), fit.model.exponent_std
    return for_json(
        {
            "method": "fit",
            "exponents": fit.model.exponents[upper],
            "exponents_std": None if std is None else std[upper],
            "chi_square": fit.chi_square,
            "degrees": fit.degrees,
        }
    )
