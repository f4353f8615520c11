"""Remove modes that noise explains, and merge copies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from floquid._arrays import Integers
from floquid.fit import chi2_limit, scaled_inverse, wald_rise
from floquid.innovations._covariance import stable_gains, white
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted
from floquid.innovations._products import gap_of, merged
from floquid.innovations._solve import inverse_of, moved, places, roughly, solve
from floquid.innovations.search._bands import anchored, grown
from floquid.inputs import Limits, Samples
from floquid.search import NEAR, REACH

GONE = 1.0  # the decay over a period [nepers] from which on a mode is gone within it
FEW = 2  # real multipliers on an axis that stand for more of them: a pair that splits has two


def better(trial: Predictor, now: Predictor, limits: Limits) -> bool:
    """True where noise does not explain what a fit with more gains, by its probability and by the criterion."""
    more = max(trial.n_parameters - now.n_parameters, 1)
    sure = trial.log_likelihood - now.log_likelihood > chi2_limit(more, limits.mode_alarm)
    return sure and trial.criterion > now.criterion


def least(trial: Predictor, now: Predictor, limits: Limits) -> float:
    """Twice the logarithm of the likelihood of a fit with less below which harmonics will not make up for the loss."""
    return now.log_likelihood - REACH * chi2_limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)


def needed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without modes that noise explains once all others are fitted again."""
    less = None if limits.over else spared(samples, now, limits)
    if less is not None:
        less = solve(samples, less, rough=True, least=least(less, now, limits))
        now = _as_good(samples, now, less, limits) or now
    while len(now.modes) > 1:
        less = _one_less(samples, now, limits)
        if less is None:
            return now
        now = less
    return now


def _one_less(samples: Samples, now: Predictor, limits: Limits) -> Predictor | None:
    """The first fit with less that explains as much with the harmonics that it then needs; None where none does."""
    for start in _fewer(samples, now, limits):
        if limits.over:
            break
        trial = solve(samples, start, rough=True, least=least(start, now, limits))
        best = _as_good(samples, now, trial, limits)
        if best is not None:
            return best
    return None


def _as_good(samples: Samples, now: Predictor, trial: Predictor, limits: Limits) -> Predictor | None:
    """A fit with less, with the harmonics that it then needs; None where noise does not explain what it lacks."""
    if trial.log_likelihood < least(trial, now, limits):
        return None
    best = grown(samples, solve(samples, trial, rough=True), limits)
    return best if _explains(samples, best, now, limits) else None


def _explains(samples: Samples, fewer: Predictor, now: Predictor, limits: Limits) -> bool:
    """True where a fit with less explains as much, and leaves innovations white that were."""
    # Beside harmonics that are too many the criterion may do without a mode that the innovations show.
    missing = not white(samples, fewer, limits.mode_alarm) and white(samples, now, limits.mode_alarm)
    return not missing and not better(now, fewer, limits)


def spared(samples: Samples, now: Predictor, limits: Limits) -> Predictor | None:
    """The predictor without all modes that noise explains together, the others moved to where they are best."""
    if len(now.modes) < 2:
        return None
    # Of modes that are nearly one, whose shapes are large and cancel, all go or none.
    inverse = inverse_of(roughly(samples, now), anchored(now))
    own = np.concatenate([mode.parameters for mode in now.modes])
    lost, count, gone, groups = 0.0, 0, [], alike(now.modes, samples.fundamental)
    left = {k: _shape_rows(now, group) for k, group in enumerate(groups)}
    while left:
        weights = {k: wald_rise(own[rows], inverse[np.ix_(rows, rows)]) for k, rows in left.items()}
        lightest = min(weights, key=lambda k: weights[k])
        rows = left.pop(lightest)
        lost, count = lost + weights[lightest], count + len(rows)
        if not lost <= chi2_limit(count, limits.mode_alarm):  # also where the linearisation overflowed
            break
        by = inverse[:, rows] @ scaled_inverse(inverse[np.ix_(rows, rows)])
        own, inverse = own - by[: len(own)] @ own[rows], inverse - by @ inverse[rows]
        gone.append([now.modes[k] for k in groups[lightest]])
    while gone:
        trial = without(samples, now, [mode for group in gone for mode in group], limits)
        if trial is not None:
            return trial
        gone.pop()
    return None


