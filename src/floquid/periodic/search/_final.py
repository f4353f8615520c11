"""The end of a fit: bands a little wider than what is reported, real multipliers, clusters, and what is left."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.errors import IdentificationError
from floquid.fit import chi2_limit
from floquid.periodic.expansion import GAP
from floquid.periodic.least_squares import (
    ModeParameters,
    RecordBlock,
    Residual,
    Solution,
    chosen_bands,
    noise_of,
    residuals_of,
    shapes,
    solve,
)
from floquid.periodic.search._moves import joined
from floquid.periodic.search._near_axis import with_axis_pairs
from floquid.periodic.search._new_lines import EXPECTED
from floquid.periodic.search._peaks import strongest
from floquid.periodic.search._scores import differences, equality, spread_of_harmonics, sure_columns
from floquid.periodic.search._state import STRICT, Limits, SearchResult, State

LOOSE = 0.02  # probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm
PADDING = 1  # harmonics fitted beyond each end of a band: weak ones that are left out bend the exponents

CROWDED = 0.15
"""The difference of two exponents, over both decays, within which lines that both have tell hardly anything apart."""

BESIDE = 1.0  # the same within which what one mode lacks bends the other
DOUBTFUL = 1e-3  # the probability of harmonics of one exponent at which a mode gets more room
CLUSTER = 1e-3  # the same at which a mode is taken for several that are not told apart
ROOM = 2  # harmonics more on each side then
AXIS = 4.0  # deviations of a decay from zero up to which a tone is steady as far as can be told

UNTOLD = 0.5
"""The deviation of an exponent, over its decay, from which on it is a column that is there and no mode to report."""


FARTHEST = 3  # harmonics of a mode, at most, that its branch is looked for at
BETTER = 9.0  # the reduction of the cost from which on a branch is the better one, and within which none is
LASTING = 0.5  # decay over the record, in nepers, within two deviations of which a tone is steady as far as can be told


def finished(state: State, limits: Limits, *, search: bool, free_period: bool) -> SearchResult:
    """The fit with its final bands, its real multipliers, and the period if it is a parameter."""
    if search:
        state, _ = centred(state, state.solution.entries.bands)
        state = joined(state, limits) if limits.choose else state
    state, bands = with_final_bands(state, limits)
    if limits.choose:
        state = _with_room(state, limits)
    state, bands = centred(state, bands)
    if search:
        state, bands = on_steady_branches(state, bands)
    if free_period:
        # Not before: with modes still missing, the period would go to where it takes what is theirs.
        state = state.with_fit(solve(state.blocks, replace(state.solution.entries, free_period=True), hold=True))
    hidden: dict[float, float] = {}
    if search:
        state, bands, hidden = with_axis_pairs(state, bands)
        state = _without_steady(state, bands) if limits.steady else state
        state, bands = _without_untold(state, bands)
    state, clusters = _with_clusters(state)
    noise = noise_of(state.blocks, state.solution, limits.floor)
    state = state.with_noise(limits.floor)
    last = solve(state.blocks, state.solution, hold=True)
    state = state.with_fit(replace(last, further=_kept(state.solution, last.entries)))
    residuals = residuals_of(state.blocks, state.solution, limits.floor)
    peak = state.peak or strongest(state.blocks, residuals, 2.0 * np.pi / state.solution.entries.fundamental, EXPECTED)
    return SearchResult(
        state.blocks,
        state.solution,
        bands,
        peak,
        tuple(residuals),
        _misfit(state, residuals, noise),
        clusters,
        hidden=hidden,
    )


def _misfit(state: State, residuals: list[Residual], noise: Floats) -> float:
    """The rms of what is left over the level of its noise, the largest of all responses."""
    shares = [
        noise[block.rows, block.hit] / residual.noise for block, residual in zip(state.blocks, residuals, strict=True)
    ]
    return float(np.max(np.concatenate(shares)))


def with_final_bands(state: State, limits: Limits) -> tuple[State, Integers]:
    """The fit at rest with bands on the safe side, and the bands that rise above the noise (entries, 2)."""
    entries = state.solution.entries
    if not limits.choose or not (~entries.fixed).any():
        return state.with_fit(solve(state.blocks, state.solution, hold=True)), entries.bands
    wide = state.linearise(entries.padded(GAP + 1, limits.most))
    loose = chosen_bands(state.blocks, wide, LOOSE, each=True)
    bands = chosen_bands(state.blocks, wide, limits.harmonic_alarm)
    free = ~entries.fixed[:, None]
    low, high = np.minimum(entries.bands, loose)[:, :1], np.maximum(entries.bands, loose)[:, 1:]
    fitted = np.where(free, np.concatenate([low, high], axis=1), entries.bands)
    low, high = np.minimum(entries.bands, bands)[:, :1], np.maximum(entries.bands, bands)[:, 1:]
    bands = np.where(free, np.concatenate([low, high], axis=1), entries.bands)
    for _ in range(2):
        solution = state.solve(_padded(entries, fitted, limits.most), at_rest=1e-3, iterations=30)
        if solution is None:
            break
        away = solution.entries.fixed & ~entries.fixed
        if not away.any():
            return state.with_fit(solution), bands
        # A weak mode ran away where it was given more harmonics than it can be told to have.
        fitted = np.where(away[:, None], entries.bands, fitted)
    return state.with_fit(solve(state.blocks, state.solution, hold=True)), entries.bands


def _sure(state: State) -> Mask:
    """Mask of columns that are surely no noise: the demands of others say nothing (columns,)."""
    return sure_columns(state.blocks, state.solution, chi2_limit(2 * state.rows, STRICT))


def _doubtful(solution: Solution, sure: Mask, alarm: float) -> list[int]:
    """The modes whose harmonics do not have one exponent, but for that probability each."""
    from scipy.special import chdtrc

    free = np.flatnonzero(~solution.entries.fixed & ~solution.entries.real)
    tests = [(int(entry), *equality(solution, int(entry), sure)) for entry in free]
    return [entry for entry, score, degrees in tests if degrees and chdtrc(degrees, score) < alarm]


def _with_room(state: State, limits: Limits) -> State:
    """With wider bands of modes whose harmonics do not agree, and of those that fold next to them.

    What is left out of a mode on the lines of another bends that one.
    """
    # Room does little harm: here all harmonics are asked, those of noise too.
    everything = np.ones(len(state.solution.entries.sines()), bool)
    doubtful, entries = _doubtful(state.solution, everything, DOUBTFUL), state.solution.entries
    if not doubtful:
        return state
    near = [
        other
        for other in np.flatnonzero(~entries.fixed & ~entries.real)
        if any(other == one or _apart(entries, int(one), int(other)) < BESIDE for one in doubtful)
    ]
    wider = entries.padded(ROOM, limits.most).bands
    bands = entries.bands.copy()
    bands[near] = wider[near]
    solution = state.solve(replace(entries, bands=bands), at_rest=1e-3, iterations=30)
    if solution is None or (solution.entries.fixed != entries.fixed).any():
        return state
    return state.with_fit(solution)


def _apart(entries: ModeParameters, one: int, other: int) -> float:
    """Distance of two modes modulo the fundamental, over the decays of both."""
    _, _, gap = differences(entries, one, other) or (1, 0, np.inf)
    return abs(gap) / (abs(entries.exponents[one].real) + abs(entries.exponents[other].real) + 1e-300)


def _with_clusters(state: State) -> tuple[State, tuple[int, ...]]:
    """With the spread of the harmonics' own exponents in the variances of clusters, and which modes these are."""
    sure, solution = _sure(state), state.solution
    entries, free = solution.entries, np.flatnonzero(solution.entries.leading)
    clusters = _doubtful(solution, sure, CLUSTER)
    further = np.zeros(len(solution.gradient)) if solution.further is None else np.array(solution.further)

    def own(entry: int) -> list[int]:
        turns = free[~entries.real[free]]
        return [int(np.searchsorted(free, entry)), len(free) + int(np.searchsorted(turns, entry))]

    for entry in clusters:
        further[own(entry)] += spread_of_harmonics(solution, entry, sure)
    return (state.with_fit(replace(solution, further=further)) if further.any() else state), tuple(clusters)


