"""The end of a search: bands a little wider than those reported, tones, names, and the residual."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Integers
from floquid.fit import AT_REST, DEVIATIONS, FARTHEST, SLOW, STEPS
from floquid.periodic.least_squares import Block, ModeParameters, Solution, noise_of, shapes, solve, weighted
from floquid.periodic.search._additions import residuals
from floquid.periodic.search._deviations import beyond_noise
from floquid.periodic.search._folds import folds
from floquid.periodic.search._moves import energies
from floquid.periodic.search._near_axis import read_apart, with_axis_pairs
from floquid.periodic.search._objective import Point, SearchResult
from floquid.periodic.search._peaks import strongest
from floquid.periodic.search._tests import Units, untold, wide_of
from floquid.search import LOOSE


def finished(
    point: Point, floor: float, *, most: int, choose: bool = True, search: bool, steady: bool, free_period: bool
) -> SearchResult:
    """The final fit of a structure with its deviations and its residual."""
    point = named(point)
    bands = point.entries.bands
    point = _padded(point, most) if choose else point.settled(rest=AT_REST, steps=STEPS)
    if free_period:
        # Not before: with modes still missing, the period would go to where it takes what is theirs.
        point = point.with_entries(replace(point.entries, free_period=True)).settled(rest=AT_REST, steps=STEPS)
    if search:
        point, bands = with_axis_pairs(point, bands)
        point = _without_steady(point, bands) if steady else point
        point = _without_undetermined(point)
    noise = noise_of(point.blocks, point.solution, floor)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in point.blocks)
    solution = solve(blocks, weighted(blocks, point.entries, point.solution.linear), hold=True)
    point = replace(point, blocks=blocks, solution=solution)
    beyond = beyond_noise(point, most, branches=search)
    if beyond.further.any():
        solution = replace(solution, further=beyond.further)
    rest = residuals(point)
    peak = strongest(blocks, rest, point.period)
    shares = [noise[block.rows, block.hit] / each.noise for block, each in zip(blocks, rest, strict=True)]
    misfit = float(np.max(np.concatenate(shares)))
    return SearchResult(blocks, solution, bands, peak, tuple(rest), misfit, beyond.clusters, unlike=beyond.unlike)


def _padded(point: Point, most: int) -> Point:
    """The fit with bands on the safe side: weak harmonics, and one beyond each end."""
    entries = point.entries
    if not (~entries.fixed).any():
        return point
    loose = replace(point, price=replace(point.price, harmonic_alarm=LOOSE))
    _, bands = Units(loose, wide_of(point, most)).stepwise(grow=True, shrink=False)
    wide = replace(entries, bands=bands)
    # Weak harmonics that are left out bend the exponents.
    wide = replace(wide, bands=_uncrowded(wide, wide.padded(1, most).bands))
    for _ in range(2):
        with suppress(np.linalg.LinAlgError):
            trial = point.with_entries(wide).settled(rest=AT_REST, steps=STEPS)
            away = np.abs(trial.entries.exponents - entries.exponents) * point.period > FARTHEST
            if not away.any() and trial.misfit <= point.misfit:
                return trial
            # A weak mode runs away where it has more harmonics than it can be told to have.
            wide = replace(wide, bands=np.where(away[:, None], entries.bands, wide.bands))
    return point


def _uncrowded(entries: ModeParameters, padded: Integers) -> Integers:
    """Padded bands without harmonics on the lines of a mode that folds next to it: the two are not determined there."""
    free, padded = np.flatnonzero(~entries.fixed & ~entries.real), padded.copy()
    taken: dict[int, set[int]] = {int(entry): set() for entry in free}
    for fold in folds(entries):
        for entry, (low, high) in (
            (fold.first, fold.of_first(entries.bands[fold.second])),
            (fold.second, fold.of_second(entries.bands[fold.first])),
        ):
            taken[entry] |= set(range(int(low), int(high) + 1))
    for entry in free.tolist():
        low, high = entries.bands[entry]
        while low > padded[entry, 0] and low - 1 not in taken[entry]:
            low -= 1
        while high < padded[entry, 1] and high + 1 not in taken[entry]:
            high += 1
        padded[entry] = low, high
    return padded


def named(point: Point) -> Point:
    """Fit with each mode on the branch whose zeroth harmonic carries most of the energy of its shape."""
    if point.wanders:  # the branches are no names, and stay
        return point
    entries, turns = point.entries, _strongest_harmonics(point.blocks, point.solution)
    exponents, bands = entries.exponents + 1j * turns * entries.fundamental, entries.bands - turns[:, None]
    below = ~entries.fixed & (exponents.imag < 0.0)
    exponents[below], bands[below] = exponents[below].conj(), -bands[below, ::-1]
    renamed = replace(entries, exponents=exponents, bands=bands)
    return point.with_entries(renamed) if below.any() else point.renamed(renamed)


def read_as_modes(result: SearchResult) -> SearchResult:
    """The result with pairs near an axis read as ordinary modes, each mode on the branch of its strongest harmonic."""
    result = read_apart(result)
    if any(block.wanders for block in result.blocks):
        return result
    # By the last fit: with harmonics at the ends of bands, and two lines of a pair next to an axis, another may be it.
    entries, turns = result.solution.entries, _strongest_harmonics(result.blocks, result.solution)
    exponents, bands = entries.exponents + 1j * turns * entries.fundamental, entries.bands - turns[:, None]
    solution = replace(result.solution, entries=replace(entries, exponents=exponents, bands=bands))
    return replace(result, solution=solution, bands=result.bands - turns[:, None])


def _strongest_harmonics(blocks: Sequence[Block], solution: Solution) -> Integers:
    """The harmonic of each pair that carries most of the energy of its shape, zero for all else (entries,)."""
    # Channels are weighted by the inverse of their noise; ties go to the larger frequency.
    entries, both = solution.entries, shapes(blocks, solution)
    noise = np.full(both.coefficients.shape[1:3], np.inf)
    for block in blocks:
        noise[block.rows, block.hit] = block.noise
    energy = np.sum(np.abs(both.coefficients / noise[:, :, None]) ** 2, axis=(1, 2))
    chosen = np.zeros(len(entries.exponents), np.int64)
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        ties = np.flatnonzero(energy[entry] > (1.0 - 1e-6) * energy[entry].max())
        turns = entries.exponents[entry].imag + both.harmonics[ties] * entries.fundamental
        chosen[entry] = both.harmonics[ties[np.argmax(np.abs(turns))]]
    return chosen


def _without_steady(point: Point, bands: Integers) -> Point:
    """With the pairs of one harmonic that do not decay held as steady tones: interference, and no modes."""
    # One that is stronger than every mode that decays stays a mode: a structure that hardly decays rings the longest.
    entries = point.entries
    free = np.flatnonzero(entries.leading)
    std = np.sqrt(np.maximum(np.diag(point.solution.covariance()), 0.0))[: len(free)]
    decay, duration = np.abs(entries.exponents[free].real), max(block.last for block in point.blocks)
    steady = (decay < DEVIATIONS * std) & (duration * (decay + 2.0 * std) < SLOW)
    steady &= ~entries.real[free] & (bands[free, 0] == bands[free, 1])
    energy = np.bincount(entries.columns().modes, energies(point), len(entries.exponents))[free]
    tones = free[steady & (energy <= energy[~steady].max(initial=0.0))]
    if not len(tones):
        return point
    fixed, exponents = entries.fixed.copy(), entries.exponents.copy()
    fixed[tones], exponents[tones] = True, 1j * exponents[tones].imag
    return point.with_entries(replace(entries, fixed=fixed, exponents=exponents)).settled(rest=AT_REST)


def _without_undetermined(point: Point) -> Point:
    """With the modes whose own information is next to none held: they would ruin the deviations of all others."""
    entries, weak = point.entries, untold(point)
    if not 0 < len(weak) < int(entries.leading.sum()):
        return point
    fixed = entries.fixed.copy()
    fixed[weak] = True
    fixed[weak[entries.real[weak]]] = False  # a real multiplier has no column of its own but as a mode
    return point.with_entries(replace(entries, fixed=fixed)).settled(rest=AT_REST)
