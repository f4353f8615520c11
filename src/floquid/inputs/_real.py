"""Real multipliers of a fit with inputs, for which a pair of conjugates, or two, may stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from floquid.fit import chi2_limit
from floquid.inputs._bands import grown, narrowed
from floquid.inputs._joint import fitted_together
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._start import bare_mode
from floquid.inputs._structure import Limits

AS_REAL = 8
"""Steps of a fit with real multipliers for pairs."""

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NARROWEST = 1e-3
"""The distance off the axis, over the fundamental, within which one is tried however little it decays."""

OFF = (0.1, 0.5, 1.0)
"""Distances off the axis, in decays, at which a pair is tried for two real multipliers."""

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


def with_pairs(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """With a pair of conjugates for two real multipliers of one sign, where it explains more than they do."""
    real = [number for number, mode in enumerate(now.modes) if mode.real]
    for numbers in combinations(real, 2):
        one, other = (now.modes[number] for number in numbers)
        if one.lowest != other.lowest:
            continue
        rest = [own for k, own in enumerate(now.modes) if k not in numbers]
        with suppress(np.linalg.LinAlgError):
            left = linearise(samples, rest, now.direct).left
            trials = [fitted_together(samples, left, [_pair_for(samples, one, other, share)]) for share in OFF]
            _, modes = max(trials, key=lambda trial: trial[0])
            found = solve(samples, [*rest, *modes], now.direct, iterations=AS_REAL, rough=True)
            found = narrowed(samples, grown(samples, found, limits), limits)
            if found.criterion > now.criterion:
                return with_pairs(samples, found, limits)
    return now


def _pair_for(samples: Samples, one: InputMode, other: InputMode, share: float) -> InputMode:
    """The pair at the mean decay of two real multipliers, so many decays off the axis, with harmonics as wide."""
    half, decay = one.lowest, 0.5 * (one.exponent.real + other.exponent.real)
    exponent = complex(decay, half * samples.fundamental + share * abs(decay))
    turns, reach = (max(getattr(mode, name)[-1] for mode in (one, other)) for name in ("turns", "reach"))
    return bare_mode(
        samples,
        exponent,
        np.arange(half - reach, half + reach + 0.5),
        np.arange(-half - turns, turns - half + 0.5),
    )


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
        half = _half(mode, omega)
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
        half = _half(mode, omega)
        turns.append(np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5))
        reach.append(np.arange(half % 1.0, np.abs(mode.reach - half).max() + 0.5))
    decays = [mode.exponent.real for mode in pairs]
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    return [(float(np.mean(decays)),), ends], max(turns, key=len), max(reach, key=len)


def noise_explains(rise: float, fewer: int) -> bool:
    """True where a rise of χ² is what so many numbers less cost by noise alone, or a fall more than more gain by it."""
    return rise < (np.sign(fewer) * chi2_limit(abs(fewer), REAL) if fewer else 0.0)


def _half(mode: InputMode, omega: float) -> float:
    """The multiple of half the fundamental that a mode is nearest to, in fundamentals."""
    return 0.5 * round(2.0 * mode.exponent.imag / omega)


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
