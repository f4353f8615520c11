"""Modes found one after another in what is left of a record, each fitted together with all before it.

This is Allen's FSE view taken at its word (section 2.2.3): the response is one of exponentials λ + imω, so that a peak
in the spectrum of what is left is a harmonic of a mode. Every mode is fitted with a band of harmonics at once, in time
on its physical branch: modes that fold onto one another in lifted responses are apart here, and neither the shaft's
wander, nor missing samples, nor a rate out of step with the period is in the way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.periodic._bands import Entries
from floquid.periodic._blocks import PLAIN, Block, Columns, complex_of
from floquid.periodic._constrain import PADDING, noise_left, with_bands
from floquid.periodic._constrained import Held, evaluated, settled
from floquid.periodic._peaks import Peak, Rest, strongest
from floquid.periodic._record_block import RecordBlock
from floquid.periodic._trial import (
    FLOOR,
    ROUGHLY,
    WIDEST,
    Limits,
    criterion,
    needed,
    tried,
    with_better_bands,
    with_real_ones,
)

FIRST_BAND = 1
"""Harmonics on each side that a new mode is fitted with."""

LOOK = 1.0
"""How many peaks of noise are expected among those that are tried: it is the fit that decides."""

REFUSALS = 4
"""Peaks in turn that may come to nothing before the search ends."""

CROWDED = 3.0
"""Modes nearer to one another than this many of their decays are looked at for a further one."""

TWINS = 2
"""Fundamentals on each side at which it is tried."""

TRIED = 4
"""How many of these trials are fitted."""

ROUNDS = 3
"""How often the search may go on after the bands were chosen for good."""

ROUNDING = 1e-13
"""The share of a channel's largest value below which what is left of it is rounding."""

NO_COLUMNS = Columns(np.zeros(0, complex), np.zeros(0), *np.zeros((3, 0), np.int64), fundamental=1.0)
"""No column at all: what they leave is the samples."""


@dataclass(frozen=True, slots=True)
class Searched:
    """What a search found: the blocks with the noise that is left, the fit, its bands, and the next peak."""

    blocks: tuple[Block, ...]
    held: Held
    bands: NDArray[np.int64]
    peak: Peak


def searched(
    blocks: Sequence[Block], base: Entries, limits: Limits, report: Callable[[str], None] = lambda _: None
) -> Searched:
    """The modes beside those in `base`, added one after another while what is left has a peak above the noise.

    Parameters
    ----------
    blocks
        The samples; their noise is estimated here.
    base
        What is fitted in any case.
    limits
        What the search is held to.
    report
        Is told of each mode.

    Returns
    -------
    Searched
        The fit.
    """
    blocks, held = _added(tuple(blocks), evaluated(blocks, base), limits, report)
    report("choosing harmonics")
    blocks, held, bands = _finished(blocks, needed(blocks, held, limits), limits)
    for _ in range(ROUNDS if limits.choose else 0):
        # The harmonics fitted beyond each band may hold what is another mode's: it is looked for without them.
        try:
            narrow = settled(blocks, replace(held.entries, bands=bands), at_rest=ROUGHLY)
        except (IdentificationError, np.linalg.LinAlgError):
            break
        before = len(narrow.entries.exponents)
        more, wider = _added(blocks, _with_twin(blocks, narrow, limits) or narrow, limits, report)
        if len(wider.entries.exponents) == before:
            break
        report("choosing harmonics")
        more, wider, ends = _finished(more, needed(more, wider, limits), limits)
        if criterion(more, wider) >= criterion(more, evaluated(more, held.entries)):
            break
        blocks, held, bands = more, wider, ends
    held, bands = with_real_ones(blocks, held, bands)
    if held.entries.real[~held.entries.fixed].any():
        # Two pairs may have stood for the harmonics of one real multiplier.
        less = needed(blocks, held, limits)
        if len(less.entries.exponents) < len(held.entries.exponents):
            blocks, held, bands = _finished(blocks, less, limits)
    peak = strongest(blocks, rests_of(blocks, held, limits.floor), 2.0 * np.pi / held.entries.fundamental, LOOK)
    return Searched(blocks, held, bands, peak)


