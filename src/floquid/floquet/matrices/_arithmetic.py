"""Sums and products of periodic matrices of one period, in the form of the operands where that is exact.

Harmonics with harmonics stay harmonics, constant pieces stay pieces, samples on one grid stay samples under sums, and
a constant leaves every form as it is; anything else is a function of time that evaluates both operands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from floquid._arrays import Floats
from floquid._checks import finite, frozen_array, input_error
from floquid.floquet.matrices._forms import FunctionMatrix, PiecewiseMatrix, values_between
from floquid.floquet.matrices._matrix import SAME, AbstractPeriodicMatrix, merged
from floquid.floquet.matrices._series import constant_matrix, product_of_series, sum_of_series

Operand: TypeAlias = AbstractPeriodicMatrix | Floats


def common_period(matrices: Mapping[str, AbstractPeriodicMatrix], of: str) -> float:
    """The period that all of the arguments of `of` have [s], by their names, or a refusal."""
    (first, matrix), *others = matrices.items()
    for name, other in others:
        if abs(other.period - matrix.period) > SAME * matrix.period:
            must = f"have the period of `{first}` to within {SAME:g} of it, {matrix.period:.15g} s"
            remedy = "Give both over one period that is a whole number of each, from one number."
            raise input_error(name, of, must, f"has {other.period:.15g} s", remedy)
    return matrix.period


def joint_breaks(matrices: Iterable[AbstractPeriodicMatrix], period: float) -> Floats:
    """The breaks of all of them in their one period (breaks,) [s]."""
    return merged(np.concatenate([np.asarray(matrix.breaks) for matrix in matrices]), period)


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
    period = common_period({"left": first, "right": second}, of)
    samples = first.samples(), second.samples()
    if samples[0] is not None and samples[1] is not None:
        found = samples[0].sum_on_grid(samples[1], sign)
        if found is not None:
            return found
    series = first.series(), second.series()
    if series[0] is not None and series[1] is not None:
        return sum_of_series(series[0], series[1], sign)
    return _pointwise(partial(_sum, sign), first, second, period)


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
    period = common_period({"left": first, "right": second}, "@")
    series = first.series(), second.series()
    if series[0] is not None and series[1] is not None:
        return product_of_series(series[0], series[1])
    return _pointwise(np.matmul, first, second, period)


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
