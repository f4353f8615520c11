"""A periodic change of coordinates that takes the jumps out of A(t) and leaves the exponents as they are."""

from __future__ import annotations

from math import comb
from typing import Any, NamedTuple

import numpy as np

from floquid._arrays import Floats
from floquid.floquet.matrices import AbstractPeriodicMatrix, Elements, FunctionMatrix, binary_units, elements

_ORDER = 6  # derivatives of P that are matched at a break
_MOST = 32  # breaks; the harmonics needed grow with the inverse of the distance between them


class Smoothed(NamedTuple):
    """x = P(t) z, and A(t) of z."""

    matrix: FunctionMatrix  # P⁻¹ (A P - P'), with as many continuous derivatives at the breaks as P has, less one
    change: Any  # P: times (times,) -> (times, n, n), a piecewise polynomial
    cuts: Floats  # a period of instants between which P is one polynomial (cuts,) [s]


def smoothed(matrix: AbstractPeriodicMatrix) -> Smoothed | None:
    r"""The matrix seen from coordinates in which it is smooth; None if it has no breaks, or too many.

    .. math:: x = P(t)\, z, \qquad P(t + T) = P(t), \qquad z' = P^{-1} (A P - P')\, z

    P is one but near the breaks, is one at each of them too, and its derivatives on either side there are those with
    which A of z has the mean of both sides' derivatives. The harmonics of z fall so much faster than those of x, and
    the exponents are the same.
    """
    breaks, period = np.asarray(matrix.breaks), matrix.period
    if not 0 < breaks.size <= _MOST:
        return None
    pieces = elements(matrix)
    before, after = _derivatives(pieces, breaks, period)
    reach = _reach(pieces, before, after)
    gap = np.append(breaks[1:], breaks[0] + period) - breaks
    rise = np.minimum(reach, 0.5 * gap)  # from a break on
    fall = np.minimum(np.roll(reach, -1), 0.5 * gap)  # down to the next one
    mean = [0.5 * (b + a) for b, a in zip(before, after, strict=True)]
    change = _spline(breaks, rise, fall, gap, _series(after, mean), _series(before, mean))
    slope = change.derivative()

    def function(times: Floats) -> Floats:
        at = change(times)
        return np.linalg.solve(at, matrix.at(times) @ at - slope(times))

    folded = np.unique(np.mod(change.x[:-1], period))
    return Smoothed(FunctionMatrix(function=function, period=period, breaks=folded, vectorised=True), change, change.x)


def _derivatives(pieces: Elements, breaks: Floats, period: float) -> tuple[list[Floats], list[Floats]]:
    """Derivatives 0, 1, ... of A just before and just after the breaks, each (breaks, n, n)."""
    from numpy.polynomial import legendre

    right = pieces.left + pieces.width
    apart = np.abs(np.mod(right[None, :] - breaks[:, None] + 0.5 * period, period) - 0.5 * period)
    sides = (apart.argmin(axis=1), np.abs(pieces.left[None, :] - breaks[:, None]).argmin(axis=1))
    out: tuple[list[Floats], list[Floats]] = ([], [])
    for found, chosen, end in zip(out, sides, (1.0, -1.0), strict=True):
        series, factor = np.moveaxis(pieces.series[chosen], 1, 0), 2.0 / pieces.width[chosen]
        for order in range(_ORDER):
            value = legendre.legval(end, legendre.legder(series, order))
            found.append(value * (factor**order)[:, None, None])
    return out


def _reach(pieces: Elements, before: list[Floats], after: list[Floats]) -> Floats:
    """Distance from each break at which P may differ from one (breaks,) [s], so that it never is far from one."""
    largest = np.abs(pieces.series).sum(axis=1).max(axis=0)
    scale = binary_units(largest)
    jump = np.abs(after[0] - before[0]) * scale / scale[:, None]
    with np.errstate(divide="ignore"):
        return 1.0 / jump.sum(axis=2).max(axis=1)


def _series(sides: list[Floats], mean: list[Floats]) -> Floats:
    """Derivatives 0, 1, ... of P at the breaks (breaks, orders, n, n), from P' = A P - P B."""
    p = [np.broadcast_to(np.eye(sides[0].shape[1]), sides[0].shape)]
    for order in range(_ORDER):
        p.append(
            sum(comb(order, i) * (sides[i] @ p[order - i] - p[order - i] @ mean[i]) for i in range(order + 1))  # type: ignore[arg-type]
        )
    return np.stack(p, axis=1)


def _spline(breaks: Floats, rise: Floats, fall: Floats, gap: Floats, after: Floats, before: Floats) -> Any:
    """P as a periodic piecewise polynomial from the first break on."""
    from scipy.interpolate import BPoly

    flat = np.zeros(after.shape[1:])
    flat[0] = np.eye(after.shape[-1])
    knots, coefficients = [float(breaks[0])], []
    for index, start in enumerate(breaks):
        end = start + gap[index]
        following = before[(index + 1) % len(breaks)]
        stops = [start, start + rise[index], end - fall[index], end]
        rows = [after[index], flat, flat, following]
        if rise[index] + fall[index] >= gap[index] * (1.0 - 1e-9):
            del stops[2], rows[2]
        for left, right, low, high in zip(stops, stops[1:], rows, rows[1:], strict=False):
            piece: Any = BPoly.from_derivatives([left, right], [low, high])
            coefficients.append(piece.c[:, 0])
            knots.append(float(right))
    return BPoly(np.stack(coefficients, axis=1), np.array(knots), extrapolate="periodic")
