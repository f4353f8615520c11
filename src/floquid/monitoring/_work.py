"""Records in order, those of the baseline, covariates and their errors: what is compared with what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Mask
from floquid._checks import counted, input_error
from floquid._show import late
from floquid.surveys import Matches, Point, point_of

OF = "monitor"
USUAL = ("speed_rpm", "temperature")
"""Covariates by default, those that the records have."""

SAME = 1e-9  # share of a covariate within which two values are one: rounding
DIGITS = 9  # significant digits of a covariate beyond which its resolution is that of floating point


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Records, their matched modes and covariates, and what is asked of them."""

    points: tuple[Point, ...]
    labelled: tuple[Point, ...]
    matches: Matches
    healthy: Mask
    names: tuple[str, ...]
    conditions: Floats
    degree: int
    rate: float
    given: bool
    along: Floats | None
    x: Floats

    @property
    def every(self) -> tuple[Point, ...]:
        """The records, then those that say what is looked for."""
        return (*self.points, *self.labelled)

    def varying(self, inside: Mask) -> Mask:
        """True of covariates that vary over records that are `inside` (covariates,)."""
        own = self.conditions[inside]
        if not len(own):
            return np.zeros(len(self.names), bool)
        return np.asarray(np.ptp(own, axis=0) > SAME * np.abs(own).max(axis=0))


def as_record(one: Any) -> Point:
    loaded = late("store", "load")(one) if isinstance(one, (str, PathLike)) else one
    return point_of(loaded, sidebands=True)


def labelled_of(direction: Any) -> tuple[Point, ...]:
    """The results that say what is looked for: one of the damaged machine, or a healthy and a damaged one."""
    if direction is None or is_array(direction):
        return ()
    return tuple(as_record(one) for one in (direction if isinstance(direction, tuple) else (direction,)))


def is_array(direction: Any) -> bool:
    """True where a direction is numbers."""
    return isinstance(direction, (np.ndarray, list))


def ordered(points: Sequence[Point], over: str | None) -> tuple[tuple[Point, ...], np.ndarray]:
    """The points in the order of a quantity, and their places before."""
    if over is None:
        return tuple(points), np.arange(len(points))
    missing = [k for k, point in enumerate(points) if over not in point.values]
    if missing:
        got = f"record {missing[0]} ({file_of(points[missing[0]])}) has none"
        raise input_error("over", OF, f"be a quantity of every record, and not {over}", got, "Leave `over` out.")
    order = np.argsort([point.values[over] for point in points], kind="stable")
    return tuple(points[k] for k in order), order


def reordered(matches: Matches, order: np.ndarray) -> Matches:
    return Matches(**{name: getattr(matches, name)[order] for name in ("exponents", "modes", "shifts", "mirrored")})


def file_of(point: Point) -> str:
    return "; ".join(point.files) or "no file"


def mask_of(baseline: slice | ArrayLike | None, count: int) -> Mask:
    """The records of the baseline; all without one."""
    out = np.zeros(count, bool)
    if baseline is None:
        return ~out
    chosen: Any = baseline if isinstance(baseline, slice) else np.asarray(baseline)
    try:
        out[chosen] = True
    except (IndexError, TypeError, ValueError):
        out[:] = False
    if not out.any():
        must, got = f"name some of the {counted(count, 'record')}", f"is {baseline!r:.60}"
        raise input_error("baseline", OF, must, got, "Such as slice(0, 30), or 0:30 for the command.")
    return out


def covariates_of(points: Sequence[Point], healthy: Mask, covariates: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the covariates, each known of every record of the baseline that has a result."""
    inside = [k for k in np.flatnonzero(healthy).tolist() if points[k].model is not None]
    if covariates is None:
        return tuple(name for name in USUAL if inside and all(name in points[k].values for k in inside))
    for name in covariates:
        missing = [k for k in inside if name not in points[k].values]
        if missing:
            known = sorted({word for k in inside for word in points[k].values}) or ["none"]
            must = f"be quantities of every record of the baseline, and {name}"
            got = f"is none of record {missing[0]} ({file_of(points[missing[0]])}), which has {', '.join(known)}"
            raise input_error("covariates", OF, must, got, "Add it by --table or --point, or leave it out.")
    return tuple(covariates)


def conditions_of(points: Sequence[Point], names: Sequence[str]) -> Floats:
    """Covariates of points (points, covariates), NaN where one is missing."""
    rows = [[point.values.get(name, np.nan) for name in names] for point in points]
    return np.array(rows, np.float64).reshape(len(points), len(names))


def standard(conditions: Floats, healthy: Mask) -> Floats:
    """Covariates over their range in the baseline, by which near records are found; zero where one is missing."""
    own = conditions[healthy]
    known = np.isfinite(own).all(axis=1)
    if not known.any():
        return np.zeros_like(conditions)
    spread = np.ptp(own[known], axis=0)
    return np.nan_to_num((conditions - own[known].mean(axis=0)) / np.where(spread > 0.0, spread, 1.0))


def errors_of(points: Sequence[Point], names: Sequence[str], conditions: Floats) -> Floats:
    """Deviations of the covariates (records, covariates): given as `name_std`, else of their resolution, res/√12.

    All values are multiples of their resolution, the largest power of ten that is possible, and one at most: 700, 750
    and 800 may well be known to one.
    """
    out = np.zeros(conditions.shape)
    for column, name in enumerate(names):
        known = conditions[np.isfinite(conditions[:, column]), column]
        size = max(float(np.abs(known).max(initial=0.0)), 1e-300)
        top = min(int(np.floor(np.log10(size))), 0)
        steps = [10.0**k for k in range(top, top - DIGITS, -1)]
        fits = [step for step in steps if np.allclose(np.rint(known / step) * step, known, rtol=0.0, atol=1e-6 * step)]
        given = [point.values.get(f"{name}_std", np.nan) for point in points]
        resolution = fits[0] / np.sqrt(12.0) if fits and np.ptp(known) > 0.0 else 0.0
        out[:, column] = np.where(np.isfinite(given), given, resolution)
    return out
