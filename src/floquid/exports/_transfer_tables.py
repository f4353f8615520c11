"""Transfer functions → tables of other programs (CSV, MATLAB, Touchstone, JSON), and the first two back."""

from __future__ import annotations

import csv
import re
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import input_error, wrong_value
from floquid._json import attributes, for_json
from floquid.core import Channel
from floquid.exports._formats import PLAIN, mat_cells, mat_file, mat_structs
from floquid.inputs import TransferFunctions
from floquid.io import GUARD, DamagedError, as_path, atomic_path, readable_file
from floquid.transfer import MeasuredTransfer, TransferFit

TRANSFER_FORMATS = (".csv", ".mat", ".sNp")
"""The suffixes that `export_transfer` knows, N the number of ports."""


def export_transfer(found: TransferFunctions, path: str | PathLike[str]) -> None:
    """Write transfer functions to a table in the format of its suffix.

    - `.csv`: a row a frequency; of each function the real and the imaginary part, with deviations, in columns that name
      harmonic, path and unit; the first names the sampling interval where G is of samples.
    - `.mat`: MATLAB version 5: `values` and `std` (harmonics, outputs, inputs, frequencies), `frequencies_hz`,
      `harmonics`, `outputs`, `inputs` and their units, `step` where it is that of samples. The struct array `paths` has
      an element a path: `paths(1).input`, `.output`, `.unit`, `.values` and `.std` (harmonics, frequencies).
    - `.sNp`: Touchstone version 1 of one harmonic of as many outputs as inputs, N: port k has input k and output k.
      Voltages in and currents out are admittances (Y), all else is written as impedances (Z), in the units that the
      comments name. Programs for circuits read it, scikit-rf among them. It has no deviations.

    `found` is what `transfer` or `measure_transfer` gave, `path` the file to write; it is replaced, whole or not at
    all. Raises InputError where it is something else, the suffix is unknown, the functions have no such form, or the
    file cannot be written there.
    """
    of = "export_transfer"
    if not isinstance(found, TransferFunctions):
        raise wrong_value("found", of, "be TransferFunctions", found, "Pass what `analysis.transfer()` gives.")
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
        **attributes(found, "values", "std", "step"),
    }
    for name, channels in (("output", found.outputs), ("input", found.inputs)):
        content[f"{name}s"] = mat_cells([channel.name for channel in channels])
        content[f"{name}_units"] = mat_cells([channel.unit.translate(PLAIN) for channel in channels])
    content["paths"] = mat_structs(
        [
            {
                "input": source.name,
                "output": output.name,
                "unit": found.unit(row, column).translate(PLAIN),
                "values": found.values[:, row, column],
                "std": np.zeros((0, 0)) if found.std is None else found.std[:, row, column],
            }
            for row, output in enumerate(found.outputs)
            for column, source in enumerate(found.inputs)
        ]
    )
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


def _parts(values: Complexes) -> list[Floats]:
    """Real and imaginary part, both NaN of what is missing: its imaginary part may be 0."""
    return [np.where(np.isfinite(values), part, np.nan) for part in (values.real, values.imag)]


def transfer_entries(found: TransferFunctions) -> dict[str, Any]:
    """The transfer functions `found` for `json.dump`; values are (harmonics, outputs, inputs, frequencies, 2)."""
    content = {
        "format": "floquid-transfer/1",
        **attributes(found, "frequencies_hz", "harmonics"),
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in found.outputs],
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in found.inputs],
        **attributes(found, "values", "std", "step"),
    }
    return for_json(content)


def measured_entries(found: MeasuredTransfer) -> dict[str, Any]:
    """Facts about measured transfer functions `found`, beside their values, for `json.dump`."""
    return for_json(attributes(found, "method", "noise", "coherence", "nonlinear"))


def fit_entries(fit: TransferFit) -> dict[str, Any]:
    """Facts about the modes of a `fit` to transfer functions, for `json.dump`; the upper mode of each pair."""
    upper, std = list(fit.model.upper_modes), fit.model.exponent_std
    return for_json(
        {
            "method": "fit",
            "exponents": fit.model.exponents[upper],
            "exponents_std": None if std is None else std[upper],
            **attributes(fit, "chi_square", "degrees"),
        }
    )


OF = "import_transfer"
HEAD = re.compile(r"G\(([+-]?\d+)\) (.+?) to (.+?) (real|imag)( std)? \[(.*)\]")
SAMPLED = re.compile(r"frequency \[Hz\](?: of samples every (\S+) s)?")


