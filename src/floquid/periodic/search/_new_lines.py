"""Search of the spectrum of the residual: further harmonics of modes, of the forced response, and modes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid.errors import IdentificationError
from floquid.fit import chi2_limit
from floquid.periodic.least_squares import (
    PLAIN,
    ModeParameters,
    RecordBlock,
    Residual,
    forced_entries,
    residuals_of,
    solve,
)
from floquid.periodic.search._moves import joined
from floquid.periodic.search._peaks import Peak, peaks
from floquid.periodic.search._scores import score_step
from floquid.periodic.search._state import ROUGHLY, Limits, State, coefficients_of, limit_of, modes_of, with_bands

AT_ONCE = 3  # peaks that are tried together
EXPECTED = 1.0  # peaks of noise expected among those that are tried: it is the fit that decides
STEPS = 8  # steps that a fit with a further line may take before it is judged

PROMISED = 0.8
"""The share of what a mode must take out of the cost that a peak has to promise: it may lie between the lines."""

LOUD = 100.0  # times the limit from which on a line cannot be a peak of noise that is coloured
REFUSALS = 3  # peaks in turn that may come to nothing before the search ends
BEYOND = 4  # harmonics beyond a band in which a peak may be a further harmonic of the mode


def with_lines(
    state: State, limits: Limits, report: Callable[[str], None] = lambda _: None, passed: list[float] | None = None
) -> State:
    """With what the spectrum of the residual holds beside the fit, the strongest peaks first.

    This is Allen's FSE view taken at its word (section 2.2.3): the response is one of exponentials λ + imω, so that a
    peak in the spectrum of what is left is a harmonic of a mode, or of a new one. Frequencies that came to nothing are
    kept in `passed`, and not tried again.
    """
    passed = [] if passed is None else passed
    refused = 0
    while refused < REFUSALS:
        state = state.with_noise(limits.floor)
        residuals = residuals_of(state.blocks, state.solution, limits.floor)
        largest, found = _peaks(state, residuals, limits, passed)
        state = replace(state, peak=largest)
        if not found:
            break
        more = _added(state, residuals, found, limits)
        if more is None and len(found) > 1:
            more = _added(state, residuals, found[:1], limits)
        if more is None:
            # Far from a loud mode its skirts are above what little noise there is: the loudest line is its own.
            loudest = _peaks(state, [residual.level() for residual in residuals], limits, passed)[1][:1]
            if loudest and loudest[0].exponent != found[0].exponent:
                more = _added(state, residuals, loudest, limits)
        if more is None:
            passed.append(found[0].exponent.imag)
            refused += 1
            continue
        state = joined(more, limits) if limits.choose else more
        report(f"searching for modes: {int((~state.solution.entries.fixed).sum())} found")
    return state


def _peaks(
    state: State, residuals: Sequence[Residual], limits: Limits, passed: Sequence[float]
) -> tuple[Peak, list[Peak]]:
    """The strongest peak; and those that noise hardly makes and that promise what a mode must take out, a few."""
    period = 2.0 * np.pi / state.solution.entries.fundamental
    least = PROMISED * chi2_limit(2 * state.rows, limits.mode_alarm)
    largest, found = peaks(state.blocks, residuals, period, EXPECTED, passed, most=AT_ONCE)
    above = LOUD if limits.loud else 1.0
    return largest, [peak for peak in found if peak.gain > above * max(peak.limit, least)]


def _added(state: State, residuals: Sequence[Residual], found: Sequence[Peak], limits: Limits) -> State | None:
    """The fit with what these peaks are; None where noise explains what they take out of the cost."""
    entries, bound = state.solution.entries, 0.0
    for peak in found:
        more = _with_peak(state, residuals, entries, peak, limits)
        if more is None:
            continue
        new = more.picked(range(len(entries.exponents), len(more.exponents)))
        if len(new.exponents):
            bound += limit_of(state, new, limits)
        else:
            wider = coefficients_of(more) - coefficients_of(entries)
            bound += chi2_limit(state.rows * max(wider, 1), limits.mode_alarm)
        entries = more
    if entries is state.solution.entries:
        return None
    now = state.linearise(entries)
    _, more = score_step(now, entries.ties())
    if state.solution.cost - now.cost + 2.0 * more < bound:
        return None  # even a full step would not make up for what noise explains
    with suppress(IdentificationError, np.linalg.LinAlgError):
        now = solve(state.blocks, now, at_rest=ROUGHLY, hold=True, iterations=STEPS)
    trial = with_bands(state.with_fit(now), limits)
    if trial.solution.cost > now.cost:
        trial = state.with_fit(now)
    return trial if state.solution.cost - trial.solution.cost > bound else None


def _with_peak(
    state: State, residuals: Sequence[Residual], entries: ModeParameters, peak: Peak, limits: Limits
) -> ModeParameters | None:
    """The entries with what a peak most likely is; None where there is no room for it."""
    line = 4.0 * np.pi / max(residual.span for residual in residuals)
    driven = _driven(entries, peak, limits, line)
    if driven is not None:
        return driven
    wider = _wider(entries, peak, line) if limits.choose else None
    if wider is not None:
        return wider
    if int(modes_of(entries).sum()) >= limits.modes:
        return None
    alone = ModeParameters.made([peak.exponent], [(0, 0)], entries.fundamental)
    grids = [
        RecordBlock(
            times=np.asarray(residual.taken * residual.step, np.float64),
            values=residual.values[:, residual.taken],
            hit=block.hit,
            rows=block.rows,
            noise=block.noise,
        )
        for block, residual in zip(state.blocks, residuals, strict=True)
    ]
    with suppress(IdentificationError, np.linalg.LinAlgError):
        alone = solve(grids, alone, at_rest=ROUGHLY).entries
    if not limits.choose:
        alone = replace(alone, bands=np.array([[-limits.width, limits.width]]))
    return entries.joined(alone)


def _driven(entries: ModeParameters, peak: Peak, limits: Limits, line: float) -> ModeParameters | None:
    """The entries with the harmonic of the forced response that a peak may be; None where it is none."""
    if not len(limits.forced):
        return None
    omega, frequency = entries.fundamental, peak.exponent.imag
    turn = limits.forced[int(np.argmin(np.abs(limits.forced * omega - frequency)))]
    known = entries.offsets[entries.fixed & (entries.factors == PLAIN)]
    if abs(turn * omega - frequency) > line or (np.abs(known - turn) < 1e-9).any():
        return None
    if abs(peak.exponent.real) > line:
        return None
    return entries.joined(forced_entries([turn], omega))


def _wider(entries: ModeParameters, peak: Peak, line: float) -> ModeParameters | None:
    """The entries with a wider band of the mode that a peak may be a harmonic of; None where it is of none."""
    omega, frequency, best, least = entries.fundamental, peak.exponent.imag, None, np.inf
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        for sign in (1.0, -1.0):
            value = entries.exponents[entry]
            m = round((sign * frequency - value.imag) / omega)
            low, high = entries.bands[entry]
            off = abs(sign * frequency - value.imag - m * omega)
            if off > line + abs(value.real) or low <= m <= high or not low - BEYOND <= m <= high + BEYOND:
                continue
            if off < least:
                bands = entries.bands.copy()
                bands[entry] = min(low, m), max(high, m)
                best, least = replace(entries, bands=bands), off
    return best
