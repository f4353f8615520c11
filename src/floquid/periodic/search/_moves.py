"""Changes to the modes of a fit, each decided by scores of one linearisation before anything is fitted anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Integers
from floquid.errors import IdentificationError
from floquid.fit import chi2_limit
from floquid.periodic.expansion import GAP
from floquid.periodic.least_squares import ModeParameters, Solution, solve
from floquid.periodic.search._scores import ColumnsLeft, best_cut, differences, removal_rises
from floquid.periodic.search._state import (
    ROUGHLY,
    STRICT,
    Limits,
    State,
    coefficients_of,
    limit_of,
    modes_of,
    with_bands,
)

REFITTED = 20.0
"""Times the limit of noise up to which it is tried whether the others, fitted again, can do without a mode."""

JOINED = 60.0  # the chi-square of the difference of two exponents up to which it is tried to take them for one mode


def without_needless(state: State, limits: Limits) -> State:
    """Without modes that noise explains, one after another: the cost, all others fitted again, rises by too little."""
    refused: set[complex] = set()
    while True:
        entries, rises = state.solution.entries, removal_rises(state.blocks, state.solution)
        those = np.flatnonzero(modes_of(entries))
        bounds = {int(e): limit_of(state, entries.picked([e]), limits) for e in those}
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


def _without(state: State, entry: int, bound: float) -> Solution | None:
    """The fit without one entry, None where the cost rises by more than the bound."""
    residual = state.solution.entries.picked([k for k in range(len(state.solution.entries.exponents)) if k != entry])
    now = state.linearise(residual)
    if len(now.gradient):
        # Where even a full step of the others does not make up for it, no fit is needed.
        gained = float(now.gradient @ np.linalg.lstsq(now.gauss_newton, now.gradient, rcond=1e-12)[0])
        if now.cost - 2.0 * gained > state.solution.cost + bound:
            return None
        with suppress(IdentificationError, np.linalg.LinAlgError):
            now = solve(state.blocks, now, at_rest=ROUGHLY, hold=True)
    return now if now.cost < state.solution.cost + bound else None


def _shared(state: State, entry: int) -> Solution | None:
    """The fit without one entry, its harmonics given to all modes that fold next to it; None where that is no better.

    Where two modes share a line, what is found there by itself lies between them.
    """
    entries = state.solution.entries
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
    now = state.solve(trial)
    if now is None:
        return None
    allowed = chi2_limit(2, STRICT) - 2.0 * state.rows * max(more, 0)
    return now if now.cost < state.solution.cost + allowed else None


def unshared(state: State, limits: Limits) -> State:
    """Without harmonics at the ends of bands, on lines of a mode that folds next to it, which the others make up for.

    With both fitted the exponents have gone where noise has them, and there no such harmonic can be taken away alone.
    """
    bound, refused = chi2_limit(2 * state.rows, STRICT), set()
    while limits.choose:
        entries, left = state.solution.entries, ColumnsLeft(state.blocks, state.solution)
        columns = entries.columns()
        for entry, side, bands in _narrower(entries):
            own = np.flatnonzero((columns.modes == entry) & (columns.harmonics == entries.bands[entry, side]))
            key = complex(entries.exponents[entry]), bands[entry].tobytes()
            if left.rise(int(own[0])) > REFITTED * bound:
                continue
            now = None if key in refused else state.solve(replace(entries, bands=bands))
            if now is not None and now.cost < state.solution.cost + bound:
                state = state.with_fit(now)
                break
            refused.add(key)
        else:
            break
    return state


def _narrower(entries: ModeParameters) -> Iterator[tuple[int, int, Integers]]:
    """Bands without a harmonic at one end of a mode's, on a line of one that folds next to it: mode, end and bands."""
    free = np.flatnonzero(~entries.fixed & ~entries.real)
    for entry in free:
        taken: set[int] = set()
        for other in free:
            sign, m, gap = differences(entries, int(entry), int(other)) or (1, 0, np.inf)
            if other != entry and abs(gap) < abs(entries.exponents[entry].real) + abs(entries.exponents[other].real):
                ends = sign * entries.bands[other] + m
                taken |= set(range(int(ends.min()), int(ends.max()) + 1))
        for side in (0, 1):
            if int(entries.bands[entry, side]) in taken and entries.bands[entry, 0] < entries.bands[entry, 1]:
                bands = entries.bands.copy()
                bands[entry, side] += 1 - 2 * side
                yield int(entry), side, bands


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
    entries = state.solution.entries
    free = np.flatnonzero(~entries.fixed)
    covariance = state.solution.covariance()
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


