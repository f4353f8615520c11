"""Modes of records of one machine, matched with those of a baseline: no operating point orders them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Sealed
from floquid.surveys._objects import Seen
from floquid.surveys._points import check_alike, objects_of
from floquid.surveys._tracking import Held, Path, assigned, match_of
from floquid.surveys._types import Point, Survey


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matches(Sealed):
    """Modes of records by the mode of the machine that they are, on one branch.

    Parameters
    ----------
    exponents
        λ [1/s], NaN where a mode is missing (records, modes).
    modes
        The mode of the record's model, -1 where it is missing (records, modes).
    shifts, mirrored
        The branch: λ is that of the model moved by this many fundamentals, of the mirror image where `mirrored`
        (records, modes).
    """

    exponents: Complexes
    modes: Integers
    shifts: Integers
    mirrored: Mask

    def covariance(self, points: Sequence[Point]) -> Floats:
        """Covariance of Re λ, then Im λ, of the modes of each of the `points` (records, 2 modes, 2 modes).

        NaN where a mode is missing.
        """
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
