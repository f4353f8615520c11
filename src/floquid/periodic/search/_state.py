"""A fit while its modes and bands may still change, what it is held to, and the bands that its harmonics ask for."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.errors import IdentificationError
from floquid.fit import chi2_limit
from floquid.periodic.expansion import GAP
from floquid.periodic.least_squares import (
    PLAIN,
    Block,
    ModeParameters,
    Residual,
    Solution,
    chosen_bands,
    linearise,
    noise_of,
    solve,
    weighted,
)
from floquid.periodic.search._peaks import Peak
from floquid.periodic.search._scores import ColumnsLeft

ROUGHLY = 0.1  # standard deviations at which a fit counts as settled while modes may still change

STRICT = 1e-6
"""The probability at which noise may pass for a harmonic, or for a difference of exponents, while modes may change."""

GROWTHS = 4  # rounds in which narrow bands may grow
NEAR = 0.02  # fundamentals within which a column is taken for one that there was before


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a fit."""

    most: int  # the highest harmonic of the axis that the sampling shows
    modes: int  # modes, a pair counted once, that may be found, at most
    mode_alarm: float  # the probability that noise passes for a mode
    harmonic_alarm: float  # the probability that it passes for a harmonic of any mode
    forced: Floats  # turns a period that a forced response may have; empty when none is looked for (harmonics,)
    choose: bool = True  # whether bands are chosen; else each mode has `width` harmonics on each side
    width: int = 0
    floor: float = 1e-12  # the share of the largest free response that the noise is taken to be at least
    angle_std: tuple[float, ...] = ()  # of the system's angle in each hit [rad]; empty by a constant period (hits,)
    loud: bool = False  # whether lines are looked for that are far above any noise alone, coloured or not
    steady: bool = False  # whether a line that does not decay is taken for interference at the end, and for no mode


@dataclass(frozen=True, slots=True)
class State:
    """A fit and the blocks that it is one of, with the noise that it leaves."""

    blocks: tuple[Block, ...]
    solution: Solution
    peak: Peak | None = None  # the strongest peak that the last search of the residual saw; None where there was none

    @property
    def rows(self) -> int:
        """Responses: channels of all hits."""
        return sum(len(block.rows) for block in self.blocks)

    def carried(self, entries: ModeParameters) -> tuple[Floats, ...]:
        """First values of the coefficients of other entries: those of the columns that there are, nearest in rate."""
        old, new = self.solution.entries.columns(), entries.columns()
        apart = np.abs(np.subtract.outer(new.rates.imag, old.rates.imag)) + 1e-3 * np.abs(
            np.subtract.outer(new.rates.real, old.rates.real)
        )
        apart[new.factors[new.modes][:, None] != old.factors[old.modes]] = np.inf
        if not apart.size:
            return tuple(np.zeros((2 * len(new.modes), len(block.rows))) for block in self.blocks)
        nearest = np.argmin(apart, axis=1)
        # Of columns that are nearest to the same one, the first has its coefficients.
        known = apart[np.arange(len(nearest)), nearest] < NEAR * entries.fundamental
        known &= np.isin(np.arange(len(nearest)), np.unique(np.where(known, nearest, -1), return_index=True)[1])
        place = np.concatenate([nearest, nearest + len(old.modes)])
        return tuple(np.where(np.tile(known, 2)[:, None], own.coefficients[place], 0.0) for own in self.solution.linear)

    def linearise(self, entries: ModeParameters) -> Solution:
        """The linearisation at other entries."""
        return linearise(self.blocks, entries, self.carried(entries))

    def solve(self, entries: ModeParameters, *, at_rest: float = ROUGHLY, iterations: int = 15) -> Solution | None:
        """The fit near other entries, modes that run away being held; None where it fails."""
        with suppress(IdentificationError, np.linalg.LinAlgError):
            return solve(self.blocks, self.linearise(entries), at_rest=at_rest, hold=True, iterations=iterations)
        return None

    def with_noise(self, floor: float) -> State:
        """The same fit, the noise of the blocks being what it leaves."""
        noise = noise_of(self.blocks, self.solution, floor)
        blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in self.blocks)
        solution = weighted(blocks, self.solution.entries, self.solution.linear)
        return replace(self, blocks=blocks, solution=replace(solution, further=self.solution.further))

    def with_fit(self, solution: Solution) -> State:
        """With another fit of the same blocks."""
        return replace(self, solution=solution)


def released(state: State) -> State:
    """With the modes that were held where they are free again."""
    entries = state.solution.entries
    those = entries.fixed & (entries.exponents != 0.0)
    free = replace(entries, fixed=entries.fixed & ~those)
    return state.with_fit(weighted(state.blocks, free, state.solution.linear)) if those.any() else state


def modes_of(entries: ModeParameters) -> Mask:
    """Mask of the entries that are modes, fixed ones too: not the forced response (entries,)."""
    return ~entries.fixed | (entries.exponents != 0.0)


def limit_of(state: State, entries: ModeParameters, limits: Limits) -> float:
    """Reduction of the cost that is no evidence of a mode: by noise, and by errors of the shaft's angle.

    Noise takes more with the probability `mode_alarm` alone.
    """
    parameters = int((~entries.fixed).sum() + (~entries.fixed & ~entries.real).sum())
    noise = chi2_limit(parameters + state.rows * coefficients_of(entries), limits.mode_alarm)
    return noise + (_blurred(state, limits.angle_std) if limits.angle_std else 0.0)


