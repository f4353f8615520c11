"""Truth to hold results against: the Cramér-Rao bound, and an A(t) built backwards from exponents of one's choice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import finite, frozen_array, input_error, integer, noise_array, positive
from floquid.floquet import FunctionMatrix


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


def system_with_exponents(
    exponents: ArrayLike, period: float, *, seed: int = 0, n_harmonics: int = 2, strength: float = 0.5
) -> FunctionMatrix:
    r"""A(t) that has exactly the exponents given, with random periodic shapes.

    .. math:: A = (\dot P + P R)\, P^{-1}, \qquad
              P(t) = Q \Bigl(I + \sum_{m=1}^{M} (C_m \cos m\omega t + S_m \sin m\omega t)\Bigr)^{-1} G(t)

    with R real and block diagonal, Q orthogonal, and the norms of all C and S together `strength`, so that P exists
    at all times. The harmonics of the shapes and of A have no end, and fall as powers of the strength. G turns the
    plane of each pair of real negative multipliers by half a turn a period. Floquet 1883, read from right to left.

    Raises InputError where an exponent has no conjugate, real negative multipliers are odd in number, or a number is
    out of its range.

    Parameters
    ----------
    exponents
        λ (modes,) [1/s], a conjugate beside each complex one; those of real negative multipliers, Im λ = ω/2 modulo
        ω, in even number.
    period
        The period T [s].
    seed, n_harmonics, strength
        The seed of the random shapes; M, at least 1; how far the shapes are from constant ones, in [0, 1).
    """
    of = "system_with_exponents"
    length = positive(period, "period", of, unit="s")
    fundamental = 2.0 * np.pi / length
    rate, turning = _real_form(frozen_array(exponents, "exponents", of, dtype=np.complex128, axes=("modes",)), length)
    n = len(rate)
    share = finite(strength, "strength", of)
    if not 0.0 <= share < 1.0:
        raise input_error("strength", of, "lie in [0, 1)", f"is {share:g}")
    generator = np.random.default_rng(integer(seed, "seed", of, at_least=0))
    orders = fundamental * np.arange(1, integer(n_harmonics, "n_harmonics", of, at_least=1) + 1)
    waves = generator.standard_normal((2, len(orders), n, n)) / np.arange(1, len(orders) + 1)[:, None, None] ** 2
    waves *= share / np.linalg.norm(waves, ord=2, axis=(2, 3)).sum()
    frame = np.linalg.qr(generator.standard_normal((n, n)))[0]
    spin = 0.5 * fundamental * (turning - turning.T)

    def system(times: Floats) -> Floats:
        t = np.asarray(times, dtype=np.float64)
        c, s = np.cos(np.multiply.outer(t, orders)), np.sin(np.multiply.outer(t, orders))
        inner = np.eye(n) + np.tensordot(c, waves[0], 1) + np.tensordot(s, waves[1], 1)
        inner_rate = np.tensordot(c * orders, waves[1], 1) - np.tensordot(s * orders, waves[0], 1)
        # P = Q W⁻¹ G: G commutes with its own spin, and G R G⁻¹ is what its turning makes of R.
        turned = _turned(turning, 0.5 * fundamental * t)
        middle = spin + turned @ rate @ turned.swapaxes(-1, -2)
        return frame @ np.linalg.solve(inner, middle @ inner - inner_rate) @ frame.T

    return FunctionMatrix(function=system, period=length, vectorised=True)


def _turned(turning: Floats, angle: Floats) -> Floats:
    """The rotation by `angle` (times,) of each marked plane (times, n, n)."""
    marked = np.diag((turning + turning.T).sum(axis=0))
    still = np.eye(len(turning)) - marked
    return still + np.cos(angle)[:, None, None] * marked + np.sin(angle)[:, None, None] * (turning - turning.T)


def _real_form(exponents: Complexes, period: float) -> tuple[Floats, Floats]:
    """R, real and block diagonal, and a one below each plane that turns by half a turn a period."""
    of = "system_with_exponents"
    fundamental = 2.0 * np.pi / period
    turns = exponents.imag / fundamental
    negative = np.abs(np.abs(turns - np.round(turns)) - 0.5) < 1e-12
    real = ~negative & (exponents.imag == 0.0)
    upper = np.flatnonzero(~negative & (exponents.imag > 0.0))
    lower = list(np.flatnonzero(~negative & (exponents.imag < 0.0)))
    n = len(exponents)
    rate, turning, place = np.zeros((n, n)), np.zeros((n, n)), 0
    for index in upper:
        partner = [i for i in lower if abs(exponents[i] - exponents[index].conjugate()) <= 1e-12 * abs(exponents[i])]
        if not partner:
            break
        lower.remove(partner[0])
        a, b = exponents[index].real, exponents[index].imag
        rate[place : place + 2, place : place + 2] = [[a, b], [-b, a]]
        place += 2
    if lower or place != 2 * len(upper):
        raise input_error("exponents", of, "hold the conjugate of each complex one", f"are {exponents.tolist()}")
    if negative.sum() % 2:
        must = "have an even number of real negative multipliers"
        remedy = "An odd number would make det Φ(T, 0) negative, which no real A(t) does."
        raise input_error("exponents", of, must, f"have {int(negative.sum())}", remedy)
    halves = exponents[negative].real
    planes = np.arange(place, place + len(halves), 2)
    turning[planes + 1, planes] = 1.0
    rest = np.arange(place, n)
    rate[rest, rest] = np.concatenate([halves, exponents[real].real])
    return rate, turning
