"""Records in order, their covariates and the baseline, and least squares of features on functions of covariates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import counted, input_error, wrong_value
from floquid._show import late
from floquid.fit import HALF_DIGITS, scaled_inverse, wald_rise
from floquid.surveys import Matches, Point, point_of

Term = tuple[int, ...]
"""The covariates whose product a column is: (0, 1) is the first times the second, () the constant."""


@dataclass(frozen=True, slots=True)
class Regression:
    """Coefficients of features by columns (features, columns), and the covariance of all of them, row by row."""

    coefficients: Floats
    covariance: Floats  # (features * columns, features * columns)

    def predicted(self, columns: Floats) -> Floats:
        """Features at columns (records, columns) → (records, features)."""
        return columns @ self.coefficients.T

    def uncertainty(self, columns: Floats) -> Floats:
        """Covariance of the features predicted at columns (records, columns) → (records, features, features)."""
        features, width = self.coefficients.shape
        blocks = self.covariance.reshape(features, width, features, width)
        return np.einsum("ij,ajbk,ik->iab", columns, blocks, columns, optimize=True)


def terms_of(covariates: int, degree: int) -> tuple[Term, ...]:
    """All products of covariates up to a degree, the constant first."""
    return tuple(term for size in range(degree + 1) for term in combinations_with_replacement(range(covariates), size))


def columns_of(covariates: Floats, terms: tuple[Term, ...]) -> Floats:
    """The columns of some terms (records, terms), of covariates (records, covariates)."""
    return np.stack([covariates[:, list(term)].prod(axis=1) for term in terms], axis=1)


def slopes_of(covariates: Floats, terms: tuple[Term, ...]) -> Floats:
    """Derivatives of the columns by the covariates (records, terms, covariates)."""
    out = np.zeros((len(covariates), len(terms), covariates.shape[1]))
    for place, term in enumerate(terms):
        for k in range(len(term)):
            out[:, place, term[k]] += covariates[:, list(term[:k] + term[k + 1 :])].prod(axis=1)
    return out


def inverses(covariance: Floats, there: Complexes | Floats) -> Floats:
    """Inverses of the covariances of features (records, features, features), zero where one is not `there`.

    Directions without variance are left out: a record that determines a coefficient alone has no residual.
    """
    known = np.isfinite(there)
    both = known[:, :, None] & known[:, None, :]
    filled = np.where(both, covariance, 0.0) + np.where(known[:, None, :], 0.0, 1.0) * np.eye(there.shape[1])
    scale = np.sqrt(np.maximum(np.diagonal(filled, axis1=1, axis2=2), np.finfo(float).tiny))
    scales = scale[:, :, None] * scale[:, None, :]
    sizes, axes = np.linalg.eigh(filled / scales)
    weights = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > HALF_DIGITS)
    return np.where(both, (axes * weights[:, None, :]) @ axes.swapaxes(1, 2) / scales, 0.0)


def regress(values: Floats, covariance: Floats, columns: Floats) -> Regression:
    """Coefficients of values (records, features), NaN where missing, by their covariance at each record."""
    weights = inverses(covariance, values)
    size = values.shape[1] * columns.shape[1]
    information = np.einsum("iab,ij,ik->ajbk", weights, columns, columns, optimize=True).reshape(size, size)
    score = np.einsum("iab,ib,ij->aj", weights, np.nan_to_num(values), columns, optimize=True).ravel()
    inverse = scaled_inverse(information)
    return Regression((inverse @ score).reshape(values.shape[1], -1), inverse)


def selected(
    values: Floats, covariance: Floats, covariates: Floats, terms: tuple[Term, ...], level: float
) -> list[int]:
    """Places of the terms that tests ask for: the least significant is left out until all that may be are needed."""
    from scipy.special import chdtrc

    kept = list(range(len(terms)))
    while len(kept) > 1:
        columns = columns_of(covariates, tuple(terms[k] for k in kept))
        regression = regress(values, covariance, columns)
        chances = {}
        for place, k in enumerate(kept):
            if terms[k] and not any(_divides(terms[k], terms[j]) for j in kept if j != k):
                parts = np.arange(values.shape[1]) * len(kept) + place
                rise = wald_rise(regression.coefficients[:, place], regression.covariance[np.ix_(parts, parts)])
                chances[k] = float(chdtrc(values.shape[1], rise))
        worst = max(chances, key=chances.__getitem__, default=None)
        if worst is None or chances[worst] < level:
            break
        kept.remove(worst)
    return kept


def _divides(term: Term, other: Term) -> bool:
    return len(other) > len(term) and all(term.count(k) <= other.count(k) for k in set(term))


def squared_distances(values: Floats, covariance: Floats) -> tuple[Floats, Integers]:
    """R' V⁻¹ r of each record and its degrees of freedom (records,); features that are NaN do not count."""
    weights = inverses(covariance, values)
    filled = np.nan_to_num(values)
    return np.einsum("ia,iab,ib->i", filled, weights, filled), np.isfinite(values).sum(axis=1)


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
        must = f"name some of the {counted(count, 'record')}"
        raise wrong_value("baseline", OF, must, baseline, "Such as slice(0, 30), or 0:30 for the command.")
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
