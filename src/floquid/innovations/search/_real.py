"""One real multiplier for a pair near an axis."""

from __future__ import annotations

import numpy as np

from floquid.fit import half_of, near_axis
from floquid.innovations._predictor import Predictor
from floquid.innovations._products import as_real
from floquid.innovations._solve import inverse_of, normal_of, places, solve
from floquid.innovations.search._bands import anchored, grown, narrowed
from floquid.innovations.search._fewer import least, stable
from floquid.inputs import Limits, Samples


def with_real_ones(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """With one real multiplier for each pair near an axis where the criterion prefers that: a state less."""
    spread = np.diag(inverse_of(normal_of(samples, now), anchored(now)))
    omega = samples.fundamental
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        std = float(max(spread[place.start + mode.rows - 1], 0.0) ** 0.5)
        if limits.over or not near_axis(mode, omega, std):
            continue
        rest = [other for k, other in enumerate(now.modes) if k != number]
        # A real multiplier needs harmonics that the pair did without.
        real = [one.padded(1.0, limits.highest) for one in as_real(samples, now, [mode], half_of(mode, omega), 1)]
        trial = stable(samples, now, [*rest, *real], limits)
        if trial is None:
            continue
        enough = least(trial, now, limits)
        trial = solve(samples, trial, rough=True, least=enough)
        if trial.log_likelihood >= enough:
            trial = narrowed(samples, grown(samples, trial, limits), limits)
        if trial.criterion > now.criterion:
            return with_real_ones(samples, trial, limits)
    return now
