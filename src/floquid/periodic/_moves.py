"""Changes to a fit that are tried, each decided by scores of one linearisation before anything is fitted anew."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.periodic._bands import Entries
from floquid.periodic._blocks import Block
from floquid.periodic._constrained import Held, evaluated, settled, weighted
from floquid.periodic._harmonics import GAP
from floquid.periodic._held import chosen_bands
from floquid.periodic._residual import noise_of
from floquid.periodic._scores import ColumnsLeft, best_cut, differences, removal_rises

ROUGHLY = 0.1
"""Standard deviations at which a fit counts as settled while modes may still change."""

STRICT = 1e-6
"""The probability at which noise may pass for a harmonic, or for a difference of exponents, while modes may change."""

REFITTED = 20.0
"""Times the limit of noise up to which it is tried whether the others, fitted again, can do without a mode."""

GROWTHS = 4
"""How often narrow bands may grow."""

JOINED = 60.0
"""The chi-square of the difference of two exponents up to which it is tried to take them for one mode."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a fit is held to.

    Parameters
    ----------
    most
        The highest harmonic of the axis that the sampling shows.
    modes
        Modes, a pair counted once, that may be found, at most.
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
    loud
        Whether lines are looked for that are far above any noise alone, coloured or not.
    """

    most: int
    modes: int
    mode_alarm: float
    harmonic_alarm: float
    forced: NDArray[np.float64]
    choose: bool = True
    width: int = 0
    floor: float = 1e-12
    loud: bool = False


@dataclass(frozen=True, slots=True)
class State:
    """A fit and the blocks that it is one of, with the noise that it leaves."""

    blocks: tuple[Block, ...]
    held: Held

    @property
    def rows(self) -> int:
        """Responses: channels of all hits."""
        return sum(len(block.rows) for block in self.blocks)

    def carried(self, entries: Entries) -> tuple[NDArray[np.float64], ...]:
        """First values of the coefficients of other entries: those of the columns that there are, nearest in rate."""
        old, new = self.held.entries.columns(), entries.columns()
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
        return tuple(np.where(np.tile(known, 2)[:, None], own.coefficients[place], 0.0) for own in self.held.linear)

    def evaluated(self, entries: Entries) -> Held:
        """The linearisation at other entries."""
        return evaluated(self.blocks, entries, self.carried(entries))

    def settled(self, entries: Entries, *, at_rest: float = ROUGHLY, iterations: int = 15) -> Held | None:
        """The fit near other entries, modes that run away being held; None where it fails."""
        with suppress(IdentificationError, np.linalg.LinAlgError):
            return settled(self.blocks, self.evaluated(entries), at_rest=at_rest, hold=True, iterations=iterations)
        return None

    def with_noise(self, floor: float) -> State:
        """The same fit, the noise of the blocks being what it leaves."""
        noise = noise_of(self.blocks, self.held, floor)
        blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in self.blocks)
        held = weighted(blocks, self.held.entries, self.held.linear)
        return State(blocks, replace(held, further=self.held.further))

    def with_fit(self, held: Held) -> State:
        """With another fit of the same blocks."""
        return replace(self, held=held)


NEAR = 0.02
"""Fundamentals within which a column is taken for one that there was before."""


def released(state: State) -> State:
    """With the modes that were held where they are free again."""
    entries = state.held.entries
    those = entries.fixed & (entries.exponents != 0.0)
    free = replace(entries, fixed=entries.fixed & ~those)
    return state.with_fit(weighted(state.blocks, free, state.held.linear)) if those.any() else state


def modes_of(entries: Entries) -> NDArray[np.bool_]:
    """Which entries are modes, also those that are held where they are: not the forced response (entries,)."""
    return ~entries.fixed | (entries.exponents != 0.0)


def limit_of(state: State, entries: Entries, alarm: float) -> float:
    """What noise takes out of the cost by entries beside others, but for that probability."""
    from scipy.special import chdtri

    parameters = int((~entries.fixed).sum() + (~entries.fixed & ~entries.real).sum())
    return float(chdtri(parameters + state.rows * coefficients_of(entries), alarm))


def coefficients_of(entries: Entries) -> int:
    """Real coefficients of one channel."""
    sines = entries.sines()
    return len(sines) + int(sines.sum())


def with_bands(state: State, limits: Limits, level: float = STRICT, *, refused: set[bytes] | None = None) -> State:
    """With the bands of the harmonics that rise above the noise.

    They end where taking the last harmonic away would raise the cost by what noise explains, and go on to the outermost
    harmonic that one linearisation with wider ones shows.
    """
    entries = state.held.entries
    if not limits.choose or not (~entries.fixed).any():
        return state
    wide = state.evaluated(entries.padded(GAP + 1, limits.most))
    chosen = chosen_bands(state.blocks, wide, level, each=True)
    inner = _narrowed(state, level)
    bands = np.stack([np.minimum(inner[:, 0], chosen[:, 0]), np.maximum(inner[:, 1], chosen[:, 1])], axis=1)
    key, refused = chosen.tobytes() + bands.tobytes(), set() if refused is None else refused
    again = (chosen != bands).any() and key not in refused
    narrower = _refitted(state, chosen, limits.most, level) if again else None
    if narrower is not None:
        return narrower
    refused.add(key)
    if (bands == entries.bands).all():
        return state
    held = state.settled(replace(entries, bands=bands))
    return state if held is None else state.with_fit(held)


def _refitted(state: State, bands: NDArray[np.int64], most: int, level: float) -> State | None:
    """The fit with narrower bands that grow again as they need; None where noise does not explain what that costs.

    Where modes share lines, exponents follow the noise until none of the shared harmonics can be done without.
    """
    from scipy.special import chdtri

    trial = state
    for _ in range(GROWTHS):
        held = trial.settled(replace(trial.held.entries, bands=bands))
        if held is None:
            return None
        trial = state.with_fit(held)
        fewer = coefficients_of(state.held.entries) - coefficients_of(held.entries)
        if fewer <= 0:
            return None
        if held.cost < state.held.cost + float(chdtri(state.rows * fewer, level)):
            return trial
        found = chosen_bands(state.blocks, trial.evaluated(held.entries.padded(GAP + 1, most)), level, each=True)
        wider = np.stack([np.minimum(bands[:, 0], found[:, 0]), np.maximum(bands[:, 1], found[:, 1])], axis=1)
        if (wider == bands).all():
            return None
        bands = wider
    return None


def _narrowed(state: State, level: float) -> NDArray[np.int64]:
    """The bands without the harmonics at their ends that noise explains, taken away one after another (entries, 2)."""
    from scipy.special import chdtri

    entries = state.held.entries
    columns, bands = entries.columns(), entries.bands.copy()
    left, limit = ColumnsLeft(state.blocks, state.held), float(chdtri(2 * state.rows, level))
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


def without_needless(state: State, limits: Limits) -> State:
    """Without modes that noise explains, one after another: the cost, all others fitted again, rises by too little."""
    refused: set[complex] = set()
    while True:
        entries, rises = state.held.entries, removal_rises(state.blocks, state.held)
        those = np.flatnonzero(modes_of(entries))
        bounds = {int(e): limit_of(state, entries.picked([e]), limits.mode_alarm) for e in those}
        ranked = sorted(those.tolist(), key=lambda e: rises[e] / bounds[e])
        for entry in ranked:
            if complex(entries.exponents[entry]) in refused:
                continue
            if rises[entry] > REFITTED * bounds[entry]:
                less = _shared(state, entry) if limits.choose and not entries.fixed[entry] else None
                if less is None:
                    continue
                state = state.with_fit(less)
                break
            less = _without(state, entry, bounds[entry])
            if less is None and limits.choose and not entries.fixed[entry]:
                less = _shared(state, entry)
            if less is not None:
                state = state.with_fit(less)
                break
            refused.add(complex(entries.exponents[entry]))
        else:
            return state


def _without(state: State, entry: int, bound: float) -> Held | None:
    """The fit without one entry, None where the cost rises by more than the bound."""
    rest = state.held.entries.picked([k for k in range(len(state.held.entries.exponents)) if k != entry])
    now = state.evaluated(rest)
    if len(now.gradient):
        # Where even a full step of the others does not make up for it, no fit is needed.
        gained = float(now.gradient @ np.linalg.lstsq(now.gauss_newton, now.gradient, rcond=1e-12)[0])
        if now.cost - 2.0 * gained > state.held.cost + bound:
            return None
        with suppress(IdentificationError, np.linalg.LinAlgError):
            now = settled(state.blocks, now, at_rest=ROUGHLY, hold=True)
    return now if now.cost < state.held.cost + bound else None


def _shared(state: State, entry: int) -> Held | None:
    """The fit without one entry, its harmonics given to all modes that fold next to it; None where that is no better.

    Where two modes share a line, what is found there by itself lies between them.
    """
    from scipy.special import chdtri

    entries = state.held.entries
    if entries.real[entry] or entries.bands[entry, 1] - entries.bands[entry, 0] > 1:
        return None
    bands, takers = entries.bands.copy(), 0
    for other in np.flatnonzero(~entries.fixed & ~entries.real):
        if other == entry:
            continue
        sign, m, gap = differences(entries, int(other), entry) or (1, 0, np.inf)
        ends = sign * entries.bands[entry] + m
        apart = max(ends.min() - bands[other, 1], bands[other, 0] - ends.max())
        if abs(gap) > abs(entries.exponents[entry].real) + abs(entries.exponents[other].real) or apart > 1:
            continue
        bands[other] = min(bands[other, 0], ends.min()), max(bands[other, 1], ends.max())
        takers += 1
    if takers < 2:
        return None
    trial = replace(entries, bands=bands).picked([k for k in range(len(bands)) if k != entry])
    more = coefficients_of(trial) - coefficients_of(entries)
    now = state.settled(trial)
    if now is None:
        return None
    allowed = float(chdtri(2, STRICT)) - 2.0 * state.rows * max(more, 0)
    return now if now.cost < state.held.cost + allowed else None


def joined(state: State, limits: Limits) -> State:
    """With modes of equal exponents, whole fundamentals apart, taken for one with the harmonics of both (Wald 1943)."""
    refused: set[tuple[complex, complex]] = set()
    while True:
        pairs = [p for p in _equal(state, limits) if (p.first, p.second) not in refused]
        taken: set[int] = set()
        chosen = [p for p in pairs if not {p.one, p.other} & taken and not taken.update({p.one, p.other})]
        if not chosen:
            return state
        trials = [chosen] if len(chosen) == 1 else [chosen, *([p] for p in chosen)]
        for several in trials:
            found = _joined(state, several, limits)
            if found is not None:
                state = state.with_fit(found)
                break
            if len(several) == 1:
                refused.add((several[0].first, several[0].second))
        else:
            return state


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two modes that may be one: `other`, conjugated for sign -1, is m fundamentals above `one`."""

    one: int
    other: int
    sign: int
    turns: int
    score: float
    first: complex
    second: complex


