"""A spline of shaft angle against time, fitted by linear least squares together with the lines' own offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import BLOCK, Floats, Integers, Mask
from floquid._checks import Rebuilt
from floquid.fit import LAGS, SURE, chi2_limit

if TYPE_CHECKING:
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array

HARMLESS = 1e-3
"""The share of the angle between pulses below which none is left out: the residual of exact pulses is the spline's own
error, which is small in most places and not in others."""

LINE = np.array([0.0, 0.0, 1.0, 1.0]), 1
"""Knots and degree of a straight line."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AngleSpline(Rebuilt):
    """A B-spline of the angle over [first, last] with the covariance of its coefficients, straight beyond its ends.

    Parameters
    ----------
    first, last
        The span [s].
    slope
        The speed of the straight line that the spline is added to [rad/s]: zero angle of the line is at `first`.
    knots, coefficients, degree, covariance
        The spline over (t - first)/(last - first): the knots (coefficients + degree + 1,), the coefficients
        (coefficients,) [rad], and their covariance (coefficients, coefficients) [rad²].
    """

    first: float
    last: float
    slope: float
    knots: Floats
    coefficients: Floats
    degree: int
    covariance: Floats

    def __post_init__(self) -> None:
        n = len(self.coefficients)
        self._freeze(knots=(n + self.degree + 1,), coefficients=("coefficients",), covariance=(n, n))

    def angle(self, times: Floats) -> Floats:
        """The angle at `times` [rad]."""
        x, inside, spline = self._evaluate(times)
        return self.slope * (times - self.first) + spline(inside) + (x - inside) * spline(inside, 1)

    def speed(self, times: Floats) -> Floats:
        """The speed at `times` [rad/s]."""
        _, inside, spline = self._evaluate(times)
        return self.slope + spline(inside, 1) / (self.last - self.first)

    def angle_std(self, times: Floats) -> Floats:
        """The standard deviation of the angle at `times` [rad]."""
        return self._deviation(times, derivative=False)

    def speed_std(self, times: Floats) -> Floats:
        """The standard deviation of the speed at `times` [rad/s]."""
        return self._deviation(times, derivative=True) / (self.last - self.first)

    def mean_speed(self) -> tuple[float, float]:
        """The mean speed over the span and its standard deviation [rad/s]."""
        ends = np.zeros(len(self.coefficients))
        ends[0], ends[-1] = -1.0, 1.0  # the spline meets its first and its last coefficient
        span = self.last - self.first
        return (
            self.slope + float(ends @ self.coefficients) / span,
            float(np.sqrt(max(ends @ self.covariance @ ends, 0.0))) / span,
        )

    def _evaluate(self, times: Floats) -> tuple[Floats, Floats, BSpline]:
        from scipy.interpolate import BSpline

        x = (times - self.first) / (self.last - self.first)
        return x, np.clip(x, 0.0, 1.0), BSpline(self.knots, self.coefficients, self.degree)

    def _deviation(self, times: Floats, *, derivative: bool) -> Floats:
        from scipy.interpolate import BSpline

        x, inside, _ = self._evaluate(times)
        basis = BSpline(self.knots, np.eye(len(self.coefficients)), self.degree)
        found = np.empty(len(times))
        step = max(1, BLOCK // len(self.coefficients))
        for begin in range(0, len(times), step):
            part = slice(begin, begin + step)
            rows = basis(inside[part], int(derivative))
            out = np.flatnonzero(x[part] != inside[part])
            if not derivative and len(out):
                rows[out] += (x[part] - inside[part])[out, None] * basis(inside[part][out], 1)
            found[part] = np.einsum("ij,ij->i", rows @ self.covariance, rows)
        return np.sqrt(np.maximum(found, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AngleFit:
    """The spline, the offsets of the lines (lines,) [rad] of mean zero with their deviations, and what is left over.

    `residuals` (pulses,) [rad] are of every pulse, those not `kept` included; `std` [rad] is of those that are.
    """

    spline: AngleSpline
    offsets: Floats
    offsets_std: Floats
    kept: Mask
    residuals: Floats
    std: float


@dataclass(frozen=True, slots=True)
class _Rung:
    """A fit with one number of pieces, and what its deviations are made of."""

    knots: Floats
    degree: int
    coefficients: Floats
    offsets: Floats
    squares: float
    n_parameters: int
    factor: tuple[Floats, bool]
    weights: Floats
    inverse_counts: Floats

    def deviations(self) -> tuple[Floats, Floats]:
        """For noise of unit variance: the coefficients' covariance, and the offsets' deviations from their mean."""
        from scipy.linalg import cho_solve

        inverse = np.asarray(cho_solve(self.factor, np.eye(len(self.coefficients))))
        # The offsets' own covariance is D⁻¹ + Wᵀ N⁻¹ W; no more of it is formed than is needed.
        n_seen = np.count_nonzero(self.inverse_counts) + 1
        spread = inverse @ self.weights
        variances = self.inverse_counts + np.einsum("kl,kl->l", self.weights, spread)
        with_mean = (self.inverse_counts + self.weights.T @ spread.sum(axis=1)) / n_seen
        of_mean = (self.inverse_counts.sum() + self.weights.sum(axis=1) @ spread.sum(axis=1)) / n_seen**2
        return inverse, np.sqrt(np.maximum(variances - 2.0 * with_mean + of_mean, 0.0))


def fit_angle(
    times: Floats,
    angles: Floats,
    lines: Integers,
    n_lines: int,
    most: int,
    *,
    step: float = 0.0,
    rounded: float = 0.0,
) -> AngleFit:
    """Fit `angles` [rad] at `times` [s] of pulses of `lines` (pulses,) by a spline of at most `most` pieces.

    Pulses that were sampled each `step` [s] err by a part of it, in a pattern that is no motion of the shaft. Off by no
    more than `rounded` [s], they have the variance of that rounding at least, however little a fit leaves. Of one line,
    the angle is straight if some straight line is within that of each.

    The offset of line 0 is zero while fitting. Outliers are left out and the fit is done again, until none is found.
    """
    first, last = float(times[0]), float(times[-1])
    x = (times - first) / (last - first)
    slope = float((angles[-1] - angles[0]) / (last - first))
    wave = angles - slope * (times - first)
    kept = np.ones(len(times), dtype=bool)
    floor = 8.0 * np.finfo(float).eps * max(float(np.abs(angles).max()), slope * abs(first), slope * abs(last))
    pitch = float(np.median(np.diff(angles)))
    seen, outlying = [kept], np.sqrt(chi2_limit(1, SURE))
    known = (slope * step) ** 2 / 12.0 if rounded else 0.0
    rung = _climb(x, wave, lines, n_lines, most, floor, known)
    for _ in range(20):
        rest = _residuals(rung, x, wave, lines)
        limit = outlying * max(1.4826 * float(np.median(np.abs(rest))), floor)
        limit = max(limit, HARMLESS * pitch, slope * rounded)  # many edges may be rounded alike, and some others not
        kept = np.abs(rest) <= limit
        if any(np.array_equal(kept, one) for one in seen) or np.count_nonzero(kept) <= rung.n_parameters:
            break
        seen.append(kept)
        rung = _climb(x[kept], wave[kept], lines[kept], n_lines, most, floor, known)
    kept = seen[-1]
    if rounded and n_lines == 1 and rung.degree > 1 and _straight(x[kept], wave[kept], slope * rounded):
        rung = _solve(x[kept], wave[kept], lines[kept], n_lines, *LINE)
    # Edges that are all rounded alike leave nothing, and are no better known.
    least = max(floor**2, known if rung.degree == 1 else 0.0)
    variance = max(rung.squares / max(np.count_nonzero(kept) - rung.n_parameters, 1), least)
    present = np.bincount(lines[kept], minlength=n_lines) > 0
    offsets = np.where(present, rung.offsets, np.nan)
    inverse, lines_std = rung.deviations()
    residuals = _residuals(rung, x, wave, lines)
    # An edge that is known to a sample errs by half of one at most.
    if np.sqrt(variance) > 0.5 * slope * step and _moving(residuals[kept], rung.n_parameters):
        inverse = inverse + np.eye(len(inverse))
    return AngleFit(
        spline=AngleSpline(
            first=first,
            last=last,
            slope=slope,
            knots=rung.knots,
            coefficients=rung.coefficients,
            degree=rung.degree,
            covariance=variance * inverse,
        ),
        offsets=offsets - float(np.nanmean(offsets)),
        offsets_std=np.where(present, np.sqrt(variance) * lines_std, np.nan),
        kept=kept,
        residuals=residuals,
        std=float(np.sqrt(variance)),
    )


def _straight(x: Floats, wave: Floats, room: float) -> bool:
    """True where a straight line is within `room` [rad] of each pulse."""
    from scipy.optimize import linprog

    basis, ones = np.stack([np.ones(len(x)), x], axis=1), np.ones((len(x), 1))
    limits = np.block([[basis, -ones], [-basis, -ones]])  # the largest distance is the third unknown
    found = linprog([0.0, 0.0, 1.0], A_ub=limits, b_ub=np.concatenate([wave, -wave]) / room, bounds=(None, None))
    return found.status == 0 and found.fun <= 1.0


def _moving(residuals: Floats, n_parameters: int) -> bool:
    """True where residuals (pulses,) are correlated: Ljung and Box's sum over some lags, less what the fit makes."""
    n, power = len(residuals), float(residuals @ residuals)
    if n < 4 * LAGS or power == 0.0:
        return False
    sums = [float(residuals[lag:] @ residuals[:-lag]) ** 2 / (n - lag) for lag in range(1, LAGS + 1)]
    score = n * (n + 2.0) * sum(sums) / power**2
    # Of white errors a fit of p parameters makes residuals whose squared correlations sum to about (p/n)²/2 n.
    return score - 0.5 * n_parameters**2 / n > chi2_limit(LAGS, SURE)


def _residuals(rung: _Rung, x: Floats, wave: Floats, lines: Integers) -> Floats:
    from scipy.interpolate import BSpline

    return wave - BSpline(rung.knots, rung.coefficients, rung.degree)(x) - rung.offsets[lines]


def _climb(x: Floats, wave: Floats, lines: Integers, n_lines: int, most: int, floor: float, known: float) -> _Rung:
    """The straight line, or where it is significantly worse the spline that Akaike's criterion prefers."""
    from scipy.special import fdtrc

    line = _solve(x, wave, lines, n_lines, *LINE)
    tried, pieces, rows = [], 1, len(x) - len(np.unique(lines))
    # The normal matrix of the pieces is a full one.
    while pieces <= most and pieces + 3 + 2 <= rows and pieces**2 <= BLOCK:
        inner = np.quantile(x, np.linspace(0.0, 1.0, pieces + 1)[1:-1])  # as many pulses in each piece: none is empty
        tried.append(_solve(x, wave, lines, n_lines, np.concatenate([[0.0] * 4, inner, [1.0] * 4]), 3))
        pieces += max(pieces // 2, 1)
    if not tried:
        return line
    least = len(x) * floor**2  # below it, all is rounding
    best = min(tried, key=lambda rung: _criterion(rung, len(x), least))
    if known and best.squares <= known * (len(x) - best.n_parameters):  # no fit tells more than the rounding leaves
        best = min(tried, key=lambda rung: rung.squares / known + 2.0 * rung.n_parameters)
    more, free = best.n_parameters - line.n_parameters, len(x) - best.n_parameters
    gain = (line.squares - best.squares) / max(best.squares, least, free * known) * free / more
    if fdtrc(more, free, max(gain, 0.0)) * len(tried) > SURE:
        return line
    return best


def _criterion(rung: _Rung, n: int, least: float) -> float:
    p = rung.n_parameters + 1  # and the variance
    return n * float(np.log(max(rung.squares, least))) + 2.0 * p + 2.0 * p * (p + 1) / max(n - p - 1, 1)


def _solve(x: Floats, wave: Floats, lines: Integers, n_lines: int, knots: Floats, degree: int) -> _Rung:
    r"""Least squares of B c + Z g, the offsets g eliminated first: their normal matrix D = ZᵀZ is diagonal.

    .. math:: (B^T B - W D W^T) c = (B^T - W Z^T) y, \qquad W = B^T Z D^{-1}
    """
    from scipy.interpolate import BSpline
    from scipy.linalg import cho_factor, cho_solve
    from scipy.sparse import csr_array

    basis: csr_array = csr_array(BSpline.design_matrix(x, knots, degree))
    n_coefficients = len(knots) - degree - 1
    per_line = np.bincount(lines, minlength=n_lines).astype(float)
    counted = per_line > 0
    counted[np.argmax(counted)] = False  # the first line, line 0, is the reference: its offset is none
    inverse_counts = np.where(counted, 1.0 / np.maximum(per_line, 1.0), 0.0)
    choose: csr_array = csr_array((np.ones(len(x)), lines, np.arange(len(x) + 1)), shape=(len(x), n_lines))
    shared: Any = (basis.T @ choose).toarray()
    weights = shared * inverse_counts
    normal = (basis.T @ basis).toarray() - weights @ shared.T
    factor: Any = cho_factor(normal)
    of_lines = choose.T @ wave
    coefficients = np.asarray(cho_solve(factor, basis.T @ wave - weights @ of_lines))
    offsets = inverse_counts * (of_lines - shared.T @ coefficients)
    rest = wave - basis @ coefficients - offsets[lines]
    return _Rung(
        knots=knots,
        degree=degree,
        coefficients=coefficients,
        offsets=offsets,
        squares=float(rest @ rest),
        n_parameters=n_coefficients + int(np.count_nonzero(counted)),
        factor=factor,
        weights=weights,
        inverse_counts=inverse_counts,
    )
