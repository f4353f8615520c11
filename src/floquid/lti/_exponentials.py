r"""Separable least squares for sums of exponentials: Y ≈ E(μ) R, with E one column μ^k a pole and R free.

With unit noise and free residues the cost is tr((I - P) Y Yᵀ), P the projector on the columns of E, so that all that
the data are needed for is a factor F with F Fᵀ = Y Yᵀ (`_factor`). The gradient is that of the
variable projection; the Gauss-Newton matrix is Kaufman's (1975),

.. math:: H_{st} = (d_s^H (I-P) d_t) \sum_j \bar R_{sj} R_{tj}, \qquad d_s = \partial e_s/\partial s

The residues carry noise of their own, which inflates H. Its expectation is taken off (`information`), and the
covariance of the poles is the sandwich I⁻¹ H I⁻¹: the free residues are nuisance parameters whose number grows with
the data, and the plain inverse would be too small wherever a mode is weak.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import BLOCK, Complexes, Floats, Integers
from floquid._checks import frozen_array, input_error
from floquid.fit import AT_REST, STEPS, Ends, Normal, Steps, levenberg_marquardt, positive_part, sandwich
from floquid.lti._factor import Factor
from floquid.lti._poles import LARGEST_GROWTH, PAIR, PoleSet
from floquid.lti._types import ModalModel, Outcome, TimeResponses


@dataclass(frozen=True, slots=True)
class Fit:
    """The least-squares fit of one set of poles: its cost, and what a step and the covariance need."""

    poles: PoleSet
    cost: float
    gradient: Floats
    gauss_newton: Floats
    information: Floats

    def covariance(self) -> Floats:
        """The covariance of the real parameters (order, order), for noise of unit variance."""
        return sandwich(self.information, self.gauss_newton)


def powers(s: Complexes, samples: int) -> Complexes:
    """The columns e^{sk} (samples, poles), each scaled to a largest entry of one (a growing mode must not overflow)."""
    # Where their squares would be denormal they are zero: denormal numbers cost a hundred times as much as others.
    grows, span = s.real > 0, int(np.ceil(np.sqrt(samples)))
    decaying = np.asarray(np.where(grows, -s, s), np.complex128)
    # e^{s(qa + b)} is the product of two, each one of √samples exponentials.
    late = np.exp((span * np.arange(-(-samples // span))[:, None]) * decaying)
    columns = (late[:, None] * np.exp(np.arange(span)[:, None] * decaying)).reshape(span * len(late), len(s))[:samples]
    columns[np.arange(samples)[:, None] * decaying.real <= -LARGEST_GROWTH] = 0.0
    columns[:, grows] = columns[::-1, grows]
    return columns


def real_powers(poles: PoleSet, samples: int) -> Floats:
    """Real columns of the same space (samples, order): of a pair Re and Im of its own, the upper one."""
    columns, starts = powers(poles.s, samples), poles.starts()
    out = np.empty((samples, poles.order))
    out[:, starts] = columns.real
    pair = poles.kind == PAIR
    out[:, starts[pair] + 1] = columns.imag[:, pair]
    return out


def real_basis(poles: PoleSet, columns: Complexes) -> Floats:
    """Span the same space by real columns (samples, order): Re and Im of a pair, the column of a real pole."""
    first, _ = poles.columns()
    imaginary = np.arange(poles.order) > first
    return np.where(imaginary, columns[:, first].imag, columns[:, first].real)


def complex_residues(poles: PoleSet, real: Floats) -> Complexes:
    """Residues of the complex columns (order, …) from those of the real ones (order, …)."""
    out = np.zeros(real.shape, complex)
    for start, kind in zip(poles.starts(), poles.kind, strict=True):
        if kind == PAIR:
            out[start] = 0.5 * (real[start] - 1j * real[start + 1])
            out[start + 1] = out[start].conj()
        else:
            out[start] = real[start]
    return out


def _remainder(block: Factor, q: Floats, projected: Floats) -> float:
    """||(I - QQᵀ) F||²: by subtraction, unless so little is left that rounding would show."""
    whole = block.energy
    left = whole - float(np.sum(projected**2))
    return left if left > 1e-6 * whole else float(np.sum((block.values - q @ projected) ** 2))


def _decomposed(poles: PoleSet, samples: int) -> tuple[Floats, Floats, Floats]:
    """Q and R of the real columns, and their slopes less what the columns take of them (samples, order)."""
    columns = real_powers(poles, samples)
    q, r = np.linalg.qr(columns)
    slopes = np.arange(samples)[:, None] * columns
    return q, r, slopes - q @ (q.T @ slopes)


def fit(poles: PoleSet, factors: Sequence[Factor]) -> Fit:
    """Cost, gradient and information matrices at `poles`."""
    # In real columns: a pair is a Re e + b Im e, and its slopes by Re s and Im s are a c + b d and b c - a d, with c
    # and d the real and imaginary parts of de/ds. So each parameter has one coefficient on the first column of its
    # entry, a or b, and one on the second, b or -a, and all sums over responses are in the second moments of a and b.
    n, slopes_of = poles.order, Slopes.of(poles)
    cost, gradient = 0.0, np.zeros(n)
    whole, noise = np.zeros((n, n)), np.zeros((n, n))
    for block in factors:
        q, r, slopes = _decomposed(poles, len(block.values))
        both = np.concatenate([q, slopes], axis=1).T @ block.values
        rank = q.shape[1]  # of a block with fewer samples than poles, its samples
        projected, seen = both[:rank], both[rank:]
        cost += _remainder(block, q, projected)
        inverse = np.linalg.pinv(r, rcond=1e-14)
        residues = inverse @ projected
        curvature = slopes.T @ slopes
        gradient += slopes_of.gradient(seen, residues)
        moved = slopes_of.moved(curvature)
        whole += slopes_of.matrix(moved, residues @ residues.T)
        noise += block.columns * slopes_of.matrix(moved, inverse @ inverse.T)
    return Fit(poles, cost, gradient, whole, positive_part(whole, whole - noise))


def of_dependent_noise(found: Fit, factors: Sequence[Factor]) -> Fit:
    r"""The fit with the covariance of a gradient whose noise is not independent between responses.

    .. math:: \operatorname{cov} g_{st} = (d_s^H (I-P) d_t)\, (\bar R \hat\Sigma R^T)_{st}, \qquad
              \hat\Sigma = \frac{Y^T (I-P)\, Y}{N - n}

    in place of the Gauss-Newton matrix, which is the same for Σ = I. Σ is not formed: what is needed of it is the
    residual times the residues.
    """
    poles, n = found.poles, found.poles.order
    slopes_of, scatter = Slopes.of(poles), np.zeros((n, n))
    for block in factors:
        samples = len(block.values)
        q, r, slopes = _decomposed(poles, samples)
        projected = q.T @ block.values
        residues = np.linalg.pinv(r, rcond=1e-14) @ projected
        turned = (block.values - q @ projected) @ residues.T
        scatter += slopes_of.matrix(slopes_of.moved(slopes.T @ slopes), turned.T @ turned / max(samples - n, 1))
    return replace(found, gauss_newton=scatter)


@dataclass(frozen=True, slots=True)
class Slopes:
    """Columns that each real parameter moves, and the residues that are its coefficients there (order,) each."""

    columns: tuple[Integers, Integers]
    residues: tuple[Integers, Integers]
    sign: Floats  # of the coefficient on the second column: 1, -1, or 0 where there is none

    @staticmethod
    def of(poles: PoleSet) -> Slopes:
        """For the parameters of these poles."""
        first, second = poles.columns()
        this, pair = np.arange(poles.order), second > first
        sign = np.where(pair, np.where(this > first, -1.0, 1.0), 0.0)
        return Slopes((first, second), (this, np.where(pair, first + second - this, this)), sign)

    def gradient(self, seen: Floats, residues: Floats) -> Floats:
        """Σ_j of the slopes' products with the data (order,), from those of the columns (order, responses)."""
        (first, second), (on_first, on_second) = self.columns, self.residues
        one = np.einsum("pj,pj->p", seen[first], residues[on_first])
        return one + self.sign * np.einsum("pj,pj->p", seen[second], residues[on_second])

    def moved(self, curvature: Floats) -> Floats:
        """The products of the columns that each two parameters move (2, order, 2, order), from those of all columns."""
        both = np.concatenate(self.columns)
        signs = np.concatenate([np.ones(len(self.sign)), self.sign])
        n = len(curvature)
        return (curvature[both][:, both] * signs[:, None] * signs).reshape(2, n, 2, n)

    def matrix(self, moved: Floats, moments: Floats) -> Floats:
        """Σ_j of the slopes' products with one another (order, order), from `moved` and the residues' moments."""
        both, n = np.concatenate(self.residues), len(moments)
        return (moved * moments[both][:, both].reshape(2, n, 2, n)).sum(axis=(0, 2))


