"""Periods: the least one that several share, and one matrix declared over more of it or less."""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, integer, positive
from floquid.floquet.matrices._conversion import SAME, real_series, series_of_samples
from floquid.floquet.matrices._forms import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    HarmonicMatrix,
    PiecewiseMatrix,
    SampledMatrix,
)

MOST = 1000  # periods of one matrix in a common period
REPEATS = 1e-10  # difference, as a share of the largest value, within which a matrix repeats itself
_GOLDEN = 0.3819660112501051
_PROBES = 32


def common_period(*periods: float) -> float:
    r"""The least common multiple of several `periods` [s], to within 1e-12 of it.

    .. math:: T = a\,p = b\,q, \qquad a, b \in \mathbb{N} \text{ without a common divisor}

    Raises InputError where a period is not positive, or there is no such time within 1000 periods of each.
    """
    return multiples(periods, "floquet.common_period")[0]


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


def constant_value(matrix: AbstractPeriodicMatrix) -> Floats | None:
    """The one value of a matrix whose form has no other (rows, columns)."""
    if isinstance(matrix, HarmonicMatrix):
        single = np.shape(matrix.harmonics) == (1,)
    elif isinstance(matrix, (PiecewiseMatrix, SampledMatrix)):
        single = np.shape(matrix.values)[2] == 1
    else:
        single = False
    return matrix.at(0.0) if single else None


def repeated(matrix: AbstractPeriodicMatrix, count: int) -> AbstractPeriodicMatrix:
    """Matrix over `count` of its periods; see `AbstractPeriodicMatrix.repeated`."""
    number = integer(count, "count", "AbstractPeriodicMatrix.repeated", at_least=1)
    return declared(matrix, number, number * matrix.period)


def declared(matrix: AbstractPeriodicMatrix, count: int, period: float) -> AbstractPeriodicMatrix:
    """The matrix over `count` of its periods, together `period` to within rounding."""
    if count == 1 and period == matrix.period:
        return matrix
    if isinstance(matrix, HarmonicMatrix):
        lines = np.asarray(matrix.harmonics) * count
        return HarmonicMatrix(coefficients=matrix.coefficients, harmonics=lines, period=period)
    turns = matrix.period * np.arange(count)

    def tiled(times: Floats) -> Floats:
        every = np.add.outer(turns, times).ravel() * (period / (count * matrix.period))
        return np.minimum(every, np.nextafter(period, 0.0))

    if isinstance(matrix, PiecewiseMatrix):
        values, edges = np.tile(np.asarray(matrix.values), count), tiled(np.asarray(matrix.edges))
        return PiecewiseMatrix(values=values, edges=edges, period=period)
    if isinstance(matrix, SampledMatrix):
        values, times = np.tile(np.asarray(matrix.values), count), tiled(np.asarray(matrix.times))
        return SampledMatrix(values=values, period=period, times=times, interpolation=matrix.interpolation)
    return FunctionMatrix(function=matrix.at, period=period, breaks=tiled(np.asarray(matrix.breaks)), vectorised=True)


def reduced(matrix: AbstractPeriodicMatrix) -> AbstractPeriodicMatrix:
    """Matrix over its smallest period; see `AbstractPeriodicMatrix.reduced`."""
    if constant_value(matrix) is not None:
        return matrix
    if isinstance(matrix, HarmonicMatrix):
        return _reduced_series(matrix)
    count = _repetitions(matrix)
    if count == 1:
        return matrix
    period = matrix.period / count
    if isinstance(matrix, PiecewiseMatrix):
        edges = merged(np.mod(np.asarray(matrix.edges), period), period)
        return PiecewiseMatrix(values=values_between(matrix, edges, period), edges=edges, period=period)
    samples = _reduced_samples(matrix, count) if isinstance(matrix, SampledMatrix) else None
    if samples is not None:
        return samples
    breaks = merged(np.mod(np.asarray(matrix.breaks), period), period)
    return FunctionMatrix(function=matrix.at, period=period, breaks=breaks, vectorised=True)


