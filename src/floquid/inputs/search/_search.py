"""Search for modes with inputs: the descent of J over structures from no mode on, with pairs near an axis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import NearAxis, read_blocks
from floquid.fit import begun_off, block_stands, chi2_limit, couples, half_of, near_axis, wald_rise, with_blocks
from floquid.inputs._modes import InputMode, runs_away
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._start import bare_mode, candidates, fitted_together
from floquid.inputs.search._bands import HOPE, REST, Point, centred, far_growths, growths, helpful, shrinkages
from floquid.inputs.search._scores import by_noise_beyond
from floquid.inputs.search._structure import Limits, Structure
from floquid.search import LOOSE, NEAR, REACH, Move, descended


def read_near_axis(samples: Samples, now: Linearisation) -> NearAxis[Linearisation]:
    """The fit with exponents near an axis read from their mean and squared half-difference, where these are regular."""
    # Each pair, and the two real multipliers of one sign that are nearest to each other, are fitted as a block once.
    # Ordinary modes take the place of each block, behind all others.
    now = with_blocks(now, lambda own: _couples(samples, own), lambda own, numbers: _as_block(samples, own, numbers))
    blocks = {}
    if any(mode.square is not None for mode in now.modes):
        blocks = read_blocks(now.modes, covariance(samples, now), _places(now.modes), samples.fundamental)
    modes = [mode for mode in now.modes if mode.square is None]
    for number, read in blocks.items():
        modes += ordinary(samples, replace(now.modes[number], square=read.square))
    at = now
    if blocks:
        at = linearise(samples, modes, now.direct)
        at = linearise(samples, [centred(samples, mode, at, k).scaled() for k, mode in enumerate(at.modes)], at.direct)
    return NearAxis.of(at, blocks, now.modes, samples.fundamental)


def _places(modes: Sequence[InputMode]) -> Integers:
    """The free parameters that are the real and the imaginary part of each exponent, or σ and q (modes, 2)."""
    ends = np.cumsum([0, *(mode.free.sum() for mode in modes)])
    seconds = [
        (first + last) // 2 if mode.square is None else last - 1
        for mode, first, last in zip(modes, ends, ends[1:], strict=False)
    ]
    return np.stack([ends[:-1], np.array(seconds, np.int64)], axis=1)


def _couples(samples: Samples, now: Linearisation) -> Iterator[list[int]]:
    """Numbers of modes that may be of either kind, all of them within bounds in the record."""
    spread = covariance(samples, now) if now.modes else np.zeros((0, 0))
    for numbers in couples(now.modes, spread, _places(now.modes), samples.fundamental):
        if not any(runs_away(samples, now.modes[number].exponent) for number in numbers):
            yield numbers


def _as_block(samples: Samples, now: Linearisation, numbers: Sequence[int]) -> Linearisation | None:
    """The fit with a block for one pair or two real multipliers; None where either kind for itself is regular."""
    own = [now.modes[number] for number in numbers]
    rest = [mode for k, mode in enumerate(now.modes) if k not in numbers]
    with suppress(np.linalg.LinAlgError):
        block = block_of_pair(samples, own[0]) if len(own) == 1 else block_of_reals(own, samples.fundamental)
        trial = solve(samples, [*rest, block], now.direct)
        variance = float(covariance(samples, trial)[-1, -1])
        return trial if block_stands(trial, now, variance, samples.fundamental, real=own[0].real) else None
    return None


def block_of_pair(samples: Samples, mode: InputMode) -> InputMode:
    """The block of a pair, about the axis that it is nearest to: its states are z and its derivative along q."""
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    away = mode.exponent.imag - half * omega
    away = begun_off(away, mode.exponent.real, omega)
    reach, first = _folded(mode.reach - half, mode.gains)
    _, second = _folded(mode.reach - half, -1j * mode.gains / away)
    initial = mode.initial * np.exp(-1j * half * omega * samples.first_times)
    return replace(
        mode,
        exponent=complex(mode.exponent.real),
        real=True,
        reach=reach,
        gains=np.concatenate([first, second]),
        turns=np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5),
        initial=np.concatenate([initial.real, initial.imag / away]).astype(complex),
        square=-(away**2),
    ).scaled()


def block_of_reals(modes: Sequence[InputMode], omega: float) -> InputMode:
    """The block of two real multipliers of one sign, with harmonics as wide."""
    other, one = sorted(modes, key=lambda mode: mode.exponent.real)
    decay, gap = 0.5 * (one.exponent.real + other.exponent.real), one.exponent.real - other.exponent.real
    apart = begun_off(0.5 * gap, decay, omega)
    turns, reach = (
        np.arange(one.axis, max(getattr(mode, name)[-1] for mode in modes) + 0.5) for name in ("turns", "reach")
    )
    gains = [np.pad(mode.gains, ((0, 0), (0, len(reach) - len(mode.reach)))) for mode in (one, other)]
    # The sign of a state is free: alike, their difference is small, as it is where they meet.
    sign = -1.0 if np.sum((gains[0] * gains[1].conj()).real) < 0.0 else 1.0
    both = [(gains[0], sign * gains[1]), (one.initial, sign * other.initial)]
    first, second = (np.concatenate([0.5 * (a + b), 0.5 * (a - b) / apart]) for a, b in both)
    return replace(
        one, exponent=complex(decay), reach=reach, gains=first, turns=turns, initial=second, square=apart**2
    ).scaled()


def ordinary(samples: Samples, mode: InputMode) -> list[InputMode]:
    """The pair, or the two real multipliers, that a block is."""
    assert mode.square is not None
    root, low, omega = float(np.sqrt(abs(mode.square))), mode.axis, samples.fundamental
    if mode.square > 0.0:
        return [replace(mode.at(way), real=True).scaled() for way in (root, -root)]
    up, down = mode.at(1j * root), mode.at(-1j * root)
    # The real part of each signal is half of it and half of its conjugate.
    turns, reach = (np.arange(-band[-1], band[-1] + 0.5) for band in (mode.turns, mode.reach))
    gains = np.zeros((len(up.gains), len(reach)), complex)
    gains[:, -len(mode.reach) :] += 0.5 * up.gains
    gains[:, len(mode.reach) - 1 :: -1] += 0.5 * down.gains.conj()
    initial = up.initial * np.exp(1j * low * omega * samples.first_times)
    exponent = up.exponent + 1j * low * omega
    return [replace(up, exponent=exponent, reach=reach + low, gains=gains, turns=turns - low, initial=initial).scaled()]


def _folded(turns: Floats, values: Complexes) -> tuple[Floats, Complexes]:
    """Harmonics from zero or ½ on, and amplitudes there (rows, harmonics), of the real part of a complex signal."""
    found = np.arange(turns[0] % 1.0, np.abs(turns).max() + 0.5)
    amplitudes = np.zeros((len(values), len(found)), complex)
    for turn, value in zip(turns.tolist(), values.T, strict=True):
        amplitudes[:, round(abs(turn) - found[0])] += value.conj() if turn < 0.0 else value if turn else value.real
    return found, amplitudes


def searched(
    samples: Samples, limits: Limits, report: Callable[[str], None] = lambda _: None
) -> tuple[Linearisation, bool]:
    """The modes by which J is least, with their harmonics, and whether the budget of time was over before."""
    until, given = limits.begun().until, samples
    # Rough steps are made in single precision: by powers of two nothing else changes.
    units = np.ldexp(1.0, np.frexp(samples.input_size)[1])
    samples = replace(samples, inputs=samples.inputs / units[:, None])
    least = descended(Point(samples, limits, linearise(samples, []), helpful), _stages, until, report)
    if not least.n_modes:
        return linearise(given, [], least.at.direct), least.unfinished
    report(f"searching for modes: harmonics of {least.n_modes}")
    loose = replace(limits, harmonic_alarm=LOOSE)
    least = descended(replace(least, limits=loose), _last_stages, until, report)
    found = least.at
    modes = [centred(samples, mode, found, number) for number, mode in enumerate(found.modes)]
    modes = [replace(mode, gains=mode.gains / units[:, None], sizes=units * mode.sizes).scaled() for mode in modes]
    return solve(given, [_padded(mode, limits.highest) for mode in modes], found.direct), least.unfinished


def _stages(point: Point) -> Iterator[Iterable[Move[Structure]]]:
    """Moves in groups: a group is made only where none of those before lowers J."""
    if point.n_modes:
        yield growths(point, alone=False)
        yield [*shrinkages(point), *removals(point), *merges(point)]
        yield [point.settling] if point.scores.promised > REST else []
        yield kinds(point)
    if point.limits.room(point.at.modes):
        yield additions(point)
    if point.n_modes:
        yield afresh(point)


def _last_stages(point: Point) -> Iterator[Iterable[Move[Structure]]]:
    """Moves by which the modes stay, of bands and of kinds."""
    yield growths(point, alone=False)
    yield shrinkages(point)
    yield [point.settling] if point.scores.promised > REST else []
    yield kinds(point)
    yield far_growths(point)


def nearly_one(samples: Samples, now: Linearisation) -> bool:
    """True where two modes of a fit differ by less than they decay, apart from a multiple of the fundamental."""
    found = [mode.exponent for mode in now.modes]
    return not all(apart(each, found[:number], samples.fundamental) for number, each in enumerate(found))


def _padded(mode: InputMode, highest: float) -> InputMode:
    """A mode with one harmonic more at each end of its bands: what is left out has no deviation."""
    return mode.padded("turns", 1.0, highest).padded("reach", 1.0, highest)


START = (1, 2)  # harmonics of input and output on either side that a candidate has
APART = (0.7, 1.4)  # decays of two real multipliers, over that of a pair, from which those far from it are found


def removals(point: Point) -> Iterator[Move[Structure]]:
    """Without one mode that may cost more than the others lose by it, once they have the harmonics that they need."""
    now = point.structure
    for number, weight in enumerate(point.scores.of_modes.tolist()):
        price = point.price.of_mode(now.modes[number])
        if weight < REACH * price:
            yield Move(weight - price, "remove", now.without([number]))


def merges(point: Point) -> Iterator[Move[Structure]]:
    """Two pairs as the stronger one where their exponents agree modulo the fundamental (Wald 1943)."""
    now, root, omega = point.structure, point.scores.spread_root, point.samples.fundamental
    ends = np.cumsum([0, *(int(mode.free.sum()) for mode in now.modes)])
    rows = [np.array([a, a + (b - a) // 2]) for a, b in pairwise(ends)]
    weights = point.scores.of_modes
    for pair in combinations([k for k, mode in enumerate(now.modes) if not mode.real], 2):
        two, one = sorted(pair, key=lambda number: weights[number])
        for sign in (1.0, -1.0):
            first, second = now.modes[one], now.modes[two] if sign > 0.0 else now.modes[two].conjugated()
            gap = second.exponent - first.exponent
            turn = round(gap.imag / omega)
            gap -= 1j * turn * omega
            between = root[rows[two]] * np.array([[1.0], [sign]]) - root[rows[one]]
            whole = first
            for band, shift in (("turns", turn), ("reach", -turn)):
                both = np.concatenate([getattr(first, band), getattr(second, band) + shift])
                whole = whole.with_band(band, np.arange(both.min(), both.max() + 1.0))
            change = wald_rise(np.array([gap.real, gap.imag]), between @ between.T) + point.price.of_mode(whole)
            change -= point.price.of_mode(first) + point.price.of_mode(second)
            if change < 0.0:
                yield Move(change, "merge", now.without([one, two]).joined([whole]))


def kinds(point: Point) -> Iterator[Move[Structure]]:
    """A pair near an axis as one real multiplier or two, and two real multipliers of one sign as a pair."""
    # A pair and two real multipliers are one block of two states: a step of its fit tells the sign of its q.
    now, samples = point.structure, point.samples
    for number, mode in enumerate(now.modes):
        if near_axis(mode, samples.fundamental):
            block, rest = block_of_pair(samples, mode), now.without([number])
            columns, squares = point.at.slices()[number][0], point.at.noise**2
            alone = point.at.left + point.at.columns.response(point.at.coefficients, columns)
            share = np.sum(alone**2, axis=1) / samples.count / squares
            loss = samples.count * float(np.sum(np.log(np.maximum(share, 1.0))))
            for name, shares in (("single", (1.0,)), ("two", APART)):
                decays = [complex(share * mode.exponent.real) for share in shares]
                bare = [bare_mode(samples, own, block.reach, block.turns, real=True) for own in decays]
                gain, real = fitted_together(samples, alone, bare)
                move = _kind(point, name, rest.joined(real), point.at.cost + loss - gain)
                if move.change < 0.0:
                    yield move
            yield from _other_kind(point, rest, block)
    for two in _twins(now.modes):
        block = block_of_reals([now.modes[number] for number in two], samples.fundamental)
        yield from _other_kind(point, now.without(two), block)


def _other_kind(point: Point, rest: Structure, block: InputMode) -> Iterator[Move[Structure]]:
    """A block as the other kind than it is, where q changes its sign in a step."""
    samples, square = point.samples, block.square
    with suppress(np.linalg.LinAlgError):
        at = solve(samples, [*rest.modes, block], rest.direct, iterations=1, rough=True)
        *modes, moved = at.modes
        assert square is not None
        assert moved.square is not None
        if (moved.square > 0.0) != (square > 0.0):
            trial = replace(rest, modes=(*modes, *ordinary(samples, moved)))
            yield _kind(point, "kind", trial, at.cost)


def _kind(point: Point, name: str, structure: Structure, cost: float) -> Move[Structure]:
    change = point.price.of(structure) - point.price.of(point.structure) + cost - point.at.cost
    return Move(change, name, structure)


def _twins(modes: Sequence[InputMode]) -> Iterator[list[int]]:
    """The two real multipliers of each sign that are nearest to each other."""
    for lowest in (0.0, 0.5):
        alike = [number for number, mode in enumerate(modes) if mode.real and mode.axis == lowest]
        alike.sort(key=lambda number: modes[number].exponent.real)
        gaps = np.diff([modes[number].exponent.real for number in alike])
        if len(gaps):
            first = int(np.argmin(gaps))
            yield alike[first : first + 2]


def afresh(point: Point) -> Iterator[Move[Structure]]:
    """Modes with few harmonics, all products fitted together: all, the stronger half, or pairs near an axis as real."""
    samples, modes, omega = point.samples, point.structure.modes, point.samples.fundamental
    strong = sorted(np.argsort(-point.scores.of_modes)[: (len(modes) + 1) // 2].tolist())
    near = [mode for mode in modes if near_axis(mode, omega)]
    least = max(1e-3, by_noise_beyond(point.scores, point.limits))
    for own, real in ((modes, ()), ([modes[number] for number in strong], ()), (modes if near else (), near)):
        bare = [_bare(samples, mode, axis=any(mode is one for one in real)) for mode in own]
        if bare:
            with suppress(np.linalg.LinAlgError):
                gain, fitted = fitted_together(samples, samples.values, bare)
                structure = replace(point.structure, modes=tuple(fitted))
                yield Move(point.price.of(structure) - gain, "afresh", structure, least, helped=True)


def _bare(samples: Samples, mode: InputMode, *, axis: bool) -> InputMode:
    """A mode with one harmonic on either side, and no products yet; on the axis that it is nearest to if so said."""
    real = mode.real or axis
    low = half_of(mode, samples.fundamental) % 1.0
    turns = np.arange(low if real else -1.0, 2.0)
    return bare_mode(samples, complex(mode.exponent.real) if real else mode.exponent, turns, turns, real=real)


def additions(point: Point) -> Iterator[Move[Structure]]:
    """With one mode more, of the candidates that explain most of the residual."""
    samples, now, alarm = point.samples, point.structure, point.limits.mode_alarm
    reach, turns = (np.arange(-most, most + 1.0) for most in START)
    ranked = []
    for exponent in candidates(samples, point.at.left)[0].tolist():
        bare = bare_mode(samples, exponent, reach, turns)
        with suppress(np.linalg.LinAlgError):
            gain, (mode,) = fitted_together(samples, point.at.left, [bare])
            numbers = 2 * (mode.gains.size + len(mode.initial)) * len(turns) * len(samples.values)
            if gain >= chi2_limit(numbers, alarm):  # what noise may take, all products free
                ranked.append((gain, mode))
    if not ranked:
        return
    ranked.sort(key=lambda each: -each[0])
    least = max(1e-3, by_noise_beyond(point.scores, point.limits, ranked[0][0])) if now.modes else 1e-3
    tried: list[complex] = []
    for gain, mode in ranked:
        change = point.price.of_mode(mode) - gain
        if change * HOPE < -least and apart(mode.exponent, tried, samples.fundamental):
            tried.append(mode.exponent)
            yield Move(change, "add", now.joined([mode]), least)


def apart(exponent: complex, others: Iterable[complex], omega: float) -> bool:
    """True where an exponent is further than half a decay from others, modulo the fundamental."""
    for other in others:
        gaps = [exponent - other, exponent - other.conjugate()]
        near = min(abs(gap - 1j * omega * round(gap.imag / omega)) for gap in gaps)
        if near < NEAR * min(abs(exponent.real), abs(other.real)):
            return False
    return True
