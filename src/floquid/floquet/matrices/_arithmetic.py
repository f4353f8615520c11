"""Periodic matrices in other forms: Fourier coefficients right to rounding, sums and products of one period."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import finite, frozen_array, input_error
from floquid.floquet.matrices._forms import FunctionMatrix, PiecewiseMatrix, values_between
from floquid.floquet.matrices._matrix import SAME, AbstractPeriodicMatrix, Elements, merged
from floquid.floquet.matrices._series import constant_matrix, product_of_series, sum_of_series, two_sided

_FIRST, _LAST = 64, 2048  # samples of a period of a function without breaks, before it is cut into elements
_POINTS = 16  # of Gauss, in an element
_ELEMENTS = 4096
_ROUNDING = 4e-15
_ENDLESS = 256  # lines that are looked at of a matrix whose lines have no end
_STRONG, _STRONG_OF_MANY = 1e-3, 5e-2  # of the largest line: what a step has to pass over, where the lines have an end
_PROBES = np.array([0.1180339887, 0.4721359549, 0.7639320225])  # off every simple fraction of the period


class Reach(NamedTuple):
    """Reach of the lines of a periodic matrix."""

    highest: int  # the highest harmonic that counts
    strong: int  # the highest of those that are strong: a truncation raised by less may not meet anything new
    ends: bool  # true if they have an end; if not, only strong lines are counted


def reach(matrix: AbstractPeriodicMatrix, tolerance: float, scale: Floats | None = None) -> Reach:
    """Reach of the lines above `tolerance` of the norm of all, states in units of `scale` (n,)."""
    coefficients, has_end = _all_lines(matrix)
    if scale is not None:
        coefficients = coefficients * (scale / scale[:, None])[:, :, None]
    norms = np.linalg.norm(coefficients, axis=(0, 1))[coefficients.shape[2] // 2 :]
    floor = tolerance * float(np.linalg.norm(norms))
    largest = float(norms[1:].max(initial=0.0))
    strong = _last_above(norms, max(floor, (_STRONG if has_end else _STRONG_OF_MANY) * largest))
    return Reach(_last_above(norms, floor) if has_end else strong, strong, has_end)


def _last_above(norms: Floats, floor: float) -> int:
    above = np.flatnonzero(norms > floor)
    return int(above[-1]) if above.size else 0


def _all_lines(matrix: AbstractPeriodicMatrix) -> tuple[Complexes, bool]:
    """All coefficients of M(t) (rows, columns, 2 M + 1), and whether that is all."""
    if (series := matrix.series()) is not None:
        return fourier(series, int(np.asarray(series.harmonics)[-1])), True
    if not np.size(matrix.breaks):
        found = _of_smooth(matrix, None)
        if found is not None:
            return found, True
    return _of_elements(elements(matrix), matrix.period, _ENDLESS), False


def fourier(matrix: AbstractPeriodicMatrix, n_harmonics: int) -> Complexes:
    """The Fourier coefficients M_m for m = -N..N (rows, columns, 2 N + 1); zero below the rounding of the samples."""
    # In closed form for harmonics, constant pieces and trigonometric samples. A function without breaks is sampled at
    # equal steps until its upper harmonics have died away, which is checked between the samples; what has breaks or
    # does not die away is cut into elements; on each it is a Legendre series, with coefficients in closed form too.
    if (series := matrix.series()) is not None:
        lines = np.arange(-n_harmonics, n_harmonics + 1)
        out = np.zeros((*series.shape, len(lines)), dtype=np.complex128)
        _, to, source = np.intersect1d(lines, np.asarray(series.harmonics), return_indices=True)
        out[..., to] = np.asarray(series.coefficients)[..., source]
        return out
    if (pieces := matrix.pieces()) is not None:
        return _of_elements(pieces, matrix.period, n_harmonics)
    if not np.size(matrix.breaks):
        found = _of_smooth(matrix, n_harmonics)
        if found is not None:
            return found
    return _of_elements(elements(matrix), matrix.period, n_harmonics)


def elements(matrix: AbstractPeriodicMatrix) -> Elements:
    """A matrix cut at its breaks, and halved until its Legendre series end within each element, or refused."""
    breaks, period = np.asarray(matrix.breaks), matrix.period
    left = breaks if breaks.size else np.zeros(1)
    right = np.append(left[1:], left[0] + period)
    nodes, project = _projection()
    done: list[Elements] = []
    floor = np.zeros(matrix.shape)
    while left.size:
        width = right - left
        values = matrix.at(left[:, None] + 0.5 * width[:, None] * (1.0 + nodes))
        floor = np.maximum(floor, _units(np.abs(values).max(axis=(0, 1))))
        series = np.einsum("dp,eprc->edrc", project, values)
        tail = np.abs(series[:, -3:]).max(axis=1) * (width / period)[:, None, None]
        # What is too short to be halved holds a jump; its share of any coefficient is below rounding.
        ended = (tail <= _ROUNDING * floor).all(axis=(1, 2)) | (width <= 1e-15 * period)
        done.append(Elements(left[ended], width[ended], series[ended]))
        middle = 0.5 * (left + right)
        left, right = (np.concatenate([a[~ended], b[~ended]]) for a, b in ((left, middle), (middle, right)))
        if left.size and left.size + sum(len(part.left) for part in done) > _ELEMENTS:
            raise input_error(
                "system",
                "floquet.fourier",
                "be smooth in pieces",
                f"more than {_ELEMENTS} pieces of the period do not suffice, near t = {left[0]:g} for one",
                "Give noisy or measured values as samples; name the instants at which a callable jumps in `breaks`.",
            )
    return Elements(*(np.concatenate(parts) for parts in zip(*done, strict=True)))


def of_function(function: Callable[[Floats], Complexes], cuts: Floats, period: float, n_harmonics: int) -> Complexes:
    """The coefficients (..., 2 N + 1) of a function times -> (times, ...), smooth between the `cuts` of the period."""
    parts = np.maximum(1, np.ceil(np.diff(cuts) / period * (n_harmonics + 4.0) * 0.5)).astype(int)
    edges = np.unique(
        np.concatenate([np.linspace(a, b, p + 1) for a, b, p in zip(cuts, cuts[1:], parts, strict=False)])
    )
    nodes, project = _projection()
    left, width = edges[:-1], np.diff(edges)
    values = function((left[:, None] + 0.5 * width[:, None] * (1.0 + nodes)).ravel())
    values = values.reshape(len(left), len(nodes), 1, -1)
    series = np.einsum("dp,eprc->edrc", project, values)
    return _of_elements(Elements(left, width, series), period, n_harmonics)[0]


def _window(coefficients: Complexes, n_harmonics: int) -> Complexes:
    """Coefficients of -M..M cut down or filled up to -N..N."""
    rows, columns, count = coefficients.shape
    have = min(n_harmonics, count // 2)
    out = np.zeros((rows, columns, 2 * n_harmonics + 1), dtype=np.complex128)
    centre = slice(count // 2 - have, count // 2 + have + 1)
    out[..., n_harmonics - have : n_harmonics + have + 1] = coefficients[..., centre]
    return out


def _of_smooth(matrix: AbstractPeriodicMatrix, n_harmonics: int | None) -> Complexes | None:
    """The coefficients, all there are for N of None, from samples at equal steps; None if they do not die away."""
    period, n = matrix.period, _FIRST
    while n < 4 * ((n_harmonics or 0) + 1) and n < _LAST:
        n *= 2
    samples = matrix.at(period * np.arange(n) / n)
    probes = matrix.at(period * _PROBES)
    while True:
        upper = np.moveaxis(np.fft.rfft(samples, axis=0), 0, 2)[..., : n // 2] / n
        units = _units(np.abs(samples).max(axis=0))
        if (np.abs(upper[..., 3 * n // 8 :]).max(axis=2) <= _ROUNDING * units).all():
            upper[np.abs(upper) <= 0.1 * _ROUNDING * units[..., None]] = 0.0
            angle = 2.0 * np.pi * np.multiply.outer(np.arange(n // 2), _PROBES)
            series = 2.0 * (upper @ np.exp(1j * angle)).real - upper[..., :1].real
            if (np.abs(np.moveaxis(probes, 0, 2) - series).max(axis=2) <= 1e3 * _ROUNDING * units).all():
                every = two_sided(upper)
                return every if n_harmonics is None else _window(every, n_harmonics)
        if n >= _LAST:
            return None
        between = matrix.at(period * (np.arange(n) + 0.5) / n)
        samples = np.stack([samples, between], axis=1).reshape(2 * n, *matrix.shape)
        n *= 2


def _of_elements(pieces: Elements, period: float, n_harmonics: int) -> Complexes:
    """From the integrals ∫ P_d(x) e^{-iax} dx = 2 (-i)^d j_d(a) over -1..1."""
    from scipy.special import spherical_jn

    harmonics = np.arange(n_harmonics + 1)
    n_degrees = pieces.series.shape[1]
    out = np.zeros((*pieces.series.shape[2:], len(harmonics)), dtype=np.complex128)
    real = not np.iscomplexobj(pieces.series)
    lower = np.zeros_like(out)
    for begin in range(0, len(pieces.left), 256):  # in parts, for memory
        left, width, series = (part[begin : begin + 256] for part in pieces)
        angle = np.multiply.outer(np.pi * width / period, harmonics)
        turn = np.exp(-2j * np.pi * np.multiply.outer((left + 0.5 * width) / period, harmonics))
        for degree in range(n_degrees):
            weight = (width / period)[:, None] * np.asarray(spherical_jn(degree, angle)) * turn * (-1j) ** degree
            out += np.tensordot(series[:, degree], weight, (0, 0))
            if not real:
                # for harmonic -m the angle and the turn change sign: the conjugate weight
                lower += np.tensordot(series[:, degree], weight.conj(), (0, 0))
    return two_sided(out) if real else np.concatenate([lower[..., :0:-1], out], axis=-1)


def _projection() -> tuple[Floats, Floats]:
    """Gauss points on -1..1 (points,) and the matrix from values there to Legendre coefficients (degrees, points)."""
    from numpy.polynomial import legendre

    nodes, weights = legendre.leggauss(_POINTS)
    degrees = np.arange(_POINTS)
    return nodes, legendre.legvander(nodes, _POINTS - 1).T * weights * (degrees[:, None] + 0.5)


def _units(largest: Floats) -> Floats:
    """The unit of an error of each entry: the largest entry of its row or its column, whichever is less."""
    return np.minimum(largest.max(axis=1)[:, None], largest.max(axis=0)[None, :])


def after_jumps(matrix: AbstractPeriodicMatrix, times: Floats) -> Floats:
    """The values at `times` of the first period (times, rows, columns); those after it where there is a jump."""
    breaks = np.asarray(matrix.breaks)
    if breaks.size:  # rounding must not decide on which side of a jump an instant lies
        apart = np.abs(times[:, None] - np.append(breaks, breaks[0] + matrix.period)).min(axis=1)
        times = np.where(apart <= SAME * matrix.period, times + 2.0 * SAME * matrix.period, times)
    return matrix.at(times)


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
