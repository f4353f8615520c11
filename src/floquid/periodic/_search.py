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
from floquid.periodic._blocks import Block, complex_of
from floquid.periodic._constrain import PADDING, noise_left, with_bands
from floquid.periodic._constrained import Held, evaluated, settled
from floquid.periodic._held import chosen_bands
from floquid.periodic._peaks import Peak, Rest, strongest
from floquid.periodic._record_block import RecordBlock

FIRST_BAND = 1
"""Harmonics on each side that a new mode is fitted with."""

WIDEST = 4
"""Harmonics on each side that a mode may have while others are still missing, and take what is theirs."""

STRICT = 1e-6
"""The probability at which noise may pass for a harmonic while modes are still missing: a wide band takes what is a
mode of its own that folds next to this one."""

ROUGHLY = 0.1
"""Standard deviations at which a fit counts as settled while modes are still missing."""

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


@dataclass(frozen=True, slots=True)
class Limits:
    """What a search is held to.

    Parameters
    ----------
    most
        The highest harmonic of the axis that the sampling shows.
    modes
        Entries that may be found, at most.
    mode_alarm, harmonic_alarm
        The probabilities at which noise may pass for a mode, and for a harmonic.
    forced
        Turns a period of the harmonics that a forced response may have; empty when none is looked for (harmonics,).
    choose
        Whether bands are chosen; else each mode has `width` harmonics on each side.
    width
        See `choose`.
    """

    most: int
    modes: int
    mode_alarm: float
    harmonic_alarm: float
    forced: NDArray[np.float64]
    choose: bool = True
    width: int = 0


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
    blocks, held, peak = _added(tuple(blocks), evaluated(blocks, base), limits, report)
    report("choosing harmonics")
    blocks, held, bands = _finished(blocks, _needed(blocks, held, limits), limits)
    for _ in range(ROUNDS if limits.choose else 0):
        # The harmonics fitted beyond each band may hold what is another mode's: it is looked for without them.
        try:
            narrow = settled(blocks, replace(held.entries, bands=bands), at_rest=ROUGHLY)
        except (IdentificationError, np.linalg.LinAlgError):
            break
        before = len(narrow.entries.exponents)
        more, wider, peak = _added(blocks, _with_twin(blocks, narrow, limits) or narrow, limits, report)
        if len(wider.entries.exponents) == before:
            break
        report("choosing harmonics")
        more, wider, ends = _finished(more, _needed(more, wider, limits), limits)
        if _criterion(more, wider) >= _criterion(more, evaluated(more, held.entries)):
            break
        blocks, held, bands = more, wider, ends
    held, bands = _with_real_ones(blocks, held, bands)
    return Searched(blocks, held, bands, peak)


