"""One mode of Hill's problem, seen from an amplitude that swings as its own does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.floquet.hill_method._eigenpairs import Problem, Truncated, nearest

_ROUNDS = 6


def swinging_along(problem: Problem, found: Truncated, index: int) -> Truncated:
    r"""Mode `index`, found again with its swings of amplitude divided out; as it was, where that does not help.

    .. math:: x = e^{g(t)}\, z, \qquad z' = (A - g' I)\, z, \qquad g(t + T) = g(t)

    A shape of which some phases are 1e-6 of others, and whose left partner is as small where it is large, has an
    exponent that is well conditioned at each instant, but not in harmonics, where all phases are mixed. With g the
    logarithm of the shape's size both partners are level, and the exponent is the same.
    """
    value, shape = complex(found.exponents[index]), found.vectors[index]
    n_harmonics = problem.n_harmonics
    n_grid = 8 * (n_harmonics + 1)
    logarithm = np.zeros(n_grid)
    best = Truncated(*(part[index : index + 1] for part in found))  # type: ignore[arg-type]
    condition = best.condition[0]
    middle = problem.coefficients.shape[2] // 2
    kept = max(1, n_harmonics // 2)
    for _ in range(_ROUNDS):
        size = np.linalg.norm(_on_grid(shape, n_grid), axis=0)
        lines = np.fft.rfft(np.log(np.maximum(size, 1e-12 * size.max())))
        lines[kept + 1 :] = 0.0
        lines[0] = 0.0
        logarithm = logarithm + np.fft.irfft(lines, n_grid)
        speed = 1j * problem.fundamental * np.arange(kept + 1) * np.fft.rfft(logarithm)[: kept + 1] / n_grid
        coefficients = problem.coefficients.copy()
        states = np.arange(problem.n_states)
        coefficients[states, states, middle : middle + kept + 1] -= speed
        coefficients[states, states, middle - kept : middle] -= speed[:0:-1].conj()
        again = nearest(Problem(coefficients, problem.fundamental), value, shape)
        if not again.condition[0] < condition:
            break
        level = again.condition[0] > 0.5 * condition
        condition, shape = again.condition[0], again.vectors[0]
        value = complex(again.exponents[0])
        whole = np.fft.fft(np.exp(logarithm) * _on_grid(shape, n_grid), axis=1) / n_grid
        best = again._replace(vectors=whole[None][..., np.arange(-n_harmonics, n_harmonics + 1)])
        if level:
            break
    return best


def _on_grid(shape: NDArray[np.complex128], n_grid: int) -> NDArray[np.complex128]:
    """A shape's harmonics -N..N (n, 2 N + 1) as its values at equal steps of the period (n, grid)."""
    half = shape.shape[1] // 2
    lines = np.zeros((shape.shape[0], n_grid), dtype=np.complex128)
    lines[:, np.arange(-half, half + 1)] = shape
    return np.fft.ifft(lines, axis=1) * n_grid