def centred(state: State, bands: Integers) -> tuple[State, Integers]:
    """The same fit, each mode on the branch whose zeroth harmonic carries most of the energy of its shape.

    Channels are weighted by the inverse of their noise; ties go to the larger frequency.
    """
    entries = state.solution.entries
    both = shapes(state.blocks, state.solution)
    noise = np.full(both.coefficients.shape[1:3], np.inf)
    for block in state.blocks:
        noise[block.rows, block.hit] = block.noise
    energy = np.sum(np.abs(both.coefficients / noise[:, :, None]) ** 2, axis=(1, 2))
    exponents, fitted, kept = entries.exponents.copy(), entries.bands.copy(), bands.copy()
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        ties = np.flatnonzero(energy[entry] > (1.0 - 1e-6) * energy[entry].max())
        turns = exponents[entry].imag + both.harmonics[ties] * entries.fundamental
        m = int(both.harmonics[ties[np.argmax(np.abs(turns))]])
        exponents[entry], fitted[entry], kept[entry] = _branch(
            m, exponents[entry], fitted[entry], kept[entry], entries.fundamental
        )
    if (fitted == entries.bands).all():
        return state, bands
    return state.with_fit(state.linearise(replace(entries, exponents=exponents, bands=fitted))), kept


def _branch(
    m: int, exponent: complex, fitted: Integers, kept: Integers, omega: float
) -> tuple[complex, Integers, Integers]:
    """Exponent and bands of a mode counted from its harmonic `m`, the frequency not negative."""
    exponent, fitted, kept = exponent + 1j * m * omega, fitted - m, kept - m
    return (exponent, fitted, kept) if exponent.imag >= 0.0 else (exponent.conjugate(), -fitted[::-1], -kept[::-1])


