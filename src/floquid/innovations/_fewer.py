"""Modes that noise explains, or of which one does for several, left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._bands import anchored, grown
from floquid.innovations._gain import stable_gains
from floquid.innovations._mode import Mode, as_complex
from floquid.innovations._predictor import Predictor, predicted
from floquid.innovations._solve import normal_of, places, solve, squares
from floquid.inputs import Limits, Samples, limit_of

DOUBTFUL = 5.0
"""The squared deviations of a mode's shape over the limit, from which on no fit without it is tried."""

HOPELESS = 5.0
"""The loss by a mode less, over the limit, from which on no harmonics of others are grown to make it up."""

GONE = 1.0
"""The decay over a period [nepers] from which on a mode is gone within it."""

ALIKE = 0.5
"""The distance of two modes over their decay below which they may be one."""


def better(trial: Predictor, now: Predictor, limits: Limits) -> bool:
    """True where noise does not explain what a fit with more gains, by its probability and by the criterion."""
    more = max(trial.n_parameters - now.n_parameters, 1)
    sure = trial.log_likelihood - now.log_likelihood > limit_of(more, limits.mode_alarm)
    return sure and trial.criterion < now.criterion


def hopeless(trial: Predictor, now: Predictor, limits: Limits) -> bool:
    """True where a fit with less loses more than harmonics would make up for."""
    limit = limit_of(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
    return now.log_likelihood - trial.log_likelihood > HOPELESS * limit


def needed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without modes that noise explains once all others are fitted again."""
    while len(now.modes) > 1:
        trials = [solve(samples, trial, rough=True) for trial in _fewer(samples, now, limits)]
        for trial in sorted(trials, key=lambda own: -own.log_likelihood):
            if hopeless(trial, now, limits):
                return now
            best = grown(samples, solve(samples, trial, rough=True), limits)
            if not better(now, best, limits):
                now = best
                break
        else:
            return now
    return now


def _fewer(samples: Samples, now: Predictor, limits: Limits) -> Iterator[Predictor]:
    """Starts with a mode less: without one that the linearisation does not need, or fewer for some that are alike.

    Of modes that are nearly one the linearisation does not hold: shapes are large and cancel.
    """
    inverse = normal_of(samples, now, rough=True).inverse(anchored(now))
    groups = alike(now.modes, samples.fundamental)
    for group in groups:
        rest = [mode for k, mode in enumerate(now.modes) if k not in group]
        trial = None
        if len(group) > 1:
            trial = stable(samples, now, [*rest, *_merged(samples, now, group)], limits)
        else:
            mode, place = now.modes[group[0]], places(now.modes)[group[0]]
            count = 2 * mode.shape.size
            weight = squares(mode.parameters[-count:], inverse[place, place][-count:, -count:])
            if weight <= DOUBTFUL * limit_of(count, limits.mode_alarm):
                trial = stable(samples, now, rest, limits)
        if trial is not None:
            yield trial


def stable(samples: Samples, now: Predictor, modes: Sequence[Mode], limits: Limits) -> Predictor | None:
    """The predictor of other modes than those of now, from rest; with the gains of Riccati's equation if it grows."""
    rest = np.zeros((len(samples.records), sum(mode.rows for mode in modes)))
    found = predicted(samples, modes, now.columns, rest, now.whitening)
    if found is None:
        covariance = now.innovations @ now.innovations.T / samples.n_samples
        modes = stable_gains(samples, modes, covariance, limits.highest)
        found = predicted(samples, modes, now.columns, rest, now.whitening)
    return found


def alike(modes: Sequence[Mode], omega: float, near: float = ALIKE) -> list[list[int]]:
    """Groups of modes that may be one: of a kind, so near over their decay but for iω."""
    groups: list[list[int]] = []
    for number, mode in enumerate(modes):
        for group in groups:
            if any(_gap(modes[other], mode, omega)[0] < near for other in group):
                group.append(number)
                break
        else:
            groups.append([number])
    return groups


def _gap(first: Mode, second: Mode, omega: float) -> tuple[float, float, bool]:
    """The distance of two modes over their decay, and by which turns, of the conjugate or not, the second is there."""
    if first.real != second.real or (first.real and first.turns[0] % 1.0 != second.turns[0] % 1.0):
        return np.inf, 0.0, False
    found = []
    for other, exponent in enumerate((second.exponent, second.exponent.conjugate())):
        turn = round((first.exponent - exponent).imag / omega)
        gap = abs(first.exponent - exponent - 1j * turn * omega)
        found.append((gap / min(abs(first.exponent.real), abs(exponent.real)), float(turn), bool(other)))
    return min(found)


def _merged(samples: Samples, now: Predictor, group: Sequence[int]) -> list[Mode]:
    """One mode less than a group has, of the same products of shape and gains as far as so many can have them."""
    first, omega, noise = now.modes[group[0]], samples.fundamental, now.noise
    modes = []
    for number in group:
        mode = now.modes[number]
        _, turn, other = _gap(first, mode, omega)
        modes.append((mode.conjugate() if other else mode).turned(turn, omega, samples.step))
    turns, reach = (
        np.arange(min(own[0] for own in bands), max(own[-1] for own in bands) + 0.5)
        for bands in ([mode.turns for mode in modes], [mode.reach for mode in modes])
    )
    modes = [mode.widened(turns, reach) for mode in modes]
    drives = np.concatenate([np.sqrt(np.mean(samples.inputs**2, axis=1))[:, None], noise])
    seen = np.array([_flat(mode.shape / noise, first.real) for mode in modes])
    reached = np.array([_flat(mode.gains * drives, first.real) for mode in modes])
    left, values, right = np.linalg.svd(seen.T @ reached, full_matrices=False)
    exponent = complex(np.mean([mode.exponent for mode in modes]))
    return [
        Mode(
            exponent=exponent,
            real=first.real,
            turns=turns,
            shape=_unflat(values[k] * left[:, k], first.real).reshape(modes[0].shape.shape) * noise,
            reach=reach,
            gains=_unflat(right[k], first.real).reshape(modes[0].gains.shape) / drives,
        ).scaled()
        for k in range(len(group) - 1)
    ]


def _flat(values: NDArray[np.complex128], real: bool) -> NDArray:
    """Numbers of a product: of a real multiplier real and imaginary parts count by themselves."""
    flat = values.ravel()
    return np.concatenate([flat.real, flat.imag]) if real else flat


def _unflat(values: NDArray, real: bool) -> NDArray[np.complex128]:
    return as_complex(values) if real else values
