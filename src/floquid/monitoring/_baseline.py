"""The baseline of a machine: features as functions of covariates, the scatter beyond deviations, limits of charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import counted, input_error
from floquid.fit import ROUNDING, chi2_limit, scaled_inverse
from floquid.monitoring._work import (
    OF,
    Regression,
    Term,
    Work,
    columns_of,
    file_of,
    inverses,
    regress,
    selected,
    slopes_of,
    squared_distances,
    terms_of,
)
from floquid.surveys import Matches

LEVEL = 0.05  # the probability at which noise may add a column, or scatter, that is not needed
DRAWS = 1000  # of noise, for the quantile of its largest root
CELLS = 4000  # of the integral of a limit: it is known to 1e-3 of its probability


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """The features of a healthy machine over its covariates."""

    asked: tuple[Term, ...]  # products of covariates up to the degree asked for
    terms: tuple[Term, ...]  # those that tests ask for
    middle: Floats  # by which covariates are centred (covariates,)
    half: Floats  # and scaled (covariates,)
    regression: Regression  # the coefficients of the columns
    scatter: Floats  # covariance of the features beyond their deviations (features, features)
    rank: int  # the number of directions that it was found in
    degrees: int  # the degrees of freedom that it rests on
    gram: Floats  # inverse of the sum of squares of all columns asked for, by which leverages are measured

    def scaled(self, covariates: Floats) -> Floats:
        """Covariates (records, covariates) from their middle, over half their range."""
        return (covariates - self.middle) / self.half

    def columns(self, covariates: Floats) -> Floats:
        """The columns used of covariates (records, covariates)."""
        return columns_of(self.scaled(covariates), self.terms)

    def extrapolated(self, covariates: Floats) -> Mask:
        """True outside the range of a covariate in the baseline (records,)."""
        outside: Mask = np.abs(self.scaled(covariates)) > 1.0 + ROUNDING
        return np.asarray(outside.any(axis=1))

    def leverage(self, covariates: Floats) -> Floats:
        """The leverage d' (D'D)⁻¹ d of all columns asked for (records,): above one a record outweighs the baseline."""
        columns = columns_of(self.scaled(covariates), self.asked)
        return np.einsum("ij,jk,ik->i", columns, self.gram, columns)

    def spread(self, covariance: Floats, covariates: Floats, std: Floats) -> Floats:
        """Covariance of features about their prediction at known coefficients (records, features, features)."""
        return covariance + _moved(self.regression, self.terms, self.scaled(covariates), std / self.half) + self.scatter

    def limit(self, degrees: int, rate: float) -> float:
        """The limit that a squared distance of some degrees of freedom exceeds at a rate."""
        return squared_limit(degrees, min(self.rank, degrees), self.degrees, rate)


def fit_baseline(values: Floats, covariance: Floats, covariates: Floats, std: Floats, degree: int) -> Baseline:
    """The baseline of features (records, features) over covariates (records, covariates) with errors `std`."""
    middle = 0.5 * (covariates.max(axis=0) + covariates.min(axis=0))
    half = 0.5 * np.ptp(covariates, axis=0)
    half = np.where(half > 0.0, half, 1.0)
    scaled = (covariates - middle) / half
    asked = terms_of(covariates.shape[1], degree)
    columns = columns_of(scaled, asked)
    whole = regress(values, covariance, columns)
    spread = covariance + _moved(whole, asked, scaled, std / half)
    whole = regress(values, spread, columns)
    degrees = len(values) - len(asked)
    scatter, rank = scatter_of(values - whole.predicted(columns), spread, degrees)
    kept = selected(values, spread + scatter, scaled, asked, LEVEL)
    return Baseline(
        asked=asked,
        terms=tuple(asked[k] for k in kept),
        middle=middle,
        half=half,
        regression=regress(values, spread + scatter, columns[:, kept]),
        scatter=scatter,
        rank=rank,
        degrees=degrees,
        gram=scaled_inverse(columns.T @ columns),
    )


def _moved(regression: Regression, terms: tuple[Term, ...], scaled: Floats, std: Floats) -> Floats:
    """Covariance of the features by errors of the scaled covariates (records, features, features)."""
    by = np.einsum("aj,ijc->iac", regression.coefficients, slopes_of(scaled, terms)) * std[:, None, :]
    return by @ by.swapaxes(1, 2)


def scatter_of(residual: Floats, covariance: Floats, degrees: int) -> tuple[Floats, int]:
    """The covariance of residuals (records, features) beyond their own, and the number of its directions.

    Zero unless it is seen. Residuals over their deviations have roots (eigenvalues of their mean square) about one; the
    restricted likelihood is largest at Q = L V (ℓ - 1) V' L' over roots ℓ above one where covariances LL' are alike. A
    direction counts where its root exceeds the largest of noise at `LEVEL`, and the mean of the others where their χ²
    does.
    """
    features = residual.shape[1]
    nothing = np.zeros((features, features)), 0
    whole = np.isfinite(residual).all(axis=1)
    degrees -= int(np.count_nonzero(~whole))
    if degrees < 2 or not features:
        return nothing
    scale = np.sqrt(np.diagonal(covariance[whole], axis1=1, axis2=2).mean(axis=0))
    unit = covariance[whole] / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(unit)
    roots = (vectors / np.sqrt(values)[:, None, :]) @ vectors.swapaxes(1, 2)
    z = np.einsum("iab,ib->ia", roots, residual[whole] / scale)
    sizes, axes = np.linalg.eigh(z.T @ z / degrees)
    many = sizes > largest_root(features, degrees)
    rest = sizes[~many]
    excess = np.where(many, sizes - 1.0, 0.0)
    if len(rest) and degrees * rest.sum() > chi2_limit(len(rest) * degrees, LEVEL):
        excess[~many] = max(float(rest.mean()) - 1.0, 0.0)
    own, turned = np.linalg.eigh(unit.mean(axis=0))
    root = (turned * np.sqrt(own)) @ turned.T * scale[:, None]
    return root @ (axes * excess) @ axes.T @ root.T, int(many.sum())


@lru_cache(maxsize=256)
def largest_root(features: int, degrees: int) -> float:
    """The largest eigenvalue that the mean square of white noise exceeds at `LEVEL`, by `DRAWS` draws."""
    generator = np.random.default_rng(0)
    most = []
    for _ in range(DRAWS):
        noise = generator.standard_normal((degrees, features))
        most.append(np.linalg.eigvalsh(noise @ noise.T if degrees < features else noise.T @ noise)[-1] / degrees)
    return float(np.quantile(most, 1.0 - LEVEL))


@lru_cache(maxsize=1024)
def squared_limit(degrees: int, rank: int, behind: int, rate: float) -> float:
    r"""The limit that a squared distance exceeds at a rate, `rank` of its directions having an estimated variance.

    χ² of the other directions, and Hotelling's T² of these by the degrees of freedom `behind` their variance, more by
    what an error of these directions puts into the others:

    .. math:: \chi^2_{f-m} + \Big(1 + \frac{f - m}{\nu}\Big) \frac{m\,\nu}{\nu - m + 1} F_{m,\, \nu - m + 1}
    """
    from scipy.special import chdtri, fdtrc

    if rank == 0:
        return chi2_limit(degrees, rate)
    left = max(behind - rank + 1, 1)
    cells = (np.arange(CELLS) + 0.5) / CELLS
    known = chdtri(degrees - rank, cells) if degrees > rank else np.zeros(1)
    turned = 1.0 + (degrees - rank) / max(behind, 1)

    def chance(limit: float) -> float:
        rest = np.maximum(limit - known, 0.0) * left / (rank * max(behind, 1) * turned)
        return float(np.mean(fdtrc(rank, left, rest)))

    low, high = 0.0, 1.0
    while chance(high) > rate:
        low, high = high, 2.0 * high
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chance(middle) > rate else (low, middle)
    return high


def one_sided(base: Baseline, rate: float) -> float:
    """The deviations that one direction exceeds at a rate: Student's where the scatter was estimated."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(base.degrees, 1.0 - rate) if base.rank else ndtri(1.0 - rate))


