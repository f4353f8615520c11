"""Results with measured inputs in numbers: `summary.json`, and tables of transfer functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.exports._summary import mode_entries
from floquid.findings import as_mapping
from floquid.inputs import TransferFunctions
from floquid.pipeline import DrivenAnalysis


def driven_summary(analysis: DrivenAnalysis) -> dict[str, Any]:
    """The content of `summary.json` of a result with inputs: plain numbers, lists and texts.

    `modes` are as in `summary`; `inputs` has, of each mode, its `coefficients` b over the inputs' `harmonics` with
    deviations, and the `direct` term; a complex number is [real, imaginary].

    Parameters
    ----------
    analysis
        What `identify_driven` found.

    Returns
    -------
    dict
        Ready for `json.dump`.
    """
    model, own = analysis.model, analysis.model.inputs
    assert own is not None
    return {
        "format": "floquid-summary-driven/1",
        "period": model.period,
        "order": model.order,
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in model.channels],
        "modes": mode_entries(model, 1.0 / analysis.noise),
        "inputs": {
            "channels": [{"name": channel.name, "unit": channel.unit} for channel in own.channels],
            "hold": analysis.settings.hold,
            "harmonics": own.harmonics.tolist(),
            "coefficients": _pairs(own.coefficients),
            "coefficients_std": None if own.coefficient_std is None else _pairs(own.coefficient_std),
            "direct_harmonics": own.direct_harmonics.tolist(),
            "direct": _pairs(own.direct),
            "initial": _pairs(own.initial),
        },
        "noise": analysis.noise[:, 0].tolist(),
        "held_out_error": [float(value) if np.isfinite(value) else None for value in analysis.held_out],
        "passed": analysis.passed,
        "warnings": list(analysis.warnings),
        "findings": [as_mapping(finding) for finding in analysis.findings],
    }


def transfer_entries(found: TransferFunctions) -> dict[str, Any]:
    """Transfer functions in plain numbers and lists, values (harmonics, outputs, inputs, frequencies) as [re, im].

    Parameters
    ----------
    found
        The transfer functions.

    Returns
    -------
    dict
        Ready for `json.dump`.
    """
    return {
        "format": "floquid-transfer/1",
        "frequencies_hz": found.frequencies_hz.tolist(),
        "harmonics": found.harmonics.tolist(),
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in found.outputs],
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in found.inputs],
        "values": _pairs(found.values),
        "std": None if found.std is None else _pairs(found.std),
    }


def transfer_rows(found: TransferFunctions) -> str:
    """Transfer functions as a table of comma-separated values: a row a frequency, real and imaginary parts.

    Parameters
    ----------
    found
        The transfer functions.

    Returns
    -------
    str
        The table, with a line of names and units.
    """
    heads, columns = ["frequency [Hz]"], [found.frequencies_hz]
    for place, harmonic in enumerate(found.harmonics.tolist()):
        for row, output in enumerate(found.outputs):
            for column, source in enumerate(found.inputs):
                name, unit = f"G({harmonic:+d}) {source.name} to {output.name}", f"{output.unit}/{source.unit}"
                value = found.values[place, row, column]
                heads += [f"{name} real [{unit}]", f"{name} imag [{unit}]"]
                columns += [value.real, value.imag]
                if found.std is not None:
                    std = found.std[place, row, column]
                    heads += [f"{name} real std [{unit}]", f"{name} imag std [{unit}]"]
                    columns += [std.real, std.imag]
    lines = [",".join(f'"{head}"' for head in heads)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in np.transpose(columns)]
    return "\n".join(lines) + "\n"


def _pairs(values: NDArray[np.complex128]) -> list[Any]:
    return np.stack([values.real, values.imag], axis=-1).tolist()
