"""Hill's truncated problem, of an A(t) whose jumps are taken out: its eigenpairs, and those n that are the modes."""

from __future__ import annotations

from math import comb
from typing import Any, NamedTuple

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Mask
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
    # How far from each break P may differ from one, so that it never is far from one.
    scale = binary_units(np.abs(pieces.series).sum(axis=1).max(axis=0))
    jump = np.abs(after[0] - before[0]) * scale / scale[:, None]
    with np.errstate(divide="ignore"):
        reach = 1.0 / jump.sum(axis=2).max(axis=1)
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


def block_toeplitz(coefficients: Complexes, n_harmonics: int) -> Complexes:
    """The product with M(t) in harmonics: block (k, m) is M_{k-m}, k and m from -N to N.

    The coefficients (rows, columns, 2 M + 1) reach to M of at least 2 N; the matrix goes harmonic by harmonic.
    """
    rows, columns, count = coefficients.shape
    index = np.arange(2 * n_harmonics + 1)
    blocks = coefficients[..., count // 2 + index[:, None] - index[None, :]]
    return blocks.transpose(2, 0, 3, 1).reshape(len(index) * rows, len(index) * columns)


def real_hill(coefficients: Complexes, n_harmonics: int, fundamental: float) -> Floats:
    """Hill's matrix of a real A(t) in cosines and sines, unitarily similar to A_{k-m} - i m ω δ_{km}.

    With q_m = (c_m - i s_m)/√2 and q_{-m} = (c_m + i s_m)/√2 the unknowns are c_0..c_N, then s_1..s_N. It is real, so
    that its eigenvalues are conjugate in pairs exactly. A_m as in `block_toeplitz` [1/s].
    """
    n, _, count = coefficients.shape
    m = np.arange(n_harmonics + 1)
    weight = np.where(m == 0, np.sqrt(0.5), 1.0)
    less = coefficients[..., count // 2 + m[:, None] - m[None, :]] * (weight[:, None] * weight)
    more = coefficients[..., count // 2 + m[:, None] + m[None, :]] * (weight[:, None] * weight)
    cos_cos, cos_sin = less.real + more.real, (less.imag - more.imag)[..., :, 1:]
    sin_cos, sin_sin = -(less.imag + more.imag)[..., 1:, :], (less.real - more.real)[..., 1:, 1:]
    blocks = np.concatenate(
        [np.concatenate([cos_cos, cos_sin], axis=3), np.concatenate([sin_cos, sin_sin], axis=3)], axis=2
    )
    size = (2 * n_harmonics + 1) * n
    matrix = np.ascontiguousarray(blocks.transpose(2, 0, 3, 1)).reshape(size, size)
    cosine, sine = np.arange(n, (n_harmonics + 1) * n), np.arange((n_harmonics + 1) * n, size)
    speed = np.repeat(fundamental * m[1:], n)
    matrix[cosine, sine] -= speed
    matrix[sine, cosine] += speed
    return matrix


def speeds(n: int, n_harmonics: int, fundamental: float) -> Complexes:
    """The diagonal i k ω of n states, harmonic by harmonic from -N to N ((2 N + 1) n,) [1/s]."""
    return np.asarray(1j * fundamental * np.repeat(np.arange(-n_harmonics, n_harmonics + 1), n), dtype=np.complex128)


def modulo(differences: Complexes, fundamental: float) -> Complexes:
    """Differences of exponents with the nearest multiple of iω taken off, of any shape (...) [1/s]."""
    turns = np.round(np.imag(differences) / fundamental)
    return np.asarray(differences - 1j * fundamental * turns, dtype=np.complex128)


def in_exponentials(vectors: Complexes, n: int) -> Complexes:
    """Vectors in cosines and sines (size, vectors) as coefficients of e^{imωt} (vectors, n, 2 N + 1)."""
    blocks = vectors.reshape(-1, n, vectors.shape[1]).transpose(2, 1, 0)
    n_harmonics = blocks.shape[2] // 2
    cosine, sine = blocks[..., 1 : n_harmonics + 1], blocks[..., n_harmonics + 1 :]
    above, below = np.sqrt(0.5) * (cosine - 1j * sine), np.sqrt(0.5) * (cosine + 1j * sine)
    return np.concatenate([below[..., ::-1], blocks[..., :1], above], axis=2)


_SAME = (1e-6, 1e-4, 1e-8)  # of ω: within which two eigenvalues are one of a family, or a multiple one
_SPLIT = 6.0  # times the rounding: a k-fold exponent splits by at most 2 k times what each moves by to first order
_FLOOR = 1e-13  # of A's size: a leak below it is none
_EPS = float(np.finfo(float).eps)
_ROUNDS = 6


class Problem(NamedTuple):
    """A(t) in harmonics, in balanced units."""

    coefficients: Complexes  # A_m, m = -2 N..2 N (n, n, 4 N + 1) [1/s]
    fundamental: float  # ω [rad/s]

    @property
    def n_harmonics(self) -> int:
        """The truncation N."""
        return self.coefficients.shape[2] // 4

    @property
    def n_states(self) -> int:
        """The number of states n."""
        return self.coefficients.shape[0]

    @property
    def growth(self) -> float:
        """The mean trace of A(t), which the exponents sum to [1/s]."""
        return float(np.trace(self.coefficients[..., self.coefficients.shape[2] // 2]).real)

    @property
    def size(self) -> float:
        """The largest row sum of all |A_m| [1/s]."""
        return float(np.abs(self.coefficients).sum(axis=(1, 2)).max())

    @property
    def norm(self) -> float:
        """A bound of the norm of the truncated matrix [1/s]."""
        return self.size + self.n_harmonics * self.fundamental


class Truncated(NamedTuple):
    """The modes of a truncation, one of each family, conjugates together."""

    exponents: Complexes  # λ where the shape is best centred in the truncation (modes,) [1/s]
    vectors: Complexes  # the shapes' harmonics -N..N (modes, n, 2 N + 1)
    leak: Floats  # a bound of what A carries out of the truncation (modes,) [1/s], for shapes of norm one
    condition: Floats  # of each eigenvalue (modes,)

    def rounding(self, problem: Problem) -> Floats:
        """The largest effect of rounding on the exponents (modes,) [1/s]."""
        return 4.0 * _EPS * self.condition * problem.norm

    def split(self, problem: Problem) -> Floats:
        """Distance, modulo iω, of each to the farthest of those equal to it up to rounding (modes,)."""
        apart = np.abs(modulo(np.subtract.outer(self.exponents, self.exponents), problem.fundamental))
        # The condition of an exactly defective one is without bound, that by which it splits is not.
        rounding = np.minimum(self.rounding(problem), np.cbrt(_EPS) * problem.norm)
        one = apart <= _SPLIT * np.minimum(rounding, rounding[:, None])
        return np.where(one, apart, 0.0).max(axis=1)


def effect_of_edges(problem: Problem, modes: Truncated) -> Floats:
    r"""About what the harmonics beyond the truncation would move the exponents by (modes,) [1/s].

    .. math:: \kappa \sum_{|k| > N} \frac{|(A p)_k|^2}{|k|\, \omega}, \qquad (A p)_k = \sum_m A_{k-m}\, p_m

    To second order, with κ the condition and the left partner of each shape taken to leak as it does itself.
    """
    n_harmonics = problem.n_harmonics
    count = 2 * n_harmonics + 1
    whole = np.zeros((len(modes.exponents), problem.n_states, count + 4 * n_harmonics), dtype=np.complex128)
    for index in np.flatnonzero(np.abs(problem.coefficients).any(axis=(0, 1))).tolist():
        whole[..., index : index + count] += problem.coefficients[..., index] @ modes.vectors
    energy = (np.abs(whole) ** 2).sum(axis=1)
    k = np.abs(np.arange(whole.shape[2]) - 3 * n_harmonics)
    weights = np.where(k > n_harmonics, 1.0 / (np.maximum(k, 1) * problem.fundamental), 0.0)
    return modes.condition * (energy @ weights)


def truncated(problem: Problem) -> Truncated | None:
    """The modes of A_{k-m} - i m ω δ_{km}; None while the truncation cannot tell n of them."""
    # Every mode is there about 2 N + 1 times, as λ + i k ω with its harmonics moved by k; that copy is taken whose
    # least is carried over the edges, the best centred of several. Where multiple exponents are not told from copies,
    # all are taken from one multiple of iω, where each stands once.
    from scipy.linalg import eig

    n = problem.n_states
    matrix = real_hill(problem.coefficients, problem.n_harmonics, problem.fundamental)
    found = eig(matrix, left=True, overwrite_a=True, check_finite=False)
    values, left, right = (np.asarray(part, dtype=np.complex128) for part in found)
    upper = np.flatnonzero(values.imag >= 0.0)
    values, left, right = values[upper], left[:, upper], right[:, upper]
    condition = 1.0 / np.maximum(np.abs((left.conj() * right).sum(axis=0)), 1e-300)
    vectors = in_exponentials(right, n)
    leak = _leaks(problem, vectors)
    energy = (np.abs(vectors) ** 2).sum(axis=1)
    off_centre = np.abs(energy @ np.arange(-problem.n_harmonics, problem.n_harmonics + 1))
    ranks = np.maximum(leak, _FLOOR * (problem.size + problem.fundamental)) * (1.0 + off_centre)
    order = np.argsort(ranks, kind="stable")
    for same in _SAME:
        taken = _one_of_each(values, order, n, problem.fundamental, same * problem.fundamental)
        if taken is None:
            continue
        picked, conjugate = taken
        exponents = values[picked]
        exponents[conjugate] = exponents[conjugate].conj()
        chosen = Truncated(exponents, vectors[picked], leak[picked], condition[picked])
        # Liouville: a family taken twice, or one left out, shows in the sum unless its growth is the mean one.
        doubt = n * same * problem.fundamental + chosen.rounding(problem).sum()
        doubt += (chosen.condition * chosen.leak**2).sum() / problem.fundamental
        if abs(exponents.real.sum() - problem.growth) <= doubt:
            chosen.vectors[conjugate] = chosen.vectors[conjugate][..., ::-1].conj()
            return chosen
    return None


def nearest(problem: Problem, near: complex, start: Complexes) -> Truncated:
    """The one mode nearest to an exponent, by inverse iteration from a shape (n, 2 N + 1) on both sides."""
    from scipy.linalg import lu_factor, lu_solve

    n, count = start.shape
    matrix = block_toeplitz(problem.coefficients, problem.n_harmonics)
    diagonal = np.arange(n * count)
    matrix[diagonal, diagonal] -= speeds(n, count // 2, problem.fundamental) + near + _EPS * problem.size
    factors = lu_factor(matrix, check_finite=False)
    right, left = start.T.ravel(), start.T.ravel()
    for _ in range(3):
        right = np.asarray(lu_solve(factors, right, check_finite=False))
        right /= np.linalg.norm(right)
        left = np.asarray(lu_solve(factors, left, trans=2, check_finite=False))
        left /= np.linalg.norm(left)
    overlap = left.conj() @ right
    matrix[diagonal, diagonal] += _EPS * problem.size
    shift = (left.conj() @ (matrix @ right)) / overlap
    vector = right.reshape(count, n).T[None]
    return Truncated(
        np.array([near + shift]), vector, _leaks(problem, vector), np.array([1.0 / max(abs(overlap), 1e-300)])
    )


def _leaks(problem: Problem, vectors: Complexes) -> Floats:
    """A bound of the part of A p that lies beyond the truncation (vectors,) [1/s]."""
    n_harmonics = problem.n_harmonics
    norms = np.linalg.norm(problem.coefficients, axis=(0, 1))[2 * n_harmonics :]
    beyond = np.append(np.cumsum(norms[:0:-1])[::-1], 0.0)  # sums over harmonics above 0..2 N
    m = np.arange(-n_harmonics, n_harmonics + 1)
    weights = beyond[n_harmonics - m] + beyond[n_harmonics + m]
    return np.linalg.norm(vectors, axis=1) @ weights


def _one_of_each(
    values: Complexes, order: Indices, n: int, fundamental: float, same: float
) -> tuple[Indices, Mask] | None:
    """The first of every family in `order` and whether its conjugate is meant, until there are n; None if not n."""
    taken = np.empty(0, dtype=np.complex128)
    picked: list[int] = []
    conjugate: list[bool] = []
    for index in order.tolist():
        pair = (values[index],) if values[index].imag == 0.0 else (values[index], values[index].conjugate())
        for is_conjugate, value in enumerate(pair):
            apart = value - taken
            turns = np.round(apart.imag / fundamental)
            near = np.abs(apart - 1j * fundamental * turns) <= same
            if near.any() and not (near & (turns == 0)).any():
                continue
            taken = np.append(taken, value)
            picked.append(index)
            conjugate.append(bool(is_conjugate))
        if len(taken) >= n:
            break
    return (np.array(picked), np.array(conjugate)) if len(taken) == n else None


def swinging_along(problem: Problem, found: Truncated, index: int) -> Truncated:
    r"""Mode `index`, found again with its swings of amplitude divided out; as it was, where that does not help.

    .. math:: x = e^{g(t)}\, z, \qquad z' = (A - g' I)\, z, \qquad g(t + T) = g(t)

    A shape with some phases 1e-6 of others, and whose left partner is as small where it is large, has an
    exponent that is well conditioned at each instant, but not in harmonics, where all phases are mixed. With g the
    logarithm of the shape's size both partners are level, and the exponent is the same.
    """
    value, shape = complex(found.exponents[index]), found.vectors[index]
    n_harmonics = problem.n_harmonics
    n_grid = 8 * (n_harmonics + 1)
    logarithm = np.zeros(n_grid)
    best = Truncated(*(part[index : index + 1] for part in found))  # type: ignore[arg-type]
    condition = best.condition[0]
    middle = problem.coefficients.shape[2] // 2
    kept = max(1, n_harmonics // 2)
    for _ in range(_ROUNDS):
        size = np.linalg.norm(_on_grid(shape, n_grid), axis=0)
        lines = np.fft.rfft(np.log(np.maximum(size, 1e-12 * size.max())))
        lines[kept + 1 :] = 0.0
        lines[0] = 0.0
        logarithm = logarithm + np.fft.irfft(lines, n_grid)
        speed = 1j * problem.fundamental * np.arange(kept + 1) * np.fft.rfft(logarithm)[: kept + 1] / n_grid
        coefficients = problem.coefficients.copy()
        states = np.arange(problem.n_states)
        coefficients[states, states, middle : middle + kept + 1] -= speed
        coefficients[states, states, middle - kept : middle] -= speed[:0:-1].conj()
        again = nearest(Problem(coefficients, problem.fundamental), value, shape)
        if not again.condition[0] < condition:
            break
        level = again.condition[0] > 0.5 * condition
        condition, shape = again.condition[0], again.vectors[0]
        value = complex(again.exponents[0])
        whole = np.fft.fft(np.exp(logarithm) * _on_grid(shape, n_grid), axis=1) / n_grid
        best = again._replace(vectors=whole[None][..., np.arange(-n_harmonics, n_harmonics + 1)])
        if level:
            break
    return best


def _on_grid(shape: Complexes, n_grid: int) -> Complexes:
    """A shape's harmonics -N..N (n, 2 N + 1) as its values at equal steps of the period (n, grid)."""
    half = shape.shape[1] // 2
    lines = np.zeros((shape.shape[0], n_grid), dtype=np.complex128)
    lines[:, np.arange(-half, half + 1)] = shape
    return np.fft.ifft(lines, axis=1) * n_grid