@dataclass(frozen=True, slots=True)
class Chart:
    """Squared distances of records, of their moving averages, and of these along a direction (records,)."""

    t2: Floats
    ewma: Floats
    directed: Floats
    degrees: np.ndarray
    averaged: np.ndarray


def chart(
    baseline: Baseline, residual: Floats, spread: Floats, columns: Floats, *, inside: bool, memory: float,
    direction: Floats | None,
) -> Chart:  # fmt: skip
    r"""T² and exponentially weighted moving averages of residuals in the order of the records.

    .. math:: T_i^2 = r_i^T (V_i + J_i C J_i^T)^{-1} r_i, \qquad e_i = (1 - a)\, e_{i-1} + a\, r_i

    with the covariance of e by all V and by the coefficients that all residuals have in common. `inside` the baseline,
    from which these were estimated, their covariance is taken off. A missing feature leaves its average as it was.
    Along a direction v it is the one-sided v' E⁻¹ e/(v' E⁻¹ v)^{1/2}.
    """
    sign = -1.0 if inside else 1.0
    count, features = residual.shape
    width = columns.shape[1]
    t2, degrees = squared_distances(residual, spread + sign * baseline.regression.uncertainty(columns))
    out = np.full((2, count), np.nan)
    averaged = np.zeros(count, np.int64)
    mean, own, common = np.zeros(features), np.zeros((features, features)), np.zeros((features, features, width))
    begun = np.zeros(features, bool)
    size = features * width
    for row in range(count):
        there = np.isfinite(residual[row])
        begun |= there
        if not there.any():
            continue
        keep, take = np.where(there, 1.0 - memory, 1.0), np.where(there, memory, 0.0)
        mean = keep * mean + take * np.nan_to_num(residual[row])
        filled = np.where(there[:, None] & there, spread[row], 0.0)
        own = keep[:, None] * own * keep + take[:, None] * filled * take
        common = keep[:, None, None] * common
        common[np.arange(features), np.arange(features)] += take[:, None] * columns[row]
        flat = common.reshape(features, size)
        whole = own + sign * flat @ baseline.regression.covariance @ flat.T
        root = inverses(whole[None], np.where(begun, mean, np.nan)[None])[0]
        out[0, row], averaged[row] = mean @ root @ mean, begun.sum()
        if direction is not None:
            length = direction @ root @ direction
            out[1, row] = direction @ root @ mean / np.sqrt(length) if length > 0.0 else np.nan
    return Chart(np.where(degrees > 0, t2, np.nan), out[0], out[1], degrees, averaged)