def joint_breaks(matrices: tuple[AbstractPeriodicMatrix, ...], period: float) -> Floats:
    """The breaks of all of them in a period that is a whole number of each (breaks,) [s]."""
    every = [
        np.add.outer(matrix.period * np.arange(round(period / matrix.period)), np.asarray(matrix.breaks)).ravel()
        for matrix in matrices
    ]
    return merged(np.concatenate(every), period)


def merged(times: Floats, period: float) -> Floats:
    """Instants of one period, ascending, each once: those nearer than `SAME` of the period are one instant."""
    ordered = np.unique(np.minimum(times, np.nextafter(period, 0.0)))
    if ordered.size < 2:
        return ordered
    kept = ordered[np.append(True, np.diff(ordered) > SAME * period)]
    # The end of the period is its beginning.
    return kept[:-1] if kept.size > 1 and period - kept[-1] + kept[0] <= SAME * period else kept


def values_between(matrix: AbstractPeriodicMatrix, edges: Floats, period: float) -> Floats:
    """The values in the middle between each edge and the next one (rows, columns, edges)."""
    ends = np.append(edges[1:], edges[0] + period)
    return np.moveaxis(matrix.at(0.5 * (edges + ends)), 0, 2)


def _reduced_samples(matrix: SampledMatrix, count: int) -> SampledMatrix | HarmonicMatrix | None:
    """The samples of one repetition, or the harmonics of samples that are no whole number of repetitions."""
    period, times, values = matrix.period / count, np.asarray(matrix.times), np.asarray(matrix.values)
    if len(times) % count == 0:
        rows = times.reshape(count, -1)
        if np.abs(rows - rows[0] - period * np.arange(count)[:, None]).max() < 1e-9 * period:
            one = values[..., : rows.shape[1]]
            return SampledMatrix(values=one, period=period, times=rows[0], interpolation=matrix.interpolation)
    return _reduced_series(series_of_samples(matrix)) if matrix.interpolation == "fourier" else None


def _reduced_series(matrix: HarmonicMatrix) -> HarmonicMatrix:
    lines, values = np.asarray(matrix.harmonics), np.asarray(matrix.coefficients)
    sizes = np.abs(values).max(axis=(0, 1))
    count = int(np.gcd.reduce(lines[sizes > REPEATS * sizes.max()])) if sizes.any() else 0
    if count < 2:  # 0: only the mean counts, and what is constant has no smallest period
        return matrix
    kept = lines % count == 0
    return real_series(values[..., kept], lines[kept] // count, matrix.period / count)


def _repetitions(matrix: AbstractPeriodicMatrix) -> int:
    """The largest number, up to `MOST`, of repetitions within the period; 1 for what is constant."""
    if np.ptp(matrix.at(_probes(matrix, 0.0)), axis=0).max() <= REPEATS * _size(matrix):
        return 1
    count = 1
    for prime in _primes():
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
    spread = period * np.mod(_GOLDEN * np.arange(1, _PROBES + 1), 1.0)
    if not breaks.size:
        return spread
    edges = merged(np.concatenate([breaks, np.mod(breaks - shift, period)]), period)
    ends = np.append(edges[1:], edges[0] + period)
    place = np.searchsorted(edges, spread, side="right") - 1
    from_edges = np.minimum(np.mod(spread - edges[place], period), np.mod(ends[place] - spread, period))
    return np.concatenate([spread[from_edges > 1e-9 * period], edges + _GOLDEN * (ends - edges)])


def _size(matrix: AbstractPeriodicMatrix) -> float:
    return float(np.abs(matrix.at(_probes(matrix, 0.0))).max())


def _primes() -> list[int]:
    return [n for n in range(2, MOST + 1) if all(n % d for d in range(2, int(n**0.5) + 1))]


def _incommensurate(first: float, second: float, of: str) -> Exception:
    got = f"are {first:.15g} s and {second:.15g} s, which have none to within {SAME:g}"
    remedy = "If they are meant to be equal or a whole multiple, give both from one number."
    return input_error("periods", of, f"have a common multiple within {MOST} of each", got, remedy)
