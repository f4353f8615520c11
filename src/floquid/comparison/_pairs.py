"""Modes of two points paired by exponents and shapes together, and their differences with joint covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid.fit import directions, unit_scale
from floquid.surveys import BRANCHES, Seen, assigned, branch_of, invariants, similarities, turn_between

NEAR = 0.02  # of ω: a difference of exponents that costs as much as shapes at right angles, beside the deviations
DEAREST = 1.5  # cost above which two modes are no pair
SHAPELESS = 1.0 - 1e-9  # the same without shapes: the limit of the part of the exponents


@dataclass(frozen=True, slots=True)
class Match:
    """Two objects that are one mode, the second on the branch of the first."""

    a: int
    b: int
    first: Seen
    second: Seen
    mirrored: bool
    mac: float  # NaN without shapes


@dataclass(frozen=True, slots=True)
class Parts:
    """Differences of paired objects, real numbers: how they follow from the exponents of both sides."""

    values: Floats  # (parts,)
    by_first: Floats  # slopes by real, then imaginary parts of the object's exponents (parts, 2 modes)
    by_second: Floats
    beyond: Floats  # variance of second order (parts,)
    modes: tuple[tuple[int, int], ...]  # numbers of the modes, a row of a table each
    left: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())  # modes of either object that the other has not


@dataclass(frozen=True, slots=True)
class Paired:
    """Two sets of objects against one another."""

    matches: tuple[Match, ...]
    macs: Floats  # similarity of each with each (first, second); NaN without shapes
    turn: float = 0.0  # by how much of a period phase zero of the second is the later one


def paired(first: Sequence[Seen], second: Sequence[Seen], *, shapes: bool) -> Paired:
    """The pairs of two sets of objects, the second with phase zero where the first has it.

    Cost = min(1, |Δλ| / (deviations ⊕ 0.02 ω)) + 1 - mac; all are assigned at once, none dearer than 1.5.
    """
    angle = turn_between(first, second, [one.exponent for one in first], NEAR) if shapes else 0.0
    second = [other.turned(angle) for other in second]
    costs = np.full((len(first), len(second)), 1e6)
    macs = np.full(costs.shape, np.nan)
    branches = np.zeros((*costs.shape, 2), int)
    for i, one in enumerate(first):
        for j, other in enumerate(second):
            if shapes:
                found = similarities(one, other)
                best, away = branch_of(found, other, one.exponent)
                macs[i, j], branches[i, j] = found[best], BRANCHES[best]
            else:
                branches[i, j], away = _nearest(one, other)
            limit = np.sqrt(_variance(one) + _variance(other) + (NEAR * one.fundamental) ** 2)
            if _comparable(one, other, away):
                costs[i, j] = min(1.0, abs(away) / limit) + (1.0 - macs[i, j] if shapes else 0.0)
    pairs = []
    for i, j in enumerate(assigned(costs, DEAREST if shapes else SHAPELESS).tolist() if costs.size else ()):
        if j >= 0:
            shift, mirrored = int(branches[i, j, 0]), bool(branches[i, j, 1])
            pairs.append(Match(i, j, first[i], second[j].on(shift, mirrored), mirrored, float(macs[i, j])))
    return Paired(tuple(pairs), macs, turn=-angle / (2.0 * np.pi) % 1.0)


def _nearest(one: Seen, other: Seen) -> tuple[tuple[int, bool], complex]:
    """The branch of an object whose exponent is nearest to that of another, and how far off it is."""
    found = []
    for mirrored in (False, True):
        lam = other.exponent.conjugate() if mirrored else other.exponent
        shift = int(np.rint((one.exponent.imag - lam.imag) / one.fundamental))
        found.append(((shift, mirrored), lam + 1j * shift * one.fundamental - one.exponent))
    return min(found, key=lambda choice: abs(choice[1]))


def _variance(thing: Seen) -> float:
    """The mean variance of the exponents of an object."""
    return float(np.trace(thing.covariance)) / len(thing.modes)


def _comparable(one: Seen, other: Seen, away: complex) -> bool:
    """False of a real multiplier beside a pair, and of multipliers of different sign."""
    if one.real and other.real:
        return abs(away.imag) < 0.25 * one.fundamental
    return len(one.modes) + len(other.modes) == 3 or not (one.real or other.real)


def parts_of(match: Match) -> Parts:
    """The differences of a pair, first less second, that are data.

    Of two pairs they are both parts of Δλ; of real multipliers real parts alone; of a pair and two real multipliers the
    mean and the squared half-difference, regular where one turns into the other.
    """
    one, other = match.first, match.second
    lam, mu = one.exponents, other.exponents
    if one.real and other.real:
        places = _neighbours(lam.real, mu.real)
        rows = np.arange(len(places))
        by_first, by_second = np.zeros((len(places), 2 * len(lam))), np.zeros((len(places), 2 * len(mu)))
        at, beside = np.array(places).T
        by_first[rows, at], by_second[rows, beside] = 1.0, 1.0
        modes = tuple((one.modes[i], other.modes[j]) for i, j in places)
        left = (
            tuple(mode for k, mode in enumerate(one.modes) if k not in at),
            tuple(mode for k, mode in enumerate(other.modes) if k not in beside),
        )
        return Parts((lam[at] - mu[beside]).real, by_first, by_second, np.zeros(len(places)), modes, left)
    modes = ((one.modes[int(lam.real.argmax())], other.modes[int(mu.real.argmax())]),)
    if not (one.real or other.real):
        difference = complex(lam[0] - mu[0])
        return Parts(np.array([difference.real, difference.imag]), np.eye(2), np.eye(2), np.zeros(2), modes)
    locked = one if one.real else other
    half_turns = int(np.rint(2.0 * locked.exponent.imag / locked.fundamental))
    (here, by_first, first), (there, by_second, second) = (_about(thing, half_turns) for thing in (one, other))
    return Parts(here - there, by_first, by_second, np.array([0.0, first + second]), modes)


def _neighbours(first: Floats, second: Floats) -> list[tuple[int, int]]:
    """Pairs of numbers that are nearest to each other, as many as the fewer."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.abs(np.subtract.outer(first, second)))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _about(thing: Seen, half_turns: int) -> tuple[Floats, Floats, float]:
    """Mean and squared half-difference of an object about an axis, their slopes, and a variance of second order."""
    if len(thing.modes) > 1:
        (a, b), turned = thing.exponents.tolist(), np.eye(4)
    else:
        a = complex(thing.exponents[0])
        b = a.conjugate() + 1j * half_turns * thing.fundamental
        turned = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    values, slopes = invariants(a, b)
    halves = np.array([[0.5, -0.5, 0.0, 0.0], [0.0, 0.0, 0.5, -0.5]]) @ turned
    spread = float(np.trace(halves @ thing.covariance @ halves.T))
    return values[:2], slopes[:2] @ turned, 2.0 * spread**2