def polish(
    start: PoleSet | Fit,
    factors: Sequence[Factor],
    *,
    iterations: int = STEPS,
    tolerance: float = AT_REST,
    enough: float = -np.inf,
) -> Fit:
    """The maximum-likelihood poles near those of the start: steps to the least projected cost."""
    return levenberg_marquardt(
        start if isinstance(start, Fit) else fit(start, factors),
        Steps(
            normal=lambda at: Normal(matrix=at.information, gradient=at.gradient),
            moved=lambda at, step: fit(at.poles.moved(step), factors),
            limited=no_longer,
            enough=lambda at, _: at.cost < enough,
        ),
        Ends(steps=iterations, deviations=tolerance),
    )


def no_longer(_at: object, step: Floats, _normal: Normal, _damping: float) -> Floats:
    """A step whose parts are at most one neper or radian a sample."""
    return step / max(1.0, float(np.abs(step).max()))


def fit_residues(
    multipliers: ArrayLike,
    data: TimeResponses,
    *,
    covariance: Floats | None = None,
    outcome: Outcome = Outcome.SUCCESS,
    stats: Mapping[str, float] | None = None,
) -> ModalModel:
    r"""The modal model of given multipliers, conjugates next to each other: the residues that leave least.

    .. math:: \min_R \sum_k \Big( y_{oi}[k] - \sum_r R_{r,oi}\, \mu_r^k \Big)^2, \qquad
              R = E^+ y, \quad E_{kr} = \mu_r^k

    This is the last step of most identifiers, and all that an algorithm of poles alone needs to become one.

    Raises InputError where a multiplier is zero or not finite, or there are as many as samples.

    Parameters
    ----------
    multipliers
        μ (modes,). Of each conjugate pair both, or only the one above the real axis, may be given.
    data
        The responses.
    covariance
        Of the poles (2 modes, 2 modes) in the order of the model's multipliers [1/s²].
    outcome
        How the identification ended.
    stats
        Numbers about the fit.
    """
    given = frozen_array(multipliers, "multipliers", "fit_residues", axes=("modes",), dtype=np.complex128)
    if (given == 0).any():
        raise input_error("multipliers", "fit_residues", "not be zero", f"holds {int((given == 0).sum())} zeros")
    poles = PoleSet.from_multipliers(given)
    samples = int(data.lengths.max())
    if poles.order >= samples:
        raise input_error("multipliers", "fit_residues", f"be fewer than the {samples} samples", f"are {poles.order}")
    return model_of(poles, data, covariance=covariance, outcome=outcome, stats=stats)