COMMON = 0.5  # share of the baseline's records that a mode must be found in


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """Parts of exponents (records, features), with their covariance at each record."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats


def common(matches: Matches, healthy: Mask, warnings: list[str]) -> Matches:
    """The modes that at least half of the `healthy` records with a result have; others are told."""
    known = np.isfinite(matches.exponents)
    usable = known[: len(healthy)].any(axis=1) & healthy
    share = known[: len(healthy)][usable].mean(axis=0) if usable.any() else np.zeros(known.shape[1])
    rare = np.flatnonzero((share < COMMON) & known.any(axis=0))
    if len(rare):
        hertz = np.nanmedian(np.abs(matches.exponents[:, rare].imag), axis=0) / (2.0 * np.pi)
        words = ", ".join(f"{own:.4g}" for own in hertz)
        warnings.append(f"Modes in less than half of the baseline are left out: {words} Hz.")
    kept = share >= COMMON
    names = ("exponents", "modes", "shifts", "mirrored")
    return Matches(**{name: getattr(matches, name)[:, kept] for name in names})


def features_of(work: Work) -> Features:
    """Parts of the exponents of the modes; those without deviations, as of real multipliers one, are none."""
    exponents, covariance = work.matches.exponents, work.matches.covariance(work.every)
    count = exponents.shape[1]
    usable = np.flatnonzero(work.healthy & np.isfinite(exponents[: len(work.points)]).any(axis=1))
    names, units, parts = [], [], []
    for mode in range(count):
        for part, word, unit in ((mode, "decay", "1/s"), (mode + count, "frequency", "rad/s")):
            if np.nanmin(covariance[usable, part, part]) > 0.0:
                names.append(f"mode {mode + 1} {word}")
                units.append(unit)
                parts.append(part)
    if not parts:
        got = f"have none in common, with {counted(len(usable), 'result')} that can be used"
        remedy = "Identify them with deviations, and look at the reasons of those that fail."
        raise input_error("results", OF, "have modes with deviations in the baseline", got, remedy)
    both = np.concatenate([exponents.real, exponents.imag], axis=1)[:, parts]
    return Features(names=tuple(names), units=tuple(units), values=both, covariance=covariance[:, parts][:, :, parts])


def tell_missing(values: Floats, healthy: Mask, names: Sequence[str], warnings: list[str]) -> None:
    """Tell of modes that are missing more often than in the baseline: that is a change that no chart shows."""
    later = ~healthy & np.isfinite(values).any(axis=1)
    for column, name in enumerate(names):
        if not name.endswith("decay") or not later.any():
            continue
        before, after = (int((~np.isfinite(values[rows, column])).sum()) for rows in (healthy, later))
        share, total = (before + 1.0) / (healthy.sum() + 2.0), int(later.sum())
        if after > total * share + 4.0 * np.sqrt(total * share * (1.0 - share)):
            mode = name.rpartition(" ")[0]
            warnings.append(f"{mode} is missing in {after} of {total} later records, and in {before} of the baseline.")


def direction_of(work: Work, features: Features, base: Baseline) -> Floats | None:
    """The change of the features by a damage (features,)."""
    if work.along is not None:
        if work.along.shape != (len(features.names),) or not work.along.any():
            must = f"hold the changes of the {len(features.names)} features ({', '.join(features.names)})"
            raise input_error("direction", OF, must, f"has the shape {work.along.shape}")
        return work.along
    if not work.labelled:
        return None
    rows = features.values[len(work.points) :]
    damaged, which = rows[-1], work.labelled[-1]
    if len(rows) > 1:
        return np.nan_to_num(damaged - rows[0])
    varying = work.varying(work.healthy)
    own = np.array([[which.values.get(name, np.nan) for name in work.names]])[:, varying]
    if not np.isfinite(own).all() or not np.isfinite(damaged).any():
        must, got = "have the covariates and modes of the baseline", f"{file_of(which)} has not"
        raise input_error("direction", OF, must, got, "Identify it as the other records, with its operating point.")
    return np.nan_to_num(damaged - base.regression.predicted(base.columns(own))[0])
