"""Real multipliers of a fit with inputs, for which a pair of conjugates, or two, may stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from floquid.fit import chi2_limit
from floquid.inputs._joint import fitted_together
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._start import bare_mode
from floquid.inputs.search._bands import grown, narrowed
from floquid.inputs.search._near_axis import half_of
from floquid.inputs.search._structure import Limits

AS_REAL = 8
"""Steps of a fit with real multipliers for pairs."""

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NARROWEST = 1e-3
"""The distance off the axis, over the fundamental, within which one is tried however little it decays."""

SAME = 0.05
"""The distance of two exponents over their decay below which they are one."""

REAL = 1e-3
"""The probability at which noise may move a real multiplier off the axis."""


def with_real_ones(
    samples: Samples, now: Linearisation, limits: Limits, refused: list[complex] | None = None, rounds: int = 1
) -> Linearisation:
    """With pairs whose multipliers may be one or two real ones taken for that, where noise explains the rest.

    Fits with these go on for some rounds while what each gains may make up for what is missing.
    """
    refused = [] if refused is None else refused
    for pairs in near_real(now.modes, lambda: covariance(samples, now), samples.fundamental, refused):
        best = _as_real(samples, now, pairs, limits, rounds)
        if best is not None:
            return with_real_ones(samples, best, limits, refused, rounds)
    return now


def near_real(
    modes: Sequence[InputMode],
    parameters: Callable[[], NDArray[np.float64]],
    omega: float,
    refused: list[complex],
    within: float = OFF_AXIS,
) -> Iterator[list[int]]:
    """Pairs, by their numbers, for which one real multiplier or two are to be tried: those of one sign together first.

    They are `within` so many deviations of the axis. `parameters` has the covariance of the free numbers of all modes,
    and it may have more beyond. Pairs of which none was taken join `refused`.
    """
    spread, place = None, 0
    near: dict[float, list[int]] = {}
    for number, mode in enumerate(modes):
        imag, place = place + int(mode.free.sum()) // 2, place + int(mode.free.sum())
        half = half_of(mode, omega)
        away = abs(mode.exponent.imag - half * omega)
        if mode.real or away > max(abs(mode.exponent.real), NARROWEST * omega):
            continue
        if any(abs(mode.exponent - other) < SAME * abs(other.real) for other in refused):
            continue
        spread = parameters() if spread is None else spread
        if away <= within * spread[imag, imag] ** 0.5:
            near.setdefault(half % 1.0, []).append(number)
    for pairs in near.values():
        yield from [pairs, *([[one] for one in pairs] if len(pairs) > 1 else [])]
        refused += [modes[number].exponent for number in pairs]


def real_for(pairs: Sequence[InputMode], omega: float) -> tuple[list[tuple[float, ...]], NDArray, NDArray]:
    """What may stand for pairs near the axis: exponents of one real multiplier, of two, and their turns and reach."""
    turns, reach = [], []
    for mode in pairs:
        half = half_of(mode, omega)
        turns.append(np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5))
        reach.append(np.arange(half % 1.0, np.abs(mode.reach - half).max() + 0.5))
    decays = [mode.exponent.real for mode in pairs]
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    return [(float(np.mean(decays)),), ends], max(turns, key=len), max(reach, key=len)


def noise_explains(rise: float, fewer: int) -> bool:
    """True where a rise of χ² is what so many numbers less cost by noise alone, or a fall more than more gain by it."""
    return rise < (np.sign(fewer) * chi2_limit(abs(fewer), REAL) if fewer else 0.0)


def _as_real(
    samples: Samples, now: Linearisation, pairs: Sequence[int], limits: Limits, rounds: int
) -> Linearisation | None:
    """The fit with one real multiplier, or two, for some pairs; None where that costs more than noise explains."""
    rest = [own for k, own in enumerate(now.modes) if k not in pairs]
    kinds, turns, reach = real_for([now.modes[number] for number in pairs], samples.fundamental)
    left = linearise(samples, rest, now.direct).left
    for starts in kinds:
        bare = [bare_mode(samples, own, reach, turns, real=True) for own in starts]
        with suppress(np.linalg.LinAlgError):
            _, modes = fitted_together(samples, left, bare)
            found = solve(samples, [*rest, *modes], now.direct, iterations=AS_REAL, rough=True)
            found = grown(samples, found, limits)
            for more in reversed(range(rounds)):
                before, found = found, solve(samples, found.modes, now.direct, iterations=AS_REAL, rough=True)
                if found.n_parameters > now.n_parameters:  # with the harmonics that it needs it may have fewer
                    found = narrowed(samples, found, limits)
                rise, fewer = now.log_likelihood - found.log_likelihood, now.n_parameters - found.n_parameters
                if noise_explains(rise, fewer):
                    return found
                if not noise_explains(rise - more * (found.log_likelihood - before.log_likelihood), fewer):
                    break
    return None
