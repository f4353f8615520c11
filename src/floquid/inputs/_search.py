"""Search for modes with inputs: candidates of the residual one after another, bands by scores, and what noise does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._modes import InputMode, reached_by
from floquid.inputs._samples import Samples
from floquid.inputs._solver import (
    Linearisation,
    carried,
    columns_of,
    covariance,
    linearise,
    slopes_of,
    solve,
    state_slopes,
)
from floquid.inputs._start import candidates, relaxed

TRIED = 4
"""Candidates that are fitted beside the modes before the search ends."""

START = (1, 2)
"""Harmonics of input and output on either side that a candidate has."""

GROWTHS = 8
"""Rounds in which bands may grow."""

LOOSE = 0.02
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""

REAL = 1e-3
"""The probability at which noise may move a real multiplier off the axis."""

NUDGE = 1e-6
"""The relative change of ω by which the response's slope is taken."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a search.

    Parameters
    ----------
    mode_alarm, harmonic_alarm
        The probabilities that noise passes for a mode, and for a harmonic.
    highest
        The highest harmonic of input and output.
    modes
        Modes that may be found, at most.
    """

    mode_alarm: float = 1e-9
    harmonic_alarm: float = 1e-6
    highest: int = 12
    modes: int = 20


def searched(samples: Samples, limits: Limits, report: Callable[[str], None] = lambda _: None) -> Linearisation:
    """The modes that rise above the noise, with the harmonics by which inputs reach them and outputs see them."""
    now = grown(samples, solve(samples, ()), limits)
    while len(now.modes) < limits.modes:
        more = _with_one_more(samples, now, limits)
        if more is None:
            break
        now = with_real_ones(samples, more, limits)
        report(f"searching for modes: {len(now.modes)} found")
    if not now.modes:
        return now
    now = with_real_ones(samples, without_needless(samples, now, limits), limits)
    loose = replace(limits, harmonic_alarm=LOOSE)
    now = narrowed(samples, grown(samples, now, loose, rounds=2), loose)
    return solve(samples, [_padded(mode, limits) for mode in now.modes], now.direct)


def _limit(degrees: int, probability: float) -> float:
    """What noise exceeds in χ² of some degrees of freedom with a probability."""
    from scipy.special import chdtri

    return float(chdtri(degrees, probability))


def _padded(mode: InputMode, limits: Limits) -> InputMode:
    """A mode with one harmonic more at each end of its bands: what is left out has no deviation."""
    ends = mode.turns[-1:] + 1.0 if mode.real else np.array([mode.turns[0] - 1.0, mode.turns[-1] + 1.0])
    turns = np.sort(np.concatenate([mode.turns, ends[np.abs(ends) <= limits.highest]]))
    for turn in mode.reach[-1:] + 1.0 if mode.real else np.array([mode.reach[0] - 1.0, mode.reach[-1] + 1.0]):
        if abs(turn) <= limits.highest:
            mode = _with_reach(mode, float(turn))
    return replace(mode, turns=turns)


def _with_one_more(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation | None:
    """The fit with the candidate that explains most of the residual; None where noise does."""
    ranked = []
    for exponent in candidates(samples, now.left).tolist():
        reach, turns = (np.arange(-most, most + 1.0) for most in START)
        with suppress(np.linalg.LinAlgError):
            ranked.append(relaxed(samples, now.left, exponent, reach, turns))
    ranked.sort(key=lambda one: -one[0])
    tried: list[complex] = []
    for _, mode in ranked:
        if any(abs(mode.exponent - other) < 0.5 * abs(other.real) for other in tried):
            continue
        tried.append(mode.exponent)
        with suppress(np.linalg.LinAlgError):
            trial = grown(samples, solve(samples, (*now.modes, mode), now.direct), limits)
            more = trial.n_parameters - now.n_parameters
            gained = trial.log_likelihood - now.log_likelihood
            if gained > _limit(max(more, 1), limits.mode_alarm):
                return trial
        if len(tried) == TRIED:
            break
    return None


def grown(samples: Samples, now: Linearisation, limits: Limits, rounds: int = GROWTHS) -> Linearisation:
    """The fit with the harmonics beside its bands whose scores rise above the noise."""
    for _ in range(rounds):
        scores = _Scores(samples, now)
        wider = [_wider(samples, now, number, limits, scores) for number in range(len(now.modes))]
        direct = _more_direct(samples, now, limits, scores)
        if all(a is b for a, b in zip(wider, now.modes, strict=True)) and direct == now.direct:
            return now
        now = solve(samples, [centred(samples, mode, now, k) for k, mode in enumerate(wider)], direct)
    return now


def _wider(samples: Samples, now: Linearisation, number: int, limits: Limits, scores: _Scores) -> InputMode:
    """A mode with one harmonic more at each end of its bands where the residual asks for it."""
    mode, state = now.modes[number], now.states[number]
    turns, wide, channels = mode.turns, mode, len(samples.values)
    for end, way in [(turns[-1], 1.0)] if mode.real else [(turns[0], -1.0), (turns[-1], 1.0)]:
        for count in (1, 2):
            more = end + way * np.arange(1.0, count + 1.0)
            if np.abs(more).max() > limits.highest:
                break
            extra = columns_of(samples, replace(mode, turns=more), state)
            if scores.of_columns(extra) > _limit(2 * channels * count, limits.harmonic_alarm):
                turns = np.sort(np.append(turns, more))
                break
    for turn in [mode.reach[-1] + 1.0] if mode.real else [mode.reach[0] - 1.0, mode.reach[-1] + 1.0]:
        if abs(turn) <= limits.highest:
            more = _with_reach(mode, turn)
            if scores.of_input(samples, number, more, turn) > _limit(2 * len(samples.inputs), limits.harmonic_alarm):
                wide = _with_reach(wide, turn)
    return wide if len(turns) == len(mode.turns) else replace(wide, turns=turns)


def _with_reach(mode: InputMode, turn: float) -> InputMode:
    """With one more harmonic of the inputs, of no gain yet."""
    place = int(np.searchsorted(mode.reach, turn))
    gains = np.insert(mode.gains, place, 0.0, axis=1)
    return replace(mode, reach=np.insert(mode.reach, place, turn), gains=gains)


class _Scores:
    """Gains of the fit by columns or parameters more, all that there are moving along, to first order."""

    def __init__(self, samples: Samples, now: Linearisation) -> None:
        self.now = now
        states = state_slopes(samples, now)
        self.slopes = [slopes_of(samples, now, c, states) for c in range(len(samples.values))] if now.modes else []
        self.along = [own @ now.columns.T @ now.inverse for own in self.slopes]
        self.matrix = sum(
            ((own @ own.T - along @ (now.columns @ own.T)) / now.noise[c] ** 2)
            for c, (own, along) in enumerate(zip(self.slopes, self.along, strict=True))
        )

    def of_columns(self, extra: NDArray[np.float64]) -> float:
        """The gain by linear columns in every channel (columns, samples)."""
        now = self.now
        beyond = extra - (extra @ now.columns.T) @ now.inverse @ now.columns
        inverse, seen = _inverse(beyond @ beyond.T), beyond @ now.left.T
        gain = float(np.sum((seen * (inverse @ seen)) / now.noise**2))
        if not self.slopes:
            return gain
        matrix, pull = np.array(self.matrix), np.zeros(len(self.slopes[0]))
        for channel, own in enumerate(self.slopes):
            mixed, weight = own @ beyond.T, 1.0 / now.noise[channel] ** 2
            matrix -= weight * mixed @ inverse @ mixed.T
            pull -= weight * mixed @ inverse @ seen[:, channel]
        return gain + float(pull @ _inverse(matrix) @ pull)

    def of_input(self, samples: Samples, number: int, wide: InputMode, turn: float) -> float:
        """The gain by the inputs at one harmonic more that a mode does not have yet."""
        now = self.now
        alone = replace(wide, reach=np.array([turn]), gains=np.ones((len(wide.gains), 1), complex))
        chosen = reached_by(samples, alone)[: (2 if wide.real else 1) * len(wide.gains)]
        shape, turns = now.shape(number), now.modes[number].turns.tolist()
        matrix, gradient, mixed = 0.0, 0.0, 0.0
        for channel, (own, along) in enumerate(zip(self.slopes, self.along, strict=True)):
            moved = carried(samples, shape[:, channel], turns) * chosen
            rows = moved.real if wide.real else np.concatenate([moved.real, -moved.imag])
            seen, weight = rows @ now.columns.T, 1.0 / now.noise[channel] ** 2
            matrix = matrix + weight * (rows @ rows.T - seen @ now.inverse @ seen.T)
            mixed = mixed + weight * (rows @ own.T - seen @ along.T)
            gradient = gradient + weight * (rows @ now.left[channel])
        left = np.asarray(matrix - mixed @ _inverse(np.asarray(self.matrix)) @ np.transpose(mixed))
        return float(np.asarray(gradient) @ _inverse(left) @ np.asarray(gradient))

    def step_along(self, slopes: NDArray[np.float64]) -> tuple[float, float]:
        """The step of one parameter with these slopes (channels, samples), all others moving along, and its deviation.

        Infinite where nothing is known of it.
        """
        now, own, pull, mixed = self.now, 0.0, 0.0, np.zeros(len(self.slopes[0]))
        for channel, (slope, others) in enumerate(zip(slopes, self.slopes, strict=True)):
            beyond, weight = slope - (now.columns @ slope) @ now.inverse @ now.columns, 1.0 / now.noise[channel] ** 2
            own += weight * float(beyond @ slope)
            pull += weight * float(beyond @ now.left[channel])
            mixed += weight * (others @ beyond)
        information = own - float(mixed @ _inverse(np.asarray(self.matrix)) @ mixed)
        if not information > 1e-9 * own:
            return 0.0, float(np.inf)
        return pull / information, information**-0.5


def period_step(samples: Samples, now: Linearisation) -> tuple[float, float]:
    """(Own period - period given)/period given, as the response has it, to first order, and its deviation."""
    ends = []
    for sign in (1.0, -1.0):
        moved = replace(samples, fundamental=samples.fundamental * (1.0 + sign * NUDGE))
        ends.append(now.coefficients.T @ linearise(moved, now.modes, now.direct).columns)
    step, std = _Scores(samples, now).step_along((ends[0] - ends[1]) / (2.0 * NUDGE))
    return -step, std


def _inverse(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a matrix of products, but for directions that are rounding."""
    own = np.diag(matrix)
    size = np.sqrt(np.maximum(own, 1e-12 * own.max(initial=0.0) + 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    good = values > 1e-9 * max(values[-1], 1e-300)
    return (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)


def _more_direct(samples: Samples, now: Linearisation, limits: Limits, scores: _Scores) -> tuple[float, ...]:
    """Harmonics of the direct term, with the next one where the residual asks for it."""
    turn = float(len(now.direct))
    if turn > limits.highest:
        return now.direct
    both = samples.turned(turn) * samples.inputs
    extra = np.concatenate([both.real, both.imag]) if turn else both.real
    limit = _limit(len(extra) * len(samples.values), limits.harmonic_alarm)
    return (*now.direct, turn) if scores.of_columns(extra) > limit else now.direct


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


def without_needless(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without modes that noise explains once all others are fitted again with the harmonics that they then need."""
    refused: set[complex] = set()
    while len(now.modes) > 1:
        rises = []
        for number, mode in enumerate(now.modes):
            if mode.exponent not in refused:
                less = [own for k, own in enumerate(now.modes) if k != number]
                trial = solve(samples, less, now.direct, iterations=4)
                rises.append((now.log_likelihood - trial.log_likelihood, number, trial))
        if not rises:
            return now
        _, number, trial = min(rises, key=lambda one: one[:2])
        trial = grown(samples, solve(samples, trial.modes, trial.direct), limits)
        limit = _limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
        if now.log_likelihood - trial.log_likelihood > limit:
            refused.add(now.modes[number].exponent)
        else:
            now = trial
    return now


def narrowed(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without the harmonics at the ends of bands that noise explains."""
    for _ in range(GROWTHS):
        found, changed = [], False
        spread = covariance(samples, now)
        place = 0
        for number, mode in enumerate(now.modes):
            own, free = mode, mode.free
            size = int(free.sum())
            block = slice(place, place + size)
            place += size
            columns, turning = now.slices()[number]
            for end in (-1,) if mode.real else (0, -1):
                if len(own.turns) > 1 and _weight(now, columns, turning, end) < _limit(
                    2 * len(samples.values), limits.harmonic_alarm
                ):
                    own, changed = replace(own, turns=own.turns[1:] if end == 0 else own.turns[:-1]), True
            for end in (-1,) if mode.real else (0, -1):
                if len(own.reach) > 1 and _input_weight(mode, free, spread[block, block], end) < _limit(
                    2 * len(samples.inputs), limits.harmonic_alarm
                ):
                    kept = slice(1, None) if end == 0 else slice(None, -1)
                    own, changed = replace(own, reach=own.reach[kept], gains=own.gains[:, kept]), True
            found.append(own)
        if not changed:
            return now
        now = solve(samples, found, now.direct)
    return now


def _weight(now: Linearisation, columns: slice, turning: NDArray[np.bool_], end: int) -> float:
    """How far the coefficients of an outermost harmonic are from zero, all channels, in squared deviations."""
    which = len(turning) - 1 if end else 0
    index = [columns.start + which]
    if turning[which]:
        index.append(columns.start + len(turning) + int(turning[: which + 1].sum()) - 1)
    inverse = np.linalg.inv(now.inverse[np.ix_(index, index)])
    own = now.coefficients[index] / now.noise
    return float(np.einsum("kc,kl,lc->", own, inverse, own))


def _input_weight(mode: InputMode, free: NDArray[np.bool_], spread: NDArray[np.float64], end: int) -> float:
    """How far the gains of an outermost harmonic of the inputs are from zero, in squared deviations."""
    size, starts, count = mode.gains.size, len(mode.initial), len(mode.reach)
    which = count - 1 if end else 0
    at = 1 + which + count * np.arange(len(mode.gains))
    index = np.concatenate([at, at + size if mode.real else at + 1 + size + starts])
    if not free[index].all() and not mode.real:
        return np.inf
    index = index[free[index]]
    place = np.cumsum(free)[index] - 1
    flat = np.concatenate([mode.gains.real[:, which], mode.gains.imag[:, which]])
    flat = flat[np.isin(np.concatenate([at, at + size if mode.real else at + 1 + size + starts]), index)]
    return float(flat @ np.linalg.solve(spread[np.ix_(place, place)], flat)) if len(flat) else np.inf


def with_real_ones(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """With each pair whose multipliers may be one or two real ones taken for that, where noise explains the rest."""
    for number in range(len(now.modes)):
        mode = now.modes[number]
        if mode.real:
            continue
        omega = samples.fundamental
        half = 0.5 * round(2.0 * mode.exponent.imag / omega)
        if abs(mode.exponent.imag - half * omega) > abs(mode.exponent.real):
            continue
        rest = [own for k, own in enumerate(now.modes) if k != number]
        best = _as_real(samples, now, rest, mode, half, limits)
        if best is not None:
            return with_real_ones(samples, best, limits)
    return now


def _as_real(
    samples: Samples, now: Linearisation, rest: Sequence[InputMode], mode: InputMode, half: float, limits: Limits
) -> Linearisation | None:
    """The fit with one real multiplier, or two, for a pair; None where that costs more than noise explains."""
    begin = half % 1.0
    turns = np.arange(begin, np.abs(mode.turns + half).max() + 0.5)
    reach = np.arange(begin, np.abs(mode.reach - half).max() + 0.5)
    for count in (1, 2):
        modes: list[InputMode] = []
        with suppress(np.linalg.LinAlgError):
            for k in range(count):
                left = linearise(samples, [*rest, *modes], now.direct).left
                start = mode.exponent.real * (1.0 if count == 1 else (0.7, 1.4)[k])
                modes.append(relaxed(samples, left, start, reach, turns, real=True)[1])
            found = grown(samples, solve(samples, [*rest, *modes], now.direct), limits)
            fewer = now.n_parameters - found.n_parameters
            rise = now.log_likelihood - found.log_likelihood
            if rise < (_limit(fewer, REAL) if fewer > 0 else 0.0):
                return found
    return None
