"""Scores of changes to a fit by one linearisation: modes taken away, parted or joined, and its period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Indices, Mask
from floquid.fit import inverse_root
from floquid.periodic.least_squares import Block, ModeParameters, Solution

SINGULAR = 1e-12  # the share of the largest eigenvalue of a scaled matrix below which a direction says nothing


@dataclass(frozen=True, slots=True)
class Cut:
    """Best cut of a mode in two: the first harmonic of the upper part, and the reduction of the cost."""

    entry: int
    harmonic: int
    gain: float
    moved: tuple[complex, complex]  # by how much the exponents of the lower and of the upper part move [1/s]


def removal_rises(blocks: Sequence[Block], solution: Solution) -> Floats:
    r"""The rise of the cost where a mode is taken away, all exponents as they are (entries,).

    .. math:: \Delta_e = \sum_{c,h} \frac{1}{\sigma_{c,h}^2} \beta_e^T (G^{-1})_{ee}^{-1} \beta_e

    with β the coefficients and G the Gram matrix of the columns. Refitted, the others take some of it back.
    """
    modes = solution.entries.columns().modes
    rises = np.zeros(len(solution.entries.exponents))
    for block, linear in zip(blocks, solution.linear, strict=True):
        weight = 1.0 / block.noise**2
        for entry in range(len(rises)):
            own = np.flatnonzero(np.tile(modes == entry, 2))
            spread, beta = linear.inverse[np.ix_(own, own)], linear.coefficients[own]
            rises[entry] += float(np.sum(beta * _solved(spread, beta), axis=0) @ weight)
    return rises


class ColumnsLeft:
    """The coefficients of a fit's columns, of which some may be taken away, all exponents as they are."""

    def __init__(self, blocks: Sequence[Block], solution: Solution) -> None:
        """Of the linear part of each block."""
        self._n = len(solution.entries.sines())
        self._left = np.arange(2 * self._n)
        self._weights = [1.0 / block.noise**2 for block in blocks]
        self._spread = [np.array(own.inverse) for own in solution.linear]
        self._beta = [np.array(own.coefficients) for own in solution.linear]

    def rise(self, column: int) -> float:
        """The rise of the cost where a column is taken away, cosine and sine."""
        own, rise = self._own(column), 0.0
        for weight, spread, beta in zip(self._weights, self._spread, self._beta, strict=True):
            rise += float(np.sum(beta[own] * _solved(spread[np.ix_(own, own)], beta[own]), axis=0) @ weight)
        return rise

    def take(self, column: int) -> None:
        """Take a column away: the others take over what they can."""
        own, residual = self._own(column), np.flatnonzero(self._left % self._n != column)
        for number, (spread, beta) in enumerate(zip(self._spread, self._beta, strict=True)):
            both = spread[np.ix_(own, residual)]
            self._beta[number] = beta[residual] - both.T @ _solved(spread[np.ix_(own, own)], beta[own])
            self._spread[number] = spread[np.ix_(residual, residual)] - both.T @ _solved(spread[np.ix_(own, own)], both)
        self._left = self._left[residual]

    def _own(self, column: int) -> Indices:
        return np.flatnonzero(self._left % self._n == column)


def sure_columns(blocks: Sequence[Block], solution: Solution, limit: float) -> Mask:
    """Mask of columns that would raise the cost by more than the limit if they were taken away (columns,)."""
    left = ColumnsLeft(blocks, solution)
    return np.array([left.rise(column) > limit for column in range(len(solution.entries.sines()))], bool)


def equality(solution: Solution, entry: int, sure: Mask) -> tuple[float, int]:
    """The chi-square of the sure harmonics of a mode having one exponent, and its degrees of freedom (Rao's test)."""
    columns, ties = np.flatnonzero((solution.entries.columns().modes == entry) & sure), solution.entries.ties()
    if len(columns) < 2:
        return 0.0, 0
    gain = score_gain(solution, _parted(ties, columns)) - score_gain(solution, ties)
    return max(gain, 0.0), 2 * (len(columns) - 1)


