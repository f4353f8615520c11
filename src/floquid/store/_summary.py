"""`summary.json`: the result in the numbers that other programs want, format `floquid-summary/1`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.order import Choice
from floquid.periodic import participation
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel


def summary(analysis: Analysis) -> dict[str, Any]:
    """The content of `summary.json`: plain numbers, lists and texts; what is not computed is None.

    Every exponent is listed, conjugates included; a complex number is [real, imaginary]. `participation` is the share
    of each of the mode's `harmonics` in the energy of its shape, channels weighted by the inverse of their noise.
    `noise_whitening` has the filter of each channel that took the colour of the noise off.

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
    weights = 1.0 / analysis.lifted.noise
    return {
        "format": "floquid-summary/1",
        "period": model.period,
        "period_std": None,
        "order": model.order,
        "order_choice": None if analysis.choice is None else _choice(analysis.choice),
        "n_cycles": max(c.n_cycles for c in analysis.cycles),
        "n_phases": analysis.cycles[0].n_phases,
        "noise_whitening": None if analysis.lifted.whitening is None else analysis.lifted.whitening.tolist(),
        "modes": [_mode(model, r, std, weights) for r in range(model.order)],
        "system": None if analysis.state is None else _system(analysis.state),
        "validation": None,
        "warnings": list(analysis.warnings),
    }


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
