"""What a search tries: modes added, parted, joined or taken for real ones, each weighed by one criterion."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.periodic._bands import Entries
from floquid.periodic._blocks import Block
from floquid.periodic._constrained import Held, evaluated, settled
from floquid.periodic._held import chosen_bands

WIDEST = 4
"""Harmonics on each side that a mode may have while others are still missing, and take what is theirs."""

STRICT = 1e-6
"""The probability at which noise may pass for a harmonic while modes are still missing: a wide band takes what is a
mode of its own that folds next to this one."""

FLOOR = 1e-12
"""The share of the largest free response that the noise is taken to be at least, unless told."""

ROUGHLY = 0.1
"""Standard deviations at which a fit counts as settled while modes are still missing."""


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
        The probabilities that noise passes for a mode, and for a harmonic of any mode.
    forced
        Turns a period of the harmonics that a forced response may have; empty when none is looked for (harmonics,).
    choose
        Whether bands are chosen; else each mode has `width` harmonics on each side.
    width
        See `choose`.
    floor
        The share of the largest free response that the noise is taken to be at least.
    """

    most: int
    modes: int
    mode_alarm: float
    harmonic_alarm: float
    forced: NDArray[np.float64]
    choose: bool = True
    width: int = 0
    floor: float = FLOOR


def criterion(blocks: Sequence[Block], found: Held) -> float:
    """Akaike's: the misfit, and two for each number that is fitted."""
    rows = sum(len(block.rows) for block in blocks)
    return found.cost + 2.0 * (len(found.gradient) + size(found.entries) * rows)


def tried(blocks: Sequence[Block], held: Held, trial: Entries, limits: Limits) -> tuple[Held | None, float]:
    """The fit of a trial, and by how much its criterion beats what noise would give; None where it fails.

    Its bands are chosen again where that does no harm, as those of `held` were: what is gained by that alone speaks for
    no mode.
    """
    from scipy.special import chdtri

    rows = sum(len(block.rows) for block in blocks)
    added = trial.picked(range(len(held.entries.exponents), len(trial.exponents)))
    wider = size(added) if len(added.exponents) else size(trial) - size(held.entries)
    more = len(added.parameters().weights) + rows * max(wider, 1)
    least = criterion(blocks, held) - float(chdtri(more, limits.mode_alarm)) + 2.0 * more
    try:
        found = with_better_bands(blocks, settled(blocks, trial, at_rest=ROUGHLY), limits)
    except (IdentificationError, np.linalg.LinAlgError):
        return None, 0.0
    return found, least - criterion(blocks, found)


def with_better_bands(blocks: Sequence[Block], held: Held, limits: Limits) -> Held:
    """With bands chosen again, where that does no harm."""
    if not limits.choose or not (~held.entries.fixed).any():
        return held
    bands = chosen_bands(blocks, evaluated(blocks, widened(held.entries)), STRICT, each=True)
    with suppress(IdentificationError, np.linalg.LinAlgError):
        other = settled(blocks, replace(held.entries, bands=bands), at_rest=ROUGHLY)
        return min(held, other, key=lambda one: criterion(blocks, one))
    return held


def widened(entries: Entries) -> Entries:
    wide = np.stack([np.minimum(entries.bands[:, 0], -WIDEST), np.maximum(entries.bands[:, 1], WIDEST)], axis=1)
    return replace(entries, bands=np.where(entries.fixed[:, None], entries.bands, wide))


def size(entries: Entries) -> int:
    """Real coefficients of one channel."""
    return len(entries.sines()) + int(entries.sines().sum())


def needed(blocks: tuple[Block, ...], held: Held, limits: Limits) -> Held:
    """The fit without modes that are not needed: noise explains them, or another has them as harmonics."""
    from scipy.special import chdtri

    rows = sum(len(block.rows) for block in blocks)
    while True:
        entries, best, most = held.entries, None, 0.0
        free = np.flatnonzero(~entries.fixed)
        for entry in free:
            rest = entries.picked([k for k in range(len(entries.exponents)) if k != entry])
            own = entries.picked([entry])
            more = len(own.parameters().weights) + rows * size(own)
            least = float(chdtri(more, limits.mode_alarm)) - 2.0 * more
            for trial in (rest, *_taken_over(entries, int(entry), limits)):
                now = evaluated(blocks, trial)
                # Where even a full step of the others does not make up for it, no fit is needed.
                gained = float(now.gradient @ np.linalg.lstsq(now.information, now.gradient, rcond=1e-12)[0])
                if criterion(blocks, now) - 2.0 * gained > criterion(blocks, held) + least:
                    continue
                with suppress(IdentificationError, np.linalg.LinAlgError):
                    now = settled(blocks, trial, at_rest=ROUGHLY)
                won = criterion(blocks, held) + least - criterion(blocks, now)
                if won > most:
                    best, most = now, won
        if best is None:
            return held
        held = best


def _taken_over_by_real(entries: Entries, entry: int) -> list[Entries]:
    """The same, given to each real multiplier of like decay that it folds onto."""
    trials, value = [], entries.exponents[entry]
    at = value.imag / entries.fundamental + entries.offsets[entry]
    for other in np.flatnonzero(entries.real & ~entries.fixed):
        turns = at - entries.offsets[other]
        off = abs(turns - round(turns)) * entries.fundamental
        if other != entry and max(off, abs(value.real - entries.exponents[other].real)) < 0.5 * abs(value.real):
            bands = entries.bands.copy()
            bands[other, 1] = max(bands[other, 1], entries.bands[entry, 1] + round(turns))
            trials.append(replace(entries, bands=bands).picked([k for k in range(len(bands)) if k != entry]))
    return trials


def _taken_over(entries: Entries, entry: int, limits: Limits) -> list[Entries]:
    """The entries without one, its harmonics being given to each mode that it folds onto."""
    trials, value = _taken_over_by_real(entries, entry), entries.exponents[entry]
    if entries.real[entry]:
        return trials
    for other in np.flatnonzero(~entries.fixed & ~entries.real):
        for sign in (1.0, -1.0):
            if other == entry:
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


def with_real_ones(blocks: tuple[Block, ...], held: Held, bands: NDArray[np.int64]) -> tuple[Held, NDArray[np.int64]]:
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
            if criterion(blocks, found) <= criterion(blocks, held):
                held, bands = found, bands.copy()
                bands[entry] = kept
    return held, bands
