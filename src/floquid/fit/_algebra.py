"""Algebra of information matrices and covariances, scaled to a unit diagonal first: units do not decide the rank."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats

ROUNDING = 1e-14  # the share of what was summed in double precision below which what is left is rounding

HALF_DIGITS = ROUNDING**0.5
"""The share where something was squared first: also a step for differences, and a whole number's distance from one."""

LEAST_SHARE = 1e-2
"""The share of its information that a direction keeps: noise on coefficients must not turn a curvature negative."""


def unit_scale(matrix: Floats) -> Floats:
    """The root of the diagonal of a matrix (n,), 1 where that is zero."""
    size = np.diag(matrix)
    return np.sqrt(np.where(size > np.finfo(float).tiny, size, 1.0))


def directions(matrix: Floats, least: float, *, scale: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues above a share of the largest, and their eigenvectors, of a symmetric matrix over its scale."""
    # The largest counts as 1 at least, which it is of a unit diagonal. There are none of a matrix that overflowed.
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = matrix / np.outer(scale, scale)
    if not len(matrix) or not np.isfinite(scaled).all():
        return np.zeros(0), np.zeros((len(matrix), 0))
    values, vectors = np.linalg.eigh(scaled)
    good = values > least * max(float(values[-1]), 1.0)
    return values[good], vectors[:, good]


def inverse_root(
    matrix: Floats, least: float = ROUNDING, *, floor: bool = False, scale: Floats | None = None
) -> Floats:
    """A root W of the inverse of a symmetric matrix, W Wᵀ = M⁻¹ (n, directions).

    Directions below a share of the largest eigenvalue are left out. With `floor` they are taken to have that share:
    what is not known has a large variance, and all of a matrix that overflowed is NaN. `scale` replaces the root of
    the diagonal.
    """
    scale = unit_scale(matrix) if scale is None else scale
    if not floor:
        values, vectors = directions(matrix, least, scale=scale)
        return vectors / np.sqrt(values) / scale[:, None]
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = matrix / np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return np.full(matrix.shape, np.nan)
    values, vectors = np.linalg.eigh(scaled)
    lowest = least * max(float(values.max(initial=1.0)), 1.0)
    return vectors / np.sqrt(np.maximum(values, lowest)) / scale[:, None]


def scaled_inverse(
    matrix: Floats, least: float = ROUNDING, *, floor: bool = False, scale: Floats | None = None
) -> Floats:
    """The inverse of a symmetric matrix by the root of `inverse_root` (n, n)."""
    root = inverse_root(matrix, least, floor=floor, scale=scale)
    return root @ root.T


def covariance_root(covariance: Floats) -> Floats:
    """A root R of a covariance, R Rᵀ = C (n, directions), which may be singular."""
    scale = unit_scale(covariance)
    values, vectors = directions(covariance, ROUNDING, scale=scale)
    return scale[:, None] * vectors * np.sqrt(values)


def sandwich(information: Floats, scatter: Floats, least: float = ROUNDING) -> Floats:
    """The covariance I⁻¹ H I⁻¹ of parameters with the information I, whose gradient has the covariance H."""
    inverse = scaled_inverse(information, least)
    return inverse @ scatter @ inverse


def positive_part(whole: Floats, reduced: Floats) -> Floats:
    """The part of `reduced` between a hundredth of `whole` and all of it in each direction: it stays definite."""
    if not len(whole):
        return whole
    scale = unit_scale(whole)
    both = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(whole / both)
    size = np.sqrt(np.maximum(values, 0.1 * ROUNDING * max(values[-1], 0.1 * ROUNDING)))
    root, inverse = vectors * size, (vectors / size).T
    inner = inverse @ (reduced / both) @ inverse.T
    share, axes = np.linalg.eigh(0.5 * (inner + inner.T))
    kept = root @ (axes * np.clip(share, LEAST_SHARE, 1.0)) @ axes.T @ root.T
    return kept * both


LAGS = 16
"""Lags of a correlation that tell coloured noise: what modes leave has some a period apart."""

NOT_WHITE = 0.1  # the sum of squared correlations over these lags from which on a residual is no white noise


def yule_walker(correlation: Floats, order: int) -> Floats:
    """The filter (order + 1,) that whitens an autoregression, from its autocorrelation at lags from zero on."""
    from scipy.linalg import solve_toeplitz

    first = correlation[:order].copy()
    first[0] *= 1.0 + 1e-9
    return np.concatenate([[1.0], -np.asarray(solve_toeplitz(first, correlation[1 : order + 1]))])


def filtered(values: Floats, taps: Floats) -> Floats:
    """Values (channels, samples) after the filter of each channel, from the first sample with all its past on."""
    if taps.shape[1] > values.shape[1]:
        return values[:, :0]
    return np.array([np.convolve(row, filter_, "valid") for row, filter_ in zip(values, taps, strict=True)])


def filter_gain(taps: Floats, delays: Floats, rates: Complexes, *, slope: bool = False) -> Complexes:
    """The gain of filters (channels, taps) at e^{st}, Σ_i a_i e^{-s τ_i}, or its derivative by s (channels, ...)."""
    weights = -delays * taps if slope else taps
    return np.asarray(np.tensordot(weights, np.exp(-np.multiply.outer(delays, rates)), axes=1), np.complex128)