def _with_real_ones(blocks: tuple[Block, ...], held: Held, bands: NDArray[np.int64]) -> tuple[Held, NDArray[np.int64]]:
    """With each pair whose multipliers may be one real multiplier taken for that, where the criterion says so."""
    for entry in np.flatnonzero(~held.entries.fixed & ~held.entries.real):
        entries = held.entries
        value, omega = entries.exponents[entry], entries.fundamental
        half = round(2.0 * value.imag / omega)
        if abs(value.imag - 0.5 * half * omega) > abs(value.real):
            continue
        turns = np.abs(np.append(entries.bands[entry], bands[entry]) + 0.5 * half).reshape(2, 2).max(axis=1)
        fitted, kept = (np.array([-(half // 2) - half % 2, int(np.floor(turn - 0.5 * half))]) for turn in turns)
        real, exponents = entries.real.copy(), entries.exponents.copy()
        offsets, ends = entries.offsets.copy(), entries.bands.copy()
        real[entry], exponents[entry] = True, value.real
        offsets[entry], ends[entry] = 0.5 * half, fitted
        trial = replace(entries, real=real, exponents=exponents, offsets=offsets, bands=ends)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            found = settled(blocks, trial)
            if _criterion(blocks, found) <= _criterion(blocks, held):
                held, bands = found, bands.copy()
                bands[entry] = kept
    return held, bands


def _criterion(blocks: Sequence[Block], found: Held) -> float:
    """Akaike's: the misfit, and two for each number that is fitted."""
    rows = sum(len(block.rows) for block in blocks)
    return found.cost + 2.0 * (len(found.gradient) + _size(found.entries) * rows)


def _added(
    blocks: tuple[Block, ...], held: Held, limits: Limits, report: Callable[[str], None]
) -> tuple[tuple[Block, ...], Held, Peak]:
    """With every mode that rises above the noise, bands within `WIDEST`."""
    passed: list[float] = []
    while True:
        rests = rests_of(blocks, held)
        blocks = tuple(block.with_noise(rest.noise) for block, rest in zip(blocks, rests, strict=True))
        period = 2.0 * np.pi / held.entries.fundamental
        peak = strongest(blocks, rests, period, LOOK, passed)
        full = int((~held.entries.fixed).sum()) >= limits.modes
        if peak.gain < peak.limit or full or len(passed) >= REFUSALS:
            return blocks, held, peak
        trial = _with_peak(blocks, rests, held, peak, limits)
        if trial is None:
            passed.append(peak.exponent.imag)
            continue
        held = trial
        count = int((~held.entries.fixed).sum())
        report(f"searching for modes: {count} found")


def _with_peak(blocks: tuple[Block, ...], rests: Sequence[Rest], held: Held, peak: Peak, limits: Limits) -> Held | None:
    """The fit with one more harmonic, of the forced response or of a mode, or one more mode; None where it fails."""
    span = max(rest.span for rest in rests)
    own, best, most = evaluated(blocks, held.entries), None, 0.0
    for trial in _trials(blocks, rests, held.entries, peak, limits, 4.0 * np.pi / span):
        found, won = _won(blocks, own, trial, limits)
        if found is not None and won > most:
            best, most = found, won
    return best


def _trials(
    blocks: Sequence[Block], rests: Sequence[Rest], entries: Entries, peak: Peak, limits: Limits, line: float
) -> list[Entries]:
    """What a peak may be, in the order in which it is tried."""
    omega, frequency = entries.fundamental, peak.exponent.imag
    trials = []
    if len(limits.forced):
        turn = limits.forced[int(np.argmin(np.abs(limits.forced * omega - frequency)))]
        known = entries.offsets[entries.fixed & (entries.factors == 0)]
        if abs(turn * omega - frequency) < line and not (np.abs(known - turn) < 1e-9).any():
            trials.append(entries.joined(forced_entries([turn], omega)))
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
    if len(free) >= limits.modes:
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
    best, most = None, 0.0
    for k in np.argsort(costs)[:TRIED]:
        found, won = _won(blocks, held, trials[k], limits)
        if found is not None and won > most:
            best, most = found, won
    return best


def _needed(blocks: tuple[Block, ...], held: Held, limits: Limits) -> Held:
    """The fit without modes that are not needed: noise explains them, or another has them as harmonics."""
    from scipy.special import chdtri

    rows = sum(len(block.rows) for block in blocks)
    while True:
        entries, best, most = held.entries, None, 0.0
        free = np.flatnonzero(~entries.fixed)
        for entry in free:
            rest = entries.picked([k for k in range(len(entries.exponents)) if k != entry])
            own = entries.picked([entry])
            more = len(own.parameters().weights) + rows * _size(own)
            least = float(chdtri(more, limits.mode_alarm)) - 2.0 * more
            for trial in (rest, *_taken_over(entries, int(entry), limits)):
                now = evaluated(blocks, trial)
                # Where even a full step of the others does not make up for it, no fit is needed.
                gained = float(now.gradient @ np.linalg.lstsq(now.information, now.gradient, rcond=1e-12)[0])
                if _criterion(blocks, now) - 2.0 * gained > _criterion(blocks, held) + least:
                    continue
                with suppress(IdentificationError, np.linalg.LinAlgError):
                    now = settled(blocks, trial, at_rest=ROUGHLY)
                won = _criterion(blocks, held) + least - _criterion(blocks, now)
                if won > most:
                    best, most = now, won
        if best is None:
            return held
        held = best


def _taken_over(entries: Entries, entry: int, limits: Limits) -> list[Entries]:
    """The entries without one, its harmonics being given to each mode that it folds onto."""
    trials, value = [], entries.exponents[entry]
    for other in np.flatnonzero(~entries.fixed & ~entries.real):
        for sign in (1.0, -1.0):
            if other == entry or entries.real[entry]:
                continue
            gap = complex(value.real, sign * value.imag) - entries.exponents[other]
            turns = round(gap.imag / entries.fundamental)
            near = abs(gap - 1j * turns * entries.fundamental) < abs(value.real)
            if near and turns:
                ends = sign * entries.bands[entry] + turns
                bands = entries.bands.copy()
                bands[other] = min(bands[other, 0], ends.min()), max(bands[other, 1], ends.max())
                if bands[other, 1] - bands[other, 0] <= 2 * limits.most:
                    trials.append(replace(entries, bands=bands).picked([k for k in range(len(bands)) if k != entry]))
    return trials


def _won(blocks: Sequence[Block], held: Held, trial: Entries, limits: Limits) -> tuple[Held | None, float]:
    """The fit of a trial, and by how much its criterion beats what noise would give; None where it fails.

    Its bands are chosen again where that does no harm.
    """
    from scipy.special import chdtri

    rows = sum(len(block.rows) for block in blocks)
    more = len(trial.parameters().weights) - len(held.gradient) + rows * (_size(trial) - _size(held.entries))
    more = max(more, 1)
    least = _criterion(blocks, held) - float(chdtri(more, limits.mode_alarm)) + 2.0 * more
    try:
        found = settled(blocks, trial, at_rest=ROUGHLY)
    except (IdentificationError, np.linalg.LinAlgError):
        return None, 0.0
    if limits.choose:
        wide = evaluated(blocks, _widened(found.entries))
        bands = chosen_bands(blocks, wide, STRICT)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            other = settled(blocks, replace(found.entries, bands=bands), at_rest=ROUGHLY)
            found = min(found, other, key=lambda one: _criterion(blocks, one))
    return found, least - _criterion(blocks, found)


def _widened(entries: Entries) -> Entries:
    wide = np.stack([np.minimum(entries.bands[:, 0], -WIDEST), np.maximum(entries.bands[:, 1], WIDEST)], axis=1)
    return replace(entries, bands=np.where(entries.fixed[:, None], entries.bands, wide))


def _size(entries: Entries) -> int:
    """Real coefficients of one channel."""
    return len(entries.sines()) + int(entries.sines().sum())


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
    noise = noise_left(blocks, held)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    held = evaluated(blocks, held.entries)
    return blocks, held, bands


def rests_of(blocks: Sequence[Block], held: Held) -> list[Rest]:
    """What a fit leaves of each block, with the level of its noise."""
    columns = held.entries.columns()
    rests = []
    for block, linear in zip(blocks, held.linear, strict=True):
        times, left = block.rest(columns, complex_of(linear.coefficients))
        _, whole = block.rest(columns, np.zeros((len(columns.modes), len(block.rows)), complex))
        rests.append(Rest.of(times, left, 1e-13 * np.abs(whole).max(axis=1)))
    return rests


def forced_entries(turns: Sequence[float], fundamental: float, *, factor: int = 0) -> Entries:
    """Fixed entries of a forced response, one for each of the turns a period."""
    own = np.asarray(turns, float)
    n = len(own)
    return Entries.made(
        np.zeros(n), np.zeros((n, 2)), fundamental, real=own == 0.0, offsets=own, fixed=True, factor=factor
    )