def _added(
    blocks: tuple[Block, ...], held: Held, limits: Limits, report: Callable[[str], None]
) -> tuple[tuple[Block, ...], Held]:
    """With every mode that rises above the noise, bands within `WIDEST`."""
    passed: list[float] = []
    while True:
        rests = rests_of(blocks, held, limits.floor)
        blocks = tuple(block.with_noise(rest.noise) for block, rest in zip(blocks, rests, strict=True))
        period = 2.0 * np.pi / held.entries.fundamental
        peak = strongest(blocks, rests, period, LOOK, passed)
        full = int((~held.entries.fixed).sum()) >= limits.modes
        if peak.gain < peak.limit or full or len(passed) >= REFUSALS:
            return blocks, held
        trial = _with_peak(blocks, rests, held, peak, limits)
        if trial is None:
            # Far from a loud mode its skirts are above what little noise there is: the loudest line is its own.
            loudest = strongest(blocks, [rest.level() for rest in rests], period, LOOK, passed)
            if loudest.exponent != peak.exponent:
                trial = _with_peak(blocks, rests, held, loudest, limits)
        if trial is None:
            passed.append(peak.exponent.imag)
            continue
        held = trial
        count = int((~held.entries.fixed).sum())
        report(f"searching for modes: {count} found")


def _with_peak(blocks: tuple[Block, ...], rests: Sequence[Rest], held: Held, peak: Peak, limits: Limits) -> Held | None:
    """The fit with one more harmonic, of the forced response or of a mode, or one more mode; None where it fails."""
    span = max(rest.span for rest in rests)
    line = 4.0 * np.pi / span
    own, best, most = with_better_bands(blocks, evaluated(blocks, held.entries), limits), None, 0.0
    driven = _driven(held.entries, peak, limits, line)
    if driven is not None:
        # A mode with harmonics would take several lines of a forced response at once: those come first.
        found, lead = tried(blocks, own, driven, limits)
        if found is not None and lead > 0.5 * peak.gain:
            return found
    for trial in _trials(blocks, rests, held.entries, peak, limits, line):
        found, lead = tried(blocks, own, trial, limits)
        if found is not None and lead > most:
            best, most = found, lead
    return best


def _driven(entries: Entries, peak: Peak, limits: Limits, line: float) -> Entries | None:
    """The entries with the harmonic of the forced response that a peak may be; None where it is none."""
    if not len(limits.forced):
        return None
    omega, frequency = entries.fundamental, peak.exponent.imag
    turn = limits.forced[int(np.argmin(np.abs(limits.forced * omega - frequency)))]
    known = entries.offsets[entries.fixed & (entries.factors == PLAIN)]
    if abs(turn * omega - frequency) > line or (np.abs(known - turn) < 1e-9).any():
        return None
    return entries.joined(forced_entries([turn], omega))


def _trials(
    blocks: Sequence[Block], rests: Sequence[Rest], entries: Entries, peak: Peak, limits: Limits, line: float
) -> list[Entries]:
    """What a peak may be, in the order in which it is tried."""
    omega, frequency = entries.fundamental, peak.exponent.imag
    trials = []
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        for sign in (1.0, -1.0):
            value = entries.exponents[entry]
            m = round((sign * frequency - value.imag) / omega)
            low, high = entries.bands[entry]
            near = abs(sign * frequency - value.imag - m * omega) < line + abs(value.real)
            if near and not low <= m <= high and low - 4 <= m <= high + 4:
                bands = entries.bands.copy()
                bands[entry] = min(low, m), max(high, m)
                trials.append(replace(entries, bands=bands))
    narrow = np.clip(entries.bands, -WIDEST, WIDEST)
    held = replace(entries, bands=np.where(entries.fixed[:, None], entries.bands, narrow))
    alone = Entries.made([peak.exponent], [(0, 0)], omega)
    grids = [
        RecordBlock(
            times=np.asarray(rest.taken * rest.step, np.float64),
            values=rest.values[:, rest.taken],
            hit=block.hit,
            rows=block.rows,
            noise=block.noise,
        )
        for block, rest in zip(blocks, rests, strict=True)
    ]
    with suppress(IdentificationError, np.linalg.LinAlgError):
        alone = settled(grids, alone).entries
    width = FIRST_BAND if limits.choose else limits.width
    trials.append(held.joined(replace(alone, bands=np.array([[-width, width]]))))
    return trials