def on_steady_branches(state: State, bands: Integers) -> tuple[State, Integers]:
    r"""The fit at a speed that wanders, each mode on the branch whose frequency does not follow the speed.

    .. math:: e^{\lambda t + i m \theta} = e^{(\lambda + i k \omega) t + i (m - k) \theta + i k (\theta - \omega t)}

    At a constant speed all k are one mode; else the cost tells them apart. Where it does not, the deviations cover the
    other branches, too.
    """
    if not any(isinstance(block, RecordBlock) and block.speeds is not None for block in state.blocks):
        return state, bands
    state = state.with_fit(solve(state.blocks, state.solution, at_rest=1e-2, iterations=10, hold=True))
    spread: dict[int, complex] = {}
    for entry in np.flatnonzero(~state.solution.entries.fixed & ~state.solution.entries.real):
        entries = state.solution.entries
        if entries.fixed[entry]:  # the fit on another branch of a mode before it held this one
            continue
        tried, omega = [], entries.fundamental
        for m in range(*np.clip([entries.bands[entry, 0], entries.bands[entry, 1] + 1], -FARTHEST, FARTHEST + 1)):
            exponents, fitted, kept = entries.exponents.copy(), entries.bands.copy(), bands.copy()
            parts = _branch(m, exponents[entry], fitted[entry], kept[entry], omega)
            exponents[entry], fitted[entry], kept[entry] = parts
            trial = state.linearise(replace(entries, exponents=exponents, bands=fitted)) if m else state.solution
            step = np.asarray(np.linalg.lstsq(trial.gauss_newton, trial.gradient, rcond=1e-12)[0], np.float64)
            tried.append((trial.cost - float(step @ trial.gradient), m, trial, kept, trial.entries.moved(step)))
        cost, m, found, kept, _ = min(tried, key=lambda one: one[:2])
        if m and state.solution.cost - cost > BETTER:
            with suppress(IdentificationError, np.linalg.LinAlgError):
                found = solve(state.blocks, found, at_rest=1e-2, iterations=10, hold=True)
                if state.solution.cost - found.cost > BETTER:
                    state, bands = state.with_fit(found), kept
        likely: Complexes = np.array([one.exponents[entry] for value, *_, one in tried if value < cost + BETTER])
        own = state.solution.entries.exponents[entry]
        # A branch whose frequency would be negative is that of the conjugate.
        gaps = [
            values.imag - omega * np.rint(values.imag / omega) for values in (likely - own, likely - own.conjugate())
        ]
        apart = np.minimum(*np.abs(gaps))
        spread[int(entry)] = complex(np.abs(likely.real - own.real).max(), apart.max())
    return _with_spread(state, spread), bands


