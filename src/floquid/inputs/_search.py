"""Search for modes with inputs: candidates of the residual one after another, bands by scores, and what noise does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._joint import chosen_together, fitted_together
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._scores import Scores
from floquid.inputs._solver import Linearisation, columns_of, covariance, linearise, solve
from floquid.inputs._start import bare_mode, candidates, relaxed

TRIED = 4
"""Candidates that are fitted beside the modes before the search ends."""

START = (1, 2)
"""Harmonics of input and output on either side that a candidate has."""

ROUGH = 3
"""Steps of a fit that is not the last."""

GROWTHS = 12
"""Rounds in which bands may grow."""

DOUBTFUL = 5.0
"""The squared deviations of a mode's shape over the limit, from which on no fit without it is tried."""

MINOR = 0.05
"""The share of the largest gain of a round below which a harmonic waits for the next."""

HOPELESS = 20.0
"""The loss by leaving a mode out, over the limit, from which on no harmonics of others are grown to make it up."""

FIRST = 3
"""Rounds in which bands grow before modes that are needless have gone."""

NARROW = 1e-12
"""The probability at which noise may make up for harmonics that are left out together."""

AS_REAL = 8
"""Steps of a fit with real multipliers for pairs."""

FEW = 4
"""Modes to begin with up to which a search that begins with one is made, too."""

TOO_NEAR = 0.5
"""The distance of two modes over their decay below which they may be one."""

WIDE = 15
"""Harmonics of the inputs of one mode from which on a mode may be missing beside it."""

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

SAME = 0.05
"""The distance of two exponents over their decay below which they are one."""

STRIDE = 3
"""Harmonics beyond the end of a band that are looked at in a round."""

STABLE = 0.35
"""The share of the looks at which a candidate comes up from which on a search begins with it."""

LOOSE = 0.02
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""

REAL = 1e-3
"""The probability at which noise may move a real multiplier off the axis."""


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
    poles, shares = candidates(samples, samples.values)
    first = chosen_together(samples, poles[shares >= STABLE], limits.modes)
    now = _found(samples, first, limits, report)
    if len(first) > 1 and len(now.modes) > 1 and (len(first) <= FEW or _crowded(samples, now)):
        # Two poles may stand for one mode of strong harmonics: begin with one, too.
        other = _found(samples, first[:1], replace(limits, modes=min(limits.modes, FEW)), report)
        now = max(now, other, key=lambda own: own.log_likelihood - own.n_parameters * np.log(samples.n_samples))
    if not now.modes:
        return now
    loose = replace(limits, harmonic_alarm=LOOSE)
    now = narrowed(samples, grown(samples, now, loose, rounds=2), loose)
    return solve(samples, [_padded(mode, limits) for mode in now.modes], now.direct)


def _crowded(samples: Samples, now: Linearisation) -> bool:
    """True where modes of a fit are nearly one, or inputs reach one by very many harmonics."""
    omega, found = samples.fundamental, [mode.exponent for mode in now.modes]
    for number, one in enumerate(found):
        for other in found[:number]:
            gaps = [one - other, one - other.conjugate()]
            near = min(abs(gap - 1j * omega * round(gap.imag / omega)) for gap in gaps)
            if near < TOO_NEAR * min(abs(one.real), abs(other.real)):
                return True
    return max((len(mode.reach) for mode in now.modes), default=0) > WIDE


def _found(
    samples: Samples, first: Sequence[InputMode], limits: Limits, report: Callable[[str], None]
) -> Linearisation:
    """The modes that a search ends with that begins with some."""
    now = grown(samples, solve(samples, first, iterations=ROUGH, rough=True), limits, rounds=FIRST)
    now = narrowed(samples, without_needless(samples, now, limits), limits)
    refused: list[complex] = []
    now = with_real_ones(samples, grown(samples, now, limits), limits, refused)
    report(f"searching for modes: {len(now.modes)} found")
    while len(now.modes) < limits.modes:
        more = _with_one_more(samples, now, limits)
        if more is None:
            break
        now = with_real_ones(samples, narrowed(samples, more, limits), limits, refused)
        report(f"searching for modes: {len(now.modes)} found")
    return with_real_ones(samples, without_needless(samples, now, limits), limits, refused)


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
    for exponent in candidates(samples, now.left)[0].tolist():
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
            trial = solve(samples, (*now.modes, mode), now.direct, iterations=ROUGH, rough=True)
            trial = grown(samples, trial, limits)
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
        scores = Scores(samples, now)
        wider = _wider(samples, now, limits, scores)
        direct = _more_direct(samples, now, limits, scores)
        if all(a is b for a, b in zip(wider, now.modes, strict=True)) and direct == now.direct:
            return now
        modes = [centred(samples, mode, now, k) for k, mode in enumerate(wider)]
        now = solve(samples, modes, direct, iterations=ROUGH, rough=True)
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
    least = [_limit(2 * len(rows), limits.harmonic_alarm) for rows in (samples.values, samples.inputs)]
    most = MINOR * max((float(own.max(initial=0.0)) for own in gains), default=0.0)
    found = list(now.modes)
    for kind, beyond in enumerate((seen, reached)):
        place = 0
        for number, more in beyond:
            own = gains[kind][place : place + len(more)]
            place += len(more)
            far = np.flatnonzero(own > max(least[kind], most))
            if not len(far):
                continue
            kept, mode = more[: far[-1] + 1], found[number]
            if kind:
                for turn in kept.tolist():
                    mode = _with_reach(mode, turn)
            else:
                mode = replace(mode, turns=np.sort(np.append(mode.turns, kept)))
            found[number] = mode
    return found


