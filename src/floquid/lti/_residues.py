"""The residues that belong to given poles, and what noise does to them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error
from floquid.lti._exponentials import complex_residues, powers, real_basis
from floquid.lti._factor import BLOCK
from floquid.lti._poles import PoleSet
from floquid.lti._types import ModalModel, Outcome, TimeResponses

LARGEST_GROWTH = 345.0
"""The logarithm of the growth over a record beyond which squares leave the range of floating point."""


def fit_residues(
    multipliers: ArrayLike,
    data: TimeResponses,
    *,
    covariance: NDArray[np.float64] | None = None,
    outcome: Outcome = Outcome.SUCCESS,
    stats: Mapping[str, float] | None = None,
) -> ModalModel:
    r"""The modal model of given multipliers, conjugates next to each other: the residues that leave least.

    .. math:: \min_R \sum_k \Big( y_{oi}[k] - \sum_r R_{r,oi}\, \mu_r^k \Big)^2, \qquad
              R = E^+ y, \quad E_{kr} = \mu_r^k

    This is the last step of most identifiers, and all that an algorithm of poles alone needs to become one.

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

    Raises
    ------
    InputError
        A multiplier is zero or not finite, or there are as many as samples.
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
    covariance: NDArray[np.float64] | None = None,
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


def _of_input(
    poles: PoleSet, data: TimeResponses, number: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
    """Residues (n, outputs), their spread and slope (n, n), and the residual's deviation (outputs,), of one input."""
    samples = int(data.lengths[number])
    columns = powers(poles.full(), samples)
    q, r = np.linalg.qr(real_basis(poles, columns))
    inverse = np.linalg.pinv(r, rcond=1e-14)
    residues = np.zeros((poles.order, data.n_outputs), complex)
    left = np.zeros(data.n_outputs)
    # The columns were scaled so that a growing mode cannot overflow; residues belong to sample zero.
    s = poles.full()
    growth = np.where(s.real > 0, samples - 1, 0) * s
    # A pole of noise that would have to start from less than can be computed with has no residue.
    scale = np.where(
        growth.real < LARGEST_GROWTH, np.exp(-np.minimum(growth.real, LARGEST_GROWTH) - 1j * growth.imag), 0
    )
    back = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale != 0)
    step = max(1, BLOCK // samples)
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        block = data.values[part, number, :samples]
        projected = block @ q
        residues[:, part] = scale[:, None] * complex_residues(poles, inverse @ projected.T)
        left[part] = _energy_left(block, q, projected)
    pinv = scale[:, None] * complex_residues(poles, inverse @ q.T)
    slope = pinv @ (np.arange(samples)[:, None] * columns * back)
    return residues, pinv @ pinv.conj().T, slope, np.sqrt(left / max(samples - poles.order, 1))


def _energy_left(
    block: NDArray[np.float64], q: NDArray[np.float64], projected: NDArray[np.float64]
) -> NDArray[np.float64]:
    """||y - y q qᵀ||² (outputs,): by subtraction, unless so little is left that rounding would show."""
    whole = np.einsum("ok,ok->o", block, block)
    left = whole - np.einsum("on,on->o", projected, projected)
    small = left < 1e-6 * whole
    if small.any():
        left[small] = np.sum((block[small] - projected[small] @ q.T) ** 2, axis=1)
    return left
