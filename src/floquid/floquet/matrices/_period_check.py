"""Refusal of a callable that does not repeat itself after its period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.floquet.matrices._balancing import balance
from floquid.floquet.matrices._forms import FunctionMatrix

OFFSET = 0.381966  # off every simple fraction of the period, where jumps and zeros like to sit


def refuse_other_period(matrix: FunctionMatrix, of: str) -> None:
    """Refuse a callable that is another matrix one period later."""
    times = probe_times(matrix.period)
    distance = np.abs(times[:, None] - np.asarray(matrix.breaks)[None, :])
    times = times[(distance > 1e-6 * matrix.period).all(axis=1)]
    now, later = matrix.at(times), matrix.at(times + matrix.period)
    differences = np.abs(later - now)
    # Entry by entry, whatever their units, and not below what rounding makes of entries that come and go.
    rounding = 1e-13 * np.abs(now).max()
    if now.shape[1] == now.shape[2]:
        scale, size = balance(now)
        rounding = 1e-13 * size * scale[:, None] / scale
    allowed = 1e-8 * np.abs(now).max(axis=0) + rounding
    over = (differences > allowed).any(axis=(1, 2))
    if over.any():
        worst, change = int(over.argmax()), differences.max(axis=(1, 2))
        raise input_error(
            "period",
            of,
            "be a period of A(t)",
            f"A differs by {change[worst]:.3g} between t = {times[worst]:g} and one period of {matrix.period:g} later",
            "Half a revolution is a period only in the fixed frame: check the period and the coordinates. Values in "
            "single precision are no periodic matrix: compute them in double.",
        )


def probe_times(period: float, count: int = 16) -> NDArray[np.float64]:
    """Instants spread over the period (times,) [s]."""
    return period * (np.arange(count) + OFFSET) / count