def _with_reach(mode: InputMode, turn: float) -> InputMode:
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
    limit = _limit(len(extra) * len(samples.values), limits.harmonic_alarm)
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


def without_needless(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without modes that noise explains once all others are fitted again with the harmonics that they then need."""
    refused: set[complex] = set()
    while len(now.modes) > 1:
        weights, rises = Scores(samples, now).of_modes(), []
        for number, mode in enumerate(now.modes):
            own = now.n_parameters / len(now.modes)
            if mode.exponent in refused or weights[number] > DOUBTFUL * _limit(int(own) + 1, limits.mode_alarm):
                continue
            less = [other for k, other in enumerate(now.modes) if k != number]
            trial = solve(samples, less, now.direct, iterations=ROUGH, rough=True)
            rises.append((now.log_likelihood - trial.log_likelihood, number, trial))
        if not rises:
            return now
        rise, number, trial = min(rises, key=lambda one: one[:2])
        limit = _limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
        if rise > HOPELESS * limit:
            return now
        trial = grown(samples, trial, limits)
        limit = _limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
        if now.log_likelihood - trial.log_likelihood > limit:
            refused.add(now.modes[number].exponent)
        else:
            now = trial
    return now


def narrowed(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without the harmonics at the ends of bands that noise explains."""
    for _ in range(GROWTHS if now.modes else 0):
        found, spread, place = [], covariance(samples, now), 0
        seen, reached = (_ends(2 * len(rows), limits) for rows in (samples.values, samples.inputs))
        for number, mode in enumerate(now.modes):
            block = slice(place, place + int(mode.free.sum()))
            place = block.stop
            columns, turning = now.slices()[number]
            turns = seen(len(mode.turns), mode.real, lambda which: _weight(now, columns, turning, which))  # noqa: B023
            reach = reached(
                len(mode.reach),
                mode.real,
                lambda which: _input_weight(mode, spread[block, block], which),  # noqa: B023
            )
            found.append(
                replace(mode, turns=mode.turns[turns], reach=mode.reach[reach], gains=mode.gains[:, reach])
                if turns.stop - turns.start < len(mode.turns) or reach.stop - reach.start < len(mode.reach)
                else mode
            )
        if all(a is b for a, b in zip(found, now.modes, strict=True)):
            return now
        trial = solve(samples, found, now.direct, iterations=ROUGH, rough=True)
        if now.log_likelihood - trial.log_likelihood > _limit(now.n_parameters - trial.n_parameters, NARROW):
            return now
        now = trial
    return now


def _ends(degrees: int, limits: Limits) -> Callable[[int, bool, Callable[[NDArray[np.int64]], float]], slice]:
    """Judge of the part of a band to keep: the outermost harmonics together are what noise explains."""

    def kept(count: int, real: bool, weight: Callable[[NDArray[np.int64]], float]) -> slice:
        first, last = 0, count
        while last - first > 1 and weight(np.arange(last - 1, count)) < _limit(
            degrees * (count - last + 1), limits.harmonic_alarm
        ):
            last -= 1
        while (
            not real
            and last - first > 1
            and weight(np.arange(first + 1)) < _limit(degrees * (first + 1), limits.harmonic_alarm)
        ):
            first += 1
        return slice(first, last)

    return kept


def _weight(now: Linearisation, columns: slice, turning: NDArray[np.bool_], which: NDArray[np.int64]) -> float:
    """How far the coefficients of some harmonics are from zero, all channels, in squared deviations."""
    later = len(turning) + np.cumsum(turning) - 1
    index = columns.start + np.concatenate([which, later[which[turning[which]]]])
    own = now.coefficients[index] / now.noise
    return float(np.sum(own * np.linalg.solve(now.inverse[np.ix_(index, index)], own)))


def _input_weight(mode: InputMode, spread: NDArray[np.float64], which: NDArray[np.int64]) -> float:
    """How far the gains of some harmonics of the inputs are from zero, in squared deviations.

    Infinite where one is the scale of the mode.
    """
    free, size, starts = mode.free, mode.gains.size, len(mode.initial)
    at = 1 + (which[:, None] + len(mode.reach) * np.arange(len(mode.gains))).ravel()
    flat, index = mode.gains.ravel()[at - 1], np.concatenate([at, at + size if mode.real else at + 1 + size + starts])
    own = np.concatenate([flat.real, flat.imag])
    if not free[index].all() and not mode.real:
        return np.inf
    own, index = own[free[index]], index[free[index]]
    place = np.cumsum(free)[index] - 1
    return float(own @ np.linalg.solve(spread[np.ix_(place, place)], own)) if len(own) else np.inf


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
            modes = fitted_together(samples, left, bare)
            found = solve(samples, [*rest, *modes], now.direct, iterations=AS_REAL, rough=True)
            found = solve(samples, grown(samples, found, limits).modes, now.direct, iterations=AS_REAL, rough=True)
            fewer = now.n_parameters - found.n_parameters
            rise = now.log_likelihood - found.log_likelihood
            if rise < (_limit(fewer, REAL) if fewer > 0 else 0.0):
                return found
    return None