def _equal(state: State, limits: Limits) -> list[_Pair]:
    """Pairs of modes whose exponents may be equal modulo the fundamental, the surest first."""
    entries = state.held.entries
    free = np.flatnonzero(~entries.fixed)
    covariance = state.held.covariance()
    pairs = np.flatnonzero(~entries.real[free])
    turn = np.full(len(free), -1)
    turn[pairs] = len(free) + np.arange(len(pairs))
    found = []
    for k, one in enumerate(free):
        for j in range(k + 1, len(free)):
            other = free[j]
            if entries.real[one] != entries.real[other]:
                continue
            sign, m, gap = differences(entries, int(one), int(other)) or (1, 0, 0j)
            ends = sign * entries.bands[other] + m
            if max(ends.min() - entries.bands[one, 1], entries.bands[one, 0] - ends.max()) > GAP + 1:
                continue
            if max(ends.max(), entries.bands[one, 1]) - min(ends.min(), entries.bands[one, 0]) > 2 * limits.most:
                continue
            ties = np.zeros((1 if entries.real[one] else 2, len(covariance)))
            ties[0, [k, j]] = -1.0, 1.0
            if not entries.real[one]:
                ties[1, [turn[k], turn[j]]] = -1.0, sign
            elif abs(gap.imag) > 1e-9 * entries.fundamental:
                continue  # one turns by half a turn more
            spread = ties @ covariance @ ties.T
            own = np.array([gap.real, gap.imag])[: len(ties)]
            if not (np.diag(spread) > 0.0).all():
                continue
            score = float(own @ np.linalg.lstsq(spread, own, rcond=1e-12)[0])
            if score < JOINED:
                values = complex(entries.exponents[one]), complex(entries.exponents[other])
                found.append(_Pair(int(one), int(other), sign, m, score, *values))
    return sorted(found, key=lambda pair: pair.score)


