"""Modes followed from point to point: branches, the assignment of objects to tracks, and how sure each link is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Sealed
from floquid.surveys._objects import (
    BRANCHES,
    Seen,
    basis_of,
    branch_of,
    flat,
    moved,
    similarities_of_all,
    similarity,
    turn_between,
)
from floquid.surveys._points import check_alike, objects_of
from floquid.surveys._types import Point, Survey

NEAR = 0.05  # of ω: a step of the exponent that costs as much as shapes at right angles
LEFT_OUT = 0.1  # cost of each point between
DEAREST = 0.9  # cost above which there is no link
TURN = 0.02  # fall of the cost a link from which records have phases of their own: of one phase, false modes make 0.005
MEMORY = 6  # objects of a path that a new one is compared with: two modes that lock with each other share their shapes
DRAWS = 200  # of exponents and shapes from their covariances


@dataclass(frozen=True, slots=True)
class Step:
    """A link as it is made: the cost, that of the best other choice, the similarity and the confidence."""

    cost: float
    runner_up: float
    mac: float
    confidence: float


Drawn: TypeAlias = tuple[Complexes, Complexes]
"""Exponents (draws, modes) and shapes (draws, modes, channels, harmonics)."""


@dataclass(frozen=True, slots=True)
class Held:
    """An object of a path and draws of it, on the path's branch, and the branch itself."""

    own: Seen
    drawn: Complexes  # exponents of the draws (draws, modes) [1/s]
    bases: Complexes  # orthonormal rows that span the shapes of each (draws, modes, numbers)
    shift: int = 0
    mirrored: bool = False


@dataclass(slots=True)
class Path:
    """Objects of one track by point, and the link that led to each but the first."""

    places: list[int]
    objects: list[Held]
    steps: list[Step] = field(default_factory=list)

    def predicted(self, x: Floats, point: int) -> complex:
        """λ at a point: the last one, and half of the last step's slope in its imaginary part."""
        last = self.objects[-1].own.exponent
        if len(self.places) < 2:
            return last
        before = self.objects[-2].own.exponent
        slope = (last.imag - before.imag) / (x[self.places[-1]] - x[self.places[-2]])
        return last + 0.5j * slope * (x[point] - x[self.places[-1]])


@dataclass(frozen=True, slots=True)
class Match:
    """The branch of an object that continues a path, and how well it does."""

    shift: int
    conjugated: bool
    mac: float
    step: float  # |Δλ|² over the square of its limit
    like: int  # the object of the path that it is most like, from the end


def tracked(points: Sequence[Sequence[Seen]], x: Floats, gap: int, seed: int = 0) -> list[Path]:
    """Tracks through the objects of points, which ascend in `x` (points,); a path of one object is none yet."""
    common, own = (_tracked(points, x, gap, seed, turns=turns) for turns in (False, True))
    links = sum(len(path.steps) for path in own)
    return own if _cost(own) < _cost(common) - TURN * links else common


def _cost(paths: Sequence[Path]) -> float:
    """The cost of all links, and of each path that begins."""
    return sum(DEAREST + sum(step.cost for step in path.steps) for path in paths)


def _tracked(points: Sequence[Sequence[Seen]], x: Floats, gap: int, seed: int, *, turns: bool) -> list[Path]:
    """Tracks where all points have one phase zero, or each has its own and turns to that of the one before."""
    generator = np.random.default_rng(seed)
    paths: list[Path] = []
    for point, given in enumerate(points):
        active = [path for path in paths if point - path.places[-1] <= 1 + gap]
        known, wanted = [path.objects[-1].own for path in active], [path.predicted(x, point) for path in active]
        angle = turn_between(known, given, wanted, NEAR) if turns else 0.0
        objects = [thing.turned(angle) for thing in given]
        drawn = [thing.drawn(DRAWS, generator) for thing in objects]
        matches = [[match_of(path, new, x, point) for new in objects] for path in active]
        waits = np.array([point - path.places[-1] - 1 for path in active], float)
        costs = np.array([[1.0 - match.mac + min(1.0, match.step) for match in row] for row in matches])
        costs = costs.reshape(len(active), len(objects)) + LEFT_OUT * waits[:, None]
        chosen = assigned(costs)
        stays = _stays(active, objects, drawn, matches, waits, chosen, x, point)
        for row, column in enumerate(chosen):
            if column < 0:
                continue
            match = matches[row][column]
            others = np.concatenate([np.delete(costs[row], column), np.delete(costs[:, column], row), [2.0]])
            cost, runner_up = float(costs[row, column]), float(others.min())
            excess = max(0.0, cost / max(runner_up - cost, 1e-9) - 1.0)
            sure = stays[row] * np.exp(-excess) * known[row].agreement * objects[column].agreement
            active[row].places.append(point)
            on = objects[column].on(match.shift, match.conjugated)
            lam, shapes = _on(drawn[column], objects[column], match)
            active[row].objects.append(Held(on, lam, basis_of(flat(shapes)), match.shift, match.conjugated))
            active[row].steps.append(Step(cost, runner_up, match.mac, float(sure)))
        taken = set(chosen.tolist())
        begun = [(new, *drawn[k]) for k, new in enumerate(objects) if k not in taken]
        paths += [Path([point], [Held(new, lam, basis_of(flat(shapes)))]) for new, lam, shapes in begun]
    return paths


