"""How well the poles of known responses can be told: the Cramér-Rao bound, independent of the code that it judges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error, positive
from floquid.testing._separable import information, parameters, projected


@dataclass(frozen=True, slots=True)
class Known:
    """A known model over noise: multipliers closed under conjugation, `size` 2 for a pair and 1 for a real one."""

    multipliers: NDArray[np.complex128]
    residues: NDArray[np.complex128]
    lengths: NDArray[np.int64]
    dt: float
    upper: NDArray[np.intp]
    partner: NDArray[np.intp]

    @property
    def size(self) -> NDArray[np.int64]:
        """The number of poles behind each of the upper ones (upper,)."""
        return np.where(self.partner[self.upper] == self.upper, 1, 2)

    @property
    def logs(self) -> NDArray[np.complex128]:
        """The logarithms of the multipliers (modes,)."""
        return np.asarray(np.log(self.multipliers), dtype=np.complex128)

    def keep(self, modes: NDArray[np.bool_]) -> Known:
        """The model of some of the modes; conjugates stay together."""
        position = np.cumsum(modes) - 1
        upper, partner = self.upper[modes[self.upper]], self.partner[modes]
        return Known(
            self.multipliers[modes], self.residues[modes], self.lengths, self.dt, position[upper], position[partner]
        )


def known_model(
    multipliers: ArrayLike, residues: ArrayLike, noise: ArrayLike, lengths: ArrayLike, dt: float, of: str
) -> Known:
    """The arguments checked, the residues over their noise."""
    mu: NDArray[np.complex128] = frozen_array(
        multipliers, "multipliers", of, axes=("modes",), dtype=np.complex128
    ).copy()
    free: NDArray[np.complex128] = frozen_array(
        residues, "residues", of, axes=(len(mu), "outputs", "inputs"), dtype=np.complex128
    )
    std = frozen_array(noise, "noise", of, axes=free.shape[1:])
    samples = frozen_array(lengths, "lengths", of, axes=(free.shape[2],), dtype=np.int64)
    if not (std > 0).all():
        raise input_error("noise", of, "be positive", f"has {std.min():g}", "Give noise-free responses their rounding.")
    if (mu == 0).any():
        raise input_error("multipliers", of, "not be zero", f"holds {int((mu == 0).sum())} zeros")
    if len(mu) >= samples.min():
        must = f"be fewer than the {samples.min()} samples of the shortest input"
        raise input_error("multipliers", of, must, f"are {len(mu)}", "Bounds need more samples than poles.")
    real = np.abs(mu.imag) <= 1e-12 * np.abs(mu)
    partner = np.argmin(np.abs(mu[:, None] - mu.conj()), axis=1) if len(mu) else np.zeros(0, np.intp)
    mu[real] = mu[real].real
    partner = np.where(real, np.arange(len(mu)), partner)
    closed = np.abs(mu[partner] - mu.conj()) <= 1e-9 * np.abs(mu)
    if not closed.all() or not np.array_equal(partner[partner], np.arange(len(mu))):
        got = f"{mu[~closed][0] if not closed.all() else mu[0]:.6g} has none of its own"
        raise input_error("multipliers", of, "hold the conjugate of each", got, "Count conjugates one by one.")
    upper = np.flatnonzero(real | (mu.imag > 0))
    over = np.asarray(free / std, dtype=np.complex128)
    return Known(mu, over, samples, positive(dt, "dt", of, unit="s"), upper, partner)


def cramer_rao_bound(
    multipliers: ArrayLike, residues: ArrayLike, noise: ArrayLike, lengths: ArrayLike, dt: float
) -> NDArray[np.float64]:
    r"""The least covariance that an unbiased estimate of the poles can have, the residues being unknown too.

    .. math:: y_{oi}[k] = \sum_r R_{r,oi} \mu_r^k + \sigma_{oi} n[k], \qquad
              F = \sum_{oi} \frac{1}{\sigma_{oi}^2} J_{oi}^T (I - P_i) J_{oi}, \qquad
              J_{oi} = \frac{\partial y_{oi}}{\partial s}

    with s the real and imaginary parts of ln μ and P the projector on the real columns of the exponentials, which
    takes out what the free residues could do. The slopes k μ^k are those of all outputs, so that F is an entrywise
    product of their projected Gram matrices and the outer products of the residues, summed over outputs (Golub and
    Pereyra 1973; Stoica and Nehorai 1989). A real multiplier has no imaginary part to estimate. Where modes coincide
    the variance is very large rather than infinite.

    Parameters
    ----------
    multipliers
        μ, with the conjugate of each (modes,).
    residues
        R (modes, outputs, inputs) [units of the responses].
    noise
        The standard deviations of the white noise (outputs, inputs) [units of the responses].
    lengths
        The number of samples of each input (inputs,).
    dt
        The sampling interval [s].

    Returns
    -------
    ndarray
        The bound of the poles ln μ / dt (2 modes, 2 modes), real parts, then imaginary parts [1/s²].

    Raises
    ------
    InputError
        A shape or a value is not possible, a conjugate is missing, or there are as many poles as samples.
    """
    return bound_of(known_model(multipliers, residues, noise, lengths, dt, "cramer_rao_bound"))


def bound_of(known: Known) -> NDArray[np.float64]:
    """The Cramér-Rao bound of all poles, conjugates included."""
    n, at, size = len(known.multipliers), known.upper, known.size
    if not n:
        return np.zeros((0, 0))
    real = size == 1
    moves, turn = parameters(real)
    whole = np.zeros((len(moves), len(moves)))
    for length in np.unique(known.lengths):
        block = projected(known.logs[at], real, int(length))
        residues = known.residues[at][:, :, known.lengths == length].reshape(len(at), -1) / block.scale[:, None]
        whole += information(block, residues, real)
    small = _inverse(whole)
    onto = np.zeros((2 * n, len(moves)))
    for row, (entry, kind) in enumerate(zip(moves, turn, strict=True)):
        mode = at[entry]
        other = known.partner[mode]
        if kind.imag:
            onto[n + mode, row], onto[n + other, row] = 1.0, -1.0
        else:
            onto[[mode, other], row] = 1.0
    return onto @ small @ onto.T / known.dt**2


def _inverse(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse by way of a unit diagonal; a direction without information has a very large variance."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    least = len(scale) * np.finfo(float).eps
    return (vectors / np.maximum(values, least)) @ vectors.T / np.outer(scale, scale)
