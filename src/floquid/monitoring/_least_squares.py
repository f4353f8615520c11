"""Generalised least squares of features on functions of covariates, each record with a covariance of its own."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.fit import HALF_DIGITS, scaled_inverse, wald_rise

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
    """Places of the terms that tests ask for: the least significant is left out until all that may be are needed.

    A term stays as long as one of its products does, and the constant always.
    """
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
