"""Two sets of modes against one another: pairs by exponents and shapes, differences with their joint deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, positive
from floquid.comparison._sides import Side, check_periods, matched, scaled, shared_channels, side_of
from floquid.comparison._types import ComparedPoint, Comparison, Pair
from floquid.core import PeriodicModel
from floquid.fit import directions, unit_scale
from floquid.surveys import (
    BRANCHES,
    Point,
    Seen,
    assigned,
    branch_of,
    invariants,
    objects_of,
    similarities,
    turn_between,
)

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


OF = "compare"
STEADY = 1e-4  # share by which periods may differ unsaid: λ + imω then moves by less than most deviations


def compare(a: Any, b: Any, *, scale: Mapping[str, float] | None = None) -> Comparison:
    r"""Pair the modes of two results, or of a result and a known system, and say how far they differ.

    .. math:: \min \sum \min\Big(1, \frac{|\lambda_a - \lambda_b|}{\sigma \oplus 0.02\,\omega}\Big) +
              1 - \mathrm{mac}_{ab}

    over all pairs at once, λ modulo iω and mac at the best shift by harmonics; no pair costs more than 1.5. Records
    start at any instant: phase zero of b is moved to where it makes all pairs cheapest, for all modes of a point
    alike. Jointly χ² = d' (Σ_a + Σ_b)⁻¹ d over all differences d of exponents. Imaginary parts of real multipliers
    are no data; of a pair beside two real multipliers, into which a lock turns it, the mean and the squared half-
    difference are compared, which have no kink there. Where two channels at least are not common to both, exponents
    alone make the pairs.

    Points of surveys are paired with the nearest one, within 2 %. An example system without a speed turns with the
    period of the other side. Deviations of both sides must be independent: of results of one record they are not.

    Parameters
    ----------
    a, b
        What `identify` or `survey` found, modes, a known system as `survey` takes it, a function of the operating point
        beside a survey, or one of these in a file: a result, a survey, A(t) with C(t), a folder of `.lin` files, or
        "systems:jeffcott,support_y=2.01".
    scale
        What takes channels of b to the unit of a, by name.

    Raises
    ------
    InputError
        A side is none of these, the periods or the operating points differ, or units do.
    """
    by = MappingProxyType({name: positive(value, f"scale[{name!r}]", OF) for name, value in (scale or {}).items()})
    sides = side_of(a, "a", OF), side_of(b, "b", OF)
    points, over = matched(*sides, OF)
    held = [pair for pair in points if pair[0].model is not None and pair[1].model is not None]
    if not held:
        reason = next((point.reason for pair in points for point in pair if point.reason), "no point has modes")
        raise input_error("a", OF, "have modes to compare", f"has none: {reason.rstrip('.')}")
    known = {channel.name for pair in held for channel in (pair[1].model.channels if pair[1].model else ())}
    for name in by:
        if name not in known:
            raise input_error("scale", OF, "name channels of b", f"has {name!r}", f"There are: {', '.join(known)}.")
    work = _Work()
    for number, (one, other) in enumerate(held):
        _point(work, number, one, other, by, over)
    return _joined(work, sides, held, over)


@dataclass(slots=True)
class _Work:
    """Pairs, missing modes and χ², gathered point by point."""

    points: list[ComparedPoint] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)
    missing: tuple[list[tuple[int, int]], list[tuple[int, int]]] = field(default_factory=lambda: ([], []))
    chi2: float = 0.0
    dof: int = 0
    shapeless: int = 0  # points where modes are paired without shapes
    periods: float = 0.0  # the largest relative difference
    values: float = 0.0  # the same of the operating point


def set_against(
    one: Point, other: Point, scale: Mapping[str, float] = MappingProxyType({}), of: str = OF
) -> tuple[list[Seen], list[Seen], Paired]:
    """The objects of two points, and their pairs."""
    check_periods(one, other, of)
    assert one.model is not None
    assert other.model is not None
    common = shared_channels(one.model, other.model, scale, of)
    moved = Point(values=other.values, model=scaled(other.model, scale), weak=other.weak, passed=other.passed)
    shapes = len(common) >= min(2, len(one.model.channels), len(other.model.channels)) > 0
    if shapes:
        first, second = objects_of([one, moved])
    else:
        (first,), (second,) = objects_of([one]), objects_of([moved])
    return first, second, paired(first, second, shapes=shapes)


def joint_parts(pairs: Sequence[Match], first: PeriodicModel, second: PeriodicModel) -> tuple[Floats, Floats]:
    """The differences of `pairs` of two models and their covariance, by both sides: (parts,), (parts, parts)."""
    parts = [parts_of(pair) for pair in pairs]
    if not parts:
        return np.zeros(0), np.zeros((0, 0))
    covariance = np.diag(np.concatenate([own.beyond for own in parts]))
    for model, slopes in (
        (first, [in_model(own.by_first, at.first.modes, first.order) for own, at in zip(parts, pairs, strict=True)]),
        (
            second,
            [
                in_model(own.by_second, at.second.modes, second.order, mirrored=at.mirrored)
                for own, at in zip(parts, pairs, strict=True)
            ],
        ),
    ):
        if model.covariance is not None:
            by = np.concatenate(slopes)
            covariance = covariance + by @ model.covariance @ by.T
    return np.concatenate([own.values for own in parts]), covariance


def _point(work: _Work, number: int, one: Point, other: Point, scale: Mapping[str, float], over: str | None) -> None:
    """Add what two points have in common, and what one of them alone has."""
    first, second, found = set_against(one, other, scale)
    pairs = found.matches
    assert one.model is not None
    assert other.model is not None
    fails = one.reason is not None or other.reason is not None
    counted = [pair for pair in pairs if not (fails or pair.first.weak or pair.second.weak)]
    for pair in pairs:
        work.pairs += _rows(number, pair, one.model, other.model, counted=pair in counted)
    lefts = [parts_of(pair).left for pair in pairs]
    for side, objects, places in ((1, first, [pair.a for pair in pairs]), (0, second, [pair.b for pair in pairs])):
        lost = [mode for place, thing in enumerate(objects) if place not in places for mode in thing.modes]
        lost += [mode for left in lefts for mode in left[1 - side]]
        work.missing[side].extend((number, mode) for mode in sorted(lost))
    values, covariance = joint_parts(counted, one.model, other.model)
    if covariance.any():
        chi2, dof = chi_square(values, covariance)
        work.chi2, work.dof = work.chi2 + chi2, work.dof + dof
    work.shapeless += bool(np.isnan(found.macs).any())
    work.periods = max(work.periods, abs(one.model.period / other.model.period - 1.0))
    if over is not None:
        values = one.values[over], other.values[over]
        work.values = max(work.values, abs(values[0] - values[1]) / max(*np.abs(values), 1e-300))
    work.points.append(
        ComparedPoint(
            value=None if over is None else one.values[over],
            model_a=one.model, model_b=other.model, macs=found.macs, turn=found.turn,
            modes_a=tuple(thing.modes for thing in first), modes_b=tuple(thing.modes for thing in second),
        )
    )  # fmt: skip


def _rows(number: int, pair: Match, first: PeriodicModel, second: PeriodicModel, *, counted: bool) -> list[Pair]:
    """The rows of a pair: one, or one of each real multiplier of a lock."""
    parts = parts_of(pair)
    values, covariance = joint_parts([pair], first, second)
    lam, mu = (dict(zip(own.modes, own.exponents, strict=True)) for own in (pair.first, pair.second))
    each = pair.first.real and pair.second.real
    noise = float(shape_noise(pair.first) + shape_noise(pair.second))
    rows = []
    for row, (a, b) in enumerate(parts.modes):
        kept = [row] if each else list(range(len(values)))
        own = covariance[np.ix_(kept, kept)]
        std = np.sqrt(np.maximum(np.diag(own), 0.0))
        whole = len(kept) == 2 and not (pair.first.real or pair.second.real)
        rows.append(
            Pair(
                point=number, a=a, b=b, exponent_a=complex(lam[a]), exponent_b=complex(mu[b]),
                difference=complex(values[kept[0]], values[1] if whole else np.nan),
                std=complex(std[0], std[1] if whole else np.nan),
                z=float(np.sqrt(chi_square(values[kept], own)[0])) if own.any() else float("nan"),
                mac=pair.mac, mac_noise=noise, counted=counted,
            )
        )  # fmt: skip
    return rows


def _joined(work: _Work, sides: tuple[Side, Side], held: Sequence[tuple[Point, Point]], over: str | None) -> Comparison:
    """The comparison of all points, with what a reader must know."""
    from scipy.stats import chi2 as law

    warnings = [f"{own.label}: the model fails. {own_reason}" for own, own_reason in _failures(sides, held)]
    uncounted = sum(not pair.counted for pair in work.pairs)
    if uncounted:
        warnings.append(f"{uncounted} of {len(work.pairs)} pairs are weak, or of a model that fails: not in χ².")
    if work.shapeless:
        warnings.append("Fewer than two channels are common to both: modes are paired by exponents alone, modulo iω.")
    if work.values > STEADY:
        warnings.append(f"Points are paired whose {over} differs by up to {100.0 * work.values:.2g} %.")
    if work.periods > STEADY:
        warnings.append(f"The periods differ by {100.0 * work.periods:.2g} %: so do the lines λ + imω of each mode.")
    independent = not any({*one.marks} & {*other.marks} for one, other in held)
    counts = work.dof > 0 and independent
    return Comparison(
        a=sides[0].label,
        b=sides[1].label,
        over=over,
        points=tuple(work.points),
        pairs=tuple(work.pairs),
        missing_in_a=tuple(work.missing[0]),
        missing_in_b=tuple(work.missing[1]),
        chi2=work.chi2 if counts else None,
        dof=work.dof if counts else 0,
        p=float(law.sf(work.chi2, work.dof)) if counts else None,
        independent=independent,
        warnings=tuple(warnings),
    )


def _failures(sides: tuple[Side, Side], held: Sequence[tuple[Point, Point]]) -> list[tuple[Side, str]]:
    """The sides with a result that fails, and the reason of the first."""
    found = []
    for place, side in enumerate(sides):
        reasons = [pair[place].reason for pair in held if pair[place].reason is not None]
        if reasons and reasons[0] is not None:
            found.append((side, reasons[0]))
    return found
