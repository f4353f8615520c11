"""Cycles that are left out, predicted by the model fitted to the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.periodic import refit, unexplained
from floquid.sync import ShaftAngle

Clocks = Sequence[ConstantPeriod | ShaftAngle]

FOLDS = 5  # the parts that the cycles are dealt into
PHASES = 32  # instants of a period at which the response is looked at, to see where it has died
ALIVE = 0.2  # the rms of the response in a cycle, over the noise, below which there is nothing to predict
PIECES = 5  # pieces of a record in each fold, where it has that many cycles

BRIEF = 2.0
"""Cycles in which a mode may decay so that the cycle that holds most of it can still be predicted from the others."""

PARTS = 4  # parts of a cycle, every other one left out of a brief hit: the rest of it tells the states

STRETCHES = 8  # stretches of the record in each of which the error is looked at
AT_REST = 0.1  # the deviations that the last step of a refit may have: what comes after is far below the noise


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Sums of squares that the prediction of held-out cycles leaves, over the noise squared."""

    numbers: Integers  # samples predicted (channels, hits, stretches)
    squares: Floats  # Σ e²/σ² (channels, hits, stretches)
    own: Floats  # Σ e r/σ², with r what the model fitted to all cycles leaves: chi-square (channels, hits, stretches)
    response: Floats  # Σ y²/σ² (channels, hits, stretches)


def held_out(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Clocks,
    cycles: Sequence[Integers],
    noise: Floats,
) -> HeldOut | None:
    r"""Interleaved pieces of the record, in turn left out of the fit and predicted.

    With e the error of the prediction and r what the fit to all of the cycles leaves, linear least squares have
    e = (I - H)⁻¹ r, H the part of the hat matrix of the cycles left out, and so

    .. math:: \frac{e^T r}{\sigma^2} = e^T \big(\sigma^2 (I - H)^{-1}\big)^{-1} e \sim \chi^2_n

    which is the error over the noise *and* the prediction's own variance, without either being formed. Brief hits that
    share their shapes are left out one after the other, but for parts of each cycle that tell their states.

    `cycles` are those of the samples, as `cycles_of` tells them. None where there are too few; IdentificationError
    where the model cannot be fitted to what is left of the record.
    """
    alive = [only(record, own >= 0) for record, own in zip(records, cycles, strict=True)]
    whole = refit(model, alive, clocks, noise=noise, at_rest=AT_REST, one_shape=model.one_shape)
    folds = _folds(whole, cycles)
    if folds is None:
        return None
    left = unexplained(whole, alive, clocks)
    shape = (len(model.channels), model.n_hits, folds.stretches)
    numbers, squares, own, response = np.zeros(shape, np.int64), *np.zeros((3, *shape))
    for mine in folds.masks:
        rest = [only(record, ~out) for record, out in zip(alive, mine, strict=True)]
        anew = refit(whole, rest, clocks, noise=noise, at_rest=AT_REST, one_shape=whole.one_shape)
        away = [only(record, out) for record, out in zip(alive, mine, strict=True)]
        for hit, errors in enumerate(unexplained(anew, away, clocks)):
            taken = np.flatnonzero(mine[hit])
            place = (cycles[hit][taken] - folds.first) * folds.stretches // (folds.end - folds.first)
            place = np.minimum(place, folds.stretches - 1)
            e, r, y = errors[:, taken], left[hit][:, taken], records[hit].values[:, taken]
            there = ~np.isnan(y)
            for target, values in ((numbers, there), (squares, e * e), (own, e * r), (response, y * y)):
                counted = np.where(there, values, 0.0)
                for channel, row in enumerate(counted):
                    target[channel, hit] += np.bincount(place, row, folds.stretches).astype(target.dtype)
    weight = 1.0 / noise[:, :, None] ** 2
    return HeldOut(numbers, squares * weight, own * weight, response * weight)