def _joined(state: State, pairs: Sequence[_Pair], limits: Limits) -> Held | None:
    """The fit with these pairs as one mode each; None where the cost rises by more than noise explains."""
    from scipy.special import chdtri

    entries = state.held.entries
    exponents, bands = entries.exponents.copy(), entries.bands.copy()
    rises = removal_rises(state.blocks, state.held)
    for pair in pairs:
        one, other = pair.one, pair.other
        ends = pair.sign * bands[other] + pair.turns
        bands[one] = min(bands[one, 0], ends.min()), max(bands[one, 1], ends.max())
        share = rises[other] / max(rises[one] + rises[other], 1e-300)
        value = exponents[other] if pair.sign > 0 else exponents[other].conjugate()
        exponents[one] += share * (value - 1j * pair.turns * entries.fundamental - exponents[one])
    gone = {pair.other for pair in pairs}
    kept = [k for k in range(len(exponents)) if k not in gone]
    merged = replace(entries, exponents=exponents, bands=bands).picked(kept)
    fewer = max(coefficients_of(entries) - coefficients_of(merged), 0)
    bound = float(chdtri(2 * len(pairs) + state.rows * fewer, STRICT if not fewer else limits.mode_alarm))
    now = state.settled(merged)
    return now if now is not None and now.cost < state.held.cost + bound else None