def _blurred(state: State, angle_std: tuple[float, ...]) -> float:
    r"""Residual of the forced response from errors of the angle: the most that one line may hold.

    .. math:: \frac 12 \sum_{c,h} N_h \sum_j (j\, a_{c,h,j}\, \sigma_{\theta,h} / s_{c,h})^2
    """
    columns, total = state.solution.entries.columns(), 0.0
    own = state.solution.entries.fixed[columns.modes] & (columns.factors[columns.modes] == PLAIN)
    for block, linear in zip(state.blocks, state.solution.linear, strict=True):
        squares = np.sum([part**2 for part in np.split(linear.coefficients, 2)], axis=0)[own]
        share = (columns.turns[own] * angle_std[block.hit]) ** 2 @ squares
        total += 0.5 * block.n_samples * float(share @ (1.0 / block.noise**2))
    return total


def coefficients_of(entries: ModeParameters) -> int:
    """Real coefficients of one channel."""
    sines = entries.sines()
    return len(sines) + int(sines.sum())


def with_bands(state: State, limits: Limits, *, refused: set[bytes] | None = None) -> State:
    """With the bands of the harmonics that rise above the noise.

    They end where taking the last harmonic away would raise the cost by what noise explains, and go on to the outermost
    harmonic that one linearisation with wider ones shows.
    """
    entries = state.solution.entries
    if not limits.choose or not (~entries.fixed).any():
        return state
    wide = state.linearise(entries.padded(GAP + 1, limits.most))
    chosen = chosen_bands(state.blocks, wide, STRICT, each=True)
    inner = _narrowed(state)
    bands = np.stack([np.minimum(inner[:, 0], chosen[:, 0]), np.maximum(inner[:, 1], chosen[:, 1])], axis=1)
    key, refused = chosen.tobytes() + bands.tobytes(), set() if refused is None else refused
    again = (chosen != bands).any() and key not in refused
    narrower = _refitted(state, chosen, limits.most) if again else None
    if narrower is not None:
        return narrower
    refused.add(key)
    if (bands == entries.bands).all():
        return state
    solution = state.solve(replace(entries, bands=bands))
    return state if solution is None else state.with_fit(solution)


def _refitted(state: State, bands: Integers, most: int) -> State | None:
    """The fit with narrower bands that grow again as they need; None where noise does not explain what that costs.

    Where modes share lines, exponents follow the noise until none of the shared harmonics can be done without.
    """
    trial = state
    for _ in range(GROWTHS):
        solution = trial.solve(replace(trial.solution.entries, bands=bands))
        if solution is None:
            return None
        trial = state.with_fit(solution)
        fewer = coefficients_of(state.solution.entries) - coefficients_of(solution.entries)
        if fewer <= 0:
            return None
        if solution.cost < state.solution.cost + chi2_limit(state.rows * fewer, STRICT):
            return trial
        found = chosen_bands(state.blocks, trial.linearise(solution.entries.padded(GAP + 1, most)), STRICT, each=True)
        wider = np.stack([np.minimum(bands[:, 0], found[:, 0]), np.maximum(bands[:, 1], found[:, 1])], axis=1)
        if (wider == bands).all():
            return None
        bands = wider
    return None


def _narrowed(state: State) -> Integers:
    """The bands without the harmonics at their ends that noise explains, taken away one after another (entries, 2)."""
    entries = state.solution.entries
    columns, bands = entries.columns(), entries.bands.copy()
    left, limit = ColumnsLeft(state.blocks, state.solution), chi2_limit(2 * state.rows, STRICT)
    place = {(int(e), int(m)): j for j, (e, m) in enumerate(zip(columns.modes, columns.harmonics, strict=True))}
    ends = {(int(e), side): np.inf for e in np.flatnonzero(~entries.fixed & ~entries.real) for side in (0, 1)}
    while True:
        for entry, side in ends:
            single = bands[entry, 0] == bands[entry, 1]
            ends[entry, side] = np.inf if single else left.rise(place[entry, int(bands[entry, side])])
        if not ends:
            return bands
        entry, side = min(ends, key=lambda end: ends[end])
        if ends[entry, side] > limit:
            return bands
        left.take(place[entry, int(bands[entry, side])])
        bands[entry, side] += 1 - 2 * side


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The blocks with the noise that is left, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    solution: Solution
    bands: Integers
    peak: Peak
    residuals: tuple[Residual, ...]  # residual of each block
    misfit: float = 1.0  # the rms of what is left over the level of its noise, the largest of all responses
    clusters: tuple[int, ...] = ()  # the entries whose harmonics do not have one exponent
    as_read: dict[int, complex] = field(default_factory=dict)  # deviations of exponents near an axis, by entry
    apart: dict[int, float] = field(default_factory=dict)  # of pairs of open kind how far apart both exponents may be
    hidden: dict[float, float] = field(default_factory=dict)
    """How far from a real multiplier a second one may be that noise hides [1/s], by the turns a period of that one."""
