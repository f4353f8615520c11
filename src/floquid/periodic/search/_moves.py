"""Moves from one structure to another, each with the change of J that one linearisation predicts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from floquid._arrays import Floats
from floquid.fit import DEVIATIONS, HALF_DIGITS, OFF, ROUNDING, inverse_root, scaled_inverse, wald_rise
from floquid.periodic.least_squares import ModeParameters
from floquid.periodic.search._folds import difference, folds, nearest, with_all_lines
from floquid.periodic.search._objective import Point
from floquid.periodic.search._tests import Units, wide_of
from floquid.search import NEAR, REACH, Move


def bands(point: Point, most: int) -> Iterator[Move]:
    """Bands of all modes at once: both ways, growth alone, shrinkage alone."""
    wide = wide_of(point, most)
    for grow, shrink, name in ((True, True, "bands"), (True, False, "grow"), (False, True, "shrink")):
        change, chosen = Units(point, wide).stepwise(grow=grow, shrink=shrink)
        if (chosen != point.entries.bands).any():
            yield Move(change, name, replace(point.entries, bands=chosen))
    # Where modes share lines, exponents follow the noise until no shared harmonic can be done without.
    seeds = np.clip(0, *point.entries.bands.T)
    seeds = np.where(point.entries.fixed[:, None], point.entries.bands, np.stack([seeds, seeds], axis=1))
    _, chosen = Units(point, wide, seeds).stepwise(grow=True, shrink=False)
    trial = replace(point.entries, bands=chosen)
    fewer = point.price.of(trial) - point.price.of(point.entries)
    if fewer < 0.0:
        yield Move(fewer, "bands anew", trial)


def folded(point: Point) -> Iterator[Move]:
    """Bands of modes that fold onto one another: all lines for both as one unit, or an end less for one of them."""
    entries = every = point.entries
    near = [fold for fold in folds(entries, wanders=point.wanders) if len(fold.common(entries.bands))]
    if not near:
        return
    for fold in near:
        yield from _as_one_unit(point, with_all_lines(entries, fold))
    for fold in near * len(near):  # what the last one gives the first has, too
        every = with_all_lines(every, fold)
    if len(near) > 1:
        yield from _as_one_unit(point, every)
    # By the exponents as they are no line can be done without: those of the others follow.
    for mode, harmonic, change in Units(point, point).last(mode for fold in near for mode in (fold.first, fold.second)):
        if change < (REACH - 1.0) * point.price.together(1):
            bands = entries.bands.copy()
            bands[mode] += (1, 0) if harmonic == bands[mode, 0] else (0, -1)
            yield Move(min(change, 0.05 * change), "fewer", replace(entries, bands=bands))


def _as_one_unit(point: Point, trial: ModeParameters) -> Iterator[Move]:
    """A structure with more harmonics, taken where their gain is beyond the limit of all their numbers."""
    more = int(np.ptp(trial.bands, axis=1).sum() - np.ptp(point.entries.bands, axis=1).sum())
    if more:
        price, one = point.price.of(trial) - point.price.of(point.entries), point.price.together(1)
        change = point.with_entries(trial).value - point.value
        # A gain beyond all their own prices is none of weak harmonics: exponents are wrong, or modes are missing.
        if price - more * one < change < (REACH - 1.0) * one:
            yield Move(change, "one unit", trial, max(point.price.together(more) - price, 1e-3))


def removals(point: Point) -> Iterator[Move]:
    """Without one mode, or without the weaker half of those that cost more than they take off."""
    entries, weak, whole = point.entries, [], point.price.of(point.entries)
    for entry in np.flatnonzero(~entries.fixed | (entries.exponents != 0.0)):
        price = whole - point.price.of(without(entries, [int(entry)]))
        change = _loss(point, int(entry)) - price
        if change < 0.0:
            weak.append((change, int(entry)))
        if change < (REACH - 1.0) * price:
            yield Move(min(change, 0.05 * change), "remove", without(entries, [int(entry)]))
    if len(weak) > 2:  # of two, half is one
        half = sorted(weak)[: (len(weak) + 1) // 2]
        yield Move(sum(change for change, _ in half), "remove half", without(entries, [entry for _, entry in half]))


def shared(point: Point) -> Iterator[Move]:
    """Without one mode, its harmonics given to all that fold next to it: it may lie between modes that share lines."""
    entries = point.entries
    pairs = np.flatnonzero(~entries.fixed & ~entries.real).tolist()
    for entry in pairs:
        widened, takers = entries.bands.copy(), 0
        for taker in pairs:
            sign, turns, gap = nearest(entries, taker, entry)
            if taker == entry or gap > 1.0:
                continue
            ends = sign * entries.bands[entry] + turns
            widened[taker] = min(widened[taker, 0], ends.min()), max(widened[taker, 1], ends.max())
            takers += 1
        if takers > 1:
            trial = without(replace(entries, bands=widened), [entry])
            yield Move(point.price.of(trial) - point.price.of(entries), "share", trial)


def without(entries: ModeParameters, gone: list[int]) -> ModeParameters:
    """The entries without some."""
    return entries.picked([k for k in range(len(entries.exponents)) if k not in gone])


def _loss(point: Point, entry: int) -> float:
    """Rise of the misfit where a mode is taken away, the other exponents as they are."""
    columns = np.flatnonzero(np.tile(point.entries.columns().modes == entry, 2))
    total = 0.0
    for block, linear, low in zip(point.blocks, point.solution.linear, point.floors, strict=True):
        coefficients, spread = linear.coefficients[columns], linear.inverse[np.ix_(columns, columns)]
        rise = np.sum((inverse_root(spread, ROUNDING).T @ coefficients) ** 2, axis=0)
        level = linear.left + block.n_samples * low**2
        total += block.n_samples * float(np.log1p(np.maximum(rise, 0.0) / level).sum())
    return total


def splits(point: Point) -> Iterator[Move]:
    """A mode in two along its harmonics, by the exponents that these ask for."""
    entries, by_column = point.entries, point.solution.by_column
    columns, ties, n = entries.columns(), entries.ties(), len(entries.sines())
    matrix, gradient = ties @ by_column.gauss_newton, by_column.gradient
    slack = _gain(matrix @ ties.T, ties @ gradient)[1] if len(ties) else 0.0  # what the fit itself may still gain
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        of_mode = np.flatnonzero(columns.modes == entry)
        both = np.concatenate([of_mode, n + of_mode])
        others = np.flatnonzero(~ties[:, both].any(axis=1))
        inner = by_column.gauss_newton[np.ix_(both, both)]
        price = point.price.mode(real=False)
        for place in range(1, len(of_mode)):
            parts = np.zeros((4, len(both)))
            for k, part in enumerate((slice(0, place), slice(place, len(of_mode)))):
                parts[2 * k, : len(of_mode)][part] = 1.0
                parts[2 * k + 1, len(of_mode) :][part] = 1.0
            mixed = matrix[others][:, both] @ parts.T
            outer = matrix[others] @ ties[others].T
            whole = np.block([[outer, mixed], [mixed.T, parts @ inner @ parts.T]])
            step, gain = _gain(whole, np.concatenate([ties[others] @ gradient, parts @ gradient[both]]))
            if gain - slack > price:
                moved = (complex(step[-4], step[-3]), complex(step[-2], step[-1]))
                harmonic = int(columns.harmonics[of_mode[place]])
                yield Move(price - gain + slack, "split", _cut(entries, int(entry), harmonic, moved))


def doubles(point: Point) -> Iterator[Move]:
    """A mode in two on one harmonic: modes that are nearer than they decay are one until both are fitted."""
    entries = point.entries
    columns, strengths = entries.columns(), energies(point)
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        of_mode = np.flatnonzero(columns.modes == entry)
        harmonic = int(columns.harmonics[of_mode[np.argmax(strengths[of_mode])]])
        value = entries.exponents[entry] + OFF * entries.exponents[entry].real
        beside = ModeParameters.made([value], [(harmonic, harmonic)], entries.fundamental)
        trial = entries.joined(beside)
        change = point.with_entries(trial).value - point.value
        if change < 0.0:
            yield Move(change, "double", trial)


def energies(point: Point) -> Floats:
    """Energy of the coefficients of each column over the noise of the rows (columns,)."""
    parts = [
        np.sum((linear.coefficients / block.noise) ** 2, axis=1)
        for block, linear in zip(point.blocks, point.solution.linear, strict=True)
    ]
    return np.sum(np.split(np.sum(parts, axis=0), 2), axis=0)


def _gain(matrix: Floats, gradient: Floats) -> tuple[Floats, float]:
    """A Gauss-Newton step, and what it takes off the misfit."""
    step = scaled_inverse(matrix, ROUNDING) @ gradient
    return step, float(step @ gradient)


def _cut(entries: ModeParameters, entry: int, harmonic: int, moved: tuple[complex, complex]) -> ModeParameters:
    """The entries with one in two parts, below a harmonic and from it on, each about its middle."""
    omega, (low, high) = entries.fundamental, entries.bands[entry]
    limit = NEAR * abs(entries.exponents[entry].real) + 1e-3 * omega / (2.0 * np.pi)
    rest, parts = without(entries, [entry]), []
    for (first, last), step in zip(((low, harmonic - 1), (harmonic, high)), moved, strict=True):
        middle = int(np.clip(0, first, last))
        value = entries.exponents[entry] + step * min(1.0, limit / max(abs(step), 1e-300)) + 1j * middle * omega
        parts.append((value, (first - middle, last - middle)))
    return rest.joined(ModeParameters.made([value for value, _ in parts], [ends for _, ends in parts], omega))


def merges(point: Point, span: int) -> Iterator[Move]:
    """Two modes as one where their exponents agree modulo the fundamental (Wald 1943); all disjoint ones at once."""
    entries, candidates = point.entries, []
    free = np.flatnonzero(~entries.fixed)
    if len(free) < 2:  # a pair
        return
    covariance = scaled_inverse(point.solution.information, ROUNDING)
    place, resolved = _places(entries), 2.0 * np.pi / max(point.period, *(block.last for block in point.blocks))
    for first, second in combinations(free.tolist(), 2):
        if entries.real[first] != entries.real[second] or entries.offsets[first] != entries.offsets[second]:
            continue
        for sign in (1, -1) if not entries.real[first] else (1,):
            turns, gap = difference(entries, first, second, sign)
            # Beyond the width of both lines, deviations of one that is not determined say nothing of their distance.
            if abs(gap) > abs(entries.exponents[[first, second]].real).sum() + resolved:
                continue
            ties = np.zeros((len(place[first]), len(covariance)))
            for k, (a, b) in enumerate(zip(place[first], place[second], strict=True)):
                ties[k, a], ties[k, b] = -1.0, (1.0, float(sign))[k]
            parts = np.array([gap.real, gap.imag])[: len(ties)]
            score = wald_rise(parts, ties @ covariance @ ties.T)
            # Without noise, deviations are smaller than what rounding moves exponents by.
            score = 0.0 if abs(gap) < HALF_DIGITS * entries.fundamental else score
            merged = _merged(entries, first, second, sign, turns)
            if np.ptp(merged.bands[first]) > span:
                continue
            change = score + point.price.of(merged) - point.price.of(entries)
            if change < 0.0:
                candidates.append((change, first, second, sign, turns))
                yield Move(change, "merge", merged)
    used: set[int] = set()
    every, total, steps = entries, 0.0, []
    for change, first, second, sign, turns in sorted(candidates, key=lambda pair: pair[0]):
        if not {first, second} & used:
            used |= {first, second}
            steps.append((first, second, sign, turns))
            total += change
    if len(steps) > 1:
        for first, second, sign, turns in steps:
            every = _widened(every, first, second, sign, turns)
        yield Move(total, "merge several", without(every, [second for _, second, *_ in steps]))


def together(point: Point) -> Point:
    """The fit with copies of a mode as one, where that leaves but rounding: what copies take out of it is no evidence.

    J falls by copies there, as what is left is not white.
    """
    free = np.flatnonzero(~point.entries.fixed).tolist()
    for first, second in combinations(free, 2):
        entries = point.entries
        if entries.real[first] != entries.real[second] or entries.offsets[first] != entries.offsets[second]:
            continue
        for sign in (1, -1) if not entries.real[first] else (1,):
            turns, gap = difference(entries, first, second, sign)
            if abs(gap) < HALF_DIGITS * entries.fundamental:
                trial = point.with_entries(_merged(entries, first, second, sign, turns)).settled()
                if trial.at_floor:
                    return together(trial)
    return point


def _widened(entries: ModeParameters, first: int, second: int, sign: int, turns: int) -> ModeParameters:
    """The entries with the band of one mode wide enough for the harmonics of another."""
    bands = entries.bands.copy()
    ends = sign * entries.bands[second] + turns if not entries.real[first] else entries.bands[second]
    bands[first] = min(bands[first, 0], ends.min()), max(bands[first, 1], ends.max())
    return replace(entries, bands=bands)


def _merged(entries: ModeParameters, first: int, second: int, sign: int, turns: int) -> ModeParameters:
    return without(_widened(entries, first, second, sign, turns), [second])


def _places(entries: ModeParameters) -> dict[int, list[int]]:
    """The parameters of each free mode: its decay, and its frequency where it has one."""
    free, pairs = np.flatnonzero(~entries.fixed), np.flatnonzero(~entries.fixed & ~entries.real)
    place = {int(entry): [k] for k, entry in enumerate(free)}
    for k, entry in enumerate(pairs):
        place[int(entry)].append(len(free) + k)
    return place


def branches(point: Point) -> Iterator[Move]:
    """Count the frequency of each mode from another harmonic: at a speed that wanders, another response."""
    entries = point.entries
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        for turns in (-1, 1):
            exponents, bands = entries.exponents.copy(), entries.bands.copy()
            exponents[entry] += 1j * turns * entries.fundamental
            bands[entry] -= turns
            yield Move(0.0, "branch", replace(entries, exponents=exponents, bands=bands), DEVIATIONS**2)
