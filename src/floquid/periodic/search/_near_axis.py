r"""Pairs near an axis in a fit: two exponents by their mean and squared half-difference, of either kind.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

Near an axis, 0 or half the fundamental, a pair of conjugates and two real multipliers are one model, and σ and q are
determined where neither kind is: at the edge of a parametric resonance q goes through zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.errors import IdentificationError
from floquid.periodic.least_squares import EVEN, ODD, AxisPair, ModeParameters, solve
from floquid.periodic.search._state import SearchResult, State, coefficients_of

BESIDE = 1.0
"""Distance from an axis, over the decay, within which a pair and its conjugate share their lines."""

REAL = 1e-3
"""The probability at which noise may make a second multiplier of a real one."""

OFF = 0.1
"""Deviations of q that the reported exponents have at least between them: where both are one, shapes have no limit."""


def with_axis_pairs(state: State, bands: Integers) -> tuple[State, Integers]:
    """The fit with each pair near an axis, and each two real multipliers of one sign, by their mean and difference.

    Where noise explains what a single real multiplier leaves, it is that. With the bands to report (entries, 2).
    """
    done: set[complex] = set()
    while True:
        entries = state.solution.entries
        for places, trial, kept in _candidates(entries, bands):
            own = complex(entries.exponents[places[0]] + 1j * entries.offsets[places[0]])
            if own in done:
                continue
            done.add(own)
            with suppress(IdentificationError, np.linalg.LinAlgError):
                found = solve(state.blocks, state.linearise(trial), at_rest=1e-2, iterations=20, hold=True)
                if (found.entries.fixed != trial.fixed).any():
                    continue
                state, bands = _single(state.with_fit(found), kept)
                break
        else:
            return state, bands


def _candidates(entries: ModeParameters, bands: Integers) -> Iterator[tuple[list[int], ModeParameters, Integers]]:
    """The places of modes near an axis, the entries with an even and an odd one for them, and the bands to report."""
    omega = entries.fundamental
    reals: dict[int, list[int]] = {}
    for entry in np.flatnonzero(~entries.fixed & (entries.factors == 0)):
        value = entries.exponents[entry]
        if entries.real[entry]:
            reals.setdefault(int(entries.half_turns[entry]) % 2, []).append(int(entry))
            continue
        half = round(2.0 * value.imag / omega)
        off = value.imag - 0.5 * half * omega
        if abs(off) < BESIDE * abs(value.real):
            yield [int(entry)], *_coupled(entries, bands, [int(entry)], half, float(value.real), -(off**2))
    for both in reals.values():
        if len(both) == 2:
            one, other = entries.exponents[both].real
            half = int(entries.half_turns[both[0]])
            yield both, *_coupled(entries, bands, both, half, 0.5 * (one + other), 0.25 * (one - other) ** 2)


def _coupled(
    entries: ModeParameters, bands: Integers, places: list[int], half: int, mean: float, square: float
) -> tuple[ModeParameters, Integers]:
    """The entries with an even and an odd one behind the others, as wide as those that they stand for."""
    rest = [k for k in range(len(entries.exponents)) if k not in places]
    fitted, kept = (_turns(entries, own, places) for own in (entries.bands, bands))
    low = -(half // 2) - half % 2
    ends = [(low, int(np.floor(turn - 0.5 * half))) for turn in (fitted, kept)]
    found = entries.picked(rest)
    for factor in (EVEN, ODD):
        one = ModeParameters.made([mean], [ends[0]], entries.fundamental, real=True, offsets=0.5 * half, factor=factor)
        found = found.joined(replace(one, squares=np.array([square])))
    return found, np.concatenate([bands[rest], [ends[1]] * 2])


def _turns(entries: ModeParameters, bands: Integers, places: list[int]) -> float:
    """The highest turn a period that modes near an axis have."""
    halves = np.rint(2.0 * entries.exponents.imag / entries.fundamental + 2.0 * entries.offsets)
    return float(max(np.abs(bands[place] + 0.5 * halves[place]).max() for place in places))


def _single(state: State, bands: Integers) -> tuple[State, Integers]:
    """The fit with one real multiplier for the last pair near an axis, where noise explains what that leaves."""
    from scipy.special import chdtri

    entries = state.solution.entries
    fewer = entries.picked(range(len(entries.exponents) - 1))
    last = np.arange(len(fewer.exponents)) == len(fewer.exponents) - 1
    factors, squares = np.where(last, 0, fewer.factors), np.where(last, 0.0, fewer.squares)
    for sign in (0.0, 1.0, -1.0):
        moved = fewer.exponents + last * sign * np.sqrt(max(float(entries.squares[-1]), 0.0))
        trial = replace(fewer, factors=factors, squares=squares, exponents=moved)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            found = solve(state.blocks, state.linearise(trial), at_rest=1e-2, iterations=20, hold=True)
            numbers = len(state.solution.gradient) - len(found.gradient)
            numbers += state.rows * (coefficients_of(entries) - coefficients_of(found.entries))
            if found.cost - state.solution.cost < float(chdtri(numbers, REAL)):
                return state.with_fit(found), bands[:-1]
        if entries.squares[-1] <= 0.0:
            break
    return state, bands


def read_apart(result: SearchResult) -> SearchResult:
    """The result with ordinary modes at the exponents of its pairs near an axis, behind all other entries."""
    state, bands = State(result.blocks, result.solution), result.bands
    entries = state.solution.entries
    even = np.flatnonzero(entries.even)
    if not len(even):
        return result
    covariance, omega = state.solution.covariance(), entries.fundamental
    leading = np.flatnonzero(entries.leading)
    first = len(leading) + int((~entries.fixed & ~entries.real).sum())
    rest = np.flatnonzero(~np.isin(entries.factors, (EVEN, ODD)))
    found, kept, pairs = replace(entries.picked(rest), squares=None), [*bands[rest]], {}
    for number, place in enumerate(even):
        own = [int(np.searchsorted(leading, place)), first + number]
        pair = AxisPair(
            mean=float(entries.exponents[place].real),
            square=float(entries.squares[place]),
            covariance=covariance[np.ix_(own, own)],
            half_turns=int(entries.half_turns[place]),
        )
        pairs[len(found.exponents)] = pair
        half = pair.half_turns
        least = OFF * float(np.sqrt(pair.covariance[1, 1]))
        square = pair.square if abs(pair.square) > least else float(np.copysign(least, pair.square))
        root = np.sqrt(abs(square))
        ends = np.stack([entries.bands[place], bands[place]])
        if square > 0.0:
            values = [pair.mean + root, pair.mean - root]
            one = ModeParameters.made(values, [ends[0]] * 2, omega, real=True, offsets=0.5 * half)
            kept += [ends[1]] * 2
        else:
            ends[:, 0] = -half - ends[:, 1]
            one = ModeParameters.made([pair.mean + 1j * (root + 0.5 * half * omega)], [ends[0]], omega)
            kept += [ends[1]]
        found = found.joined(one)
    solution = replace(state.linearise(found), further=_moved(state.solution.further, entries, found, rest))
    return replace(result, solution=solution, bands=np.array(kept, np.int64).reshape(-1, 2), near_axis=pairs)


def _moved(further: Floats | None, old: ModeParameters, new: ModeParameters, rest: Integers) -> Floats | None:
    """Additions to variances by the parameters of other entries: `rest` of the old ones are the first of the new."""
    if further is None:
        return None
    found = np.zeros(len(new.ties()))
    decays, turns = ([mask(own) for own in (old, new)] for mask in (_leading, _turning))
    for (of, to), first in ((decays, (0, 0)), (turns, [int(own.sum()) for own in decays])):
        kept = np.flatnonzero(to[: len(rest)])
        place = np.searchsorted(np.flatnonzero(of), rest[kept])
        found[first[1] + np.arange(len(kept))] = further[first[0] + place]
    return found


def _leading(entries: ModeParameters) -> Mask:
    return entries.leading


def _turning(entries: ModeParameters) -> Mask:
    return ~entries.fixed & ~entries.real