def _shape_rows(now: Predictor, numbers: Sequence[int]) -> Integers:
    """The parameters of the shapes of some modes among all."""
    own = [(places(now.modes)[number].stop, 2 * now.modes[number].shape.size) for number in numbers]
    return np.concatenate([np.arange(stop - count, stop) for stop, count in own])


def without(samples: Samples, now: Predictor, gone: Sequence[Mode], limits: Limits) -> Predictor | None:
    """The predictor without some modes, the others moved to where they are best; None unless noise explains those."""
    if not 0 < len(gone) < len(now.modes):
        return None
    normal = roughly(samples, now)
    inverse = inverse_of(normal, anchored(now))
    rows = _shape_rows(now, [number for number, mode in enumerate(now.modes) if mode in gone])
    values, among = np.concatenate([mode.parameters for mode in now.modes])[rows], inverse[np.ix_(rows, rows)]
    ends = (values, values + inverse[rows] @ normal.gradient)
    if max(wald_rise(each, among) for each in ends) > chi2_limit(len(rows), limits.mode_alarm):
        return None
    step = -inverse[:, rows] @ scaled_inverse(among) @ values
    start = moved(samples, now, step, 2.0 * np.pi / samples.fundamental) or now
    rest = [mode for mode, before in zip(start.modes, now.modes, strict=True) if before not in gone]
    return stable(samples, start, rest, limits)


def _fewer(samples: Samples, now: Predictor, limits: Limits) -> Iterator[Predictor]:
    """Starts with a mode less: fewer for some that are alike, then without one that is not needed to first order."""
    # Of modes that are nearly one the linearisation does not hold: shapes are large and cancel. Nor does it where one
    # of several real multipliers on an axis makes up for what others lack.
    inverse = inverse_of(roughly(samples, now), anchored(now))
    starts: list[tuple[float, list[Mode]]] = []
    axes = [mode.axis for mode in now.modes if mode.real]
    for group in alike(now.modes, samples.fundamental):
        rest = [mode for k, mode in enumerate(now.modes) if k not in group]
        if len(group) > 1:
            # They would leave one by one, and each fit of some that are nearly one is long.
            own = [now.modes[k] for k in group]
            real = any(mode.real for mode in own)
            most = (sum(mode.rows for mode in own) if real else len(own)) - 1
            counts = sorted({min(FEW if real else 1, most), most})
            starts += [(0.0, [*rest, *merged(samples, now, own, count)]) for count in counts]
            continue
        mode, place = now.modes[group[0]], places(now.modes)[group[0]]
        count = 2 * mode.shape.size
        weight = wald_rise(mode.parameters[-count:], inverse[place, place][-count:, -count:])
        doubt = weight / chi2_limit(count, limits.mode_alarm)
        if doubt <= REACH or (mode.real and axes.count(mode.axis) > FEW):
            starts.append((doubt, rest))
    for _, modes in sorted(starts, key=lambda own: own[0]):
        trial = stable(samples, now, modes, limits)
        if trial is not None:
            yield trial


def stable(samples: Samples, now: Predictor, modes: Sequence[Mode], limits: Limits) -> Predictor | None:
    """The predictor of other modes than those of now, from rest; with the gains of Riccati's equation if it grows."""
    rest = np.zeros((len(samples.records), sum(mode.rows for mode in modes)))
    found = predicted(samples, modes, now.columns, rest, now.whitening)
    if found is None:
        covariance = now.level @ now.level.T / samples.count
        modes = stable_gains(samples, modes, covariance, limits.highest)
        found = predicted(samples, modes, now.columns, rest, now.whitening)
    return found


def alike(modes: Sequence[Mode], omega: float, near: float = NEAR) -> list[list[int]]:
    """Groups of modes that may be one: so near over their decay, modulo iω; real multipliers beside pairs, too."""
    # Real multipliers of both signs are never one.
    groups: list[list[int]] = []
    for number, mode in enumerate(modes):
        for group in groups:
            axes = {own.axis for own in (mode, *(modes[other] for other in group)) if own.real}
            if len(axes) < 2 and any(_are_near(modes[other], mode, omega, near) for other in group):
                group.append(number)
                break
        else:
            groups.append([number])
    return groups


def _are_near(first: Mode, second: Mode, omega: float, near: float) -> bool:
    return gap_of(first, second, omega)[0] < near * min(abs(first.exponent.real), abs(second.exponent.real))
