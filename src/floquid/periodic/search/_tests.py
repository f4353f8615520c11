"""Tests of a fit by one linearisation: equal exponents of the harmonics of a mode, and the period."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Indices, Mask
from floquid.fit import HALF_DIGITS, LONGEST_STEP, ROUNDING, is_vague, scaled_inverse, score_gain
from floquid.periodic.least_squares import ModeParameters, Solution
from floquid.periodic.search._objective import Point


def untold(point: Point) -> Indices:
    """Places of the modes whose own information is next to none, except for the last one, which stays.

    One that stands still for longer than the record is known if that is: its decay has no share of its own.
    """
    free = np.flatnonzero(point.entries.leading)
    if len(free) < 2:
        return free[:0]
    std = np.sqrt(np.maximum(np.diag(point.solution.covariance()), 0.0))[: len(free)]
    lasting = 1.0 / max(block.last for block in point.blocks)
    return np.asarray(free[is_vague(std, np.maximum(np.abs(point.entries.exponents[free].real), lasting))], np.intp)


def equality(solution: Solution, entry: int, sure: Mask) -> tuple[float, int]:
    """The chi-square of the sure harmonics of a mode having one exponent, and its degrees of freedom (Rao's test)."""
    columns = np.flatnonzero((solution.entries.columns().modes == entry) & sure)
    if len(columns) < 2:
        return 0.0, 0
    gain = _gain(solution, _parted(solution.entries, columns)) - _gain(solution, solution.entries.ties())
    return max(gain, 0.0), 2 * (len(columns) - 1)


def spread_of_harmonics(solution: Solution, entry: int, sure: Mask) -> tuple[float, float]:
    r"""The weighted variance of the exponents that the sure harmonics of a mode ask for, of both parts [1/s²].

    .. math:: s^2 = \sum_m w_m (\lambda_m - \bar\lambda)^2 \Big/ \sum_m w_m, \qquad w_m = 1/\operatorname{var} \lambda_m
    """
    columns = np.flatnonzero((solution.entries.columns().modes == entry) & sure)
    gradient, _, information = solution.by_column.tied(_parted(solution.entries, columns))
    inverse, count = scaled_inverse(information, ROUNDING), len(columns)
    step, variance = inverse @ gradient, np.maximum(np.diag(inverse), 1e-300)
    variances = []
    for part in (slice(-2 * count, -count), slice(-count, None)):
        steps, weight = step[part], 1.0 / variance[part]
        mean = float(steps @ weight / weight.sum())
        variances.append(float((steps - mean) ** 2 @ weight / weight.sum()))
    return variances[0], variances[1]


def _parted(entries: ModeParameters, columns: Indices) -> Floats:
    """The ties of the other modes, then a decay of its own for each of these columns, then a frequency."""
    ties, count = entries.ties(), len(entries.columns().modes)
    rows = np.eye(ties.shape[1])
    others = ties[~ties[:, np.concatenate([columns, count + columns])].any(axis=1)]
    return np.concatenate([others, rows[columns], rows[count + columns]])


def _gain(solution: Solution, ties: Floats) -> float:
    """Reduction of the cost by a Gauss-Newton step of parameters that tie columns as given."""
    gradient, matrix, _ = solution.by_column.tied(ties)
    return score_gain(gradient, matrix, ROUNDING)


def period_step(solution: Solution) -> tuple[float, float] | None:
    """(own period - T)/T by one step of the fundamental as a further parameter, and its deviation; None if untold.

    A real multiplier that is alone on its axis may be a pair beside it, whose lines move together, or one of two, whose
    slowest line moves alone: neither is a sign of the period.
    """
    entries, columns = solution.entries, solution.entries.columns()
    n = len(columns.modes)
    if entries.free_period or not columns.turns.any():
        return None
    ties = [entries.ties()]
    for entry in entries.alone:
        own = np.flatnonzero(columns.modes == entry)
        slowest = int(own[np.argmin(np.abs(columns.turns[own]))])
        beside = np.zeros((3, ties[0].shape[1]))
        beside[0, n + own] = beside[1, slowest] = beside[2, n + slowest] = 1.0
        ties.append(beside)
    turned = np.zeros((1, ties[0].shape[1]))
    turned[0, n : 2 * n] = columns.turns
    gradient, _, information = solution.by_column.tied(np.concatenate([*ties, turned]))
    others = information[-1, :-1] @ scaled_inverse(information[:-1, :-1], ROUNDING)
    left = float(information[-1, -1] - others @ information[:-1, -1])
    if left <= HALF_DIGITS * information[-1, -1]:
        return None
    std = left**-0.5 / entries.fundamental
    step = float(gradient[-1] - others @ gradient[:-1]) / left
    # Beyond, one linearisation says nothing.
    return (-step / entries.fundamental, std) if 2.0 * np.pi * std < LONGEST_STEP else None
