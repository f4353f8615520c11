"""Pairs on the axis of real multipliers, taken for such."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid.fit import DEVIATIONS
from floquid.innovations._bands import grown, narrowed
from floquid.innovations._fewer import GONE, least, stable
from floquid.innovations._predictor import Predictor
from floquid.innovations._products import as_real, gap_of
from floquid.innovations._solve import inverse_of, normal_of, places, solve
from floquid.inputs import Limits, Samples

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NEAR = 0.05
"""The distance from the axis over the decay up to which it is tried whatever its deviation."""

SAME = 2.0
"""Deviations within which exponents of both kinds are the same."""

KIND = 25.0
"""Twice the difference in the logarithm of the likelihood below which a record does not tell the kind."""


def with_real_ones(
    samples: Samples, now: Predictor, limits: Limits, before: Sequence[float] = ()
) -> tuple[Predictor, list[float]]:
    """With pairs near the axis of real multipliers taken for one such, or for two, by the criterion.

    With them, where the record leaves undecided whether a mode is one of two real multipliers or the pair, how far
    lasting modes move, in deviations, where it is fitted as the other kind: infinite where none lasts, zero where the
    kind is known (modes,). Where both kinds have the same exponents within their deviations it does not matter.
    """
    undecided = list(before) or [0.0] * len(now.modes)
    normal, omega = normal_of(samples, now, rough=True), samples.fundamental
    spread = np.sqrt(np.maximum(np.diag(inverse_of(normal)), 0.0))
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        rest, turns = [own for k, own in enumerate(now.modes) if k != number], mode.exponent.imag / omega
        for half, count in product((0.5 * np.floor(2.0 * turns), 0.5 * np.ceil(2.0 * turns)), (1, 2)):
            away, std = abs(turns - half) * omega, spread[place.start + 1]
            decay = abs(mode.exponent.real)
            far = max(NEAR * decay, OFF_AXIS * std)
            # Two that decay are never farther from their mean than it decays; inputs in a loop hold others, too.
            if mode.real or limits.over or away > (far if len(samples.inputs) else min(far, decay)):
                continue
            # A real multiplier needs harmonics that the pair did without.
            some = [own.padded(1.0, limits.highest) for own in as_real(samples, now, [mode], half, count)]
            trial = stable(samples, now, [*rest, *some], limits)
            better, gained, moves = False, -np.inf, np.inf
            if trial is not None:
                enough = least(trial, now, limits)
                trial = solve(samples, trial, rough=True, least=enough if count == 1 else -np.inf)
                moves = _moves(now, trial, number, spread, omega)
                if count == 2 or trial.log_likelihood >= enough:
                    trial = narrowed(samples, grown(samples, trial, limits), limits)
                better, gained = trial.criterion > now.criterion, trial.log_likelihood - now.log_likelihood
            near, decays = away < DEVIATIONS * std, [own.exponent.real for own in trial.modes[-2:]] if trial else []
            alike = [abs(own - mode.exponent.real) < SAME * spread[place.start] for own in decays]
            same = bool(decays) and all(alike) and away < SAME * std
            told = gained > KIND if better else gained < -KIND and not near
            if count == 2 and not told and not same:
                undecided[number] = max(undecided[number], moves)
            if trial is not None and better:
                others = [own for k, own in enumerate(undecided) if k != number]
                return with_real_ones(samples, trial, limits, [*others, *[undecided[number]] * count])
    return now, undecided


def _moves(now: Predictor, trial: Predictor, number: int, spread: NDArray[np.float64], omega: float) -> float:
    """The most that modes that outlast a period move where one is of another kind, over their deviations."""
    rest = [(mode, spread[place.start]) for mode, place in zip(now.modes, places(now.modes), strict=True)]
    del rest[number]
    steps = [
        gap_of(mode, other, omega)[0] / max(std, 1e-300)
        for (mode, std), other in zip(rest, trial.modes, strict=False)
        if -2.0 * np.pi / omega * mode.exponent.real < GONE
    ]
    return float(max(steps, default=np.inf))
