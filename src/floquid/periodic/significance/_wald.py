"""Wald's test by joint covariances in factors, and agreement of the response with its period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices
from floquid.core import Estimates, PeriodicModel
from floquid.fit import (
    EVIDENT,
    IN_VAIN,
    ROUNDING,
    SIGNIFICANT,
    chi2_limit,
    covariance_root,
    inverse_root,
    scaled_inverse,
)
from floquid.lifting import Lifted
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, linearise
from floquid.sync import LARGEST_DRIFT

TURNED = 1.0  # the phase [rad] that the fundamental may slip while modes last, for one step of a fit to tell the period


@dataclass(frozen=True, slots=True, kw_only=True)
class Synchrony:
    """Difference of the response's own period from the one given.

    Parameters
    ----------
    relative
        (own period - given period)/given period, a linear estimate.
    std
        Its standard deviation.
    slip
        The samples by which the phase slips over the longest hit at that difference.
    """

    relative: float
    std: float
    slip: float

    @property
    def sign(self) -> tuple[float, float]:
        """The relative difference and its standard deviation."""
        return self.relative, self.std

    @property
    def broken(self) -> bool:
        """True where the response's own period is significantly another one, by more than does no harm."""
        return abs(self.relative) > SIGNIFICANT * self.std and self.slip > LARGEST_DRIFT


def synchrony(model: PeriodicModel, lifted: Lifted) -> Synchrony | None:
    """Difference of the response's own period from the one it was lifted with.

    Two signs are looked for: a slow turn of the harmonics within each mode (`drift`), and modes of equal decay spaced
    by nearly ω (`spacing`). The latter come where the difference is so large that each harmonic became a mode. Returns
    the one with the smaller deviation; None when the response does not tell the period. The `model` was identified from
    the responses `lifted`.
    """
    signs = [sign for sign in (drift(model, lifted), spacing(model, lifted)) if sign is not None]
    return min(signs, key=lambda sign: sign.std, default=None)


def spacing(model: PeriodicModel, lifted: Lifted) -> Synchrony | None:
    r"""The period from modes that are harmonics of one mode torn apart by a wrong period.

    Modes a, b of equal real part with Im(λ_a - λ_b) = mω/(1 + ε), m ≠ 0. More than two such pairs must agree on
    ε, and half of the modes must be in them: two close modes of nearly equal decay are no sign of a wrong period. Of
    several ε the one with most pairs counts. None when too few pairs of modes agree, or too few modes are in them. The
    `model` was identified from the responses `lifted`.
    """
    std = model.exponent_std
    if std is None:
        return None
    first, second = np.nonzero(np.triu(np.ones((model.order, model.order), bool), 1))
    gap = model.exponents[first] - model.exponents[second]
    deviation = np.hypot(std[first].real, std[second].real), np.hypot(std[first].imag, std[second].imag)
    turns = np.rint(gap.imag / model.fundamental)
    relative = np.divide(turns * model.fundamental, gap.imag, out=np.ones(len(gap)), where=turns != 0) - 1.0
    error = np.divide(deviation[1], np.abs(turns) * model.fundamental, out=np.full(len(gap), np.inf), where=turns != 0)
    alike = (
        (np.abs(gap.real) < 5.0 * deviation[0])
        & (deviation[0] < EVIDENT * np.abs(model.exponents[first].real))
        & (error < np.abs(relative) / SIGNIFICANT)
    )
    # A pair and the pair of its conjugates are one witness, a mode and the conjugate of another on its line are none.
    alike &= model.exponents[first].imag + model.exponents[second].imag > SIGNIFICANT * deviation[1]
    relative, error, members = relative[alike], error[alike], np.stack([first, second])[:, alike]
    # A mode and its conjugate are one member.
    mode = np.array([np.argmin(np.abs(model.exponents - e.real - 1j * abs(e.imag))) for e in model.exponents], int)
    best, most = None, IN_VAIN
    for value, std_of_pair in zip(relative, error, strict=True):
        near = np.abs(relative - value) < 4.0 * np.hypot(error, std_of_pair)
        if near.sum() <= most or 2 * len(np.unique(mode[members[:, near]])) < len(np.unique(mode)):
            continue
        weight = 1.0 / error[near] ** 2
        mean, sigma = float(np.sum(weight * relative[near]) / weight.sum()), float(weight.sum() ** -0.5)
        best, most = _difference(mean, sigma, lifted), int(near.sum())
    return best