def import_transfer(path: str | PathLike[str]) -> TransferFunctions:
    """The transfer functions in a table that `export_transfer` wrote, or another program in its form.

    `.csv` and `.mat`. Of a table of comma-separated values the head of each column counts, not its place: the first is
    `frequency [Hz]`, with `of samples every 0.05 s` behind it where G is of samples, the others are like
    `G(+1) F to x real [m/N]`, `imag`, `real std` and `imag std`. Deviations may be missing.

    `path` is the table. Raises InputError where the file cannot be read or holds something else.
    """
    file = readable_file(path, of=OF)
    kinds = {".csv": lambda: _table(file), ".mat": lambda: GUARD.call(file, _variables, file)}
    if file.suffix.lower() not in kinds:
        raise input_error("path", OF, "end in .csv or .mat", f"is {file}", "Write it with `export_transfer`.")
    try:
        return kinds[file.suffix.lower()]()
    except (DamagedError, KeyError, ValueError, TypeError, NotImplementedError, csv.Error) as error:
        got = f"{file} is not: {(str(error) or type(error).__name__).splitlines()[0]}"
        raise input_error("path", OF, "be a table as `export_transfer` writes it", got, "See its page.") from None


def _table(file: Path) -> TransferFunctions:
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = [row for row in csv.reader(stream) if row]
    first, heads = SAMPLED.fullmatch(rows[0][0].strip()), [HEAD.fullmatch(head.strip()) for head in rows[0][1:]]
    if first is None or not heads or not all(heads):
        wrong = [head for head, own in zip(rows[0], [first, *heads], strict=True) if own is None]
        raise ValueError(f"its column {wrong[0]!r} names no path" if wrong else "it has no columns")
    if len(rows) < 2 or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError(f"it needs lines of {len(rows[0])} numbers below its head")
    numbers = np.array(rows[1:], float)
    parts = {own.groups()[:5]: column for own, column in zip(heads, numbers[:, 1:].T, strict=True) if own}
    units = {own.groups()[1:3]: own[6] for own in heads if own}
    harmonics = sorted({int(harmonic) for harmonic, *_ in parts})
    inputs, outputs = (list(dict.fromkeys(key[place] for key in units)) for place in (0, 1))
    values, std = (np.full((len(harmonics), len(outputs), len(inputs), len(numbers)), np.nan, complex) for _ in "gs")
    for kind, found in ((None, values), (" std", std)):
        for (harmonic, source, output, part, own), column in parts.items():
            if own == kind and part == "real":
                place = harmonics.index(int(harmonic)), outputs.index(output), inputs.index(source)
                found[place] = column + 1j * parts[harmonic, source, output, "imag", own]
    both = {path: _units(unit) for path, unit in units.items()}
    return TransferFunctions(
        frequencies_hz=numbers[:, 0],
        harmonics=np.array(harmonics),
        values=values,
        std=std if any(key[4] for key in parts) else None,
        outputs=tuple(Channel(name=name, unit=both[inputs[0], name][0]) for name in outputs),
        inputs=tuple(Channel(name=name, unit=both[name, outputs[0]][1]) for name in inputs),
        step=float(first[1]) if first[1] else None,
    )


def _units(text: str) -> tuple[str, str]:
    """The units of output and input of that of a path; "-" is none."""
    if "/" not in text:
        return text, "-"
    above, below = text[:-1].rsplit("/(", 1) if text.endswith(")") and "/(" in text else text.rsplit("/", 1)
    return ("-" if above == "1" else above), below


def _variables(file: Path) -> TransferFunctions:
    from scipy.io import loadmat

    found = loadmat(file)
    std, step = found["std"], np.ravel(found["step"])
    outputs, inputs = (
        tuple(
            Channel(name=str(np.ravel(name)[0]), unit=str(np.ravel(unit)[0]))
            for name, unit in zip(np.ravel(found[f"{side}s"]), np.ravel(found[f"{side}_units"]), strict=True)
        )
        for side in ("output", "input")
    )
    hertz, harmonics = np.ravel(found["frequencies_hz"]), np.ravel(found["harmonics"])
    # MATLAB leaves out the last axes of length 1.
    shape = (len(harmonics), len(outputs), len(inputs), len(hertz))
    return TransferFunctions(
        frequencies_hz=hertz,
        harmonics=harmonics.astype(np.int64),
        values=found["values"].reshape(shape),
        std=std.reshape(shape) if std.size else None,
        outputs=outputs,
        inputs=inputs,
        step=float(step[0]) if len(step) else None,
    )