def match_of(path: Path, new: Seen, x: Floats, point: int) -> Match:
    """The branch of `new` that continues a path: of those that are alike, the one nearest to the prediction."""
    remembered = similarities_of_all([known.own for known in path.objects[-MEMORY:]], new)
    found = remembered.max(axis=0)
    best, away = branch_of(found, new, path.predicted(x, point))
    like = int(remembered[:, best].argmax()) - len(remembered)
    return Match(*BRANCHES[best], float(found[best]), abs(away) ** 2 / (NEAR * new.fundamental) ** 2, like)


def assigned(costs: Floats, dearest: float = DEAREST) -> Indices:
    """The object that continues each path (paths,), -1 where none is near enough: `costs` are above the dearest."""
    from scipy.optimize import linear_sum_assignment

    count, objects = costs.shape
    alone = np.where(np.eye(count, dtype=bool), dearest, 1e6)
    _, columns = linear_sum_assignment(np.hstack([costs, alone]))
    return np.where(columns < objects, columns, -1)


def _stays(
    active: Sequence[Path],
    objects: Sequence[Seen],
    drawn: Sequence[Drawn],
    matches: Sequence[Sequence[Match]],
    waits: Floats,
    chosen: Indices,
    x: Floats,
    point: int,
) -> Floats:
    """Share of draws from the covariances in which each path keeps its object (paths,)."""
    if not len(active) or not len(objects):
        return np.ones(len(active))
    costs = np.empty((DRAWS, len(active), len(objects)))
    for row, path in enumerate(active):
        last = path.objects[-1]
        step = path.predicted(x, point) - last.own.exponent
        for column, (match, thing) in enumerate(zip(matches[row], objects, strict=True)):
            lam, shapes = _on(drawn[column], thing, match)
            mac = similarity(path.objects[match.like].bases, basis_of(flat(shapes)))
            away = np.abs(lam.mean(axis=1) - last.drawn.mean(axis=1) - step) ** 2
            limit = (NEAR * thing.fundamental) ** 2
            costs[:, row, column] = 1.0 - mac + np.minimum(1.0, away / limit) + LEFT_OUT * waits[row]
    return np.mean([assigned(own) == chosen for own in costs], axis=0)


def _on(drawn: Drawn, thing: Seen, match: Match) -> Drawn:
    """Draws of an object on the branch of a match."""
    lam, shapes = drawn
    if match.conjugated:
        lam, shapes = lam.conj(), shapes.conj()[..., ::-1]
    return lam + 1j * match.shift * thing.fundamental, moved(shapes, match.shift)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches(Sealed):
    """Modes of records by the mode of the machine that they are, on one branch."""

    exponents: Complexes  # λ [1/s], NaN where a mode is missing (records, modes)
    modes: Integers  # the mode of the record's model, -1 where it is missing (records, modes)
    shifts: Integers  # fundamentals by which λ is that of the model moved (records, modes)
    mirrored: Mask  # λ is that of the mirror image (records, modes)

    def covariance(self, points: Sequence[Point]) -> Floats:
        """Covariance of Re λ, then Im λ, of the modes of each of the `points` (records, 2 modes, 2 modes)."""
        count = self.modes.shape[1]
        out = np.full((len(points), 2 * count, 2 * count), np.nan)
        for row, point in enumerate(points):
            there = np.flatnonzero(self.modes[row] >= 0)
            if point.model is None or point.model.covariance is None or not len(there):
                continue
            parts = np.concatenate([self.modes[row, there], self.modes[row, there] + point.model.order])
            sign = np.concatenate([np.ones(len(there)), np.where(self.mirrored[row, there], -1.0, 1.0)])
            places = np.concatenate([there, there + count])
            own = point.model.covariance[np.ix_(parts, parts)] * np.multiply.outer(sign, sign)
            out[row, places[:, None], places] = own
        return out


