"""What one linearisation says of changes to a fit: modes taken away, parted or joined, and its period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.periodic._bands import Entries
from floquid.periodic._blocks import Block
from floquid.periodic._constrained import Held

SINGULAR = 1e-12
"""The share of the largest eigenvalue of a scaled matrix below which a direction says nothing."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Where a mode is best cut in two: its first harmonic of the upper part, and what that would take off the cost."""

    entry: int
    harmonic: int
    gain: float
    moved: tuple[complex, complex]
    """By how much the exponents of the lower and of the upper part move [1/s]."""


def removal_rises(blocks: Sequence[Block], held: Held) -> NDArray[np.float64]:
    r"""The rise of the cost where a mode is taken away, all exponents as they are (entries,).

    .. math:: \Delta_e = \sum_{c,h} \frac{1}{\sigma_{c,h}^2} \beta_e^T (G^{-1})_{ee}^{-1} \beta_e

    with β the coefficients and G the Gram matrix of the columns. Refitted, the others take some of it back.
    """
    modes = held.entries.columns().modes
    rises = np.zeros(len(held.entries.exponents))
    for block, linear in zip(blocks, held.linear, strict=True):
        weight = 1.0 / block.noise**2
        for entry in range(len(rises)):
            own = np.flatnonzero(np.tile(modes == entry, 2))
            spread, beta = linear.inverse[np.ix_(own, own)], linear.coefficients[own]
            rises[entry] += float(np.sum(beta * _solved(spread, beta), axis=0) @ weight)
    return rises


def column_rises(blocks: Sequence[Block], held: Held) -> NDArray[np.float64]:
    """The rise of the cost where a column is taken away, cosine and sine, all exponents as they are (columns,)."""
    sines = held.entries.sines()
    n = len(sines)
    rises, first = np.zeros(n), np.arange(n)
    for block, linear in zip(blocks, held.linear, strict=True):
        cos, sin = first, first + n
        a, b = linear.inverse[cos, cos], linear.inverse[sin, sin]
        c = linear.inverse[cos, sin]
        alpha, beta = linear.coefficients[:n], linear.coefficients[n:]
        weight = 1.0 / block.noise**2
        determinant = np.where(sines, a * b - c**2, 1.0)
        squares = b[:, None] * alpha**2 + a[:, None] * beta**2 - 2.0 * c[:, None] * alpha * beta
        both = np.divide(squares @ weight, determinant, out=np.full(n, np.inf), where=determinant > 0.0)
        rises += np.where(sines, both, np.divide(alpha**2 @ weight, a, out=np.full(n, np.inf), where=a > 0.0))
    return rises


def equality(held: Held, entry: int) -> tuple[float, int]:
    """The chi-square of the harmonics of a mode having one exponent, and its degrees of freedom (Rao's score test)."""
    ties = held.entries.ties()
    columns = np.flatnonzero(held.entries.columns().modes == entry)
    if len(columns) < 2:
        return 0.0, 0
    count, rows = ties.shape[1] // 2, np.eye(ties.shape[1])
    others = ties[~ties[:, np.concatenate([columns, count + columns])].any(axis=1)]
    free = np.concatenate([others, rows[columns], rows[count + columns]])
    gain = score_gain(held, free) - score_gain(held, ties)
    return max(gain, 0.0), 2 * (len(columns) - 1)


def best_cut(held: Held, entry: int) -> Cut | None:
    """The cut of a mode into a lower and an upper part of its harmonics that promises most; None of one harmonic."""
    columns = held.entries.columns()
    own = np.flatnonzero(columns.modes == entry)
    own = own[np.argsort(columns.harmonics[own])]
    ties, n = held.entries.ties(), len(columns.modes)
    mine = ties[:, np.concatenate([own, n + own])].any(axis=1)
    best = None
    for place in range(1, len(own)):
        parts = np.zeros((4, 2 * n))
        for k, part in enumerate((own[:place], own[place:])):
            parts[2 * k, part], parts[2 * k + 1, n + part] = 1.0, 1.0
        step, gain = score_step(held, np.concatenate([ties[~mine], parts]))
        if best is None or gain > best.gain:
            moved = (complex(step[-4], step[-3]), complex(step[-2], step[-1]))
            best = Cut(entry, int(columns.harmonics[own[place]]), gain, moved)
    return best


def score_step(held: Held, ties: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The Gauss-Newton step of parameters that tie columns as given, and what it takes off the cost."""
    gradient, matrix, _ = held.by_column.tied(ties)
    step = _solved(matrix, gradient[:, None])[:, 0]
    return step, float(step @ gradient)


def score_gain(held: Held, ties: NDArray[np.float64]) -> float:
    """What a Gauss-Newton step of parameters that tie columns as given takes off the cost."""
    return score_step(held, ties)[1]


def period_step(held: Held) -> tuple[float, float] | None:
    """(own period - T)/T by one step of the fundamental as a further parameter, and its deviation; None if untold."""
    entries = held.entries
    turns, n = entries.columns().turns, len(entries.columns().modes)
    if entries.free_period or not turns.any():
        return None
    ties = np.concatenate([entries.ties(), np.concatenate([np.zeros(n), turns])[None]])
    gradient, _, information = held.by_column.tied(ties)
    inverse = _solved(information, np.eye(len(information)))
    variance = float(inverse[-1, -1])
    if not variance > 0.0 or not information[-1, -1] > 0.0:
        return None
    return -float(inverse[-1] @ gradient) / entries.fundamental, float(np.sqrt(variance)) / entries.fundamental


def differences(entries: Entries, one: int, other: int) -> tuple[int, int, complex] | None:
    """Sign, whole fundamentals and what is left of λ_other = λ_one + imω, λ_other conjugated for sign -1; the nearest."""
    best = None
    for sign in (1, -1):
        value = entries.exponents[other] if sign > 0 else entries.exponents[other].conjugate()
        value += 1j * sign * entries.fundamental * entries.offsets[other]
        gap = value - entries.exponents[one] - 1j * entries.fundamental * entries.offsets[one]
        m = round(gap.imag / entries.fundamental)
        left = gap - 1j * m * entries.fundamental
        if best is None or abs(left) < abs(best[2]):
            best = (sign, m, complex(left))
    return best


def _solved(matrix: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least-squares solution of a symmetric system, scaled; directions that say nothing are left out."""
    size = np.diag(matrix)
    scale = np.sqrt(np.where(size > 0.0, size, np.inf))
    if not len(scale) or not np.isfinite(scale).any():
        return np.zeros_like(target)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > SINGULAR * max(values[-1], 1e-300)
    return ((vectors[:, good] / values[good]) @ (vectors[:, good].T @ (target / scale[:, None]))) / scale[:, None]
