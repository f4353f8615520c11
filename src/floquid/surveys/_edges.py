"""Edges of instability between points: where the exponents of a lock, or of one mode, cross the imaginary axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander

from floquid._arrays import Floats
from floquid.surveys._objects import REAL, Seen, invariants
from floquid.surveys._wiener import smooth

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
    """Two real multipliers, the partner of the one that grows from the mean of both where it is below the noise.

    That mean is smooth over x: of the pairs of the track it is the real part. The more certain of both is taken.
    """
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
