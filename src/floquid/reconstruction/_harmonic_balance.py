r"""Floquet modes of an equation of motion by harmonic balance, with their slopes by its parameters.

With u the coefficients of a shape, s = λ + imω and d the order of the highest derivative,

.. math:: F_m = s_m^d\, u_m - \sum_{p<d} \sum_k A^{(p)}_k\, s_{m-k}^p\, u_{m-k} = 0, \qquad c^H u = 1

is solved for λ and u by Newton's method from a mode that is near. This is Hill's equation cut off at a harmonic, one
mode at a time: no eigenvalue is searched for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError

Array = NDArray[Any]

STEPS = 25  # newton steps at most
DONE = 1e-13  # the relative step at which they end


class NoModeError(IdentificationError):
    """The equation of motion has no mode near the one that is looked for."""


@dataclass(frozen=True, slots=True)
class Mode:
    """A Floquet mode."""

    exponent: complex
    coefficients: Array  # (harmonics, displacements)


@dataclass(frozen=True, slots=True)
class Slopes:
    """Derivatives of a mode with respect to the parameters, and to ω last."""

    exponent: Array  # (parameters + 1,)
    coefficients: Array  # (parameters + 1, harmonics, displacements)

    def with_gap(self, count: int) -> Slopes:
        """With parameters added, before ω, that move nothing."""
        place = len(self.exponent) - 1
        still = np.zeros((count, *self.coefficients.shape[1:]))
        return Slopes(
            np.concatenate([self.exponent[:place], np.zeros(count), self.exponent[place:]]),
            np.concatenate([self.coefficients[:place], still, self.coefficients[place:]]),
        )


def solved(matrices: Array, mode: Mode, anchor: Array, fundamental: float) -> tuple[Mode, Array]:
    """The mode of these coefficient matrices (d, harmonics, n, n) near another, and the bordered Jacobian there."""
    width = len(mode.coefficients) // 2
    turns = 1j * fundamental * np.arange(-width, width + 1)
    lam, u = mode.exponent, mode.coefficients / np.sum(anchor.conj() * mode.coefficients)
    size = u.size
    for _ in range(STEPS):
        rest, jacobian = _equations(matrices, lam, u, turns, anchor)
        step = np.linalg.solve(jacobian, np.append(-rest.ravel(), 1.0 - np.sum(anchor.conj() * u)))
        u = u + step[:size].reshape(u.shape)
        lam = complex(lam + step[size])
        if not np.isfinite(lam):
            break
        small = np.linalg.norm(step[:size]) < DONE * np.linalg.norm(u)
        if small and abs(step[size]) < DONE * (abs(lam) + fundamental):
            return Mode(lam, u), _equations(matrices, lam, u, turns, anchor)[1]
    raise NoModeError("No mode of the structured equation of motion lies near the one identified.")


def _equations(matrices: Array, lam: complex, u: Array, turns: Array, anchor: Array) -> tuple[Array, Array]:
    """F (harmonics, displacements), and its Jacobian by u and λ, bordered by the normalisation."""
    degree, size = len(matrices), u.size
    rates = lam + turns
    n, count = u.shape[1], len(turns)
    bands = _banded(matrices, count)
    powers = [rates**p for p in range(degree + 1)]
    by_shape = -sum(bands[p] * powers[p][None, None, :, None] for p in range(degree))
    by_shape = np.asarray(by_shape)
    by_shape[np.arange(count), :, np.arange(count), :] += powers[degree][:, None, None] * np.eye(n)
    by_rate = _by_rates(bands, rates, u).sum(axis=2)
    jacobian = np.zeros((size + 1, size + 1), complex)
    jacobian[:size, :size] = by_shape.reshape(size, size)
    jacobian[:size, size] = by_rate.ravel()
    jacobian[size, :size] = anchor.conj().ravel()
    rest = np.einsum("minj,nj->mi", by_shape, u)
    return rest, jacobian


def _banded(matrices: Array, count: int) -> Array:
    """A_{m-n} (d, m, i, n, j)."""
    most, n = matrices.shape[1] // 2, matrices.shape[-1]
    bands = np.zeros((len(matrices), count, n, count, n), complex)
    for k in range(-most, most + 1):
        rows = np.arange(max(0, k), min(count, count + k))
        bands[:, rows, :, rows - k, :] = matrices[:, most + k]
    return bands


def _by_rates(bands: Array, rates: Array, u: Array) -> Array:
    """The slope of F (m, i) by the rate of each harmonic (m, i, n)."""
    degree, count = len(bands), len(rates)
    by_rate = np.zeros((*u.shape, count), complex)
    for p in range(1, degree):
        by_rate -= p * np.einsum("minj,nj->min", bands[p], u * rates[:, None] ** (p - 1))
    by_rate[np.arange(count), :, np.arange(count)] += degree * u * rates[:, None] ** (degree - 1)
    return by_rate


def slopes_of(basis: Array, matrices: Array, mode: Mode, jacobian: Array, fundamental: float) -> Slopes:
    """Derivatives of a mode with respect to the parameters of a basis (parameters, d, harmonics, n, n), and to ω."""
    u, count = mode.coefficients, len(mode.coefficients)
    width, most, degree = count // 2, matrices.shape[1] // 2, len(matrices)
    turns = np.arange(-width, width + 1)
    rates = mode.exponent + 1j * fundamental * turns
    seen = np.zeros((degree, count, 2 * most + 1, u.shape[1]), complex)
    for k in range(-most, most + 1):
        rows = np.arange(max(0, k), min(count, count + k))
        for p in range(degree):
            seen[p, rows, most + k] = rates[rows - k, None] ** p * u[rows - k]
    right = np.tensordot(basis, seen, axes=([1, 2, 4], [0, 2, 3]))  # (parameters, i, m): minus the slope of F
    right = np.moveaxis(right, 1, 2).reshape(len(basis), u.size)
    by_omega = -(_by_rates(_banded(matrices, count), rates, u) @ (1j * turns)).reshape(1, -1)
    whole = np.concatenate([right, by_omega])
    moved = np.linalg.solve(jacobian, np.concatenate([whole, np.zeros((len(whole), 1))], axis=1).T).T
    return Slopes(moved[:, -1], moved[:, :-1].reshape(len(whole), *u.shape))