def spread_of_harmonics(solution: Solution, entry: int, sure: Mask) -> tuple[float, float]:
    r"""The weighted variance of the exponents that the sure harmonics of a mode ask for, of both parts [1/s²].

    .. math:: s^2 = \sum_m w_m (\lambda_m - \bar\lambda)^2 \Big/ \sum_m w_m, \qquad w_m = 1/\operatorname{var} \lambda_m
    """
    columns, ties = np.flatnonzero((solution.entries.columns().modes == entry) & sure), solution.entries.ties()
    gradient, _, information = solution.by_column.tied(_parted(ties, columns))
    inverse, count = _solved(information, np.eye(len(information))), len(columns)
    step, variance = inverse @ gradient, np.maximum(np.diag(inverse), 1e-300)
    found = []
    for part in (slice(-2 * count, -count), slice(-count, None)):
        own, weight = step[part], 1.0 / variance[part]
        mean = float(own @ weight / weight.sum())
        found.append(float((own - mean) ** 2 @ weight / weight.sum()))
    return found[0], found[1]


def _parted(ties: Floats, columns: Indices) -> Floats:
    """The ties of the other modes, then a decay of its own for each of these columns, then a frequency."""
    count, rows = ties.shape[1] // 2, np.eye(ties.shape[1])
    others = ties[~ties[:, np.concatenate([columns, count + columns])].any(axis=1)]
    return np.concatenate([others, rows[columns], rows[count + columns]])


def best_cut(solution: Solution, entry: int) -> Cut | None:
    """The cut of a mode into a lower and an upper part of its harmonics that promises most; None of one harmonic."""
    columns = solution.entries.columns()
    own = np.flatnonzero(columns.modes == entry)
    own = own[np.argsort(columns.harmonics[own])]
    ties, n = solution.entries.ties(), len(columns.modes)
    mine = ties[:, np.concatenate([own, n + own])].any(axis=1)
    best = None
    for place in range(1, len(own)):
        parts = np.zeros((4, 2 * n))
        for k, part in enumerate((own[:place], own[place:])):
            parts[2 * k, part], parts[2 * k + 1, n + part] = 1.0, 1.0
        step, gain = score_step(solution, np.concatenate([ties[~mine], parts]))
        if best is None or gain > best.gain:
            moved = (complex(step[-4], step[-3]), complex(step[-2], step[-1]))
            best = Cut(entry, int(columns.harmonics[own[place]]), gain, moved)
    return best


def score_step(solution: Solution, ties: Floats) -> tuple[Floats, float]:
    """The Gauss-Newton step of parameters that tie columns as given, and what it takes off the cost."""
    gradient, matrix, _ = solution.by_column.tied(ties)
    step = _solved(matrix, gradient[:, None])[:, 0]
    return step, float(step @ gradient)


def score_gain(solution: Solution, ties: Floats) -> float:
    """Reduction of the cost by a Gauss-Newton step of parameters that tie columns as given."""
    return score_step(solution, ties)[1]


def period_step(solution: Solution) -> tuple[float, float] | None:
    """(own period - T)/T by one step of the fundamental as a further parameter, and its deviation; None if untold."""
    entries = solution.entries
    turns, n = entries.columns().turns, len(entries.columns().modes)
    if entries.free_period or not turns.any():
        return None
    ties = np.concatenate([entries.ties(), np.concatenate([np.zeros(n), turns])[None]])
    gradient, _, information = solution.by_column.tied(ties)
    inverse = _solved(information, np.eye(len(information)))
    variance = float(inverse[-1, -1])
    if not variance > 0.0 or not information[-1, -1] > 0.0:
        return None
    return -float(inverse[-1] @ gradient) / entries.fundamental, float(np.sqrt(variance)) / entries.fundamental


def differences(entries: ModeParameters, one: int, other: int) -> tuple[int, int, complex] | None:
    """Sign, whole fundamentals m and what is left of λ_other = λ_one + imω, λ_other conjugated for sign -1."""
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


def _solved(matrix: Floats, target: Floats) -> Floats:
    """The least-squares solution of a symmetric system, scaled; directions that say nothing are left out."""
    root = inverse_root(matrix, SINGULAR)
    return root @ (root.T @ target)
