"""Edges of instability between points: where the exponents of a lock, or of one mode, cross the imaginary axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander

from floquid._arrays import Floats, Integers
from floquid.surveys._objects import REAL, Seen, invariants

DEGREE = 2  # of the polynomial that is free: the process adds to its second derivative
AMPLITUDES = 25  # on a logarithmic grid with a flat prior
SMALLEST, LARGEST = 1e-7, 1e3  # amplitude over the size of the values: a polynomial, and anything at all
ROUNDING = 1e-9  # share of the size of the values below which a deviation is rounding
STEADY = 1e-4  # share of the values themselves below which their differences are rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class Smooth:
    """Functions through values at a few points, each with an amplitude of its own."""

    x: Floats  # the points, scaled to a length of one (points,)
    y: Floats  # the values, scaled (functions, points)
    noise: Floats  # covariance of the values, a function after another (functions * points, functions * points)
    scale: Floats  # size of each function (functions,)
    grid: Floats  # amplitudes that were looked at (functions, amplitudes)
    weights: Floats  # the posterior of each

    def draws(self, at: Floats, count: int, generator: np.random.Generator) -> Floats:
        """Functions drawn from the posterior (count, functions, places), at the scaled places `at`."""
        picked = np.stack([generator.choice(self.grid.shape[1], count, p=row) for row in self.weights], axis=1)
        kinds, of = np.unique(picked, axis=0, return_inverse=True)
        out = np.empty((count, len(self.y), len(at)))
        kernels = self._kernels(at)
        for number, kind in enumerate(kinds):
            mean, covariance = self._posterior(kind, *kernels)
            here = np.flatnonzero(of.ravel() == number)
            values, vectors = np.linalg.eigh(covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            drawn = mean + generator.standard_normal((len(here), len(mean))) @ root.T
            out[here] = drawn.reshape(len(here), len(self.y), len(at))
        return out * self.scale[:, None]

    def misfit(self) -> float:
        """The rms of each point's distance from what the others predict, over its deviation; at least one."""
        best, count, total = self.weights.argmax(axis=1), len(self.x), 0.0
        for point in range(count):
            kept = np.arange(count) != point
            rows = np.flatnonzero(np.tile(kept, len(self.y)))
            noise = self.noise[np.ix_(rows, rows)]
            less = Smooth(
                x=self.x[kept], y=self.y[:, kept], noise=noise, scale=self.scale, grid=self.grid, weights=self.weights
            )
            mean, covariance = less._posterior(best, *less._kernels(self.x[[point]]))
            own = np.arange(len(self.y)) * count + point
            off = self.y[:, point] - mean
            total += float(off @ np.linalg.solve(covariance + self.noise[np.ix_(own, own)], off))
        return max(1.0, float(np.sqrt(total / (count * len(self.y)))))

    def _kernels(self, at: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Covariances of points, of points and places, and of places; the polynomials at points and at places."""
        own, cross, there = (kernel(a, b) for a, b in ((self.x, self.x), (self.x, at), (at, at)))
        basis, wanted = (np.kron(np.eye(len(self.y)), np.vander(x, DEGREE + 1)) for x in (self.x, at))
        return own, cross, there, basis.astype(np.float64), wanted.astype(np.float64)

    def _posterior(
        self, amplitudes: Integers, own: Floats, cross: Floats, there: Floats, basis: Floats, wanted: Floats
    ) -> tuple[Floats, Floats]:
        """Mean and covariance of all functions at places, given the place of each amplitude on its grid."""
        squares = np.diag(self.grid[np.arange(len(self.y)), amplitudes] ** 2)
        known, across = np.kron(squares, own) + self.noise, np.kron(squares, cross)
        size = max(float(np.abs(known).max()), 1e-300)  # or the polynomial would be lost beside it
        corner = np.zeros((basis.shape[1], basis.shape[1]))
        asked = np.concatenate([across, size * wanted.T])
        weights = np.linalg.solve(np.block([[known, size * basis], [size * basis.T, corner]]), asked)
        mean = weights[: self.y.size].T @ self.y.ravel()
        covariance = np.kron(squares, there) - asked.T @ weights
        return mean, 0.5 * (covariance + covariance.T)


def smooth(x: Floats, values: Floats, covariance: Floats) -> Smooth:
    """Functions through `values` (functions, points) at `x` (points,), by their covariance at each point."""
    from scipy.linalg import null_space

    count, points = values.shape
    contrasts: Floats = np.asarray(null_space(np.vander(x, DEGREE + 1).T))
    scale = np.maximum(np.maximum(np.ptp(values, axis=1), STEADY * np.abs(values).max(axis=1)), 1e-300)
    y = values / scale[:, None]
    noise = np.zeros((count, points, count, points))
    place = np.arange(points)
    noise[:, place, :, place] = covariance / np.multiply.outer(scale, scale)
    noise[np.arange(count)[:, None], place, np.arange(count)[:, None], place] += ROUNDING**2
    own = kernel(x, x)
    grid, weights = np.empty((2, count, AMPLITUDES))
    for row in range(count):
        spread = noise[row, :, row, :]
        lowest = max(SMALLEST, float(np.sqrt(np.diag(spread).min())))
        grid[row] = np.geomspace(min(lowest, 0.1 * LARGEST), LARGEST, AMPLITUDES)
        likelihood = np.array([_restricted(amplitude**2 * own + spread, contrasts, y[row]) for amplitude in grid[row]])
        weights[row] = np.exp(likelihood - likelihood.max())
    weights /= weights.sum(axis=1, keepdims=True)
    size = count * points
    return Smooth(x=x, y=y, noise=noise.reshape(size, size), scale=scale, grid=grid, weights=weights)


def _restricted(covariance: Floats, contrasts: Floats, y: Floats) -> float:
    """Logarithm of the likelihood of what no polynomial changes."""
    from scipy.linalg import cho_factor, cho_solve

    factor = cho_factor(contrasts.T @ covariance @ contrasts)
    left = contrasts.T @ y
    return -float(np.log(np.diag(factor[0])).sum() + 0.5 * left @ cho_solve(factor, left))


def kernel(a: Floats, b: Floats) -> Floats:
    r"""Covariance of a Wiener process integrated twice, from zero at -1 (len(a), len(b)).

    .. math:: \int_0^{\min(s, t)} \frac{(s - u)^2 (t - u)^2}{4}\, du
    """
    s, t = np.meshgrid(a + 1.0, b + 1.0, indexing="ij")
    low, high = np.minimum(s, t), np.maximum(s, t)
    gap = high - low
    return low**3 * (low**2 / 20.0 + low * gap / 8.0 + gap**2 / 12.0)


Kind = Literal["lock", "sum", "single"]

MOST, FEWEST = 7, 4  # points that an edge is found from
NODES, PLACES = 17, 801  # where functions are drawn, and where their crossing is looked for
DRAWS = 200
BESIDE = 3.0  # gap of frequencies over that of growth below which two modes are taken for locked with each other
CROSSING = 0.5  # share of the draws that must cross in the bracket, or half a step beside it

Followed = Mapping[int, Seen]
"""A track: its objects by point, on its branch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """An edge between two points: its draws are empty where nothing but the bracket is known."""

    between: tuple[int, int]
    kind: Kind
    tracks: tuple[int, ...]
    onset: bool
    draws: Floats
    widening: float = 1.0


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two exponents that meet, the second on the branch of the first, with their covariance; `own` of a mode alone."""

    a: complex
    b: complex
    covariance: Floats  # real parts of both, imaginary parts of both (4, 4)


def crossings(tracks: Sequence[Followed], x: Floats, seed: int = 0) -> tuple[Crossing, ...]:
    """The edges of all tracks, ascending; `x` are the values of the points."""
    generator = np.random.default_rng(seed)
    made: dict[tuple[object, ...], Crossing] = {}
    for number, track in enumerate(tracks):
        places = sorted(track)
        for first, last in pairwise(places):
            grows = track[last].growth > 0.0
            if (track[first].growth > 0.0) == grows:
                continue
            kind, partner = _kind(tracks, number, first, last)
            if kind == "sum" and _unstable(tracks, (number, partner), first) == _unstable(
                tracks, (number, partner), last
            ):
                continue  # two that are locked with each other have changed their names
            of = tuple(sorted({number, partner})) if kind == "sum" else (number,)
            key = (first, last, kind, of)
            if key not in made:
                made[key] = _crossing(tracks, number, partner, kind, (first, last), x, generator, grows, of)
    return tuple(
        sorted(made.values(), key=lambda edge: float(np.median(edge.draws)) if len(edge.draws) else x[edge.between[0]])
    )


def _unstable(tracks: Sequence[Followed], of: tuple[int, ...], point: int) -> bool:
    return any(point in tracks[k] and tracks[k][point].growth > 0.0 for k in of)


def _kind(tracks: Sequence[Followed], number: int, first: int, last: int) -> tuple[Kind, int]:
    """The kind of an edge between two points, and the track that a track locks with; itself where none."""
    track = tracks[number]
    ends = track[first], track[last]
    if any(len(own.modes) > 1 for own in ends) or ends[0].real != ends[1].real:
        return "lock", number
    point = first if track[first].growth > 0.0 else last
    lam, best = track[point].exponent, (np.inf, number)
    for other, beside in enumerate(tracks):
        if other != number and point in beside and len(beside[point].modes) == 1:
            gap = lam - nearest(lam, beside[point])[0]
            if abs(gap.imag) < BESIDE * abs(gap.real):
                best = min(best, (abs(gap.imag), other))
    return ("single" if best[1] == number else "sum"), best[1]


def nearest(lam: complex, other: Seen) -> tuple[complex, int]:
    """The exponent of `other` on the branch, or the mirror image, nearest to λ, and the sign of its imaginary part."""
    turn, mean, found = other.fundamental, other.exponent, []
    for sign in (1, -1):
        imag = sign * mean.imag
        found.append((complex(mean.real, imag + turn * np.rint((lam.imag - imag) / turn)), sign))
    return min(found, key=lambda one: abs(one[0].imag - lam.imag))


def _crossing(
    tracks: Sequence[Followed],
    number: int,
    partner: int,
    kind: Kind,
    between: tuple[int, int],
    x: Floats,
    generator: np.random.Generator,
    onset: bool,
    of: tuple[int, ...],
) -> Crossing:
    """The edge of a track in a bracket, with its draws."""
    pairs = _window(tracks, number, partner, kind, between, x)
    told = Crossing(between=between, kind=kind, tracks=of, onset=onset, draws=np.empty(0))
    if len(pairs) < FEWEST or any(point not in pairs for point in between):
        return told
    at = x[list(pairs)]
    middle, half = 0.5 * (at.max() + at.min()), 0.5 * np.ptp(at)
    values, covariance = zip(*(_functions(pair, kind) for pair in pairs.values()), strict=True)
    process = smooth((at - middle) / half, np.array(values).T, np.array(covariance))
    low, high = x[list(between)]
    reach = np.clip([low - 0.5 * (high - low), high + 0.5 * (high - low)], at.min(), at.max())
    nodes = 0.5 * (reach.sum() + np.ptp(reach) * chebpts1(NODES))
    drawn = process.draws((nodes - middle) / half, DRAWS, generator)
    places = np.linspace(-1.0, 1.0, PLACES)
    between_nodes = chebvander(places, NODES - 1) @ np.linalg.inv(chebvander(chebpts1(NODES), NODES - 1))
    growth = _growth(drawn @ between_nodes.T, kind)
    found = _roots(0.5 * (reach.sum() + np.ptp(reach) * places), growth if onset else -growth)
    if len(found) < CROSSING * DRAWS:
        return told
    return Crossing(between=between, kind=kind, tracks=of, onset=onset, draws=found, widening=process.misfit())


def _growth(functions: Floats, kind: Kind) -> Floats:
    """Re(μ + √q), the larger of both (draws, places)."""
    if kind == "single":
        return functions[:, 0]
    q = functions[:, 1] + (1j * functions[:, 2] if kind == "sum" else 0j)
    return functions[:, 0] + np.sqrt(q).real


def _roots(places: Floats, growth: Floats) -> Floats:
    """The first place at which each curve rises through zero, of those that do (curves,)."""
    rises = (growth[:, :-1] <= 0.0) & (growth[:, 1:] > 0.0)
    rows = np.flatnonzero(rises.any(axis=1))
    first = rises[rows].argmax(axis=1)
    low, high = growth[rows, first], growth[rows, first + 1]
    return places[first] + (places[first + 1] - places[first]) * low / (low - high)


def _functions(pair: _Pair, kind: Kind) -> tuple[Floats, Floats]:
    """Invariants of two exponents that meet and their covariance: of a lock μ and q, both real; of a sum, Im q too."""
    values, slopes = invariants(pair.a, pair.b)
    used = {"single": 1, "lock": 2, "sum": 3}[kind]
    halves = np.array([[0.5, -0.5, 0.0, 0.0], [0.0, 0.0, 0.5, -0.5]])
    spread = float(np.trace(halves @ pair.covariance @ halves.T))
    covariance = slopes @ pair.covariance @ slopes.T + np.diag([0.0, 2.0, 2.0]) * spread**2
    return values[:used], covariance[:used, :used]


def _window(
    tracks: Sequence[Followed], number: int, partner: int, kind: Kind, between: tuple[int, int], x: Floats
) -> dict[int, _Pair]:
    """The points about a bracket that the edge is found from: up to where one of the two meets something else."""
    track = tracks[number]
    half = _half_turns(track, between) if kind == "lock" else 0
    places = [point for point in sorted(track) if kind != "sum" or point in tracks[partner]]
    pairs: dict[int, _Pair] = {}
    for step in (-1, 1):
        for point in places[::step]:
            if (point - between[step > 0]) * step < 0 or track[point].weak:
                continue
            pair = _pair(tracks, number, partner, kind, point, half, x)
            if pair is None or (point not in between and _meets(tracks, number, partner, kind, point, pair)):
                break
            pairs[point] = pair
    middle = float(x[list(between)].mean())
    kept = sorted(sorted(pairs, key=lambda point: abs(x[point] - middle))[:MOST])
    return {point: pairs[point] for point in kept}


def _half_turns(track: Followed, between: tuple[int, int]) -> int:
    """2 Im λ/ω of the real multipliers in a bracket, on the branch of the track."""
    locked = next(track[point] for point in between if track[point].real)
    return int(np.rint(2.0 * locked.exponent.imag / locked.fundamental))


def _pair(
    tracks: Sequence[Followed], number: int, partner: int, kind: Kind, point: int, half: int, x: Floats
) -> _Pair | None:
    """The two exponents at a point; None where they are of another kind there."""
    own = tracks[number][point]
    if kind == "lock":
        return _locked(tracks[number], point, half, x)
    lam, covariance = own.exponents, own.covariance
    if kind == "single":
        one = np.zeros((4, 4))
        one[:2, :2] = covariance[0, 0]
        return None if len(lam) > 1 else _Pair(lam[0], lam[0], one)
    beside = tracks[partner][point]
    if len(lam) + len(beside.modes) > 2 or beside.weak:
        return None
    other, _ = nearest(complex(lam[0]), beside)
    joint = np.zeros((4, 4))
    joint[::2, ::2], joint[1::2, 1::2] = covariance, beside.covariance
    return _Pair(lam[0], other, joint)


def _locked(track: Followed, point: int, half: int, x: Floats) -> _Pair | None:
    """A couple, or a pair and its mirror image about half turns of the period; None where it is real elsewhere."""
    own = track[point]
    lam = own.exponents - 0.5j * half * own.fundamental
    if own.real and np.abs(lam.imag).max() > REAL * own.fundamental:
        return None
    if own.real:
        return _couple(track, point, x)
    both = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    return _Pair(lam[0], lam[0].conjugate(), both @ own.covariance @ both.T)


def _couple(track: Followed, point: int, x: Floats) -> _Pair | None:
    """Two real multipliers, the partner of the one that grows from the mean of both where it is below the noise."""
    own = track[point]
    best = int(own.exponents.real.argmax())
    known, variance = float(own.exponents[best].real), float(own.covariance[best, best])
    pairs = [other for other in sorted(track) if not track[other].real]
    means = np.array([track[other].exponent.real for other in pairs])
    doubt = (
        4.0 * float(np.var(means) + np.mean([track[other].covariance[0, 0] for other in pairs])) if pairs else np.inf
    )
    if len(own.modes) > 1 and own.covariance[1 - best, 1 - best] <= doubt:
        return _Pair(own.exponents[0], own.exponents[1], own.covariance)
    if len(pairs) < 2:
        return None
    spread = np.zeros((4, 4))
    spread[:2, :2] = variance * np.array([[1.0, -1.0], [-1.0, 1.0]])
    spread[1, 1] += doubt
    return _Pair(known, 2.0 * float(np.interp(x[point], x[pairs], means)) - known, spread)


def _meets(tracks: Sequence[Followed], number: int, partner: int, kind: Kind, point: int, pair: _Pair) -> bool:
    """True where another track, or its own mirror image, is nearer to the mode than what it meets in the edge."""
    own = tracks[number][point]
    if own.real or kind != "lock":
        return False
    lam = own.exponent
    turn = own.fundamental
    away = abs(pair.a - pair.b)
    mirror = abs(2.0 * lam.imag - turn * np.rint(2.0 * lam.imag / turn))
    if mirror < 0.999 * away:
        return True
    others = [track[point] for k, track in enumerate(tracks) if k not in (number, partner) and point in track]
    return any(abs(lam - nearest(lam, other)[0]) < away for other in others)
