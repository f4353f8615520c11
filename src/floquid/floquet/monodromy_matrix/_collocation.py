r"""Transition matrices over short intervals, by Gauss collocation.

.. math:: \Phi = I + h \sum_i b_i A_i Y_i, \qquad Y_i = I + h \sum_j a_{ij} A_j Y_j, \qquad A_i = A(t_0 + c_i h)

with the s nodes c and weights a, b of Gauss and Legendre: of order 2s, stable however stiff the equation, and keeping
every quadratic invariant, so that the multipliers of an undamped system stay reciprocal (Hairer, Lubich and Wanner,
Geometric Numerical Integration, II.1.3 and IV.2.1). No node lies on an end of the interval, so a jump of A there is
never seen from the wrong side.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Indices

Evaluate: TypeAlias = Callable[[Indices, Floats], Floats]
"""Owner (items,) and times (items, nodes) [s] -> A there (items, nodes, n, n)."""

CHUNK = 4_000_000  # numbers of the collocation's equations that are solved in one batch
_INSIDE = 1e-7  # of an interval: where its ends are looked at, on this side of a jump that lies on them
_JUMP = 1e-6  # of A: what the values at an end may be off those between, before a jump is suspected there
MOST = 200_000  # intervals of one call beyond which the system is called impossible to integrate
DEEPEST = 46  # halvings of one interval: a jump within what is left then is worth less than rounding


class Factors(NamedTuple):
    """Transition matrices of successive intervals, sorted by owner and time."""

    owner: Indices
    left: Floats
    right: Floats
    matrices: Floats  # (factors, n, n)
    finished: bool  # true if every interval reached the tolerance


class Rule(NamedTuple):
    """A Gauss rule on [0, 1]."""

    nodes: Floats
    weights: Floats
    inner: Floats  # a_ij (nodes, nodes)


def stages(n: int) -> int:
    """The number of nodes: many where the overhead of a call counts, fewer where the arithmetic does."""
    return 8 if n <= 6 else 6


def divided(left: Floats, right: Floats, parts: Indices) -> tuple[Indices, Floats, Floats]:
    """Intervals cut into equal `parts` each (intervals,): whose each piece is, its left and its right end (pieces,)."""
    owner = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(parts) - parts, parts)
    lefts = left[owner] + step * ((right - left) / parts)[owner]
    last = step + 1 == parts[owner]
    return owner, lefts, np.where(last, right[owner], np.append(lefts[1:], 0.0))


@cache
def gauss(n_nodes: int) -> Rule:
    """The rule of `n_nodes`, its inner weights by integration of the Legendre polynomials through the nodes."""
    legendre = np.polynomial.legendre
    x, w = legendre.leggauss(n_nodes)
    values = legendre.legvander(x, n_nodes - 1)
    integrals = np.stack([legendre.legval(x, legendre.legint(unit, lbnd=-1.0)) for unit in np.eye(n_nodes)], axis=1)
    return Rule(0.5 * (x + 1.0), 0.5 * w, 0.5 * integrals @ np.linalg.inv(values))


@cache
def _extrapolation(n_nodes: int) -> Floats:
    """Weights that extrapolate values at the nodes to just inside both ends (2, nodes)."""
    legendre = np.polynomial.legendre
    values = legendre.legvander(legendre.leggauss(n_nodes)[0], n_nodes - 1)
    return legendre.legvander(np.array([2.0 * _INSIDE - 1.0, 1.0 - 2.0 * _INSIDE]), n_nodes - 1) @ np.linalg.inv(values)


def collocate(values: Floats, widths: Floats) -> Floats:
    """Φ over each interval (items, n, n), from A at its nodes (items, nodes, n, n) and its width (items,)."""
    items, s, n, _ = values.shape
    rule = gauss(s)
    scaled = values * widths[:, None, None, None]
    rows = scaled.swapaxes(1, 2)
    system = np.empty((items, s, n, s, n))
    np.multiply(-rule.inner[:, None, :, None], rows[:, None], out=system)
    system = system.reshape(items, s * n, s * n)
    diagonal = np.arange(s * n)
    system[:, diagonal, diagonal] += 1.0
    right = np.broadcast_to(np.tile(np.eye(n), (s, 1)), (items, s * n, n))
    inside = np.linalg.solve(system, right)
    slopes = (rows * rule.weights[:, None]).reshape(items, n, s * n)
    phi = slopes @ inside
    phi[:, np.arange(n), np.arange(n)] += 1.0
    return phi


def factorise(
    evaluate: Evaluate, owner: Indices, left: Floats, right: Floats, *, scale: Floats, tolerance: float, smooth: bool
) -> Factors:
    r"""The transition matrices of the intervals given, halved where one step does not reach the tolerance.

    A step is compared with two of half its width, Φ. What counts is the error relative to Φ on *either* side, so that
    the small multipliers are as good as the large ones, and the accepted value is that of the halves:

    .. math:: \lVert (\Phi_1 - \Phi)\,\Phi^{-1} \rVert, \qquad \lVert \Phi^{-1} (\Phi_1 - \Phi) \rVert

    Where A is `smooth` within each interval, the halves are better than the difference by 2^{2s}, whose square
    root is counted on; elsewhere the difference itself must be within the tolerance. A factor must also be so well
    conditioned that rounding does not spoil its small directions. The equations are solved, and errors measured, in
    units of the states `scale` (n,), powers of two.
    """
    n = len(scale)
    s = stages(n)
    units = scale / scale[:, None]

    def balanced(whose: Indices, times: Floats) -> Floats:
        return evaluate(whose, times) * units

    gain = 2.0**-s if smooth else 1.0
    chunk = max(1, CHUNK // (3 * (s * n) ** 2))
    done: list[tuple[Indices, Floats, Floats, Floats]] = []
    depth, count, finished = 0, 0, True
    single: Floats | None = None
    while owner.size:
        slices = [slice(i, i + chunk) for i in range(0, owner.size, chunk)]
        parts = [
            _step(balanced, owner[at], left[at], right[at], s, None if single is None else single[at], smooth)
            for at in slices
        ]
        halves, whole, error, rounding = parts[0]
        if len(parts) > 1:
            halves, whole, error, rounding = (np.concatenate(column) for column in zip(*parts, strict=True))
        good = (error * gain <= np.maximum(tolerance, 4.0 * rounding)) & (rounding <= np.maximum(tolerance, 1e-13))
        count += owner.size
        stop = depth >= DEEPEST or count > MOST
        if stop:
            finished = bool(good.all())
            good[:] = True
        if good.all() and not done:
            return Factors(owner, left, right, whole / units, finished)
        if good.any():
            done.append((owner[good], left[good], right[good], whole[good]))
        again = ~good
        middle = 0.5 * (left[again] + right[again])
        owner = np.repeat(owner[again], 2)
        left, right = (
            np.stack([left[again], middle], axis=1).ravel(),
            np.stack([middle, right[again]], axis=1).ravel(),
        )
        single = halves[again].reshape(-1, n, n)
        depth += 1
    if not done:
        return Factors(owner, left, right, np.empty((0, n, n)), finished=True)
    owners, lefts, rights, matrices = (np.concatenate(column) for column in zip(*done, strict=True))
    order = np.lexsort((lefts, owners))
    return Factors(owners[order], lefts[order], rights[order], matrices[order] / units, finished)


def _step(
    evaluate: Evaluate, owner: Indices, left: Floats, right: Floats, s: int, single: Floats | None, smooth: bool
) -> tuple[Floats, Floats, Floats, Floats]:
    """The two halves (items, 2, n, n), their product, its distance from one step, and the rounding (items,)."""
    rule = gauss(s)
    width = right - left
    if single is None:
        single = collocate(evaluate(owner, left[:, None] + width[:, None] * rule.nodes), width)
    starts = np.stack([left, left + 0.5 * width], axis=1).ravel()
    half = np.repeat(0.5 * width, 2)
    places = rule.nodes if smooth else np.concatenate([rule.nodes, [_INSIDE, 1.0 - _INSIDE]])
    values = evaluate(np.repeat(owner, 2), starts[:, None] + half[:, None] * places)
    halves = collocate(values[:, :s], half)
    halves = halves.reshape(-1, 2, *halves.shape[1:])
    whole = halves[:, 1] @ halves[:, 0]
    back = inverse(whole)
    difference = single - whole
    error = np.maximum(_size(difference @ back), _size(back @ difference))
    rounding = 2.0**-53 * _size(whole) * _size(back)
    if not smooth:
        # A jump between an end and the node next to it is seen by no node.
        off = _size_of_all(values[:, s:] - np.einsum("en,inkl->iekl", _extrapolation(s), values[:, :s]))
        unseen = np.where(off > _JUMP * _size_of_all(values), off * half * rule.nodes[0], 0.0)
        error = np.maximum(error, unseen.reshape(-1, 2).max(axis=1))
    return halves, whole, error, rounding


def inverse(matrices: NDArray[Any]) -> NDArray[Any]:
    """The inverses; infinity for what has none, so that its interval is halved."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        regular = np.linalg.det(matrices) != 0.0
        out = np.full_like(matrices, np.inf)
        out[regular] = np.linalg.inv(matrices[regular])
        return out


def _size_of_all(values: Floats) -> Floats:
    """The largest row sum of the matrices of each item (items, matrices, n, n) -> (items,)."""
    return np.abs(values).sum(axis=3).max(axis=(1, 2))


def _size(matrices: Floats) -> Floats:
    """The largest row sum of each (items,)."""
    return np.abs(matrices).sum(axis=2).max(axis=1)
