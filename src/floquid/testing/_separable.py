"""Sums of exponentials with free residues: the information about their poles, and their noiseless fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS = 40
"""Iterations, at most, of a noiseless fit."""

SETTLED = 1e-3
"""The share of the cost by which a step must lower it to be worth another one."""

FARTHEST = 0.1
"""The largest move of a logarithm in one step."""


@dataclass(frozen=True, slots=True)
class Projected:
    """Exponentials of one length: an orthonormal basis of their real columns, and what of their slopes is outside it.

    `scale` is what each column was multiplied by: a growing mode must not overflow.
    """

    basis: NDArray[np.float64]
    triangle: NDArray[np.float64]
    slopes: NDArray[np.complex128]
    scale: NDArray[np.float64]


def columns_of(
    logs: NDArray[np.complex128], real: NDArray[np.bool_], samples: int
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """The columns e^{sk} scaled (samples, n), their real form (samples, poles), and the scale (n,)."""
    last = np.where(logs.real > 0, (samples - 1) * logs.real, 0.0)
    exponent = np.arange(samples)[:, None] * logs - last
    columns: NDArray[np.complex128] = np.where(np.real(exponent) > -138.0, np.exp(exponent), 0.0)
    return columns, np.concatenate([columns.real, columns.imag[:, ~real]], axis=1), np.exp(-last)


def projected(logs: NDArray[np.complex128], real: NDArray[np.bool_], samples: int) -> Projected:
    """The basis and the projected slopes of poles with logarithms s (n,), one a pair, `real` where one is its own."""
    columns, flat, scale = columns_of(logs, real, samples)
    q, r = np.linalg.qr(flat)
    slopes = np.arange(samples)[:, None] * columns
    slopes = slopes - q @ (q.T @ slopes)
    return Projected(q, r, slopes, scale)


def parameters(real: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.complex128]]:
    """The real parameters: which logarithm each belongs to, and what it multiplies R d by in the response.

    A pair is twice the real part of one of its two modes: 2 for the real part of its logarithm, 2i for the imaginary.
    """
    pairs = np.flatnonzero(~real)
    turn = np.zeros(len(real) + len(pairs), np.complex128)
    turn[: len(real)], turn[len(real) :] = np.where(real, 1.0, 2.0), 2.0j
    return np.concatenate([np.arange(len(real)), pairs]), turn


def information(block: Projected, residues: NDArray[np.complex128], real: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Σ over responses of Jᵀ(I - P)J, for residues (n, responses) of the scaled columns (parameters, parameters)."""
    moves, turn = parameters(real)
    straight = (residues.conj() @ residues.T) * (block.slopes.conj().T @ block.slopes)
    crossed = (residues @ residues.T) * (block.slopes.T @ block.slopes)
    pick = np.ix_(moves, moves)
    return 0.5 * (np.outer(turn.conj(), turn) * straight[pick] + np.outer(turn, turn) * crossed[pick]).real


def least_cost(
    logs: NDArray[np.complex128], real: NDArray[np.bool_], data: Sequence[NDArray[np.float64]], enough: float
) -> float:
    """The sum of squares that poles leave of noiseless `data` (samples, responses) when they move to where it is least.

    Levenberg and Marquardt with Kaufman's (1975) Jacobian; ends early once the cost is below `enough`.
    """
    cost, gradient, matrix = _state(logs, real, data)
    moves, turn = parameters(real)
    damping = 1e-3
    for _ in range(STEPS if len(logs) else 0):
        scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        inner = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
        step = np.linalg.solve(inner, gradient / scale) / scale
        step *= min(1.0, FARTHEST / max(np.abs(step).max(), np.finfo(float).tiny))
        trial = logs.copy()
        np.add.at(trial, moves, step * np.where(turn.imag > 0, 1j, 1.0))
        now = _state(trial, real, data)
        if now[0] > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        drop, damping = cost - now[0], max(0.1 * damping, 1e-9)
        logs, (cost, gradient, matrix) = trial, now
        if cost < enough or drop < SETTLED * cost:
            break
    return cost


def _state(
    logs: NDArray[np.complex128], real: NDArray[np.bool_], data: Sequence[NDArray[np.float64]]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """The cost, the direction of descent and the Gauss-Newton matrix."""
    moves, turn = parameters(real)
    cost, gradient, matrix = 0.0, np.zeros(len(moves)), np.zeros((len(moves), len(moves)))
    for values in data:
        block = projected(logs, real, len(values))
        inside = block.basis.T @ values
        # Twice: what is left may be a small part of the whole.
        left = values - block.basis @ inside
        left = left - block.basis @ (block.basis.T @ left)
        cost += float(np.sum(left**2))
        flat = np.linalg.lstsq(block.triangle, inside, rcond=1e-14)[0]
        residues = (np.where(real, 1.0, 0.5)[:, None] * flat[: len(logs)]).astype(np.complex128)
        residues[~real] -= 0.5j * flat[len(logs) :]
        gradient += (turn * np.sum(residues * (block.slopes.T @ left), axis=1)[moves]).real
        matrix += information(block, residues, real)
    return cost, gradient, matrix