def _with_spread(state: State, spread: dict[int, complex]) -> State:
    """With the errors that the exponents of some modes, by their entries, may have in the variances of those free."""
    entries = state.solution.entries
    free = np.flatnonzero(~entries.fixed)
    turning = free[~entries.real[free]]
    further = np.zeros(len(state.solution.gradient))
    for entry, off in spread.items():
        if not entries.fixed[entry]:
            further[np.searchsorted(free, entry)] = off.real**2
            further[len(free) + np.searchsorted(turning, entry)] = off.imag**2
    return state.with_fit(replace(state.solution, further=further))


def _kept(before: Solution, after: ModeParameters) -> Floats | None:
    """The additions to variances of a fit, as far as their modes are not held after it (parameters,)."""
    if before.further is None:
        return None
    free = np.flatnonzero(~before.entries.fixed)
    modes = np.concatenate([free, free[~before.entries.real[free]]])
    period = np.ones(len(before.further) - len(modes), bool)
    return before.further[np.concatenate([~after.fixed[modes], period])]


def _padded(entries: ModeParameters, bands: Integers, most: int) -> ModeParameters:
    """The entries with these bands and a harmonic more on each side, but for harmonics where another mode has one.

    There the two would tell nothing apart, and the other one takes what is left out.
    """
    padded = replace(entries, bands=bands).padded(PADDING, most).bands
    free = np.flatnonzero(~entries.fixed & ~entries.real)
    for entry in free:
        taken: set[int] = set()
        for other in free:
            if other == entry or _apart(entries, int(entry), int(other)) > CROWDED:
                continue
            sign, turns, _ = differences(entries, int(entry), int(other)) or (1, 0, 0j)
            ends = sign * entries.bands[other] + turns
            taken |= set(range(int(ends.min()), int(ends.max()) + 1))
        low, high = entries.bands[entry]
        while low > padded[entry, 0] and low - 1 not in taken:
            low -= 1
        while high < padded[entry, 1] and high + 1 not in taken:
            high += 1
        padded[entry] = low, high
    return replace(entries, bands=padded)


def _without_untold(state: State, bands: Integers) -> tuple[State, Integers]:
    """With the modes whose own information is next to none held: they would ruin the deviations of all others."""
    entries = state.solution.entries
    free = np.flatnonzero(entries.leading)
    if len(free) < 2:
        return state, bands
    std = np.sqrt(np.maximum(np.diag(state.solution.covariance()), 0.0))[: len(free)]
    untold = free[std > UNTOLD * np.abs(entries.exponents[free].real)]
    if not 0 < len(untold) < len(free):
        return state, bands
    fixed = entries.fixed.copy()
    fixed[untold] = True
    fixed[untold[entries.real[untold]]] = False  # a real multiplier has no column of its own but as a mode
    solution = state.linearise(replace(entries, fixed=fixed))
    return state.with_fit(solve(state.blocks, solution, hold=True)), bands


def _without_steady(state: State, bands: Integers) -> State:
    """With the pairs of one harmonic that do not decay held as steady tones: interference, and no modes."""
    entries = state.solution.entries
    free = np.flatnonzero(entries.leading)
    std = np.sqrt(np.maximum(np.diag(state.solution.covariance()), 0.0))[: len(free)]
    decay, duration = np.abs(entries.exponents[free].real), max(block.last for block in state.blocks)
    steady = (decay < AXIS * std) & (duration * (decay + 2.0 * std) < LASTING)
    tones = free[steady & ~entries.real[free] & (bands[free, 0] == bands[free, 1])]
    if not 0 < len(tones) < len(free):
        return state
    fixed, exponents = entries.fixed.copy(), entries.exponents.copy()
    fixed[tones], exponents[tones] = True, 1j * exponents[tones].imag
    held = state.linearise(replace(entries, fixed=fixed, exponents=exponents))
    return state.with_fit(solve(state.blocks, held, hold=True))
