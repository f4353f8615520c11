"""Periods: the least one that several share, and one matrix declared over more of it or less."""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, integer, positive
from floquid.floquet.matrices._matrix import SAME, AbstractPeriodicMatrix, merged
from floquid.floquet.matrices._series import REPEATS

MOST = 1000  # periods of one matrix in a common period
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
    return matrix.at(0.0) if matrix.is_constant else None


def repeated(matrix: AbstractPeriodicMatrix, count: int) -> AbstractPeriodicMatrix:
    """Matrix over `count` of its periods; see `AbstractPeriodicMatrix.repeated`."""
    number = integer(count, "count", "AbstractPeriodicMatrix.repeated", at_least=1)
    return declared(matrix, number, number * matrix.period)


def declared(matrix: AbstractPeriodicMatrix, count: int, period: float) -> AbstractPeriodicMatrix:
    """The matrix over `count` of its periods, together `period` to within rounding."""
    if count == 1 and period == matrix.period:
        return matrix
    return matrix.declared(count, period)


def reduced(matrix: AbstractPeriodicMatrix) -> AbstractPeriodicMatrix:
    """Matrix over its smallest period; see `AbstractPeriodicMatrix.reduced`."""
    count = 1 if matrix.is_constant else _repetitions(matrix)
    return matrix if count == 1 else matrix.part(count)


def joint_breaks(matrices: tuple[AbstractPeriodicMatrix, ...], period: float) -> Floats:
    """The breaks of all of them in a period that is a whole number of each (breaks,) [s]."""
    every = [
        np.add.outer(matrix.period * np.arange(round(period / matrix.period)), np.asarray(matrix.breaks)).ravel()
        for matrix in matrices
    ]
    return merged(np.concatenate(every), period)


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
