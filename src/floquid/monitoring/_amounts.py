"""Amounts of sidebands of records, on one reference shape or along a template, and their trend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid.fit import RARE
from floquid.monitoring._types import Trend
from floquid.shapes import PeriodicAmount, Sidebands
from floquid.surveys import Matches, Point

MISSING = 0.1  # share of the response whose sidebands may be missing in an amount: more would look like a change of it
FEWEST = 3  # records of a trend


@dataclass(frozen=True, slots=True)
class Aligned:
    """Sidebands of a record on the reference shapes, and the places of its modes among those of the reference."""

    places: Integers
    sidebands: Sidebands


def aligned(points: Sequence[Point], matches: Matches, baseline: Mask) -> list[Aligned | None]:
    """Sidebands of each point on the shapes of that point of the baseline that has most."""
    rows = [_rows(point, matches, k) for k, point in enumerate(points)]
    first = max(np.flatnonzero(baseline).tolist(), key=lambda k: len(rows[k]), default=None)
    if first is None or not rows[first]:
        return [None] * len(points)
    tracks = np.array(sorted(rows[first]))
    own = points[first].sidebands
    assert own is not None
    reference = own.picked(np.array([rows[first][track] for track in tracks.tolist()]))
    out: list[Aligned | None] = []
    for point, row in zip(points, rows, strict=True):
        places: Indices = np.flatnonzero([track in row for track in tracks.tolist()])
        if point.sidebands is None or not len(places) or point.sidebands.channels != reference.channels:
            out.append(None)
            continue
        chosen = np.array([row[track] for track in tracks[places].tolist()])
        out.append(Aligned(places, point.sidebands.on(reference.picked(places), chosen)))
    return out


def _rows(point: Point, matches: Matches, number: int) -> dict[int, int]:
    """The row of the sidebands of a point for each track whose branch is that of its model."""
    if point.sidebands is None:
        return {}
    own = point.sidebands.modes.tolist()
    return {
        track: own.index(mode)
        for track, mode in enumerate(matches.modes[number].tolist())
        if mode in own and not matches.shifts[number, track] and not matches.mirrored[number, track]
    }


def amounts_without_model(records: Sequence[Aligned | None]) -> list[PeriodicAmount | None]:
    """The amount of each record whose sidebands are those of nearly all of the response."""
    return [
        None if own is None or own.sidebands.shares.sum() < 1.0 - MISSING else own.sidebands.amount() for own in records
    ]


@dataclass(frozen=True, slots=True)
class Template:
    """The change of the sidebands that is looked for, by the place of the mode, and sidebands without it."""

    changes: dict[int, Complexes]
    origins: dict[int, Complexes]
    measured: Sidebands | None  # whose noise is in the changes
    places: Integers


def template_of(records: Sequence[Aligned | None], labelled: Sequence[Aligned], baseline: Mask) -> Template | None:
    """The change from a healthy to a damaged result, or from the baseline to one; None where it is below its noise."""
    origins = _mean([own for own, inside in zip(records, baseline, strict=True) if own is not None and inside])
    damaged = labelled[-1]
    if len(labelled) > 1:
        origin = dict(zip(labelled[0].places.tolist(), labelled[0].sidebands.values, strict=True))
    else:
        origin = origins
    shared = [k for k in damaged.places.tolist() if k in origin and k in origins]
    if not shared:
        return None
    own = damaged.sidebands.picked(np.searchsorted(damaged.places, shared))
    changes = own.values - np.array([origin[k] for k in shared])
    measured = own if own.covariance.any() else None
    if measured is not None and measured.chance(changes) > RARE:
        return None
    return Template(dict(zip(shared, changes, strict=True)), origins, measured, np.array(shared))


def amounts_along(records: Sequence[Aligned | None], template: Template) -> tuple[Floats, Floats]:
    """The amount of a template in each record, and its deviation (records,)."""
    out = np.full((2, len(records)), np.nan)
    for row, own in enumerate(records):
        shared = [] if own is None else [k for k in own.places.tolist() if k in template.changes]
        if own is None or not shared:
            continue
        here = own.sidebands.picked(np.searchsorted(own.places, shared))
        changes, origin = (np.array([of[k] for k in shared]) for of in (template.changes, template.origins))
        spread = None
        if template.measured is not None:
            spread = template.measured.picked(np.searchsorted(template.places, shared)).covariance
        out[:, row] = here.along(changes, origin, spread)
    return out[0], out[1]


def _mean(records: Sequence[Aligned]) -> dict[int, Complexes]:
    """The mean sidebands of each mode (channels, 2)."""
    found: dict[int, list[Complexes]] = {}
    for own in records:
        for place, values in zip(own.places.tolist(), own.sidebands.values, strict=True):
            found.setdefault(place, []).append(values)
    return {place: np.mean(values, axis=0) for place, values in found.items()}


def trend_of(x: Floats, values: Floats, std: Floats | None) -> Trend | None:
    """The slope of values over x (records,) by weighted least squares, and its test."""
    from scipy.special import stdtr

    there = np.isfinite(values) & np.isfinite(x)
    if there.sum() < FEWEST or np.ptp(x[there]) <= 0.0:
        return None
    weights = np.ones(there.sum()) if std is None else std[there] ** -2.0
    y, t = values[there], x[there] - np.average(x[there], weights=weights)
    information = float(weights @ t**2)
    slope = float(weights @ (t * y)) / information
    rest = y - np.average(y, weights=weights) - slope * t
    scale = float(weights @ rest**2) / (len(y) - 2)
    deviation = float(np.sqrt((scale if std is None else max(scale, 1.0)) / information))
    chance = 2.0 * float(stdtr(len(y) - 2, -abs(slope) / deviation)) if deviation > 0.0 else 1.0
    return Trend(slope=slope, std=deviation, p_value=chance)
