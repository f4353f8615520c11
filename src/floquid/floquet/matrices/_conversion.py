"""Conversions between the forms of a periodic matrix."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats, Indices
from floquid._checks import input_error, integer, positive
from floquid.floquet.matrices._forms import PiecewiseMatrix
from floquid.floquet.matrices._fourier import fourier
from floquid.floquet.matrices._given import refuse_other_period
from floquid.floquet.matrices._matrix import SAME, AbstractPeriodicMatrix
from floquid.floquet.matrices._series import HarmonicMatrix, SampledMatrix, real_series

FIRST, LAST = 8, 512  # harmonics tried until the upper ones have died away
_FLOOR = 16.0 * 2.0**-52  # entries below this share of the largest are rounding, whose harmonics never die away
_GOLDEN = 0.3819660112501051
_NODES = 12
_HALVINGS = 6


def to_harmonics(matrix: AbstractPeriodicMatrix, n_harmonics: int | None, tolerance: float) -> HarmonicMatrix:
    """The Fourier series; see `AbstractPeriodicMatrix.to_harmonics`."""
    of = "AbstractPeriodicMatrix.to_harmonics"
    _check_period(matrix, of)
    if n_harmonics is not None:
        count = integer(n_harmonics, "n_harmonics", of, at_least=0)
        lines = np.arange(-count, count + 1)
        return real_series(fourier(matrix, count), lines, matrix.period)
    accuracy = positive(tolerance, "tolerance", of)
    if not 1e-14 <= accuracy < 1.0:
        raise input_error("tolerance", of, "lie in [1e-14, 1)", f"is {accuracy:g}")
    if (series := matrix.series()) is not None:
        return _trimmed(series, accuracy)
    probes = matrix.period * (1.0 + _GOLDEN * np.arange(1, 4))
    count, left = FIRST, np.inf
    while count <= LAST:
        values = fourier(matrix, count)
        # Those below a quarter from the top speak for those above it, which are not known.
        tail = 2.0 * np.abs(values[..., 2 * count - count // 4 + 1 :]).sum(axis=2)
        allowed = _allowed(values, accuracy)
        left = float((tail / np.maximum(allowed, np.finfo(float).tiny)).max() * accuracy)
        if (tail <= allowed).all():
            found = real_series(values, np.arange(-count, count + 1), matrix.period)
            missed = np.abs(matrix.at(probes) - found.at(probes)).max(axis=0)
            if (missed <= 10.0 * max(1.0, 1e-13 / accuracy) * allowed).all():
                return _trimmed(found, accuracy)
        count *= 2
    got = f"with {LAST} of them the upper ones are still {left:.2g} of the matrix, which is to be {accuracy:g}"
    remedy = "At a jump they never do: say how many to keep by `n_harmonics`, or use pieces or samples."
    raise input_error("tolerance", of, "be one that the harmonics fall below", got, remedy)


def to_samples(matrix: AbstractPeriodicMatrix, n_samples: int) -> SampledMatrix:
    """Samples at equal steps; see `AbstractPeriodicMatrix.to_samples`."""
    of = "AbstractPeriodicMatrix.to_samples"
    count = integer(n_samples, "n_samples", of, at_least=1)
    _check_period(matrix, of)
    values = after_jumps(matrix, matrix.period * np.arange(count) / count)
    return SampledMatrix(values=np.moveaxis(values, 0, 2), period=matrix.period)


def to_pieces(matrix: AbstractPeriodicMatrix, n_pieces: int) -> PiecewiseMatrix:
    """The means over equal pieces; see `AbstractPeriodicMatrix.to_pieces`."""
    of = "AbstractPeriodicMatrix.to_pieces"
    count = integer(n_pieces, "n_pieces", of, at_least=1)
    _check_period(matrix, of)
    period = matrix.period
    edges = period * np.arange(count) / count
    series = matrix.series()
    values = _means(matrix, edges, of) if series is None else _means_of_series(series, edges, period / count)
    return PiecewiseMatrix(values=values, edges=edges, period=period)


def _check_period(matrix: AbstractPeriodicMatrix, of: str) -> None:
    """Only a function can be other than its period says, and what is made of one period would hide it."""
    if matrix.is_function:
        refuse_other_period(matrix, of)


def after_jumps(matrix: AbstractPeriodicMatrix, times: Floats) -> Floats:
    """The values at `times` of the first period (times, rows, columns); those after it where there is a jump."""
    breaks = np.asarray(matrix.breaks)
    if breaks.size:  # rounding must not decide on which side of a jump an instant lies
        apart = np.abs(times[:, None] - np.append(breaks, breaks[0] + matrix.period)).min(axis=1)
        times = np.where(apart <= SAME * matrix.period, times + 2.0 * SAME * matrix.period, times)
    return matrix.at(times)


def _trimmed(matrix: HarmonicMatrix, tolerance: float) -> HarmonicMatrix:
    """The series without its highest harmonics, as long as they are together below `tolerance` of each entry."""
    lines, values = np.asarray(matrix.harmonics), np.asarray(matrix.coefficients)
    orders = np.unique(np.abs(lines))
    sizes = np.stack([np.abs(values[..., np.abs(lines) == order]).sum(axis=2) for order in orders])
    beyond = np.cumsum(sizes[::-1], axis=0)[::-1]
    needed = (beyond > _allowed(values, tolerance)).any(axis=(1, 2))
    last = orders[needed][-1] if needed.any() else orders[0]
    kept = np.abs(lines) <= last
    return matrix if kept.all() else real_series(values[..., kept], lines[kept], matrix.period)


def _allowed(values: Complexes, tolerance: float) -> Floats:
    """The size of the harmonics that may be left out of each entry (rows, columns)."""
    sizes = np.abs(values).sum(axis=2)
    return np.maximum(tolerance * sizes, _FLOOR * sizes.max())


def _means_of_series(matrix: HarmonicMatrix, edges: Floats, width: float) -> Floats:
    """The means from each edge on over `width` (rows, columns, edges): a sine over its angle for each harmonic."""
    lines = np.asarray(matrix.harmonics)
    damped = np.asarray(matrix.coefficients) * np.sinc(lines * width / matrix.period)
    means = real_series(damped, lines, matrix.period)
    return np.moveaxis(means.at(edges + 0.5 * width), 0, 2)


def _means(matrix: AbstractPeriodicMatrix, edges: Floats, of: str) -> Floats:
    """The means between the edges (rows, columns, edges), by Gauss quadrature on parts without a jump."""
    period = matrix.period
    bounds = np.unique(np.concatenate([edges, np.asarray(matrix.breaks), [period]]))
    owner = np.searchsorted(edges, 0.5 * (bounds[1:] + bounds[:-1]), side="right") - 1
    before, _ = _quadrature(matrix, bounds, owner, len(edges), 1)
    change = np.inf
    for halving in range(1, _HALVINGS + 1):
        means, largest = _quadrature(matrix, bounds, owner, len(edges), 2**halving)
        change = float(np.abs(means - before).max())
        if change <= 1e-12 * largest:
            return np.moveaxis(means, 0, 2)
        before = means
    must = "be one for which the means are found to 1e-12"
    got = f"they still change by {change:.2g}"
    raise input_error("n_pieces", of, must, got, "Name the instants at which the matrix jumps in its `breaks`.")


def _quadrature(
    matrix: AbstractPeriodicMatrix, bounds: Floats, owner: Indices, count: int, parts: int
) -> tuple[Floats, float]:
    """The mean of each owner's stretches (count, rows, columns), each cut into `parts`, and the largest value met."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    widths = np.repeat(np.diff(bounds) / parts, parts)
    place = np.tile(np.arange(parts), len(bounds) - 1)
    starts = np.repeat(bounds[:-1], parts) + place * widths
    values = matrix.at(starts[:, None] + 0.5 * (1.0 + nodes) * widths[:, None])
    integrals = 0.5 * widths[:, None, None] * np.einsum("k,ikrc->irc", weights, values)
    sums = np.zeros((count, *matrix.shape))
    np.add.at(sums, np.repeat(owner, parts), integrals)
    return sums * (count / matrix.period), float(np.abs(values).max())
