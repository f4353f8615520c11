r"""Separable least squares for sums of exponentials: Y ≈ E(μ) R, with E one column μ^k a pole and R free.

With unit noise and free residues the cost is tr((I - P) Y Yᵀ), P the projector on the columns of E, so that all that
the data are needed for is a factor F with F Fᵀ = Y Yᵀ (`errata.md`, "What makes it scale"). The gradient is that of the
variable projection; the Gauss-Newton matrix is Kaufman's (1975),

.. math:: H_{st} = (d_s^H (I-P) d_t) \sum_j \bar R_{sj} R_{tj}, \qquad d_s = \partial e_s/\partial s

The residues carry noise of their own, which inflates H. Its expectation is taken off (`information`), and the
covariance of the poles is the sandwich I⁻¹ H I⁻¹: the free residues are nuisance parameters whose number grows with
the data, and the plain inverse would be too small wherever a mode is weak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.lti._factor import Factor
from floquid.lti._poles import PAIR, PoleSet


@dataclass(frozen=True, slots=True)
class Fit:
    """The least-squares fit of one set of poles: its cost, and what a step and the covariance need."""

    poles: PoleSet
    cost: float
    gradient: NDArray[np.float64]
    gauss_newton: NDArray[np.float64]
    information: NDArray[np.float64]

    def covariance(self) -> NDArray[np.float64]:
        """The covariance of the real parameters (order, order), for noise of unit variance.

        Information is brought to a unit diagonal first: a weak mode beside a strong one is not a null direction.
        """
        scale = np.sqrt(np.maximum(np.diag(self.information), np.finfo(float).tiny))
        both = np.outer(scale, scale)
        inverse = np.linalg.pinv(self.information / both, rcond=1e-14, hermitian=True)
        return inverse @ (self.gauss_newton / both) @ inverse / both


def basis(poles: PoleSet, samples: int) -> NDArray[np.complex128]:
    """The columns μ^k (samples, order), each scaled to a largest entry of one (a growing mode must not overflow).

    What has decayed below 1e-60 is zero: products of denormal numbers cost a hundred times a product of others.
    """
    s = poles.full()
    exponent = (np.arange(samples)[:, None] - np.where(s.real > 0, samples - 1, 0)[None, :]) * s
    return np.where(exponent.real > -138.0, np.exp(exponent), 0.0)


def real_basis(poles: PoleSet, columns: NDArray[np.complex128]) -> NDArray[np.float64]:
    """The same space with real columns (samples, order): Re and Im of a pair, the column of a real pole."""
    parts = []
    for start, kind in zip(poles.starts(), poles.kind, strict=True):
        parts.append(columns[:, start].real)
        if kind == PAIR:
            parts.append(columns[:, start].imag)
    return np.stack(parts, axis=1) if parts else np.zeros((len(columns), 0))


def complex_residues(poles: PoleSet, real: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Residues of the complex columns (order, …) from those of the real ones (order, …)."""
    out = np.zeros(real.shape, complex)
    for start, kind in zip(poles.starts(), poles.kind, strict=True):
        if kind == PAIR:
            out[start] = 0.5 * (real[start] - 1j * real[start + 1])
            out[start + 1] = out[start].conj()
        else:
            out[start] = real[start]
    return out


def _remainder(block: Factor, q: NDArray[np.float64], projected: NDArray[np.float64]) -> float:
    """||(I - QQᵀ) F||²: by subtraction, unless so little is left that rounding would show."""
    whole = block.energy
    left = whole - float(np.sum(projected**2))
    return left if left > 1e-6 * whole else float(np.sum((block.values - q @ projected) ** 2))


def fit(poles: PoleSet, factors: Sequence[Factor]) -> Fit:
    """Cost, gradient and information matrices at `poles`."""
    n, to_real = poles.order, poles.parameter_map()
    cost, gradient = 0.0, np.zeros(n)
    whole, noise = np.zeros((n, n)), np.zeros((n, n))
    for block in factors:
        samples = len(block.values)
        columns = basis(poles, samples)
        q, r = np.linalg.qr(real_basis(poles, columns))
        projected = q.T @ block.values
        cost += _remainder(block, q, projected)
        inverse = np.linalg.pinv(r, rcond=1e-14)
        residues = complex_residues(poles, inverse @ projected)
        spread = complex_residues(poles, inverse)
        slopes = np.arange(samples)[:, None] * columns
        slopes = slopes - q @ (q.T @ slopes)
        curvature = slopes.conj().T @ slopes
        gradient += (to_real.conj().T @ np.sum((slopes.conj().T @ block.values) * residues.conj(), axis=1)).real
        whole += (to_real.conj().T @ (curvature * (residues.conj() @ residues.T)) @ to_real).real
        noise += block.columns * (to_real.conj().T @ (curvature * (spread.conj() @ spread.T)) @ to_real).real
    return Fit(poles, cost, gradient, whole, positive_part(whole, whole - noise))


def positive_part(whole: NDArray[np.float64], reduced: NDArray[np.float64]) -> NDArray[np.float64]:
    """`reduced`, with which stays definite: each direction keeps a hundredth of what it has in `whole`."""
    if not len(whole):
        return whole
    scale = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 1e-15 * values[-1]))
    inner = np.linalg.solve(root, np.linalg.solve(root, reduced / np.outer(scale, scale)).T)
    share, directions = np.linalg.eigh(0.5 * (inner + inner.T))
    kept = root @ (directions * np.maximum(share, 1e-2)) @ directions.T @ root.T
    return kept * np.outer(scale, scale)


LEAST_DAMPING = 1e-12
"""Levenberg-Marquardt's damping stays above rounding: a pole that does nothing leaves the matrix singular."""


def polish(
    poles: PoleSet,
    factors: Sequence[Factor],
    *,
    iterations: int = 60,
    tolerance: float = 1e-4,
    enough: float = -np.inf,
) -> Fit:
    """The maximum-likelihood poles near `poles`: Levenberg-Marquardt on the projected cost.

    Ends when a step is below `tolerance` standard deviations in every parameter or below rounding, or as soon as the
    cost is below `enough`.
    """
    now = fit(poles, factors)
    damping = 1e-6
    for _ in range(iterations if len(poles) else 0):
        scale = np.sqrt(np.diag(now.information)) + np.finfo(float).tiny
        system = now.information / np.outer(scale, scale)
        while damping < 1e8:
            step = np.linalg.solve(system + damping * np.eye(len(scale)), now.gradient / scale) / scale
            step *= min(1.0, 0.5 / np.abs(step).max()) if np.abs(step).max() > 0 else 1.0
            trial = fit(now.poles.moved(step), factors)
            rounding = 1e-12 * now.cost + 1e-300
            if trial.cost <= now.cost + rounding:
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            return now
        done = np.abs(step * scale).max() < tolerance or np.abs(step).max() < 1e-14
        now, damping = trial, max(0.1 * damping, LEAST_DAMPING)
        if done or now.cost < enough:
            break
    return now
