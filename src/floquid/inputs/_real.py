"""Real multipliers of a fit with inputs, for which a pair of conjugates, or two, may stand."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from floquid.inputs._bands import Limits, grown, limit_of
from floquid.inputs._joint import fitted_together
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._start import bare_mode

AS_REAL = 8
"""Steps of a fit with real multipliers for pairs."""

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

SAME = 0.05
"""The distance of two exponents over their decay below which they are one."""

REAL = 1e-3
"""The probability at which noise may move a real multiplier off the axis."""


def with_real_ones(
    samples: Samples, now: Linearisation, limits: Limits, refused: list[complex] | None = None
) -> Linearisation:
    """With pairs whose multipliers may be one or two real ones taken for that, where noise explains the rest."""
    refused = [] if refused is None else refused
    omega, spread, place = samples.fundamental, None, 0
    near: dict[float, list[int]] = {}
    for number, mode in enumerate(now.modes):
        imag = place + int(mode.free[: len(mode.free) // 2].sum())
        place += int(mode.free.sum())
        half = 0.5 * round(2.0 * mode.exponent.imag / omega)
        away = abs(mode.exponent.imag - half * omega)
        if mode.real or away > abs(mode.exponent.real):
            continue
        if any(abs(mode.exponent - other) < SAME * abs(other.real) for other in refused):
            continue
        spread = covariance(samples, now) if spread is None else spread
        if away <= OFF_AXIS * spread[imag, imag] ** 0.5:
            near.setdefault(half % 1.0, []).append(number)
    for pairs in near.values():
        for some in [pairs, *([[one] for one in pairs] if len(pairs) > 1 else [])]:
            best = _as_real(samples, now, some, limits)
            if best is not None:
                return with_real_ones(samples, best, limits, refused)
        refused += [now.modes[number].exponent for number in pairs]
    return now


def _as_real(samples: Samples, now: Linearisation, pairs: Sequence[int], limits: Limits) -> Linearisation | None:
    """The fit with one real multiplier, or two, for some pairs; None where that costs more than noise explains."""
    rest = [own for k, own in enumerate(now.modes) if k not in pairs]
    turns, reach, decays = [], [], []
    for mode in (now.modes[number] for number in pairs):
        half = 0.5 * round(2.0 * mode.exponent.imag / samples.fundamental)
        turns.append(np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5))
        reach.append(np.arange(half % 1.0, np.abs(mode.reach - half).max() + 0.5))
        decays.append(mode.exponent.real)
    left = linearise(samples, rest, now.direct).left
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    for starts in ((float(np.mean(decays)),), ends):
        bare = [bare_mode(samples, own, max(reach, key=len), max(turns, key=len), real=True) for own in starts]
        with suppress(np.linalg.LinAlgError):
            _, modes = fitted_together(samples, left, bare)
            found = solve(samples, [*rest, *modes], now.direct, iterations=AS_REAL, rough=True)
            found = solve(samples, grown(samples, found, limits).modes, now.direct, iterations=AS_REAL, rough=True)
            fewer = now.n_parameters - found.n_parameters
            rise = now.log_likelihood - found.log_likelihood
            if rise < (limit_of(fewer, REAL) if fewer > 0 else 0.0):
                return found
    return None
