"""Exponentials e^{λt + iqθ} fitted to records one by one, or taken off them together."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid.core import ConstantPeriod, Record
from floquid.periodic._refit import seen
from floquid.periodic.least_squares import ModeParameters, complex_of, linearise
from floquid.sync import ShaftAngle

STILL = 1e-6
"""The determinant of a column's cosine and sine, over their size, below which it does not turn: it is one number."""


def line_amplitudes(
    record: Record, clock: ConstantPeriod | ShaftAngle, period: float, exponents: ArrayLike, turns: ArrayLike
) -> tuple[Floats, Floats]:
    r"""The amplitude of each exponential in each channel, alone, and the sum of squares that it takes off.

    .. math:: \min_B \sum_k \big(y(t_k) - 2 \Re B\, e^{\lambda t_k + i q \theta(t_k)}\big)^2

    Returns 2|B| [units of the channels] and the sums [units squared] (channels, columns).

    Parameters
    ----------
    record
        The samples; NaN where there is none.
    clock
        What ties them to the phase.
    period
        T [s].
    exponents, turns
        λ [1/s] and q, turns a period (columns,). What grows is counted from the end of the record.
    """
    columns = _entries(exponents, turns, period).columns()
    n = len(columns.modes)
    amplitudes, squares = np.zeros((2, record.n_channels, n))
    for block in seen(period, [record], [clock]) if n else ():
        sums = block.sums(columns, np.zeros((n, len(block.rows)), complex))
        cosines, sines = np.split(np.diag(sums.gram)[:, None], 2)
        both, (one, other) = np.diag(sums.gram, n)[:, None], np.split(sums.seen, 2)
        total = np.maximum(cosines + sines, np.finfo(float).tiny)
        determinant = cosines * sines - both**2
        turning = determinant > STILL * total**2
        safe = np.where(turning, determinant, 1.0)
        alpha = np.where(turning, (sines * one - both * other) / safe, one / total)
        beta = np.where(turning, (cosines * other - both * one) / safe, other / total)
        amplitudes[block.rows] = np.hypot(alpha, beta).T
        squares[block.rows] = (alpha * one + beta * other).T
    return amplitudes, squares


def without_lines(
    record: Record, clock: ConstantPeriod | ShaftAngle, period: float, exponents: ArrayLike, turns: ArrayLike
) -> Floats:
    r"""A record less exponentials that are fitted to it together.

    .. math:: y(t_k) - 2 \Re \sum_j B_j\, e^{\lambda_j t_k + i q_j \theta(t_k)}

    Returns what is left (channels, samples) [units of the channels]. `record`, `clock`, `period`, `exponents` and
    `turns` are as of `line_amplitudes`.
    """
    entries, left = _entries(exponents, turns, period), np.array(record.values)
    for block in seen(period, [record], [clock]):
        solution = linearise([block.with_noise(np.ones(len(block.rows)))], entries)
        there = ~np.isnan(record.values[block.rows[0]])
        left[np.ix_(block.rows, there)] = block.residual(
            entries.columns(), complex_of(solution.linear[0].coefficients)
        )[1]
    return left


def _entries(exponents: ArrayLike, turns: ArrayLike, period: float) -> ModeParameters:
    """One entry a column, its exponent fixed."""
    return ModeParameters.made(exponents, (0, 0), 2.0 * np.pi / period, offsets=turns, fixed=True)
