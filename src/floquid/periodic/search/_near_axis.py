r"""Pairs near an axis in a fit: two exponents by their mean and squared half-difference, of either kind.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

Near an axis, 0 or half the fundamental, a pair of conjugates and two real multipliers are one model, and σ and q are
determined where neither kind is: at the edge of a parametric resonance q goes through zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats, Integers
from floquid.core import read_axis
from floquid.fit import AT_REST, DEVIATIONS, FARTHEST, RARE, STEPS, chi2_limit
from floquid.periodic.least_squares import EVEN, ODD, PLAIN, ModeParameters, Solution, linearise
from floquid.periodic.search._objective import Point, SearchResult, carried, placed
from floquid.periodic.search._tests import untold


@dataclass(frozen=True, slots=True)
class Trial:
    """The fit with one pair near an axis in place of some modes."""

    places: tuple[int, ...]  # those modes among the entries
    entries: ModeParameters
    bands: Integers  # bands to report (entries, 2)


def with_axis_pairs(point: Point, bands: Integers) -> tuple[Point, Integers]:
    """The fit with each pair near an axis, and each two real multipliers of one sign, by their mean and difference.

    Three and more states on one axis become one such pair where noise explains what they do beyond. A single real
    multiplier is given a second one where noise does not explain what that takes out of the cost. With the bands to
    report (entries, 2).
    """
    # Where the speed wanders, frequencies run in time and harmonics in angle: a pair and its conjugate share no lines.
    for axis in () if point.wanders else (0, 1):
        tried: set[tuple[complex, ...]] = set()
        while True:
            for trial in _trials(point.solution, bands, axis):
                key = tuple(point.entries.exponents[list(trial.places)].tolist())
                if key not in tried and any((exponent,) not in tried for exponent in key):
                    break
            else:
                break
            tried.add(key)
            entries, trial_fit = point.entries, _solved(point, trial.entries)
            states = sum(1 if entries.real[place] else 2 for place in trial.places)
            # Where the two of a pair run away they are not told apart: one of them may do.
            fewer = _single(point.with_entries(trial.entries)) if trial_fit is None and states == 2 else None
            if fewer is not None and fewer.value < point.value:
                point, bands = fewer, trial.bands[:-1]
            if trial_fit is None:
                continue
            if states == 1:
                if _needed(trial_fit, point) and len(trial_fit.entries.exponents) - 2 not in untold(trial_fit):
                    wide = _solved(trial_fit, _as_wide(trial_fit.entries))
                    point, bands = trial_fit if wide is None else wide, trial.bands
                continue
            if states > 2 and _needed(point, trial_fit):
                # Each as two with lines of their own, all of these would share their lines: they stay as told apart.
                tried |= {(exponent,) for exponent in key}
                continue
            fewer = _single(trial_fit)
            # Noise may hide the second of two, but one that is worse than both is none.
            fewer = None if fewer is not None and states == 2 and fewer.value > point.value else fewer
            if fewer is None and trial_fit.value > point.value and _hides(trial_fit, point, trial):
                continue
            point, bands = (trial_fit, trial.bands) if fewer is None else (fewer, trial.bands[:-1])
    return point, bands


def _hides(with_block: Point, point: Point, trial: Trial) -> bool:
    """True where two functions of many harmonics each take what tells another mode of its decay."""
    before = np.setdiff1d(untold(point), trial.places)
    after = np.setdiff1d(untold(with_block), len(with_block.entries.exponents) - np.array([1, 2]))
    return len(after) > len(before)


def _square_std(solution: Solution) -> float:
    """The deviation of q of the last pair near an axis [1/s²]."""
    place = len(solution.gradient) - 1 - int(solution.entries.free_period)
    return float(np.sqrt(max(solution.covariance()[place, place], 0.0)))


def _solved(point: Point, trial: ModeParameters) -> Point | None:
    """The fit near other entries; None where one of them runs away."""
    with suppress(np.linalg.LinAlgError):
        fitted = point.with_entries(trial).settled(rest=AT_REST, steps=STEPS)
        away = np.abs(fitted.entries.exponents - trial.exponents) * point.period
        return fitted if away.max(initial=0.0) < FARTHEST else None
    return None


def _needed(wider: Point, fewer: Point) -> bool:
    """True where noise does not explain what a fit with more numbers takes out of the misfit of one with fewer."""
    # Of two with as many numbers, the one of the lesser J.
    more = len(wider.solution.gradient) - len(fewer.solution.gradient)
    more += wider.price.rows * (_coefficients(wider.entries) - _coefficients(fewer.entries))
    return wider.value < fewer.value if more <= 0 else fewer.misfit - wider.misfit > chi2_limit(more, RARE)


def _coefficients(entries: ModeParameters) -> int:
    """Real coefficients of one channel."""
    sines = entries.sines()
    return len(sines) + int(sines.sum())


def _trials(solution: Solution, bands: Integers, axis: int) -> Iterator[Trial]:
    """Candidates for one pair near an axis: all modes there together, each pair of conjugates, two real multipliers."""
    # Of a single real multiplier, it and a second one.
    entries, omega = solution.entries, solution.entries.fundamental
    halves = np.rint(2.0 * entries.exponents.imag / omega + 2.0 * entries.offsets).astype(np.int64)
    members = [place for place in _near(solution) if halves[place] % 2 == axis]
    reals = [place for place in members if entries.real[place]]
    several = [group for group in _sharing(entries, members) if 2 * len(group) - int(entries.real[group].sum()) > 2]
    single_pairs = [[place] for place in members if place not in reals]
    single_pairs += [group for group in _sharing(entries, reals) if len(group) <= 2]
    taken = np.flatnonzero(entries.even & (halves % 2 == axis)).tolist()
    # Two such pairs on the same lines would not be told apart.
    single_pairs = [group for group in single_pairs if not any(_share(entries, group, [place]) for place in taken)]
    for places in several + single_pairs:
        decays = entries.exponents[places].real
        half, mean, square = int(halves[places[0]]), float(decays.mean()), 0.25 * float(np.ptp(decays)) ** 2
        if len(places) == 1 and not entries.real[places[0]]:
            square = -((float(entries.exponents[places[0]].imag) - 0.5 * half * omega) ** 2)
        wider, kept = _coupled(entries, bands, places, half, mean, square)
        single = len(places) == 1 and bool(entries.real[places[0]])
        yield Trial(tuple(places), _narrow(wider) if single else wider, kept)


def _sharing(entries: ModeParameters, members: list[int]) -> list[list[int]]:
    """Modes near one axis in groups that have lines in common: one pair stands for none on lines of their own."""
    groups: list[list[int]] = []
    for place in members:
        joined = [group for group in groups if _share(entries, group, [place])]
        groups = [group for group in groups if group not in joined]
        groups.append(sorted([place, *(member for group in joined for member in group)]))
    return groups


def _share(entries: ModeParameters, some: list[int], others: list[int]) -> bool:
    """True where modes near one axis have lines in common, as far as their bands tell."""
    (low, high), (least, most) = _turns(entries, entries.bands, some), _turns(entries, entries.bands, others)
    return least <= high and low <= most


def _near(solution: Solution) -> list[int]:
    """The places of real multipliers, and of pairs of conjugates that share their lines."""
    entries, omega = solution.entries, solution.entries.fundamental
    std, first = np.sqrt(np.maximum(np.diag(solution.covariance()), 0.0)), int(entries.leading.sum())
    std = np.where(std < omega, std, 0.0)  # a whole fundamental stands for nothing that is known
    turns, places = np.flatnonzero(~entries.fixed & ~entries.real), []
    for entry in np.flatnonzero(~entries.fixed & (entries.factors == PLAIN)):
        value = entries.exponents[entry]
        off = value.imag - 0.5 * omega * round(2.0 * value.imag / omega)
        deviation = 0.0 if entries.real[entry] else std[first + int(np.searchsorted(turns, entry))]
        if entries.real[entry] or abs(off) < max(abs(value.real), deviation):
            places.append(int(entry))
    return places


def _coupled(
    entries: ModeParameters, bands: Integers, places: list[int], half: int, mean: float, square: float
) -> tuple[ModeParameters, Integers]:
    """The entries with an even and an odd one behind the others, as wide as those that they stand for."""
    rest = [k for k in range(len(entries.exponents)) if k not in places]
    low = -(half // 2) - half % 2
    ends = [(low, int(np.floor(_turns(entries, band, places)[1] - 0.5 * half))) for band in (entries.bands, bands)]
    coupled = entries.picked(rest)
    for factor in (EVEN, ODD):
        half_pair = ModeParameters.made(
            [mean], [ends[0]], entries.fundamental, real=True, offsets=0.5 * half, factor=factor
        )
        coupled = coupled.joined(replace(half_pair, squares=np.array([square])))
    return coupled, np.concatenate([bands[rest], [ends[1]] * 2])


def _turns(entries: ModeParameters, bands: Integers, places: list[int]) -> tuple[float, float]:
    """The fewest and the most turns a period that modes near an axis have, of either sign."""
    halves = np.rint(2.0 * entries.exponents.imag / entries.fundamental + 2.0 * entries.offsets)
    turns = bands[places] + 0.5 * halves[places][:, None]
    across = np.where(turns[:, 0] * turns[:, 1] > 0.0, np.abs(turns).min(axis=1), 0.0)
    return float(across.min()), float(np.abs(turns).max())


def _single(point: Point) -> Point | None:
    """The fit with one real multiplier for the last pair near an axis; None where noise does not explain the rest."""
    # Asked of the strongest harmonics, too: many weak ones would hide what a second multiplier does to the first.
    entries = point.entries
    if float(entries.all_squares[-1]) < -DEVIATIONS * _square_std(point.solution):
        return None  # surely a pair of conjugates
    determined = len(entries.exponents) - 2 not in untold(point)
    fewer = entries.picked(range(len(entries.exponents) - 1))
    last = np.arange(len(fewer.exponents)) == len(fewer.exponents) - 1
    factors, squares = np.where(last, PLAIN, fewer.factors), np.where(last, 0.0, fewer.all_squares)
    root = np.sqrt(max(float(entries.all_squares[-1]), 0.0))
    answers = []
    for move in (0.0,) if root == 0.0 else (root, -root):
        trial = replace(fewer, factors=factors, squares=squares, exponents=fewer.exponents + last * move)
        fitted = _solved(point, trial)
        if fitted is None or (determined and _needed(point, fitted)):
            continue
        narrow = _solved(point, _narrow(entries)) if determined else None
        if narrow is None or not _needed(narrow, fitted):
            answers.append(fitted)
    return min(answers, key=lambda answer: answer.value, default=None)


def _as_wide(entries: ModeParameters) -> ModeParameters:
    """The entries with the last, odd one as wide as the even one before it."""
    bands = entries.bands.copy()
    bands[-1] = bands[-2]
    return replace(entries, bands=bands)


def _narrow(entries: ModeParameters) -> ModeParameters:
    """The entries with the lowest turn alone in the last, odd one."""
    bands = entries.bands.copy()
    bands[-1, 1] = max(bands[-1, 0], -(int(entries.half_turns[-1]) // 2))
    return replace(entries, bands=bands)


def read_apart(result: SearchResult) -> SearchResult:
    """The result with ordinary modes at the exponents of its pairs near an axis, behind all other entries."""
    bands, entries = result.bands, result.solution.entries
    if not entries.even.any():
        return result
    covariance, omega = result.solution.covariance(), entries.fundamental
    leading, even = np.flatnonzero(entries.leading), np.flatnonzero(entries.even)
    first = len(leading) + int((~entries.fixed & ~entries.real).sum())
    rest = np.flatnonzero(~np.isin(entries.factors, (EVEN, ODD)))
    apart_entries, kept = replace(entries.picked(rest), squares=None), [*bands[rest]]
    as_read, apart, places = {}, {}, {int(entry): place for place, entry in enumerate(rest)}
    for number, place in enumerate(even):
        rows = [int(np.searchsorted(leading, place)), first + number]
        held, half = bool(entries.fixed[place]), int(entries.half_turns[place])
        pair = np.zeros((2, 2)) if held else covariance[np.ix_(rows, rows)]
        mean, square = float(entries.exponents[place].real), float(entries.all_squares[place])
        read = read_axis(mean, square, pair, half, omega)
        if read.apart is not None:
            apart[len(apart_entries.exponents)] = read.apart
        places[int(place)] = len(apart_entries.exponents)
        ends = np.stack([entries.bands[place], bands[place]])
        modes, ends = _ordinary(mean, read.square, half, omega, ends)
        if square > -DEVIATIONS * np.sqrt(pair[1, 1]):  # surely conjugates are two exponentials, and are fitted as such
            as_read |= {len(apart_entries.exponents) + k: complex(read.std[k]) for k in range(len(modes.exponents))}
        kept += [ends] * len(modes.exponents)
        apart_entries = apart_entries.joined(replace(modes, fixed=np.full(len(modes.exponents), held)))
    solution = linearise(result.blocks, apart_entries, carried(result.solution, apart_entries))
    solution = replace(solution, further=_moved(result.solution.further, entries, apart_entries, rest))
    kept = np.array(kept, np.int64).reshape(-1, 2)
    return replace(placed(result, places), solution=solution, bands=kept, as_read=as_read, apart=apart)


def _ordinary(mean: float, square: float, half: int, omega: float, bands: Integers) -> tuple[ModeParameters, Integers]:
    """Two real multipliers, or a pair, of a mean and squared half-difference, and the band to report."""
    root = np.sqrt(abs(square))
    if square > 0.0:
        values = [mean + root, mean - root]
        return ModeParameters.made(values, [bands[0]] * 2, omega, real=True, offsets=0.5 * half), bands[1]
    whole = np.stack([-half - bands[:, 1], bands[:, 1]], axis=1)
    return ModeParameters.made([mean + 1j * (root + 0.5 * half * omega)], [whole[0]], omega), whole[1]


def _moved(further: Floats | None, old: ModeParameters, new: ModeParameters, rest: Integers) -> Floats | None:
    """Additions to variances by the parameters of other entries: `rest` of the old ones are the first of the new."""
    if further is None:
        return None
    additions = np.zeros(len(new.ties()))
    decays, turns = [old.leading, new.leading], [~entries.fixed & ~entries.real for entries in (old, new)]
    for (of, to), first in ((decays, (0, 0)), (turns, [int(moved.sum()) for moved in decays])):
        kept = np.flatnonzero(to[: len(rest)])
        place = np.searchsorted(np.flatnonzero(of), rest[kept])
        additions[first[1] + np.arange(len(kept))] = further[first[0] + place]
    return additions
