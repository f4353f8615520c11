"""Boundaries of stability: thin bands looked for, edges halved down to a tolerance, cells refined about a boundary."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Indices, Integers, Mask
from floquid.floquet.stability_maps._spectra import Spectra, inverse, joined

Evaluate: TypeAlias = Callable[[Floats, str], Spectra]
"""Points (points, parameters) and what they are for -> their spectra."""


class Samples(NamedTuple):
    """Points that are known, and what is known of them."""

    points: Floats  # (points, parameters)
    spectra: Spectra
    unstable: Mask


class Cells(NamedTuple):
    """Points on a lattice, and the cells between them."""

    samples: Samples
    lattice: Integers  # sample at each node of the finest lattice, -1 where none is (nodes of the first, of the second)

    cells: Integers  # first corner and width of each, in steps of the lattice (cells, 3)


def samples(points: Floats, found: Spectra, margin: float) -> Samples:
    """The points with their verdicts: unstable is what grows faster than `margin`, whatever the errors."""
    return Samples(points, found, found.certain > margin)


def added(old: Samples, new: Samples) -> Samples:
    """Join old and new samples, the new ones last."""
    return Samples(
        np.concatenate([old.points, new.points]),
        joined([old.spectra, new.spectra]),
        np.concatenate([old.unstable, new.unstable]),
    )


def taken(of: Samples, index: Indices) -> Samples:
    """The samples of these indices, in their order."""
    return Samples(of.points[index], Spectra._make(column[index] for column in of.spectra), of.unstable[index])


def swapped(vectors: NDArray[np.complex64], first: Indices, second: Indices) -> Mask:
    r"""True where neighbours on the unit circle change places between two samples (pairs,).

    The multipliers are in the order of their angles. Where two meet and pass, the eigenvectors of their places do:

    .. math:: |w_k v'_{k+1}|\, |w_{k+1} v'_k| > |w_k v'_k|\, |w_{k+1} v'_{k+1}|

    with w the left eigenvectors of one sample and v' the right ones of the other. What meets may lock, in a band of
    instability between the two samples however thin.
    """
    out = np.zeros(len(first), dtype=np.bool_)
    if not len(first) or vectors.shape[1] == 1:
        return out
    with np.errstate(invalid="ignore", over="ignore"):
        overlap = np.abs(inverse(vectors[first].astype(np.complex128)) @ vectors[second])
        here = np.arange(vectors.shape[1])
        there = np.roll(here, -1)
        crossed = overlap[:, here, there] * overlap[:, there, here]
        straight = overlap[:, here, here] * overlap[:, there, there]
        return np.asarray((crossed > straight).any(axis=1), dtype=np.bool_)


def thin_bands(known: Samples, evaluate: Evaluate, margin: float, halvings: int) -> Samples:
    """More samples of one parameter, sorted, where a band or a gap may hide between those known."""
    thinnest = np.diff(known.points[:, 0]) * 2.0**-halvings
    # Of the interval that each sample begins; the last one stands for none.
    limit = np.append(thinnest, np.inf)
    for turn in range(1, 2 * halvings + 1):
        place = known.points[:, 0]
        gaps = np.flatnonzero(_hiding(known) & (np.diff(place) > 1.5 * limit[:-1]))
        if not gaps.size:
            break
        middle = 0.5 * (place[gaps] + place[gaps + 1])
        new = samples(middle[:, None], evaluate(middle[:, None], f"looking for thin bands: pass {turn}"), margin)
        limit = np.concatenate([limit, limit[gaps]])
        known = added(known, new)
        order = np.argsort(known.points[:, 0], kind="stable")
        known, limit = taken(known, order), limit[order]
    return known


def _hiding(known: Samples) -> Mask:
    """True for intervals between samples in which a change of stability may hide (samples - 1,)."""
    calm = ~known.unstable[:-1] & ~known.unstable[1:]
    out = np.zeros(len(calm), dtype=np.bool_)
    pairs = np.flatnonzero(calm)
    out[pairs] = swapped(known.spectra.vectors, pairs, pairs + 1)
    growth = known.spectra.growth
    error = growth - known.spectra.certain
    with np.errstate(invalid="ignore"):
        rise = growth[1:-1] - error[1:-1] > np.maximum(growth[:-2] + error[:-2], growth[2:] + error[2:])
        fall = growth[1:-1] + error[1:-1] < np.minimum(growth[:-2] - error[:-2], growth[2:] - error[2:])
    peak = rise & ~known.unstable[1:-1] & calm[:-1] & calm[1:]
    dip = fall & known.unstable[:-2] & known.unstable[1:-1] & known.unstable[2:]
    out[:-1] |= peak | dip
    out[1:] |= peak | dip
    return out


def bisect(
    calm: Floats, wild: Floats, tolerance: Floats, evaluate: Evaluate, margin: float
) -> tuple[Floats, list[Samples]]:
    """The edges between stable and unstable points (edges, parameters) to `tolerance`, and what was met on the way."""
    calm, wild = calm.copy(), wild.copy()
    met = []
    width = np.abs(wild - calm)
    rounds = int(np.ceil(np.log2(np.maximum((width / tolerance).max(initial=1.0), 1.0))))
    open_ = np.arange(len(calm))
    for turn in range(1, rounds + 1):
        open_ = open_[(np.abs(wild[open_] - calm[open_]) > tolerance).any(axis=1)]
        middle = 0.5 * (calm[open_] + wild[open_])
        moved = (middle != calm[open_]).any(axis=1) & (middle != wild[open_]).any(axis=1)
        open_, middle = open_[moved], middle[moved]
        if not open_.size:
            break
        found = samples(middle, evaluate(middle, f"refining edges: pass {turn} of {rounds}"), margin)
        met.append(found)
        wild[open_[found.unstable]] = middle[found.unstable]
        calm[open_[~found.unstable]] = middle[~found.unstable]
    return 0.5 * (calm + wild), met


def refine(grids: tuple[Floats, ...], known: Samples, evaluate: Evaluate, margin: float, levels: int) -> Cells:
    """Cells of two parameters, the second fastest in `known`, halved `levels` times where stability changes or may."""
    step = 2**levels
    counts = tuple(len(grid) for grid in grids)
    lattice = np.full(tuple((count - 1) * step + 1 for count in counts), -1, dtype=np.int64)
    lattice[::step, ::step] = np.arange(len(known.points)).reshape(counts)
    corner = np.indices(tuple(count - 1 for count in counts)).reshape(2, -1).T * step
    cells = np.column_stack([corner, np.full(len(corner), step)])
    fresh = np.ones(len(cells), dtype=np.bool_)
    for turn in range(1, 4 * levels + 1):
        split = _split(known, lattice, cells, fresh)
        if not split.any():
            break
        half = cells[split, 2] // 2
        nodes = cells[split, None, :2] + half[:, None, None] * np.array([[0, 1], [1, 0], [1, 1], [1, 2], [2, 1]])
        nodes = np.unique(nodes.reshape(-1, 2), axis=0)
        nodes = nodes[lattice[nodes[:, 0], nodes[:, 1]] < 0]
        if len(nodes):
            at = [np.interp(nodes[:, k] / step, np.arange(counts[k]), grids[k]) for k in (0, 1)]
            points = np.column_stack(at)
            new = samples(points, evaluate(points, f"refining cells: pass {turn}"), margin)
            lattice[nodes[:, 0], nodes[:, 1]] = len(known.points) + np.arange(len(nodes))
            known = added(known, new)
        quarter = cells[split, None, :2] + half[:, None, None] * np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        children = np.column_stack([quarter.reshape(-1, 2), np.repeat(half, 4)])
        fresh = np.concatenate([np.zeros(int((~split).sum()), dtype=np.bool_), np.ones(len(children), dtype=np.bool_)])
        cells = np.concatenate([cells[~split], children])
    return Cells(known, lattice, cells)


def _corners(cells: Integers, lattice: Integers) -> Integers:
    """The samples at the corners of each cell, in turn (cells, 4)."""
    nodes = cells[:, None, :2] + cells[:, 2, None, None] * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return lattice[nodes[..., 0], nodes[..., 1]]


def _split(known: Samples, lattice: Integers, cells: Integers, fresh: Mask) -> Mask:
    """Mask of the cells to halve."""
    corners = _corners(cells, lattice)
    wild = known.unstable[corners]
    mixed = wild.any(axis=1) & ~wild.all(axis=1)
    # A neighbour may have found, in the middle of a common side, what the ends do not show.
    half = cells[:, 2] // 2
    sides = cells[:, None, :2] + half[:, None, None] * np.array([[1, 0], [2, 1], [1, 2], [0, 1]])
    middle = np.where((half > 0)[:, None], lattice[sides[..., 0], sides[..., 1]], -1)
    seen = (middle >= 0) & (known.unstable[middle] != wild[:, :1])
    hiding = np.zeros(len(cells), dtype=np.bool_)
    calm = np.flatnonzero(fresh & ~wild.any(axis=1))
    ends = np.stack([corners[calm], np.roll(corners[calm], -1, axis=1)], axis=2).reshape(-1, 2)
    ends, back = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    hiding[calm] = swapped(known.spectra.vectors, ends[:, 0], ends[:, 1])[back.ravel()].reshape(-1, 4).any(axis=1)
    return (half > 0) & (mixed | seen.any(axis=1) | hiding)


def boundary(of: Cells, tolerance: Floats, evaluate: Evaluate, margin: float) -> tuple[Floats, list[Samples]]:
    """The segments of the boundary (segments, 2, 2): ends, then parameters; and what was met on the way."""
    known = of.samples
    corners = _corners(of.cells, of.lattice)
    wild = known.unstable[corners]
    cut = np.flatnonzero(wild.any(axis=1) & ~wild.all(axis=1))
    if not cut.size:
        return np.empty((0, 2, 2)), []
    ends = np.stack([corners[cut], np.roll(corners[cut], -1, axis=1)], axis=2)
    crossing = known.unstable[ends[..., 0]] != known.unstable[ends[..., 1]]
    sides, back = np.unique(np.sort(ends[crossing], axis=1), axis=0, return_inverse=True)
    first_wild = known.unstable[sides[:, 0]]
    calm = known.points[np.where(first_wild, sides[:, 1], sides[:, 0])]
    unstable = known.points[np.where(first_wild, sides[:, 0], sides[:, 1])]
    edges, met = bisect(calm, unstable, tolerance, evaluate, margin)
    place = np.full(crossing.shape, -1)
    place[crossing] = back.ravel()
    # Four crossings: opposite corners agree. Each unstable corner is cut off alone.
    twice = crossing.all(axis=1)
    pairs = [place[~twice][crossing[~twice]].reshape(-1, 2)]
    for row, first in zip(place[twice], wild[cut[twice], 0], strict=True):
        pairs.append(row[[3, 0, 1, 2]].reshape(2, 2) if first else row.reshape(2, 2))
    return edges[np.concatenate(pairs)], met