def _with_twin(blocks: tuple[Block, ...], held: Held, limits: Limits) -> Held | None:
    """The fit with a second mode next to one that folds onto its own conjugate or onto another, if that wins.

    What is left has no peak where two such modes are taken for one: a second is tried around the first, a whole number
    of fundamentals away.
    """
    entries, trials = held.entries, []
    free = np.flatnonzero(~entries.fixed & ~entries.real)
    if not 0 < len(free) < limits.modes:
        return None
    values, omega = entries.exponents[free], entries.fundamental
    both = np.concatenate([values, values.conj()])
    gap = values[:, None] - both
    gap = np.abs(gap.imag - omega * np.rint(gap.imag / omega)) / (np.abs(values.real)[:, None] + np.abs(both.real))
    np.fill_diagonal(gap, np.inf)
    for value in values[gap.min(axis=1) < CROWDED]:
        for branch, shift, decay in product(range(-TWINS, TWINS + 1), (-1.0, 0.0, 1.0), (1.2, 2.0)):
            frequency = value.imag + branch * omega + shift * abs(value.real)
            if 0.0 < frequency < limits.most * omega:
                one = Entries.made([complex(decay * value.real, frequency)], [(-FIRST_BAND, FIRST_BAND)], omega)
                trials.append(entries.joined(one))
    costs = [evaluated(blocks, trial).cost for trial in trials]
    own, best, most = with_better_bands(blocks, held, limits), None, 0.0
    for k in np.argsort(costs)[:TRIED]:
        found, lead = tried(blocks, own, trials[k], limits)
        if found is not None and lead > most:
            best, most = found, lead
    return best


def _finished(
    blocks: tuple[Block, ...], held: Held, limits: Limits
) -> tuple[tuple[Block, ...], Held, NDArray[np.int64]]:
    """With bands chosen without bound, modes that are not needed left out, and the noise that is left."""
    bands = held.entries.bands
    for padding in (PADDING, 0) if limits.choose else (0,):
        try:
            held, bands = with_bands(
                blocks, held.entries, limits.most, limits.harmonic_alarm, choose=limits.choose, padding=padding
            )
            break
        except (IdentificationError, np.linalg.LinAlgError):
            # A weak mode ran away where it was given more harmonics than it can be told to have.
            continue
    noise = noise_of(blocks, held, limits.floor)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    held = evaluated(blocks, held.entries)
    return blocks, held, bands


def rests_of(blocks: Sequence[Block], held: Held, floor: float = FLOOR) -> list[Rest]:
    """What a fit leaves of each block, its noise at least `least_noise`."""
    columns = held.entries.columns()
    return [
        Rest.of(*block.rest(columns, complex_of(linear.coefficients)), least)
        for block, linear, least in zip(blocks, held.linear, least_noise(blocks, held, floor), strict=True)
    ]


def least_noise(blocks: Sequence[Block], held: Held, floor: float) -> list[NDArray[np.float64]]:
    """What the noise of each block is at least (rows,): a share of the largest free response, and rounding."""
    columns, least = held.entries.columns(), []
    fixed = held.entries.fixed[columns.modes][:, None]
    for block, linear in zip(blocks, held.linear, strict=True):
        _, free = block.rest(columns, complex_of(linear.coefficients) * fixed)
        _, whole = block.rest(NO_COLUMNS, np.zeros((0, len(block.rows)), complex))
        least.append(np.maximum(floor * np.abs(free).max(axis=1), ROUNDING * np.abs(whole).max(axis=1)))
    return least


def noise_of(blocks: Sequence[Block], held: Held, floor: float) -> NDArray[np.float64]:
    """The deviation of what is left (channels, hits), at least `least_noise`."""
    noise = noise_left(blocks, held)
    for block, least in zip(blocks, least_noise(blocks, held, floor), strict=True):
        noise[block.rows, block.hit] = np.maximum(noise[block.rows, block.hit], least)
    return noise


def forced_entries(turns: Sequence[float], fundamental: float, *, factor: int = 0) -> Entries:
    """Fixed entries of a forced response, one for each of the turns a period."""
    own = np.asarray(turns, float)
    n = len(own)
    return Entries.made(
        np.zeros(n), np.zeros((n, 2)), fundamental, real=own == 0.0, offsets=own, fixed=True, factor=factor
    )
