"""Pairs on the axis of real multipliers, taken for such."""

from __future__ import annotations

import os

import numpy as np

from floquid.innovations._bands import grown, narrowed
from floquid.innovations._fewer import least, stable
from floquid.innovations._near_axis import half_of, near_axis
from floquid.innovations._predictor import Predictor
from floquid.innovations._products import as_real
from floquid.innovations._solve import inverse_of, normal_of, places, solve
from floquid.inputs import Limits, Samples

COUNTS = tuple(map(int, os.environ.get("COUNTS", "1").split(",")))


def with_real_ones(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """With pairs near an axis taken for one real multiplier, or for two, where the criterion prefers these."""
    spread, omega = np.diag(inverse_of(normal_of(samples, now, rough=True))), samples.fundamental
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        if limits.over or not near_axis(mode, spread[place], omega):
            continue
        rest, half = [own for k, own in enumerate(now.modes) if k != number], half_of(mode, omega)
        for count in COUNTS:
            # A real multiplier needs harmonics that the pair did without.
            some = [own.padded(1.0, limits.highest) for own in as_real(samples, now, [mode], half, count)]
            trial = stable(samples, now, [*rest, *some], limits)
            if trial is None:
                continue
            enough = least(trial, now, limits)
            trial = solve(samples, trial, rough=True, least=enough if count == 1 else -np.inf)
            if count == 2 or trial.log_likelihood >= enough:
                trial = narrowed(samples, grown(samples, trial, limits), limits)
            if trial.criterion > now.criterion:
                return with_real_ones(samples, trial, limits)
    return now
