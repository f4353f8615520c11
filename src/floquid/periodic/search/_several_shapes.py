"""Several modes of one multiplier: the hits share their shapes, and each has a part of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.fit import FARTHEST, ROUNDS
from floquid.periodic.least_squares import ModeParameters, OneShape, Solution, eliminated, real_parts


def several_shapes(start: OneShape, agrees: Callable[[OneShape], bool]) -> tuple[list[int], OneShape | None]:
    """The fit of the fewest modes of one multiplier by which the hits agree, and the entry of `start` that each is.

    None where the hits do not, or residues free in each hit have no more numbers. Two hits have two shapes of anything.
    """
    entries, places = np.flatnonzero(~start.entries.fixed).tolist(), list(range(len(start.entries.exponents)))
    while True:
        trials = [_repeated(start, [*places, entry]).with_states(steps=ROUNDS) for entry in entries]
        best = int(np.argmin([trial.cost for trial in trials]))
        places = [*places, entries[best]]
        if not _fewer(start, entries[best], places.count(entries[best])):
            return places, None
        fit = trials[best].with_states().solved()
        if not stays(fit, start.entries.exponents[places]):
            return places, None
        if agrees(fit):
            return places, fit


def _fewer(start: OneShape, entry: int, count: int) -> bool:
    """True where shapes, states and exponents of a `count` of modes are fewer numbers than residues of all hits."""
    size, hits = (1 if start.entries.real[entry] else 2), start.states.shape[1]
    shape = start.n_channels * int((start.modes[start.kept % len(start.modes)] == entry).sum())
    return count * (shape + size * (hits - 1)) + size * (count - 1) < hits * shape


def degrees_of(shared: OneShape, free: ModeParameters) -> int:
    """Numbers of residues and exponents of free entries beyond those of shapes, states and exponents."""
    modes = ~free.fixed[free.columns().modes]
    numbers = int(modes.sum() + (modes & free.sines()).sum())
    more = shared.n_rates - len(free.ties())
    return numbers * sum(len(block.rows) for block in shared.blocks) - shared.n_numbers - more


def stays(shared: OneShape, exponents: Complexes) -> bool:
    """True where no exponent is far from what it was."""
    away = np.abs(shared.entries.exponents - exponents) * 2.0 * np.pi / shared.entries.fundamental
    return bool((away < FARTHEST).all())


def groups_of(
    several: OneShape, places: Sequence[int], agrees: Callable[[OneShape], bool]
) -> tuple[tuple[int, ...], ...]:
    """The hits in two groups that each have one shape of a mode with two; empty where there are none.

    Hits of a machine that changed are so, and those that excite two modes in all proportions are not.
    """
    for entry in sorted({place for place in places if places.count(place) > 1}):
        first, second, *more = np.flatnonzero(np.array(places) == entry).tolist()
        parted = _parted(several, first, second)
        if not more and agrees(parted.solved()):
            return tuple(tuple(np.flatnonzero(parted.states[each]).tolist()) for each in (first, second))
    return ()


def _parted(several: OneShape, first: int, second: int) -> OneShape:
    """The start of a fit with each of two entries in the hits alone that are most like one of two hits."""
    block, part = several.blocks[0], several.reduced[0]
    size = np.sqrt(np.maximum(np.diag(part.gram)[: len(several.own)], 0.0))
    both = [
        size[several.modes == each, None] * several.complex_shapes[several.modes == each] for each in (first, second)
    ]
    shapes = np.stack(both, axis=-1)[:, block.rows] / block.noise[:, None]
    # What each hit has of both shapes, over the noise (2, hits), and what it has beside the shape of another hit.
    parts = np.linalg.qr(shapes.reshape(-1, 2))[1] @ several.states[[first, second]]
    products, squares = parts.conj().T @ parts, np.sum(np.abs(parts) ** 2, axis=0)
    off = squares - np.abs(products) ** 2 / np.maximum(squares, np.finfo(float).tiny)[:, None]
    ends = min(combinations(range(len(squares)), 2), key=lambda pair: float(off[list(pair)].min(axis=0).sum()))
    states, held, like = several.states.copy(), several.held.copy(), off[ends[0]] <= off[ends[1]]
    for entry, end, hits in zip((first, second), ends, (like, ~like), strict=True):
        states[entry], held[entry] = np.where(hits, products[end] / squares[end], 0.0), end
    return OneShape(several.blocks, several.entries, several.linear, states, held).with_states()


def difference(start: OneShape, entry: int) -> float:
    """Difference of the free residues of an entry from one shape, over its response, in amplitude."""
    off = size = 0.0
    rows = np.flatnonzero(np.tile(start.modes == entry, 2))
    for block, reduced, values in zip(start.blocks, start.reduced, start.coefficients, strict=True):
        gram, own = reduced.gram[np.ix_(rows, rows)], values[start.own]
        apart, whole = real_parts(own - reduced.seen[start.own])[rows], real_parts(own)[rows]
        off += float(np.sum(apart * (gram @ apart) / block.noise**2))
        size += float(np.sum(whole * (gram @ whole) / block.noise**2))
    return float(np.sqrt(off / max(size, np.finfo(float).tiny)))


def carried(solution: Solution, places: Sequence[int]) -> Floats | None:
    """Additions to variances of a solution, for its entries at other places."""
    entries, further = solution.entries, solution.further
    if further is None:
        return None
    leading, pairs = np.flatnonzero(entries.leading), np.flatnonzero(entries.leading & ~entries.real)
    decays, turns, rest = np.split(further, [len(leading), len(leading) + len(pairs)])
    both = [dict(zip(of.tolist(), values, strict=True)) for of, values in ((leading, decays), (pairs, turns))]
    return np.concatenate([*([of[place] for place in places if place in of] for of in both), rest])


def _repeated(start: OneShape, places: list[int]) -> OneShape:
    """The start of a fit of the entries of these places; one that is there often has its strongest shapes."""
    states, held = start.states[places], start.held[places]
    for entry in {place for place in places if places.count(place) > 1}:
        copies = np.flatnonzero(np.array(places) == entry)
        # As many as there are hits can be told.
        each = np.linalg.svd(_residues(start, entry), full_matrices=False)[2][: len(copies)]
        states[copies[: len(each)]], held[copies[: len(each)]] = each, np.argmax(np.abs(each), axis=1)
    states = states / states[np.arange(len(held)), held][:, None]
    entries = start.entries.picked(places)
    return OneShape(start.blocks, entries, tuple(eliminated(start.blocks, entries)), states, held)


def _residues(start: OneShape, entry: int) -> Complexes:
    """The free residues of an entry over their noise (columns and channels, hits)."""
    columns = start.modes == entry
    seen = np.zeros((int(columns.sum()), start.n_channels, start.states.shape[1]), complex)
    for block, part in zip(start.blocks, start.reduced, strict=True):
        size = np.sqrt(np.maximum(np.diag(part.gram)[: len(start.own)], 0.0))[columns]
        seen[:, block.rows, block.hit] = size[:, None] * part.seen[start.own][columns] / block.noise
    rows = seen.reshape(-1, seen.shape[2])
    return np.concatenate([rows.real, rows.imag]) if start.entries.real[entry] else rows
