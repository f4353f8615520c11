"""Bands of harmonics of a fit with inputs: what rises above the noise is added, what noise explains is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from floquid.fit import chi2_limit, wald_rise
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._scores import Limits, Scores, driven_by_noise
from floquid.inputs._solver import Linearisation, columns_of, covariance, solve

ROUGH = 3
"""Steps of a fit that is not the last."""

GROWTHS = 12
"""Rounds in which bands may grow."""

MINOR = 0.05
"""The share of the largest gain of a round below which a harmonic waits for the next."""

STRIDE = 3
"""Harmonics beyond the end of a band that are looked at in a round."""

NARROW = 1e-12
"""The probability at which noise may make up for harmonics that are left out together."""


def grown(samples: Samples, now: Linearisation, limits: Limits, rounds: int = GROWTHS) -> Linearisation:
    """The fit with the harmonics beside its bands whose scores rise above the noise."""
    for _ in range(rounds):
        scores = Scores(samples, now)
        wider = _wider(samples, now, limits, scores)
        direct = _more_direct(samples, now, limits, scores)
        if all(a is b for a, b in zip(wider, now.modes, strict=True)) and direct == now.direct:
            return now
        modes = [centred(samples, mode, now, k) for k, mode in enumerate(wider)]
        trial = solve(samples, modes, direct, iterations=ROUGH, rough=True)
        if trial.criterion - now.criterion < driven_by_noise(scores, limits):
            return now
        now = trial
    return now


def _wider(samples: Samples, now: Linearisation, limits: Limits, scores: Scores) -> list[InputMode]:
    """The modes with the harmonics beyond the ends of their bands that the residual asks for, up to `STRIDE`."""
    seen, reached = [], []
    for number, mode in enumerate(now.modes):
        for band, beyond in ((mode.turns, seen), (mode.reach, reached)):
            ends = [(band[-1], 1.0)] if mode.real else [(band[0], -1.0), (band[-1], 1.0)]
            for end, way in ends:
                more = end + way * np.arange(1.0, STRIDE + 1.0)
                beyond.append((number, more[np.abs(more) <= limits.highest]))
    extra = [
        columns_of(samples, replace(now.modes[number], turns=more[k : k + 1]), now.states[number])
        for number, more in seen
        for k in range(len(more))
    ]
    gains = [scores.by_columns(extra), scores.by_inputs([(number, turn) for number, more in reached for turn in more])]
    sizes = [2 * len(rows) for rows in (samples.values, samples.inputs)]
    most = MINOR * max((float(own.max(initial=0.0)) for own in gains), default=0.0)
    found = list(now.modes)
    for kind, beyond in enumerate((seen, reached)):
        place = 0
        for number, more in beyond:
            own = gains[kind][place : place + len(more)]
            place += len(more)
            least = chi2_limit(sizes[kind] * found[number].states, limits.harmonic_alarm)
            far = np.flatnonzero(own > max(least, most))
            if not len(far):
                continue
            kept, mode = more[: far[-1] + 1], found[number]
            if kind:
                for turn in kept.tolist():
                    mode = with_reach(mode, turn)
            else:
                mode = replace(mode, turns=np.sort(np.append(mode.turns, kept)))
            found[number] = mode
    return found


def with_reach(mode: InputMode, turn: float) -> InputMode:
    """With one more harmonic of the inputs, of no gain yet."""
    place = int(np.searchsorted(mode.reach, turn))
    gains = np.insert(mode.gains, place, 0.0, axis=1)
    return replace(mode, reach=np.insert(mode.reach, place, turn), gains=gains)


def _more_direct(samples: Samples, now: Linearisation, limits: Limits, scores: Scores) -> tuple[float, ...]:
    """Harmonics of the direct term, with the next one where the residual asks for it."""
    turn = float(len(now.direct))
    if turn > limits.highest:
        return now.direct
    both = samples.turned(turn) * samples.inputs
    extra = np.concatenate([both.real, both.imag]) if turn else both.real
    limit = chi2_limit(len(extra) * len(samples.values), limits.harmonic_alarm)
    return (*now.direct, turn) if scores.by_columns([extra])[0] > limit else now.direct


def centred(samples: Samples, mode: InputMode, now: Linearisation, number: int) -> InputMode:
    """A mode on the branch whose zeroth harmonic is seen most; a pair with a frequency that is not negative."""
    if mode.real:
        return mode
    own, shape = now.modes[number], np.abs(now.shape(number)) / now.noise
    energy = np.sum(shape**2, axis=1)
    turn = float(own.turns[int(np.argmax(energy))])
    begins = samples.times[list(samples.begins[:-1])]
    exponent = mode.exponent + 1j * turn * samples.fundamental
    found = replace(
        mode,
        exponent=exponent,
        turns=mode.turns - turn,
        reach=mode.reach + turn,
        initial=mode.initial * np.exp(1j * turn * samples.fundamental * begins),
    )
    if exponent.imag >= 0.0:
        return found
    return replace(
        found,
        exponent=exponent.conjugate(),
        turns=-found.turns[::-1],
        reach=-found.reach[::-1],
        gains=found.gains[:, ::-1].conj(),
        initial=found.initial.conj(),
    )


def narrowed(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without the harmonics at the ends of bands that noise explains."""
    for _ in range(GROWTHS if now.modes else 0):
        found, spread, place = [], covariance(samples, now), 0
        for number, mode in enumerate(now.modes):
            block = slice(place, place + int(mode.free.sum()))
            place = block.stop
            seen, reached = partial(_weight, now, number), partial(_input_weight, mode, spread[block, block])
            outputs, inputs = 2 * mode.states * len(samples.values), 2 * mode.states * len(samples.inputs)
            turns = _kept(len(mode.turns), mode.real, seen, outputs, limits.harmonic_alarm)
            reach = _kept(len(mode.reach), mode.real, reached, inputs, limits.harmonic_alarm)
            if len(mode.turns[turns]) < len(mode.turns) or len(mode.reach[reach]) < len(mode.reach):
                found.append(
                    replace(mode, turns=mode.turns[turns], reach=mode.reach[reach], gains=mode.gains[:, reach])
                )
            else:
                found.append(mode)
        if all(a is b for a, b in zip(found, now.modes, strict=True)):
            return now
        trial = solve(samples, found, now.direct, iterations=ROUGH, rough=True)
        if now.log_likelihood - trial.log_likelihood > chi2_limit(now.n_parameters - trial.n_parameters, NARROW):
            return now
        now = trial
    return now