def match_records(points: Sequence[Point], baseline: Mask, near: Floats, of: str) -> Matches:
    """Match the modes of `points` with those of the `baseline` (records,), by shapes and exponents.

    Each record is compared with the record of the baseline that is nearest to it in `near` (records, quantities), as
    far as that has the mode; the baseline is gone through from its middle outwards. Weak modes, results that fail and
    two real multipliers in place of a pair count as missing. Raises InputError in the words of the caller `of`, where
    periods, channels or units do not fit.
    """
    check_alike(points, of)
    objects = [
        [] if point.reason is not None else [own for own in seen if not own.weak and len(own.modes) == 1]
        for point, seen in zip(points, objects_of(points, of), strict=True)
    ]
    chosen = np.flatnonzero(baseline)
    middle = np.median(near[chosen], axis=0) if len(chosen) else np.zeros(near.shape[1])
    off = np.sum((near - middle) ** 2, axis=1)
    first = min(chosen, key=lambda k: (-len(objects[k]), off[k]), default=None)
    tracks: list[dict[int, Held]] = []
    if first is not None:
        tracks = [{int(first): Held(own, own.exponents[None], own.basis[None])} for own in objects[first]]
        tracks.sort(key=lambda track: abs(track[int(first)].own.exponent.imag))
        from_there = np.sum((near - near[first]) ** 2, axis=1)
        others = [k for k in range(len(points)) if k != first]
        for k in sorted(others, key=lambda k: (not baseline[k], from_there[k] if baseline[k] else 0.0)):
            _put(tracks, k, objects[k], baseline, near)
    shape = (len(points), len(tracks))
    exponents, modes = np.full(shape, complex(np.nan, np.nan)), np.full(shape, -1)
    shifts, mirrored = np.zeros(shape, np.int64), np.zeros(shape, bool)
    for column, track in enumerate(tracks):
        real = np.median([track[k].own.real for k in track if baseline[k]]) > 0.5
        for k, held in track.items():
            if held.own.real == real:
                exponents[k, column], modes[k, column] = held.own.exponent, held.own.modes[0]
                shifts[k, column], mirrored[k, column] = held.shift, held.mirrored
    return Matches(exponents=exponents, modes=modes, shifts=shifts, mirrored=mirrored)


def matches_of(survey: Survey) -> Matches:
    """Modes of the points of a `survey` by its tracks; those that are weak, or two real multipliers, are missing."""
    shape = (len(survey.points), len(survey.tracks))
    exponents, modes = np.full(shape, complex(np.nan, np.nan)), np.full(shape, -1)
    shifts, mirrored = np.zeros(shape, np.int64), np.zeros(shape, bool)
    for column, track in enumerate(survey.tracks):
        failed = np.array([survey.points[k].reason is not None for k in track.points])
        used = ~(track.weak | track.locked | failed)
        rows = track.points[used]
        exponents[rows, column], modes[rows, column] = track.exponents[used, 0], track.modes[used, 0]
        shifts[rows, column], mirrored[rows, column] = track.shifts[used], track.mirrored[used]
    return Matches(exponents=exponents, modes=modes, shifts=shifts, mirrored=mirrored)


def _put(tracks: Sequence[dict[int, Held]], point: int, objects: Sequence[Seen], baseline: Mask, near: Floats) -> None:
    """Give the objects of a point to the tracks that they continue."""
    if not objects:
        return
    place = np.zeros(1)
    paths = [Path([0], [track[_nearest(track, point, baseline, near)]]) for track in tracks]
    matches = [[match_of(path, new, place, 0) for new in objects] for path in paths]
    costs = np.array([[1.0 - match.mac + min(1.0, match.step) for match in row] for row in matches])
    columns: Indices = assigned(costs)
    for track, row, column in zip(tracks, matches, columns.tolist(), strict=True):
        if column >= 0:
            shift, conjugated = row[column].shift, row[column].conjugated
            on = objects[column].on(shift, conjugated)
            track[point] = Held(on, on.exponents[None], on.basis[None], shift, conjugated)


def _nearest(track: dict[int, Held], point: int, baseline: Mask, near: Floats) -> int:
    """The record of the baseline on a track that is nearest to a point."""
    own = np.array([k for k in track if baseline[k]])
    return int(own[np.sum((near[own] - near[point]) ** 2, axis=1).argmin()])
