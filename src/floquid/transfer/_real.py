"""Real multipliers of a fit to transfer functions, for which a pair of conjugates, or two, may stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.fit import half_of, near_axis, off_axis
from floquid.inputs import InputMode

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

SAME = 0.05
"""The distance of two exponents over their decay below which they are one."""


def near_real(
    modes: Sequence[InputMode],
    parameters: Callable[[], NDArray[np.float64]],
    omega: float,
    refused: list[complex],
    within: float = OFF_AXIS,
) -> Iterator[list[int]]:
    """Pairs, by their numbers, for which one real multiplier or two are to be tried: those of one sign together first.

    They are `within` deviations of the axis. `parameters` has the covariance of the free numbers of all modes,
    and it may have more beyond. Pairs that were not taken join `refused`.
    """
    spread, place = None, 0
    near: dict[float, list[int]] = {}
    for number, mode in enumerate(modes):
        imag, place = place + int(mode.free.sum()) // 2, place + int(mode.free.sum())
        if not near_axis(mode, omega):
            continue
        if any(abs(mode.exponent - other) < SAME * abs(other.real) for other in refused):
            continue
        spread = parameters() if spread is None else spread
        if off_axis(mode, omega) <= within * spread[imag, imag] ** 0.5:
            near.setdefault(half_of(mode, omega) % 1.0, []).append(number)
    for pairs in near.values():
        yield from [pairs, *([[one] for one in pairs] if len(pairs) > 1 else [])]
        refused += [modes[number].exponent for number in pairs]


def real_for(pairs: Sequence[InputMode], omega: float) -> tuple[list[tuple[float, ...]], NDArray, NDArray]:
    """Starts in place of pairs near the axis: exponents of one real multiplier, of two, and their turns and reach."""
    turns, reach = [], []
    for mode in pairs:
        half = half_of(mode, omega)
        turns.append(np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5))
        reach.append(np.arange(half % 1.0, np.abs(mode.reach - half).max() + 0.5))
    decays = [mode.exponent.real for mode in pairs]
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    return [(float(np.mean(decays)),), ends], max(turns, key=len), max(reach, key=len)
