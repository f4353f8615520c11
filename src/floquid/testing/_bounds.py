"""Cramér-Rao bound of the poles of known responses, independent of the code that it judges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import frozen_array, input_error, noise_array, positive


@dataclass(frozen=True, slots=True)
class Known:
    """A known model over noise: multipliers closed under conjugation, `size` 2 for a pair and 1 for a real one."""

    multipliers: Complexes
    residues: Complexes
    lengths: Integers
    dt: float
    upper: Indices
    partner: Indices

    @property
    def size(self) -> Integers:
        """The number of poles behind each of the upper ones (upper,)."""
        return np.where(self.partner[self.upper] == self.upper, 1, 2)

    @property
    def logs(self) -> Complexes:
        """The logarithms of the multipliers (modes,)."""
        return np.asarray(np.log(self.multipliers), dtype=np.complex128)


def known_model(
    multipliers: ArrayLike, residues: ArrayLike, noise: ArrayLike, lengths: ArrayLike, dt: float, of: str
) -> Known:
    """The arguments checked, the residues over their noise."""
    mu: Complexes = frozen_array(multipliers, "multipliers", of, axes=("modes",), dtype=np.complex128).copy()
    free: Complexes = frozen_array(residues, "residues", of, axes=(len(mu), "outputs", "inputs"), dtype=np.complex128)
    std = noise_array(noise, of, free.shape[1:], remedy="Give noise-free responses their rounding.")
    samples = frozen_array(lengths, "lengths", of, axes=(free.shape[2],), dtype=np.int64)
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
) -> Floats:
    r"""The least covariance that an unbiased estimate of the poles can have, the residues being unknown too.

    .. math:: y_{oi}[k] = \sum_r R_{r,oi} \mu_r^k + \sigma_{oi} n[k], \qquad
              F = \sum_{oi} \frac{1}{\sigma_{oi}^2} J_{oi}^T (I - P_i) J_{oi}, \qquad
              J_{oi} = \frac{\partial y_{oi}}{\partial s}

    with s the real and imaginary parts of ln μ and P the projector on the real columns of the exponentials. P takes out
    the part of the free residues. The slopes k μ^k are those of all outputs, so that F is an entrywise product of their
    projected Gram matrices and the outer products of the residues, summed over outputs (Golub and Pereyra 1973; Stoica
    and Nehorai 1989). A real multiplier has no imaginary part to estimate. Where modes coincide the variance is very
    large rather than infinite.

    The bound is that of the poles ln μ / dt (2 modes, 2 modes), real parts, then imaginary parts [1/s²]. Raises
    InputError where a shape or a value is not possible, a conjugate is missing, or there are as many poles as samples.

    Parameters
    ----------
    multipliers, residues
        μ, with the conjugate of each (modes,), and R (modes, outputs, inputs) [units of the responses].
    noise
        The standard deviations of the white noise (outputs, inputs) [units of the responses].
    lengths, dt
        The number of samples of each input (inputs,), and the sampling interval [s].
    """
    return bound_of(known_model(multipliers, residues, noise, lengths, dt, "cramer_rao_bound"))


def bound_of(known: Known) -> Floats:
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


def _inverse(information: Floats) -> Floats:
    """The inverse by way of a unit diagonal; a direction without information has a very large variance."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    least = len(scale) * np.finfo(float).eps
    return (vectors / np.maximum(values, least)) @ vectors.T / np.outer(scale, scale)


@dataclass(frozen=True, slots=True)
class Projected:
    """Exponentials of one length: an orthonormal basis of their real columns, and what of their slopes is outside it.

    `scale` is what each column was multiplied by: a growing mode must not overflow.
    """

    basis: Floats
    triangle: Floats
    slopes: Complexes
    scale: Floats


def columns_of(logs: Complexes, real: Mask, samples: int) -> tuple[Complexes, Floats, Floats]:
    """The columns e^{sk} scaled (samples, n), their real form (samples, poles), and the scale (n,)."""
    last = np.where(logs.real > 0, (samples - 1) * logs.real, 0.0)
    exponent = np.arange(samples)[:, None] * logs - last
    columns: Complexes = np.where(np.real(exponent) > -138.0, np.exp(exponent), 0.0)
    return columns, np.concatenate([columns.real, columns.imag[:, ~real]], axis=1), np.exp(-last)


def projected(logs: Complexes, real: Mask, samples: int) -> Projected:
    """The basis and the projected slopes of poles with logarithms s (n,), one a pair, `real` where one is its own."""
    columns, flat, scale = columns_of(logs, real, samples)
    q, r = np.linalg.qr(flat)
    slopes = np.arange(samples)[:, None] * columns
    slopes = slopes - q @ (q.T @ slopes)
    return Projected(q, r, slopes, scale)


def parameters(real: Mask) -> tuple[Indices, Complexes]:
    """The real parameters: which logarithm each belongs to, and what it multiplies R d by in the response."""
    pairs = np.flatnonzero(~real)
    turn = np.zeros(len(real) + len(pairs), np.complex128)
    turn[: len(real)], turn[len(real) :] = np.where(real, 1.0, 2.0), 2.0j
    return np.concatenate([np.arange(len(real)), pairs]), turn


def information(block: Projected, residues: Complexes, real: Mask) -> Floats:
    """Σ over responses of Jᵀ(I - P)J, for residues (n, responses) of the scaled columns (parameters, parameters)."""
    moves, turn = parameters(real)
    straight = (residues.conj() @ residues.T) * (block.slopes.conj().T @ block.slopes)
    crossed = (residues @ residues.T) * (block.slopes.T @ block.slopes)
    pick = np.ix_(moves, moves)
    return 0.5 * (np.outer(turn.conj(), turn) * straight[pick] + np.outer(turn, turn) * crossed[pick]).real