def _difference(relative: float, std: float, lifted: Lifted) -> Synchrony:
    cycles = int(lifted.responses.lengths.max())
    return Synchrony(relative=relative, std=std, slip=abs(relative) * cycles * lifted.n_phases)


def drift(model: PeriodicModel, lifted: Lifted) -> Synchrony | None:
    r"""A score test of the period, with the poles and the residues free.

    If the period is T(1 + ε), harmonic m of each mode turns at mω/(1 + ε), and the lifted response moves by

    .. math:: \frac{\partial y}{\partial\epsilon} = \sum_r n \mu_r^n q_r, \qquad
              q_r = -i \omega T \sum_m m\, B_{r,m} e^{(\lambda_r + i m \omega) t_k}

    up to what the residues take up. The estimate of ε is its regression on the residual beside the slopes :math:`n
    \mu_r^n R_r` of the poles. None when no mode has more than one harmonic: then the response does not tell the period.
    The `model` was identified from the responses `lifted`.
    """
    times, n = lifted.phase_times, model.order
    turning = np.exp(np.multiply.outer(model.exponents, times))[:, None, None, :]
    harmonics = np.exp(1j * model.fundamental * np.multiply.outer(model.harmonics, times))
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    coefficients = model.coefficients * lifted.gain(rates).transpose(1, 0, 2)[:, :, None]
    shapes = (coefficients @ harmonics) * turning
    turned = -2j * np.pi * ((coefficients * model.harmonics) @ harmonics) * turning
    # (modes, channels, hits, phases) over the noise → (modes, outputs) hit by hit.
    scale = lifted.noise[None, :, :, None]
    information, score = np.zeros((2 * n + 1, 2 * n + 1)), np.zeros(2 * n + 1)
    for hit, length in enumerate(lifted.responses.lengths):
        rows = [(part / scale)[:, :, hit, :].reshape(n, -1) for part in (shapes, turned)]
        data = lifted.responses.values[:, hit, :length]
        counts = np.arange(length)
        grow = np.where(model.exponents.real > 0, length - 1, 0)
        columns = np.exp((counts[:, None] - grow) * model.exponents * lifted.period)
        size = np.exp(grow * model.exponents * lifted.period)[:, None]
        q, _ = np.linalg.qr(columns)
        slopes = counts[:, None] * columns
        slopes = slopes - q @ (q.conj().T @ slopes)
        curvature = slopes.conj().T @ slopes
        seen = (data @ slopes.real - 1j * (data @ slopes.imag)).T / lifted.responses.noise[:, hit]
        whole = [row * size for row in rows]
        _accumulate(information, score, curvature, seen, whole)
    if information[-1, -1] <= 0:
        return None
    inverse = scaled_inverse(information, 1e-12)
    estimate, std = inverse[-1] @ score, float(np.sqrt(inverse[-1, -1]))
    return _difference(float(estimate), std, lifted)


def _accumulate(
    information: Floats, score: Floats, curvature: Complexes, seen: Complexes, rows: list[Complexes]
) -> None:
    """Add one hit: the parameters are the real and imaginary parts of each ln μ, as if independent, then ε."""
    shapes, turned = rows
    n = len(shapes)
    pole = curvature * (shapes.conj() @ shapes.T)
    cross = curvature * (shapes.conj() @ turned.T)
    period = curvature * (turned.conj() @ turned.T)
    factors = np.concatenate([np.eye(n), 1j * np.eye(n)], axis=1)
    information[:-1, :-1] += (factors.conj().T @ pole @ factors).real
    mixed = (factors.conj().T @ cross.sum(axis=1)).real
    information[:-1, -1] += mixed
    information[-1, :-1] += mixed
    information[-1, -1] += float(period.sum().real)
    score[:-1] += (factors.conj().T @ np.sum(seen * shapes.conj(), axis=1)).real
    score[-1] += float(np.sum(seen * turned.conj()).real)


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