def parted(state: State, limits: Limits) -> State:
    """With modes cut in two where their lower and upper harmonics ask for different exponents, and a fit confirms it."""
    from scipy.special import chdtri

    bound, refused = float(chdtri(2, STRICT)), set()
    while int((~state.held.entries.fixed).sum()) < limits.modes:
        entries = state.held.entries
        cuts = [best_cut(state.held, int(e)) for e in np.flatnonzero(~entries.fixed & ~entries.real)]
        cuts = [
            c for c in cuts if c is not None and c.gain > bound and complex(entries.exponents[c.entry]) not in refused
        ]
        if not cuts:
            return state
        best = max(cuts, key=lambda cut: cut.gain)
        now = state.settled(_cut(entries, best.entry, best.harmonic, best.moved))
        if now is not None and state.held.cost - now.cost > bound:
            state = state.with_fit(now)
        else:
            refused.add(complex(entries.exponents[best.entry]))
    return state


def _cut(entries: Entries, entry: int, harmonic: int, moved: tuple[complex, complex]) -> Entries:
    """The entries with one in two parts, below a harmonic and from it on, each about its middle."""
    limit, omega = 0.5 * abs(entries.exponents[entry].real), entries.fundamental
    low, high = entries.bands[entry]
    parts = []
    for (first, last), step in zip(((low, harmonic - 1), (harmonic, high)), moved, strict=True):
        middle = int(np.clip(0, first, last))
        value = entries.exponents[entry] + step * min(1.0, limit / max(abs(step), 1e-300)) + 1j * middle * omega
        ends = np.array([first - middle, last - middle])
        if value.imag < 0.0:
            value, ends = value.conjugate(), -ends[::-1]
        parts.append((value, ends))
    rest = entries.picked([k for k in range(len(entries.exponents)) if k != entry])
    return rest.joined(Entries.made([value for value, _ in parts], [ends for _, ends in parts], omega))