def _joined(state: State, pairs: Sequence[_Pair], limits: Limits) -> Solution | None:
    """The fit with these pairs as one mode each; None where the cost rises by more than noise explains."""
    entries = state.solution.entries
    exponents, bands = entries.exponents.copy(), entries.bands.copy()
    rises = removal_rises(state.blocks, state.solution)
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
    bound = chi2_limit(2 * len(pairs) + state.rows * fewer, STRICT if not fewer else limits.mode_alarm)
    now = state.solve(merged)
    return now if now is not None and now.cost < state.solution.cost + bound else None


def parted(state: State, limits: Limits) -> State:
    """With modes cut in two where their lower and upper harmonics ask for different exponents, and a fit agrees."""
    bound, refused = chi2_limit(2, STRICT), set()
    while int((~state.solution.entries.fixed).sum()) < limits.modes:
        entries = state.solution.entries
        cuts = [best_cut(state.solution, int(e)) for e in np.flatnonzero(~entries.fixed & ~entries.real)]
        cuts = [
            c for c in cuts if c is not None and c.gain > bound and complex(entries.exponents[c.entry]) not in refused
        ]
        if not cuts:
            return state
        best = max(cuts, key=lambda cut: cut.gain)
        now = state.solve(_cut(entries, best.entry, best.harmonic, best.moved))
        if now is not None and state.solution.cost - now.cost > bound:
            other = _with_beside(state, best.entry, limits)
            ways = [now] if other is None or state.solution.cost - other.cost < _dearer(state, other) else [now, other]
            state = state.with_fit(min(ways, key=lambda way: way.cost + 2.0 * _numbers(state, way)))
        else:
            refused.add(complex(entries.exponents[best.entry]))
    return state


def _numbers(state: State, solution: Solution) -> int:
    """The numbers that a fit chooses."""
    return len(solution.gradient) + state.rows * coefficients_of(solution.entries)


def _dearer(state: State, solution: Solution) -> float:
    """Reduction of the cost by noise through the numbers that a fit has more."""
    return chi2_limit(max(_numbers(state, solution) - _numbers(state, state.solution), 1), STRICT)


def _with_beside(state: State, entry: int, limits: Limits) -> Solution | None:
    """The fit with the lines of one mode and of those that fold next to it given to all; None where there is no other.

    Where one of two modes lacks a harmonic on a line that both have, the other one seems to be several.
    """
    entries, bands = state.solution.entries, state.solution.entries.bands.copy()
    for other in np.flatnonzero(~entries.fixed & ~entries.real):
        sign, m, gap = differences(entries, entry, int(other)) or (1, 0, np.inf)
        if other == entry or abs(gap) > abs(entries.exponents[entry].real) + abs(entries.exponents[other].real):
            continue
        there, back = sign * entries.bands[other] + m, sign * (entries.bands[entry] - m)
        bands[entry] = min(bands[entry, 0], there.min()), max(bands[entry, 1], there.max())
        bands[other] = min(bands[other, 0], back.min()), max(bands[other, 1], back.max())
    if (bands == entries.bands).all():
        return None
    now = state.solve(replace(entries, bands=bands))
    return None if now is None else with_bands(state.with_fit(now), limits).solution


def _cut(entries: ModeParameters, entry: int, harmonic: int, moved: tuple[complex, complex]) -> ModeParameters:
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
    residual = entries.picked([k for k in range(len(entries.exponents)) if k != entry])
    return residual.joined(ModeParameters.made([value for value, _ in parts], [ends for _, ends in parts], omega))