@dataclass(frozen=True, slots=True)
class Folds:
    """Samples left out together, a mask of each hit in each fold, and the cycles that they are of."""

    masks: list[list[Mask]]
    first: int
    end: int
    stretches: int


def _folds(model: PeriodicModel, cycles: Sequence[Integers]) -> Folds | None:
    """Pieces of some cycles in all hits, or parts of each cycle of some brief hits; None where there are too few."""
    last = max(int(own.max()) for own in cycles)
    first, end = _predictable(model, last + 1)
    folds = min(FOLDS, (end - first) // 2)
    if model.one_shape and folds < 2:
        return _of_hits(cycles, last + 1)
    if folds < 2:
        return None
    shortest = float((1.0 / np.maximum(np.abs(model.exponents.real) * model.period, 1e-12)).min())
    piece = int(max(1, min((end - first) // (folds * PIECES), 0.5 * shortest)))
    # A hit that one fold would take whole stays in all fits.
    long = [int(c.max()) + 1 >= first + 2 * piece for c in cycles]
    masks = [
        [
            (c >= first) & (c < end) & ((c - first) // piece % folds == fold) & enough
            for c, enough in zip(cycles, long, strict=True)
        ]
        for fold in range(folds)
    ]
    return Folds(masks, first, end, min(STRETCHES, max(1, (end - first) // (folds * piece))))


def _of_hits(cycles: Sequence[Integers], end: int) -> Folds | None:
    """Every other part of the cycles of some hits, then the parts between, then those of other hits."""
    groups = min(FOLDS, len(cycles))
    parts = []
    for own in cycles:
        places = np.zeros(len(own), np.int64)
        for cycle in range(int(own.max()) + 1):
            inside = np.flatnonzero(own == cycle)
            places[inside] = np.arange(len(inside)) * PARTS // max(len(inside), 1)
        parts.append(places)
    masks = [
        [
            (own >= 0) & (place % 2 == side) & (hit % groups == group)
            for hit, (own, place) in enumerate(zip(cycles, parts, strict=True))
        ]
        for group in range(groups)
        for side in range(2)
    ]
    return Folds(masks, 0, end, 1) if end > 0 else None


def cycles_of(model: PeriodicModel, instants: Sequence[tuple[Floats, Floats]], noise: Floats) -> list[Integers]:
    """The whole cycle that each sample of each record is in, from its first sample on; -1 in none, or a dead one."""
    phases = np.arange(PHASES) / PHASES * model.period
    shapes = model.shapes(phases) * np.exp(np.multiply.outer(model.exponents, phases))[:, None, None]
    found = []
    for hit, (times, angles) in enumerate(instants):
        turns = (angles - angles[0]) / (2.0 * np.pi)
        number = int(turns[-1] * (1.0 + 1.0 / max(len(turns) - 1, 1)) + 1e-9)
        decays = np.exp(np.multiply.outer(times[0] + np.arange(number) * model.period, model.exponents))
        response = np.einsum("nr,rcp->cnp", decays, shapes[:, :, hit], optimize=True).real
        power = np.mean((response / noise[:, hit, None, None]) ** 2, axis=2).max(axis=0)
        alive = np.flatnonzero(power > ALIVE**2)
        end = int(alive[-1]) + 1 if len(alive) else 0
        cycle = np.floor(turns + 1e-9).astype(np.int64)
        found.append(np.where(cycle < end, cycle, -1))
    return found


def _predictable(model: PeriodicModel, cycles: int) -> tuple[int, int]:
    """The cycles of those that the others can tell: not the one that holds all there is of a brief mode."""
    rates = model.exponents.real * model.period
    return int((rates < -1.0 / BRIEF).any()), cycles - int((rates > 1.0 / BRIEF).any())


def only(record: Record, there: Mask) -> Record:
    """The record with the other samples left out."""
    values = np.where(there, record.values, np.nan)
    values.flags.writeable = False
    return replace(record, values=values)
