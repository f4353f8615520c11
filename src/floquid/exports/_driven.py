"""Results with measured inputs in numbers: `summary.json`, and tables of transfer functions."""

from __future__ import annotations

from typing import Any

from floquid._json import for_json
from floquid.exports._summary import mode_entries
from floquid.findings import as_mapping
from floquid.inputs import TransferFunctions
from floquid.pipeline import AmbientAnalysis, ExcitedAnalysis
from floquid.transfer import MeasuredTransfer, TransferFit


def driven_summary(analysis: ExcitedAnalysis) -> dict[str, Any]:
    """The content of `summary.json` of a record whose excitation goes on: plain numbers, lists and texts.

    `modes` are as in `summary`; `inputs` has, of each mode, its `coefficients` b over the inputs' `harmonics` with
    deviations, and the `direct` term, and is null where none were measured; a complex number is [real, imaginary].
    `lengths` are the durations of a record that would give each damping to 10 % [s], null with measured inputs alone.
    It is ready for `json.dump`. `analysis` is what `identify_driven` or `identify_ambient` found.
    """
    model, own = analysis.model, analysis.model.inputs
    content = {
        "format": "floquid-summary-driven/1",
        "period": model.period,
        "order": model.order,
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in model.channels],
        "modes": mode_entries(model, 1.0 / analysis.noise),
        "excitation": analysis.settings.excitation,
        "inputs": None
        if own is None
        else {
            "channels": [{"name": channel.name, "unit": channel.unit} for channel in own.channels],
            "hold": analysis.settings.hold,
            "harmonics": own.harmonics,
            "coefficients": own.coefficients,
            "coefficients_std": own.coefficient_std,
            "direct_harmonics": own.direct_harmonics,
            "direct": own.direct,
            "initial": own.initial,
        },
        "noise": analysis.noise[:, 0],
        "lengths": analysis.lengths if isinstance(analysis, AmbientAnalysis) else None,
        "held_out_error": analysis.held_out,
        "passed": analysis.passed,
        "warnings": analysis.warnings,
        "findings": [as_mapping(finding) for finding in analysis.findings],
    }
    return for_json(content)


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
    """What is known of transfer functions measured, `found`, beside their values, for `json.dump`."""
    return for_json(
        {
            "method": found.method,
            "noise": found.noise,
            "coherence": found.coherence,
            "nonlinear": found.nonlinear,
            "warnings": list(found.warnings),
        }
    )


def fit_entries(fit: TransferFit) -> dict[str, Any]:
    """What is known of modes fitted to transfer functions, `fit`, for `json.dump`: of a pair the upper one."""
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
