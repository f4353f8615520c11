"""Moves with inputs from some modes to others: without one, with real multipliers, with one that the residual shows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from floquid.fit import chi2_limit, wald_rise
from floquid.inputs._joint import fitted_together
from floquid.inputs._modes import InputMode
from floquid.inputs._solver import linearise, solve
from floquid.inputs._start import bare_mode, candidates
from floquid.inputs.search._near_axis import block_of_pair, block_of_reals, half_of, ordinary
from floquid.inputs.search._point import HOPE, Point
from floquid.inputs.search._real import NARROWEST, real_for
from floquid.inputs.search._scores import by_noise_beyond
from floquid.inputs.search._structure import Structure
from floquid.search import Move

WEAK = 4.0  # times its price up to which it is tried whether the other modes can do without one
BLOCK = 1  # steps of a block
START = (1, 2)  # harmonics of input and output on either side that a candidate has
NEAR = 0.5  # decays within which two candidates are one


def removals(point: Point) -> Iterator[Move[Structure]]:
    """Without one mode that may cost more than the others lose by it, once they have the harmonics that they need."""
    now = point.structure
    for number, weight in enumerate(point.scores.of_modes.tolist()):
        price = point.price.of_mode(now.modes[number])
        if weight < WEAK * price:
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
            first, second = now.modes[one], now.modes[two] if sign > 0.0 else conjugated(now.modes[two])
            gap = second.exponent - first.exponent
            turn = round(gap.imag / omega)
            gap -= 1j * turn * omega
            apart = root[rows[two]] * np.array([[1.0], [sign]]) - root[rows[one]]
            whole = first
            for band, shift in (("turns", turn), ("reach", -turn)):
                both = np.concatenate([getattr(first, band), getattr(second, band) + shift])
                whole = whole.with_band(band, np.arange(both.min(), both.max() + 1.0))
            change = wald_rise(np.array([gap.real, gap.imag]), apart @ apart.T) + point.price.of_mode(whole)
            change -= point.price.of_mode(first) + point.price.of_mode(second)
            if change < 0.0:
                yield Move(change, "merge", now.without([one, two]).joined([whole]))


def kinds(point: Point) -> Iterator[Move[Structure]]:
    """Pairs near an axis as real multipliers, and two real multipliers of one sign as a pair.

    Two real multipliers and a pair are one block of two states: one step of its fit says which of them it is.
    """
    now, samples = point.structure, point.samples
    for numbers in [*_near_axis(now.modes, samples.fundamental), *_twins(now.modes)]:
        own, rest = [now.modes[number] for number in numbers], now.without(numbers)
        if len(numbers) == 2:
            block = block_of_reals(own, samples.fundamental)
        else:
            block = block_of_pair(samples, *own)
            (exponents, *_), turns, reach = real_for(own, samples.fundamental)
            bare = [bare_mode(samples, complex(each), reach, turns, real=True) for each in exponents]
            without = linearise(samples, rest.modes, rest.direct)
            gain, single = fitted_together(samples, without.left, bare)
            move = _kind(point, "single", rest.joined(single), without.cost - gain)
            if move.change < 0.0:
                yield move
        with suppress(np.linalg.LinAlgError):
            at = solve(samples, [*rest.modes, block], rest.direct, iterations=BLOCK, rough=True)
            square = at.modes[-1].square
            assert square is not None
            if (square > 0.0) != own[0].real:
                parts = ordinary(samples, at.modes[-1])
                yield _kind(point, "kind", replace(rest, modes=at.modes[:-1]).joined(parts), at.cost)


def _near_axis(modes: Sequence[InputMode], omega: float) -> Iterator[list[int]]:
    for number, mode in enumerate(modes):
        away = abs(mode.exponent.imag - half_of(mode, omega) * omega)
        if not mode.real and away <= max(abs(mode.exponent.real), NARROWEST * omega):
            yield [number]


def _kind(point: Point, name: str, structure: Structure, cost: float) -> Move[Structure]:
    change = point.price.of(structure) - point.price.of(point.structure) + cost - point.at.cost
    return Move(change, name, structure)


def _twins(modes: Sequence[InputMode]) -> Iterator[list[int]]:
    """The two real multipliers of each sign that are nearest to each other."""
    for lowest in (0.0, 0.5):
        order = sorted(
            (k for k, mode in enumerate(modes) if mode.real and mode.lowest == lowest),
            key=lambda k: modes[k].exponent.real,
        )
        twos = [list(two) for two in pairwise(order)]
        yield from sorted(twos, key=lambda two: float(np.ptp([modes[k].exponent.real for k in two])))[:1]


def conjugated(mode: InputMode) -> InputMode:
    """Name a pair by the conjugate of its exponent."""
    return replace(
        mode,
        exponent=mode.exponent.conjugate(),
        turns=-mode.turns[::-1],
        reach=-mode.reach[::-1],
        gains=mode.gains[:, ::-1].conj(),
        initial=mode.initial.conj(),
    )


def additions(point: Point) -> Iterator[Move[Structure]]:
    """With modes more, of the candidates that explain most of the residual: those apart at once, and each alone."""
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
    omega = samples.fundamental
    least = max(1e-3, by_noise_beyond(point.scores, point.limits, ranked[0][0])) if now.modes else 1e-3
    tried: list[complex] = []
    for gain, mode in ranked:
        if apart(mode.exponent, tried, omega):
            tried.append(mode.exponent)
            change = point.price.of_mode(mode) - gain
            if change * HOPE < -least:
                yield Move(change, "add", now.joined([mode]), least)


def apart(exponent: complex, others: Iterable[complex], omega: float) -> bool:
    """True where an exponent is further than half a decay from others, modulo the fundamental."""
    for other in others:
        gaps = [exponent - other, exponent - other.conjugate()]
        near = min(abs(gap - 1j * omega * round(gap.imag / omega)) for gap in gaps)
        if near < NEAR * min(abs(exponent.real), abs(other.real)):
            return False
    return True
