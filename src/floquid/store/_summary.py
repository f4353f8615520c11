"""`summary.json`: the result in the numbers that other programs want, format `floquid-summary/1`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.order import Choice
from floquid.periodic import ForcedResponse, participation
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel


def summary(analysis: Analysis) -> dict[str, Any]:
    """The content of `summary.json`: plain numbers, lists and texts; what is not computed is None.

    Every exponent is listed, conjugates included; a complex number is [real, imaginary]. `participation` is the share
    of each of the mode's `harmonics` in the energy of its shape, channels weighted by the inverse of their noise.
    `forced` has the forced response beside the free one, `synchronisation` what was done to the record and how well it
    is synchronised. `noise_whitening` has the filter of each channel that took the colour of the noise off.

    Parameters
    ----------
    analysis
        What `identify` found.

    Returns
    -------
    dict
        Ready for `json.dump`.
    """
    model = analysis.model
    std = model.exponent_std
    weights = 1.0 / analysis.noise
    return {
        "format": "floquid-summary/1",
        "period": model.period,
        "period_std": _period_std(analysis),
        "order": model.order,
        "order_choice": None if analysis.choice is None else _choice(analysis.choice),
        "n_cycles": max(c.n_cycles for c in analysis.cycles),
        "n_phases": analysis.cycles[0].n_phases,
        "noise_whitening": None if analysis.lifted.whitening is None else analysis.lifted.whitening.tolist(),
        "modes": [_mode(model, r, std, weights) for r in range(model.order)],
        "forced": None if analysis.fit is None or analysis.fit.forced is None else _forced(analysis.fit.forced),
        "synchronisation": list(analysis.synchronisation),
        "system": None if analysis.state is None else _system(analysis.state),
        "validation": None,
        "warnings": list(analysis.warnings),
    }


def _period_std(analysis: Analysis) -> float | None:
    if analysis.fit is not None and analysis.fit.period_std is not None:
        return analysis.fit.period_std
    return analysis.shafts[0].period_std if analysis.shafts else None


def _forced(forced: ForcedResponse) -> dict[str, Any]:
    """Harmonics of the revolution; coefficients [re, im] (channels, hits, harmonics); offset and drift a second."""
    return {
        "revolution": forced.revolution,
        "harmonics": forced.harmonics.tolist(),
        "coefficients": _pairs(forced.coefficients),
        "coefficients_std": _pairs(forced.coefficient_std),
        "offset": forced.offset.tolist(),
        "drift": forced.drift.tolist(),
    }


def _pairs(values: NDArray[np.complex128]) -> list[Any]:
    return np.stack([values.real, values.imag], axis=-1).tolist()


def _choice(choice: Choice) -> dict[str, Any]:
    return {"ambiguous": choice.ambiguous, "reasons": list(choice.reasons), "doubts": list(choice.doubts)}


def _mode(
    model: PeriodicModel, r: int, std: NDArray[np.complex128] | None, weights: NDArray[np.float64]
) -> dict[str, Any]:
    harmonics, shares = participation(model, r, weights)
    return {
        "exponent": _pair(model.exponents[r]),
        "exponent_std": None if std is None else _pair(std[r]),
        "principal": _pair(model.principal()[r]),
        "multiplier": _pair(model.multipliers[r]),
        "frequency_hz": float(model.frequencies_hz[r]),
        "damping_ratio": float(model.damping_ratios[r]),
        "harmonics": harmonics.tolist(),
        "participation": shares.tolist(),
    }


def _system(state: StateModel) -> dict[str, Any]:
    return {
        "states": list(state.states),
        "times": state.times.tolist(),
        "values": state.system.tolist(),
        "std": None if state.system_std is None else state.system_std.tolist(),
    }


def _pair(value: complex) -> list[float]:
    return [float(value.real), float(value.imag)]
