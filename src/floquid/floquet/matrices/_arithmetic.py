"""Sums and products of periodic matrices, in the form of the operands where that is exact, and their common period.

Harmonics with harmonics stay harmonics, constant pieces stay pieces, samples on one grid stay samples under sums, and
a constant leaves every form as it is; anything else is a function of time that evaluates both operands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from math import gcd, lcm
from typing import Any, TypeAlias

import numpy as np

from floquid._arrays import Floats
from floquid._checks import finite, frozen_array, input_error, positive
from floquid.floquet.matrices._forms import FunctionMatrix, PiecewiseMatrix, values_between
from floquid.floquet.matrices._matrix import GOLDEN, SAME, AbstractPeriodicMatrix, merged
from floquid.floquet.matrices._series import REPEATS, constant_matrix, product_of_series, sum_of_series

MOST = 1000  # periods of one matrix in a common period
_PROBES = 32


def multiples(periods: tuple[float, ...], of: str) -> tuple[float, list[int]]:
    """The least common period [s] and how many of each are in it."""
    if not periods:
        raise input_error("periods", of, "hold a period at least", "is empty")
    given = [positive(period, "period", of, unit="s") for period in periods]
    first, ratios = given[0], []
    for period in given:
        ratio = Fraction(period / first).limit_denominator(MOST)
        if ratio == 0 or abs(period - first * float(ratio)) > SAME * period:
            raise _incommensurate(first, period, of)
        ratios.append(ratio)
    total = Fraction(lcm(*(r.numerator for r in ratios)), gcd(*(r.denominator for r in ratios)))
    counts = [int(total / ratio) for ratio in ratios]
    if max(counts) > MOST:
        raise _incommensurate(max(given), min(given), of)
    return first * float(total), counts


def declared(matrix: AbstractPeriodicMatrix, count: int, period: float) -> AbstractPeriodicMatrix:
    """The matrix over `count` of its periods, together `period` to within rounding."""
    if count == 1 and period == matrix.period:
        return matrix
    return matrix.declared(count, period)


def joint_breaks(matrices: tuple[AbstractPeriodicMatrix, ...], period: float) -> Floats:
    """The breaks of all of them in a period that is a whole number of each (breaks,) [s]."""
    every = [
        np.add.outer(matrix.period * np.arange(round(period / matrix.period)), np.asarray(matrix.breaks)).ravel()
        for matrix in matrices
    ]
    return merged(np.concatenate(every), period)


def repetitions(matrix: AbstractPeriodicMatrix) -> int:
    """The largest number, up to `MOST`, of repetitions within the period; 1 for what is constant."""
    if np.ptp(matrix.at(_probes(matrix, 0.0)), axis=0).max() <= REPEATS * _size(matrix):
        return 1
    count = 1
    for prime in (n for n in range(2, MOST + 1) if all(n % d for d in range(2, int(n**0.5) + 1))):
        while count * prime <= MOST and _repeats(matrix, count * prime):
            count *= prime
    return count


def _repeats(matrix: AbstractPeriodicMatrix, count: int) -> bool:
    """True if one `count`-th of the period is a period."""
    shift = matrix.period / count
    times = _probes(matrix, shift)
    allowed = REPEATS * _size(matrix)
    return all(  # a few probes are enough to refuse most
        np.abs(matrix.at(part + shift) - matrix.at(part)).max() <= allowed for part in (times[:2], times[2:])
    )


def _probes(matrix: AbstractPeriodicMatrix, shift: float) -> Floats:
    """Instants spread over the period, and one between any two jumps of M(t) or M(t + shift)."""
    period, breaks = matrix.period, np.asarray(matrix.breaks)
    spread = period * np.mod(GOLDEN * np.arange(1, _PROBES + 1), 1.0)
    if not breaks.size:
        return spread
    edges = merged(np.concatenate([breaks, np.mod(breaks - shift, period)]), period)
    ends = np.append(edges[1:], edges[0] + period)
    place = np.searchsorted(edges, spread, side="right") - 1
    from_edges = np.minimum(np.mod(spread - edges[place], period), np.mod(ends[place] - spread, period))
    return np.concatenate([spread[from_edges > 1e-9 * period], edges + GOLDEN * (ends - edges)])


def _size(matrix: AbstractPeriodicMatrix) -> float:
    return float(np.abs(matrix.at(_probes(matrix, 0.0))).max())


def _incommensurate(first: float, second: float, of: str) -> Exception:
    got = f"are {first:.15g} s and {second:.15g} s, which have none to within {SAME:g}"
    remedy = "If they are meant to be equal or a whole multiple, give both from one number."
    return input_error("periods", of, f"have a common multiple within {MOST} of each", got, remedy)


Operand: TypeAlias = AbstractPeriodicMatrix | Floats


def added(left: Any, right: Any, sign: float) -> AbstractPeriodicMatrix:
    """The sum, or with `sign` -1 the difference."""
    of = "+" if sign > 0.0 else "-"
    first, second = _operands(left, right, of)
    if first.shape != second.shape:
        raise input_error("right", of, f"have the shape {first.shape} of the left", f"has shape {second.shape}")
    if second.is_constant:
        return first.shifted(sign * second.at(0.0))
    if first.is_constant:
        return scaled(second, sign).shifted(first.at(0.0))
    one, other, period = _declared_together(first, second, of)
    samples = one.samples(), other.samples()
    if samples[0] is not None and samples[1] is not None:
        found = samples[0].sum_on_grid(samples[1], sign)
        if found is not None:
            return found
    series = one.series(), other.series()
    if series[0] is not None and series[1] is not None:
        return sum_of_series(series[0], series[1], sign)
    return _pointwise(partial(_sum, sign), one, other, period)


def scaled(matrix: AbstractPeriodicMatrix, factor: Any) -> AbstractPeriodicMatrix:
    """The matrix times a number."""
    number = finite(factor, "factor", "*", remedy="The product of two matrices is `@`.")
    return matrix.mapped(partial(np.multiply, number))


def product(left: Any, right: Any) -> AbstractPeriodicMatrix:
    """The matrix product."""
    first, second = _operands(left, right, "@")
    if first.shape[1] != second.shape[0]:
        must = f"have as many rows as the left has columns, {first.shape[1]}"
        raise input_error("right", "@", must, f"has shape {second.shape}")
    if second.is_constant:
        return first.mapped(partial(_times, second.at(0.0)))
    if first.is_constant:
        return second.mapped(partial(np.matmul, first.at(0.0)))
    one, other, period = _declared_together(first, second, "@")
    series = one.series(), other.series()
    if series[0] is not None and series[1] is not None:
        return product_of_series(series[0], series[1])
    return _pointwise(np.matmul, one, other, period)


def assembled(blocks: Sequence[Sequence[Operand]], period: float) -> AbstractPeriodicMatrix:
    """The matrix of blocks, a row after the other, all of one period; a constant one if all of them are constant."""
    heights = np.cumsum([0, *(row[0].shape[0] for row in blocks)])
    widths = np.cumsum([0, *(block.shape[1] for block in blocks[0])])
    constant, varying = np.zeros((heights[-1], widths[-1])), None
    for i, row in enumerate(blocks):
        for j, block in enumerate(row):
            rows, columns = slice(heights[i], heights[i + 1]), slice(widths[j], widths[j + 1])
            value = constant_of(block)
            if value is not None:
                constant[rows, columns] = value
                continue
            term = product(product(np.eye(heights[-1])[:, rows], block), np.eye(widths[-1])[columns])
            varying = term if varying is None else varying + term
    if varying is None:
        return constant_matrix(constant, period)
    return varying + constant if constant.any() else varying


def operand(value: Any, argument: str, of: str) -> Operand:
    """A periodic matrix as it is, or a constant one (rows, columns)."""
    if isinstance(value, AbstractPeriodicMatrix):
        return value
    remedy = "Give a periodic matrix, or an array for a constant one; a multiple of the identity is `c * np.eye(n)`."
    return frozen_array(value, argument, of, axes=("rows", "columns"), remedy=remedy)


def constant_of(value: Operand) -> Floats | None:
    """The one value of a constant (rows, columns), given as an array or as a matrix of one value."""
    if not isinstance(value, AbstractPeriodicMatrix):
        return value
    return value.at(0.0) if value.is_constant else None


def _operands(left: Any, right: Any, of: str) -> tuple[AbstractPeriodicMatrix, AbstractPeriodicMatrix]:
    """Operands as matrices: an array is a constant over the period of the other, which is no array."""
    first, second = operand(left, "left", of), operand(right, "right", of)
    if isinstance(first, AbstractPeriodicMatrix):
        return first, second if isinstance(second, AbstractPeriodicMatrix) else constant_matrix(second, first.period)
    assert isinstance(second, AbstractPeriodicMatrix)
    return constant_matrix(first, second.period), second


def _declared_together(
    first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, of: str
) -> tuple[AbstractPeriodicMatrix, AbstractPeriodicMatrix, float]:
    """Declare two matrices over their least common period."""
    period, counts = multiples((first.period, second.period), of)
    return declared(first, counts[0], period), declared(second, counts[1], period), period


def _pointwise(
    combine: Callable[..., Floats], first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, period: float
) -> AbstractPeriodicMatrix:
    """Two matrices of one period combined value by value: pieces of pieces, else a function."""
    breaks = joint_breaks((first, second), period)
    if first.pieces() is not None and second.pieces() is not None:
        values = combine(*(np.moveaxis(values_between(part, breaks, period), 2, 0) for part in (first, second)))
        return PiecewiseMatrix(values=np.moveaxis(values, 0, 2), edges=breaks, period=period)
    function = partial(_combined, combine, first, second)
    return FunctionMatrix(function=function, period=period, breaks=breaks, vectorised=True)


# Functions of their own rather than closures, so that what holds them can be pickled and sent to other processes.


def _combined(
    combine: Callable[..., Floats], first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, times: Floats
) -> Floats:
    return combine(first.at(times), second.at(times))


def _sum(sign: float, left: Floats, right: Floats) -> Floats:
    return left + sign * right


def _times(right: Floats, left: Floats) -> Floats:
    return left @ right
