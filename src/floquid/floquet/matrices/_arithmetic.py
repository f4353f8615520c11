"""Sums and products of periodic matrices, in the form of the operands where that is exact.

Harmonics with harmonics stay harmonics, constant pieces stay pieces, samples on one grid stay samples under sums, and
a constant leaves every form as it is; anything else is a function of time that evaluates both operands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import finite, frozen_array, input_error
from floquid.floquet.matrices._conversion import real_series, series_of_samples
from floquid.floquet.matrices._forms import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    HarmonicMatrix,
    PiecewiseMatrix,
    SampledMatrix,
)
from floquid.floquet.matrices._periods import constant_value, declared, joint_breaks, multiples, values_between

Operand: TypeAlias = AbstractPeriodicMatrix | Floats
Change: TypeAlias = Callable[[NDArray[Any]], NDArray[Any]]  # of every matrix of a stack (..., rows, columns)


def added(left: Any, right: Any, sign: float) -> AbstractPeriodicMatrix:
    """The sum, or with `sign` -1 the difference."""
    of = "+" if sign > 0.0 else "-"
    first, second = operand(left, "left", of), operand(right, "right", of)
    if first.shape != second.shape:
        raise input_error("right", of, f"have the shape {first.shape} of the left", f"has shape {second.shape}")
    held, added_to = _constant(first), _constant(second)
    if added_to is not None and isinstance(first, AbstractPeriodicMatrix):
        return _shifted(first, sign * added_to)
    assert isinstance(second, AbstractPeriodicMatrix)
    if held is not None:
        return _shifted(scaled(second, sign), held)
    assert isinstance(first, AbstractPeriodicMatrix)
    one, other, period = _declared_together(first, second, of)
    if isinstance(one, SampledMatrix) and isinstance(other, SampledMatrix) and _one_grid(one, other):
        values = np.asarray(one.values) + sign * np.asarray(other.values)
        return SampledMatrix(values=values, period=period, times=one.times, interpolation=one.interpolation)
    series = _as_series(one), _as_series(other)
    if series[0] is not None and series[1] is not None:
        return _sum_of_series(series[0], series[1], sign)
    return _pointwise(partial(_sum, sign), one, other, period)


def scaled(matrix: AbstractPeriodicMatrix, factor: Any) -> AbstractPeriodicMatrix:
    """The matrix times a number."""
    number = finite(factor, "factor", "*", remedy="The product of two matrices is `@`.")
    return _mapped(matrix, partial(np.multiply, number))


def product(left: Any, right: Any) -> AbstractPeriodicMatrix:
    """The matrix product."""
    first, second = operand(left, "left", "@"), operand(right, "right", "@")
    if first.shape[1] != second.shape[0]:
        must = f"have as many rows as the left has columns, {first.shape[1]}"
        raise input_error("right", "@", must, f"has shape {second.shape}")
    before, after = _constant(first), _constant(second)
    if after is not None and isinstance(first, AbstractPeriodicMatrix):
        return _mapped(first, partial(_times, after))
    assert isinstance(second, AbstractPeriodicMatrix)
    if before is not None:
        return _mapped(second, partial(np.matmul, before))
    assert isinstance(first, AbstractPeriodicMatrix)
    one, other, period = _declared_together(first, second, "@")
    series = _as_series(one), _as_series(other)
    if series[0] is not None and series[1] is not None:
        return _product_of_series(series[0], series[1])
    return _pointwise(np.matmul, one, other, period)


def transposed(matrix: AbstractPeriodicMatrix) -> AbstractPeriodicMatrix:
    """The transpose."""
    return _mapped(matrix, np.matrix_transpose)


def assembled(blocks: Sequence[Sequence[Operand]], period: float) -> AbstractPeriodicMatrix:
    """The matrix of blocks, a row after the other, all of one period; a constant one if all of them are constant."""
    heights = np.cumsum([0, *(row[0].shape[0] for row in blocks)])
    widths = np.cumsum([0, *(block.shape[1] for block in blocks[0])])
    constant, varying = np.zeros((heights[-1], widths[-1])), None
    for i, row in enumerate(blocks):
        for j, block in enumerate(row):
            rows, columns = slice(heights[i], heights[i + 1]), slice(widths[j], widths[j + 1])
            value = _constant(block)
            if value is not None:
                constant[rows, columns] = value
                continue
            term = product(product(np.eye(heights[-1])[:, rows], block), np.eye(widths[-1])[columns])
            varying = term if varying is None else varying + term
    if varying is None:
        return constant_matrix(constant, period)
    return varying + constant if constant.any() else varying


def constant_matrix(value: Floats, period: float) -> HarmonicMatrix:
    """A constant (rows, columns) as a periodic matrix."""
    return HarmonicMatrix(coefficients=np.asarray(value)[:, :, None], harmonics=[0], period=period)


def operand(value: Any, argument: str, of: str) -> Operand:
    """A periodic matrix as it is, or a constant one (rows, columns)."""
    if isinstance(value, AbstractPeriodicMatrix):
        return value
    remedy = "Give a periodic matrix, or an array for a constant one; a multiple of the identity is `c * np.eye(n)`."
    return frozen_array(value, argument, of, axes=("rows", "columns"), remedy=remedy)


def _constant(value: Operand) -> Floats | None:
    return constant_value(value) if isinstance(value, AbstractPeriodicMatrix) else value


def _declared_together(
    first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, of: str
) -> tuple[AbstractPeriodicMatrix, AbstractPeriodicMatrix, float]:
    """Declare two matrices over their least common period."""
    period, counts = multiples((first.period, second.period), of)
    return declared(first, counts[0], period), declared(second, counts[1], period), period


def _as_series(matrix: AbstractPeriodicMatrix) -> HarmonicMatrix | None:
    if isinstance(matrix, SampledMatrix) and matrix.interpolation == "fourier":
        return series_of_samples(matrix)
    return matrix if isinstance(matrix, HarmonicMatrix) else None


def _one_grid(first: SampledMatrix, second: SampledMatrix) -> bool:
    return first.interpolation == second.interpolation and np.array_equal(
        np.asarray(first.times), np.asarray(second.times)
    )


def _sum_of_series(first: HarmonicMatrix, second: HarmonicMatrix, sign: float) -> HarmonicMatrix:
    lines = np.union1d(np.asarray(first.harmonics), np.asarray(second.harmonics))
    values = np.zeros((*first.shape, len(lines)), dtype=np.complex128)
    values[..., np.searchsorted(lines, first.harmonics)] += np.asarray(first.coefficients)
    values[..., np.searchsorted(lines, second.harmonics)] += sign * np.asarray(second.coefficients)
    return real_series(values, lines, first.period)


def _product_of_series(first: HarmonicMatrix, second: HarmonicMatrix) -> HarmonicMatrix:
    """The convolution of the coefficients."""
    sums = np.add.outer(np.asarray(second.harmonics), np.asarray(first.harmonics))
    lines, place = np.unique(sums, return_inverse=True)
    place = place.reshape(sums.shape)
    values = np.zeros((first.shape[0], second.shape[1], len(lines)), dtype=np.complex128)
    left, right = np.asarray(first.coefficients), np.asarray(second.coefficients)
    for index in range(right.shape[2]):  # within one line of the right, no two lines of the left have one sum
        values[..., place[index]] += np.einsum("ijm,jk->ikm", left, right[..., index])
    return real_series(values, lines, first.period)


def _shifted(matrix: AbstractPeriodicMatrix, value: Floats) -> AbstractPeriodicMatrix:
    """The matrix plus a constant."""
    if isinstance(matrix, HarmonicMatrix):
        return _sum_of_series(matrix, constant_matrix(value, matrix.period), 1.0)
    return _mapped(matrix, partial(np.add, value))  # a spline through shifted samples is the shifted spline


def _mapped(matrix: AbstractPeriodicMatrix, change: Change) -> AbstractPeriodicMatrix:
    """The matrix with a linear change of every value, in the same form."""
    if isinstance(matrix, HarmonicMatrix):
        values = _of_stack(change, np.asarray(matrix.coefficients))
        return real_series(values, np.asarray(matrix.harmonics), matrix.period)
    if isinstance(matrix, PiecewiseMatrix):
        values = _of_stack(change, np.asarray(matrix.values))
        return PiecewiseMatrix(values=values, edges=matrix.edges, period=matrix.period)
    if isinstance(matrix, SampledMatrix):
        values = _of_stack(change, np.asarray(matrix.values))
        return SampledMatrix(
            values=values, period=matrix.period, times=matrix.times, interpolation=matrix.interpolation
        )
    function = partial(_changed, change, matrix)
    return FunctionMatrix(function=function, period=matrix.period, breaks=matrix.breaks, vectorised=True)


def _pointwise(
    combine: Callable[..., Floats], first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, period: float
) -> AbstractPeriodicMatrix:
    """Two matrices of one period combined value by value: pieces of pieces, else a function."""
    breaks = joint_breaks((first, second), period)
    if isinstance(first, PiecewiseMatrix) and isinstance(second, PiecewiseMatrix):
        values = combine(*(np.moveaxis(values_between(part, breaks, period), 2, 0) for part in (first, second)))
        return PiecewiseMatrix(values=np.moveaxis(values, 0, 2), edges=breaks, period=period)
    function = partial(_combined, combine, first, second)
    return FunctionMatrix(function=function, period=period, breaks=breaks, vectorised=True)


# Functions of their own rather than closures, so that what holds them can be pickled and sent to other processes.


def _of_stack(change: Change, values: NDArray[Any]) -> NDArray[Any]:
    return np.moveaxis(change(np.moveaxis(values, 2, 0)), 0, 2)


def _changed(change: Change, matrix: AbstractPeriodicMatrix, times: Floats) -> Floats:
    return change(matrix.at(times))


def _combined(
    combine: Callable[..., Floats], first: AbstractPeriodicMatrix, second: AbstractPeriodicMatrix, times: Floats
) -> Floats:
    return combine(first.at(times), second.at(times))


def _sum(sign: float, left: Floats, right: Floats) -> Floats:
    return left + sign * right


def _times(right: Floats, left: Floats) -> Floats:
    return left @ right
