"""Wald's test on coefficients of `Estimates`, their joint covariance kept in factors."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Indices
from floquid.core import Estimates
from floquid.fit import ROUNDING, chi2_limit, covariance_root, inverse_root
from floquid.lifting import Lifted
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, linearise


def wald(whole: Estimates, terms: Indices, channels: Indices) -> tuple[float, int, float]:
    """The chi-square of some terms in some channels, its degrees of freedom and its probability."""
    from scipy.special import chdtrc

    values, slopes = _whitened(whole, terms, channels)
    if not len(values):
        return 0.0, 0, 1.0
    # b'(I + UU')⁻¹b as what is left of a least-squares problem: no difference of large numbers.
    count = slopes.shape[1]
    system = np.concatenate([slopes, np.eye(count)])
    target = np.concatenate([values, np.zeros(count)])
    residual = target - system @ np.linalg.lstsq(system, target, rcond=None)[0]
    statistic = float(residual @ residual)
    return statistic, len(values), float(chdtrc(len(values), statistic))


def _whitened(whole: Estimates, terms: Indices, channels: Indices) -> tuple[Floats, Floats]:
    """Coefficients whose noise is white, and what deviations of the exponents do to them (values, 2 modes + 1)."""
    values, slopes, both = [], [], np.concatenate([terms, terms + len(whole.modes)])
    spread, own_root = whole.spread[:, both][:, :, both], covariance_root(whole.covariance)
    for block in range(len(whole.spread)):
        of_channel, of_hit = np.nonzero(whole.blocks[channels] == block)
        rows = (channels[of_channel], of_hit)
        if not len(of_hit):
            continue
        # W V Wᵀ = I, of as many rows as V has rank: what does not turn has no sine.
        whitener = inverse_root(spread[block], ROUNDING).T
        scales = whole.scales[terms][:, *rows]
        scaled = whole.coefficients[terms][:, *rows] / scales
        moved = whole.slopes[terms][:, *rows] / scales[..., None]
        values.append((whitener @ np.concatenate([scaled.real, scaled.imag])).ravel())
        turned = np.tensordot(whitener, np.concatenate([moved.real, moved.imag]), axes=1)
        slopes.append(turned.reshape(-1, turned.shape[-1]) @ own_root)
    return np.concatenate(values), np.concatenate(slopes)


def holm(p_values: Floats) -> Floats:
    """Probabilities corrected for their number, by Holm's step-down method (Holm 1979)."""
    order = np.argsort(p_values, kind="stable")
    stepped = np.maximum.accumulate(p_values[order] * np.arange(len(order), 0, -1))
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def noncentrality(degrees: int, level: float, power: float) -> float:
    """The noncentrality at which a chi-square test of that level has that power."""
    from scipy.special import chndtrinc

    if not degrees:
        return np.inf
    return float(chndtrinc(chi2_limit(degrees, level), degrees, 1.0 - power))


def spacing_probability(whole: Estimates, lifted: Lifted, lines: Indices) -> float:
    r"""The probability of the responses if harmonics lie whole numbers of fundamentals from their modes; 1 without any.

    .. math:: Q = g^T J^{-1} g - (A^T g)^T (A^T J A)^{-1} A^T g \sim \chi^2

    Rao's score test: g and J are the slopes of the cost and their covariance by the rates λ + imω of modes and of the
    harmonics looked at (`lines`, positions among the terms), each a line of its own; A moves these with their modes, as
    one exponent does. All other terms are there and move with their modes in both. A mode of a constant system that
    folds next to another is mostly not at the same place to a small part of its decay.
    """
    from scipy.special import chdtrc

    if not len(lines):
        return 1.0
    # Every term takes part: one that is left out would pull at the places of the others.
    count = len(whole.exponents)
    rates = linearise(LiftedBlock.all_of(lifted), ModeParameters.of_terms(whole)).by_column
    modes = (whole.modes[:, None] == np.arange(count)) * whole.turning[:, None].astype(float)
    alone = (np.arange(len(whole.modes))[:, None] == lines).astype(float)
    looked_at = alone.any(axis=1, keepdims=True)
    free, tied = (
        _gain(both.T @ rates.gradient, both.T @ rates.gauss_newton @ both)
        for both in (np.kron(np.eye(2), each) for each in (np.concatenate([modes * ~looked_at, alone], axis=1), modes))
    )
    return float(chdtrc(2 * len(lines), max(free - tied, 0.0)))


def _gain(gradient: Floats, matrix: Floats) -> float:
    sizes = np.diag(matrix)
    # A line that is nowhere to be seen takes nothing.
    scale = np.where(sizes > np.finfo(float).tiny, sizes, np.inf) ** -0.5
    return float(
        gradient * scale @ np.linalg.lstsq(matrix * np.outer(scale, scale), gradient * scale, rcond=ROUNDING)[0]
    )