def model_of(
    poles: PoleSet,
    data: TimeResponses,
    *,
    covariance: Floats | None = None,
    outcome: Outcome = Outcome.SUCCESS,
    stats: Mapping[str, float] | None = None,
) -> ModalModel:
    """The modal model of a set of poles."""
    n = poles.order
    residues = np.zeros((n, data.n_outputs, data.n_inputs), complex)
    spread, slope = np.zeros((2, data.n_inputs, n, n), complex)
    residual = np.zeros((data.n_outputs, data.n_inputs))
    for i in range(data.n_inputs):
        residues[:, :, i], spread[i], slope[i], residual[:, i] = _of_input(poles, data, i)
    return ModalModel(
        multipliers=poles.multipliers(),
        residues=residues,
        dt=data.dt,
        covariance=covariance,
        residue_spread=spread,
        residue_slope=slope,
        residual_std=residual,
        outcome=outcome,
        stats=stats or {},
    )


def from_sample_zero(poles: PoleSet, samples: int) -> tuple[Complexes, Complexes]:
    """Factor that takes residues of the columns of `powers` to sample zero, where they belong; and its inverse."""
    # A pole of noise that would have to start from less than can be computed with has no residue: zero for both.
    s = poles.full()
    growth = np.where(s.real > 0, samples - 1, 0) * s
    scale = np.exp(-np.minimum(growth.real, LARGEST_GROWTH) - 1j * growth.imag)
    scale = np.where(growth.real < LARGEST_GROWTH, scale, 0.0)
    return scale, np.divide(1.0, scale, out=np.zeros_like(scale), where=scale != 0)


def _of_input(poles: PoleSet, data: TimeResponses, number: int) -> tuple[Complexes, Complexes, Complexes, Floats]:
    """Residues (n, outputs), their spread and slope (n, n), and the residual's deviation (outputs,), of one input."""
    samples = int(data.lengths[number])
    columns = powers(poles.full(), samples)
    q, r = np.linalg.qr(real_basis(poles, columns))
    inverse = np.linalg.pinv(r, rcond=1e-14)
    residues = np.zeros((poles.order, data.n_outputs), complex)
    left = np.zeros(data.n_outputs)
    scale, back = from_sample_zero(poles, samples)
    step = max(1, BLOCK // samples)
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        block = data.values[part, number, :samples]
        projected = block @ q
        residues[:, part] = scale[:, None] * complex_residues(poles, inverse @ projected.T)
        left[part] = _energy_left(block, q, projected)
    # The pseudoinverse is this times Qᵀ, whose rows are orthonormal: it is never formed.
    inner = scale[:, None] * complex_residues(poles, inverse)
    moved = np.arange(samples)[:, None] * columns * back
    slope = inner @ (q.T @ moved.real + 1j * (q.T @ moved.imag))
    return residues, inner @ inner.conj().T, slope, np.sqrt(left / max(samples - poles.order, 1))


def _energy_left(block: Floats, q: Floats, projected: Floats) -> Floats:
    """||y - y q qᵀ||² (outputs,): by subtraction, unless so little is left that rounding would show."""
    whole = np.einsum("ok,ok->o", block, block)
    left = whole - np.einsum("on,on->o", projected, projected)
    small = left < 1e-6 * whole
    if small.any():
        left[small] = np.sum((block[small] - projected[small] @ q.T) ** 2, axis=1)
    return left
