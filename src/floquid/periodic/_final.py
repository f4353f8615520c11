"""The end of a fit: bands a little wider than what is reported, real multipliers, clusters, and what is left."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.periodic._candidates import EXPECTED
from floquid.periodic._constrained import Held, settled
from floquid.periodic._harmonics import GAP
from floquid.periodic._held import chosen_bands
from floquid.periodic._moves import Limits, State, coefficients_of
from floquid.periodic._peaks import Rest, strongest
from floquid.periodic._residual import noise_of, rests_of
from floquid.periodic._searched import Searched

LOOSE = 0.2
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""

PADDING = 1
"""Harmonics fitted beyond each end of a band: weak ones that are left out bend the exponents."""

AXIS = 6.0
"""Deviations from the axis up to which it is tried to take a multiplier for a real one."""

UNTOLD = 0.5
"""The deviation of an exponent, over its decay, from which on it is a column that is there and no mode to report."""


def finished(state: State, limits: Limits, *, search: bool, free_period: bool) -> Searched:
    """The fit with its final bands, its real multipliers, and the period if it is a parameter."""
    state, bands = with_final_bands(state, limits)
    if search:
        state, bands = _with_real_ones(state, bands)
    if free_period:
        # Not before: with modes still missing, the period would go to where it takes what is theirs.
        state = state.with_fit(settled(state.blocks, replace(state.held.entries, free_period=True), hold=True))
    if search:
        state, bands = _without_untold(state, bands)
    noise = noise_of(state.blocks, state.held, limits.floor)
    state = state.with_noise(limits.floor)
    rests = rests_of(state.blocks, state.held, limits.floor)
    peak = strongest(state.blocks, rests, 2.0 * np.pi / state.held.entries.fundamental, EXPECTED)
    return Searched(state.blocks, state.held, bands, peak, _misfit(state, rests, noise))


def _misfit(state: State, rests: list[Rest], noise: NDArray[np.float64]) -> float:
    """The rms of what is left over the level of its noise, the largest of all responses."""
    shares = [noise[block.rows, block.hit] / rest.noise for block, rest in zip(state.blocks, rests, strict=True)]
    return float(np.max(np.concatenate(shares)))


def with_final_bands(state: State, limits: Limits) -> tuple[State, NDArray[np.int64]]:
    """The fit at rest with bands on the safe side, and the bands that rise above the noise (entries, 2)."""
    entries = state.held.entries
    if not limits.choose or not (~entries.fixed).any():
        return state.with_fit(settled(state.blocks, state.held, hold=True)), entries.bands
    wide = state.evaluated(entries.padded(GAP + 1, limits.most))
    loose = chosen_bands(state.blocks, wide, LOOSE, each=True)
    bands = chosen_bands(state.blocks, wide, limits.harmonic_alarm)
    free = ~entries.fixed[:, None]
    low, high = np.minimum(entries.bands, loose)[:, :1], np.maximum(entries.bands, loose)[:, 1:]
    fitted = np.where(free, np.concatenate([low, high], axis=1), entries.bands)
    low, high = np.minimum(entries.bands, bands)[:, :1], np.maximum(entries.bands, bands)[:, 1:]
    bands = np.where(free, np.concatenate([low, high], axis=1), entries.bands)
    for padding in (PADDING, 0):
        held = state.settled(replace(entries, bands=fitted).padded(padding, limits.most), at_rest=1e-4)
        if held is not None and (held.entries.fixed == entries.fixed).all():
            return state.with_fit(held), bands
        # A weak mode ran away where it was given more harmonics than it can be told to have.
    return state.with_fit(settled(state.blocks, state.held, hold=True)), entries.bands


def criterion(state: State, found: Held) -> float:
    """Akaike's: the misfit, and two for each number that is fitted."""
    return found.cost + 2.0 * (len(found.gradient) + coefficients_of(found.entries) * state.rows)


def _with_real_ones(state: State, bands: NDArray[np.int64]) -> tuple[State, NDArray[np.int64]]:
    """With each pair whose multipliers may be one real multiplier taken for that, where the criterion says so."""
    for entry in np.flatnonzero(~state.held.entries.fixed & ~state.held.entries.real):
        entries = state.held.entries
        value, omega = entries.exponents[entry], entries.fundamental
        half = round(2.0 * value.imag / omega)
        free = np.flatnonzero(~entries.fixed)
        place = len(free) + int(np.searchsorted(free[~entries.real[free]], entry))
        off, std = abs(value.imag - 0.5 * half * omega), np.sqrt(max(state.held.covariance()[place, place], 0.0))
        if off > min(abs(value.real), AXIS * std):
            continue
        turns = np.abs(np.append(entries.bands[entry], bands[entry]) + 0.5 * half).reshape(2, 2).max(axis=1)
        fitted, kept = (np.array([-(half // 2) - half % 2, int(np.floor(turn - 0.5 * half))]) for turn in turns)
        real, exponents = entries.real.copy(), entries.exponents.copy()
        offsets, ends = entries.offsets.copy(), entries.bands.copy()
        real[entry], exponents[entry] = True, value.real
        offsets[entry], ends[entry] = 0.5 * half, fitted
        trial = replace(entries, real=real, exponents=exponents, offsets=offsets, bands=ends)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            found = settled(state.blocks, state.evaluated(trial), at_rest=1e-2)
            if criterion(state, found) <= criterion(state, state.held):
                state, bands = state.with_fit(found), bands.copy()
                bands[entry] = kept
    return state, bands


def _without_untold(state: State, bands: NDArray[np.int64]) -> tuple[State, NDArray[np.int64]]:
    """With the modes whose own information is next to none held: they would ruin the deviations of all others."""
    entries = state.held.entries
    free = np.flatnonzero(~entries.fixed)
    if len(free) < 2:
        return state, bands
    std = np.sqrt(np.maximum(np.diag(state.held.covariance()), 0.0))[: len(free)]
    untold = free[std > UNTOLD * np.abs(entries.exponents[free].real)]
    if not 0 < len(untold) < len(free):
        return state, bands
    fixed = entries.fixed.copy()
    fixed[untold] = True
    fixed[untold[entries.real[untold]]] = False  # a real multiplier has no column of its own but as a mode
    held = state.evaluated(replace(entries, fixed=fixed))
    return state.with_fit(settled(state.blocks, held, hold=True)), bands
