"""The order of moves for free responses, and the sets of modes to start from."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid.periodic.least_squares import Block, ModeParameters, RecordBlock, linearise
from floquid.periodic.least_squares._residual import least_noise
from floquid.search._additions import additions
from floquid.search._descend import descended
from floquid.search._moves import Move, bands, branches, kinds, merges, removals, splits
from floquid.search._objective import Point, Price

SECONDS = 60.0  # processor time of a search [s] after which the least J is reported as it is

Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a search is held to."""

    most: int  # the highest harmonic of the axis that the sampling shows
    modes: int  # modes at most, a pair counted once
    forced: Floats  # turns a period that a forced response may have; empty when none is looked for (harmonics,)
    choose: bool = True  # whether bands are chosen
    search: bool = True  # whether modes may be added, removed, split, merged and change their kind
    loud: float = 1.0  # times the price that a peak of the residual has to promise


def begun(
    blocks: Sequence[Block], base: ModeParameters, floor: float, most: int, false_alarm: float = 1e-3
) -> tuple[tuple[Floats, ...], Price]:
    """The least noise of each block, and the price of units."""
    first = linearise(blocks, base)
    floors = tuple(least_noise(blocks, first, floor))
    rows = sum(len(block.rows) for block in blocks)
    samples = max(sum(block.n_samples for block in blocks if block.hit == hit) for hit in {b.hit for b in blocks})
    return floors, Price(false_alarm, rows, samples, 2 * most + 1)


def searched(
    blocks: Sequence[Block],
    floors: Sequence[Floats],
    price: Price,
    starts: Sequence[ModeParameters],
    bounds: Bounds,
    log: Log = lambda _: None,
    seconds: float = SECONDS,
) -> Point:
    """The least J of the descents from several sets of modes."""
    until = time.process_time() + seconds
    best: Point | None = None
    for start in starts:
        first = Point.at(blocks, floors, price, start).settled()
        log(f"start: {int((~start.fixed).sum())} modes, J {first.value:.0f}")
        found = descended(first, lambda point: _stages(point, bounds), until, log)
        log(f"end: J {found.value:.0f}")
        best = found if best is None or found.value < best.value else best
    assert best is not None
    return best


def _stages(point: Point, bounds: Bounds) -> Iterator[Iterable[Move]]:
    """Moves in groups: a group is made only where none of those before lowers J."""
    free = int((~point.entries.fixed).sum())
    if bounds.choose or bounds.search:
        yield _structural(point, bounds)
    if bounds.search and any(isinstance(block, RecordBlock) and block.speeds is not None for block in point.blocks):
        yield branches(point)
    if bounds.search:
        yield additions(point, bounds.forced, bounds.most, loud=bounds.loud, room=free < bounds.modes)


def _structural(point: Point, bounds: Bounds) -> Iterator[Move]:
    room = int((~point.entries.fixed).sum()) < bounds.modes
    if bounds.choose and (~point.entries.fixed).any():
        yield from bands(point, bounds.most)
    if bounds.search:
        yield from removals(point)
        yield from splits(point) if room else ()
        yield from merges(point, bounds.most)
        yield from kinds(point)