def in_model(by: Floats, modes: Sequence[int], order: int, *, mirrored: bool = False) -> Floats:
    """Slopes by the exponents of an object as slopes by those of its model (parts, 2 order)."""
    out = np.zeros((len(by), 2 * order))
    count, kept = len(modes), np.array(modes)
    out[:, kept], out[:, kept + order] = by[:, :count], by[:, count:] * (-1.0 if mirrored else 1.0)
    return out


def shape_noise(thing: Seen) -> float:
    """The share of a shape's energy that is noise: 1 - mac that it makes, to first order."""
    variance = thing.deviations.real**2 + thing.deviations.imag**2
    count = np.count_nonzero(variance) / len(thing.modes)
    energy = float(np.sum(np.abs(thing.shapes) ** 2))
    return float(np.sum(variance)) / energy * (1.0 - 1.0 / count) if count > 1.0 and energy > 0.0 else 0.0


def chi_square(values: Floats, covariance: Floats) -> tuple[float, int]:
    """D' C⁻¹ d over the directions that have a variance, and their number."""
    scale = unit_scale(covariance)
    sizes, vectors = directions(covariance, 1e-12, scale=scale)  # parts that are one number by rounding
    along = vectors.T @ (values / scale)
    return float(np.sum(along**2 / sizes)), len(sizes)
