"""The order of moves for free responses: modes and bands of records, lines of one LTI system, coloured noise."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats
from floquid.fit import ROUNDING, chi2_limit
from floquid.periodic.least_squares import (
    PLAIN,
    Block,
    ModeParameters,
    filtered_blocks,
    least_noise,
    linearise,
    residual_filter,
)
from floquid.periodic.search._additions import additions
from floquid.periodic.search._moves import bands, branches, doubles, folded, merges, removals, shared, splits, together
from floquid.periodic.search._objective import Point, Price
from floquid.search import SECONDS, Move, descended

LOUD = 100.0  # times the price from which on a line cannot be a peak of noise that is coloured

Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of a search: harmonics, modes, forced responses and time."""

    most: int  # the highest harmonic of the axis that the sampling shows
    span: int  # fundamentals from the first to the last harmonic of a mode that it tells apart, at most
    modes: int  # modes at most, a pair counted once
    forced: Floats  # turns a period that a forced response may have; empty when none is looked for (harmonics,)
    width: int | None = None  # harmonics on each side of every mode; None where they are chosen
    search: bool = True  # whether modes may be added, removed, split, merged and change their kind
    angle_std: tuple[float, ...] = ()  # of the system's angle in each hit [rad]; empty by a constant period (hits,)
    seconds: float = SECONDS


def priced(
    blocks: Sequence[Block], base: ModeParameters, floor: float, *, mode_alarm: float, harmonic_alarm: float
) -> tuple[tuple[Floats, ...], Price]:
    """The least noise of each block beside what is fitted in any case, and the price of units."""
    floors = tuple(least_noise(blocks, linearise(blocks, base), floor))
    rows, wanders = sum(len(block.rows) for block in blocks), any(block.wanders for block in blocks)
    return floors, Price(mode_alarm, harmonic_alarm, rows, wanders=wanders)


def searched(first: Point, bounds: Bounds, report: Log = lambda _: None) -> Point:
    """The descent of J from a structure, errors of the shaft's angle being no modes."""
    until = time.process_time() + bounds.seconds

    # Bands first at the exponents as they are: with wide ones, modes that share lines follow the noise.
    current = descended(first, lambda point: iter([_bands(point, bounds)]), until, report).settled()
    least = descended(_blurred(current, bounds.angle_std), lambda point: _stages(point, bounds), until, report)
    return replace(together(least), unfinished=least.unfinished)


def _stages(point: Point, bounds: Bounds) -> Iterator[Iterable[Move]]:
    """Moves in groups: a group is made only where none of those before lowers J."""
    # Bands come first: while they are wrong, what scores say of exponents misleads.
    yield _bands(point, bounds)
    if bounds.width is None:
        yield folded(point)
    if not bounds.search:
        return
    if point.wanders:  # on a wrong branch a mode leaves lines of its own
        yield branches(point)
    yield _modes(point, bounds)
    if _room(point, bounds) and bounds.width is None:
        yield doubles(point)
    yield from additions(point, bounds.forced, bounds.most, room=_room(point, bounds), width=bounds.width)


def _bands(point: Point, bounds: Bounds) -> Iterator[Move]:
    if (~point.entries.fixed).any() and bounds.width is None:
        yield from bands(point, bounds.most)


def _modes(point: Point, bounds: Bounds) -> Iterator[Move]:
    yield from removals(point)
    if bounds.width is None:  # bands that are given stay: modes are not split or merged then
        yield from splits(point) if _room(point, bounds) else ()
        yield from merges(point, bounds.span)
        yield from shared(point)


def _room(point: Point, bounds: Bounds) -> bool:
    return int((~point.entries.fixed).sum()) < bounds.modes


def lines(blocks: Sequence[Block], base: ModeParameters, false_alarm: float, report: Log = lambda _: None) -> Point:
    """The lines of one LTI system, each exponential alone, beside what is fitted in any case."""
    nothing, seen = np.zeros(0), 2 * sum(len(block.rows) for block in blocks)
    # A line is one unit: its exponent costs what two numbers more add to the limit of its amplitudes.
    added = chi2_limit(seen + 2, false_alarm) - chi2_limit(seen, false_alarm)
    mode_alarm = float(np.exp(-0.5 * added))  # the χ² of two numbers
    floors, price = priced(blocks, base, ROUNDING, mode_alarm=mode_alarm, harmonic_alarm=false_alarm)

    def stages(point: Point) -> Iterator[Iterable[Move]]:
        yield (*removals(point), *merges(point, 0))
        yield from additions(point, nothing, 0, width=0)

    return descended(Point.at(blocks, floors, price, base), stages, time.process_time() + SECONDS, report)


def searched_white(
    blocks: tuple[Block, ...],
    entries: ModeParameters,
    price_of: Callable[[tuple[Block, ...]], tuple[tuple[Floats, ...], Price]],
    bounds: Bounds,
    report: Log,
) -> tuple[Point, Floats | None]:
    """The search of samples after the filter that whitens the residual, and that filter (channels, taps)."""
    # The filter is None where the residual is white. The colour is judged twice: by the residual of loud modes, which
    # are no noise, and by that of all.
    taps, after = None, blocks

    def loud(point: Point) -> Iterator[Iterable[Move]]:
        yield _bands(point, bounds)
        if _room(point, bounds):
            yield from additions(point, bounds.forced, bounds.most, loud=LOUD, width=bounds.width)

    def at(samples: tuple[Block, ...], start: ModeParameters) -> Point:
        return Point.at(samples, *price_of(samples), start).settled()

    current = descended(at(blocks, entries), loud, time.process_time() + bounds.seconds, report)
    for look in range(2):
        before = taps
        plain = current if before is None else at(blocks, current.entries)
        taps = residual_filter(blocks, plain.solution)
        through = None if taps is None else filtered_blocks(blocks, taps)
        taps, after = (None, blocks) if through is None else (taps, through)
        if look and taps is None and before is None:
            break
        if taps is not None:
            report(f"the noise is coloured along the record: whitened by {taps.shape[1] - 1} taps")
        current = searched(at(after, current.entries), bounds, report)
    return current, taps


def _blurred(point: Point, angle_std: tuple[float, ...]) -> Point:
    r"""With the residual of the forced response from errors of the angle in the price: the most that one line may hold.

    .. math:: \frac 12 \sum_{c,h} N_h \sum_j (j\, a_{c,h,j}\, \sigma_{\theta,h} / s_{c,h})^2
    """
    if not angle_std:
        return point
    columns, total = point.entries.columns(), 0.0
    forced = point.entries.fixed[columns.modes] & (columns.factors[columns.modes] == PLAIN)
    for block, linear in zip(point.blocks, point.solution.linear, strict=True):
        squares = np.sum([part**2 for part in np.split(linear.coefficients, 2)], axis=0)[forced]
        share = (columns.turns[forced] * angle_std[block.hit]) ** 2 @ squares
        total += 0.5 * block.n_samples * float(share @ (1.0 / block.noise**2))
    return replace(point, price=replace(point.price, blur=max(total, point.price.blur)))
