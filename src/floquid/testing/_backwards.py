"""Periodic systems built backwards from the exponents they are to have."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import finite, frozen_array, input_error, integer, positive
from floquid.floquet import FunctionMatrix


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