def _kept(
    count: int, real: bool, weight: Callable[[NDArray[np.int64]], float], degrees: int, probability: float
) -> slice:
    """The part of a band of some harmonics to keep: those beyond, together, are what noise explains.

    `weight` has the squared deviations of some of them from zero, of `degrees` each.
    """
    first, last = 0, count
    while last - first > 1 and weight(np.arange(last - 1, count)) < chi2_limit(
        degrees * (count - last + 1), probability
    ):
        last -= 1
    while (
        not real and last - first > 1 and weight(np.arange(first + 1)) < chi2_limit(degrees * (first + 1), probability)
    ):
        first += 1
    return slice(first, last)


def _weight(now: Linearisation, number: int, which: NDArray[np.int64]) -> float:
    """The distance of the coefficients of some harmonics of a mode from zero, all channels, in squared deviations."""
    columns, turning = now.slices()[number]
    later = len(turning) + np.cumsum(turning) - 1
    index = columns.start + np.concatenate([which, later[which[turning[which]]]])
    if now.modes[number].square is not None:
        index = np.concatenate([index, index + (columns.stop - columns.start) // 2])
    own = now.coefficients[index] / now.noise
    # A direction that another column has, too, is none: the block may be singular.
    return wald_rise(own, now.inverse[np.ix_(index, index)])


def _input_weight(mode: InputMode, spread: NDArray[np.float64], which: NDArray[np.int64]) -> float:
    """The distance of the gains of some harmonics of the inputs from zero, in squared deviations.

    Infinite where one is the scale of the mode.
    """
    free, size, starts = mode.free, mode.gains.size, len(mode.initial)
    at = 1 + (which[:, None] + len(mode.reach) * np.arange(len(mode.gains))).ravel()
    flat, index = mode.gains.ravel()[at - 1], np.concatenate([at, at + size if mode.real else at + 1 + size + starts])
    own = np.concatenate([flat.real, flat.imag])
    if np.isin(mode.held, index).any():
        return np.inf
    own, index = own[free[index]], index[free[index]]
    place = np.cumsum(free)[index] - 1
    return wald_rise(own, spread[np.ix_(place, place)]) if len(own) else np.inf
