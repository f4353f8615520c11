"""Samples that are left out of a fit, and predicted by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.checks._check import REMAINDER, Evidence, strongest
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.errors import FloquidError
from floquid.findings import Finding, failure
from floquid.fit import RARE, REST
from floquid.innovations import GONE
from floquid.inputs import Samples
from floquid.periodic import refit, unexplained

LEAST_FIT = 1.0 - REMAINDER  # the share of the response that has to be predicted on cycles held out

ERROR = 1.0 + REMAINDER
"""The prediction error over noise and its own deviation that is let pass in any case; a tenth more over a stretch."""

KEPT = 0.75
"""The share of each record, from when its inputs move on, that a model is fitted to for the check on the rest."""

FAILING = 1.4
"""Factor of the limit from which on a model fails, twice over a stretch; where the excitation goes on, over
what is expected."""

FOLDS = 5
"""Parts that cycles, or records, are dealt into, pieces of a record in each, and stretches with errors of their own."""

PARTS = 4  # parts of a cycle, every other one left out of a brief hit: the rest of it tells the states

ALIVE = 0.2  # the rms of the response in a cycle, over the noise, below which there is nothing to predict


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Errors of a prediction of samples that were left out of a fit."""

    arrays: Mapping[str, Floats]  # `held_out_error`, and `fit` of free responses, for the reader (channels, hits)
    sizes: Mapping[str, tuple[float, float, float | None]]  # by name: an error, its limit, from where on a model fails
    numbers: Mapping[str, Any]  # where the largest is, and its size
    fit: float | None = None  # the share of the response that is predicted
    least: Mapping[str, Any] | None = None  # where that is least


def left_out(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Findings on samples that were left out of a fit and are not predicted by it."""
    try:
        errors, why = case.left_out(), failure("held_out_too_few")
    except (FloquidError, np.linalg.LinAlgError) as error:
        errors, why = None, failure("held_out_singular", error=str(error).rstrip("."))
    if errors is None:
        return evidence.missing(case.predicted, why)
    evidence.arrays |= errors.arrays
    if any(np.isinf(value) for value, *_ in errors.sizes.values()):
        return evidence.missing(case.predicted, failure("held_out_grows"))
    findings: tuple[Finding, ...] = ()
    if errors.fit is not None and not evidence.kept("fit", errors.fit, LEAST_FIT, at_least=True):
        findings = evidence.against("held_out_fit", "fit", fit=errors.fit, **errors.least)
    kept = [evidence.kept(name, value, limit, failing=most) for name, (value, limit, most) in errors.sizes.items()]
    if not all(kept):
        share = 0.0 if errors.fit is None else 1.0 - evidence.metrics.get("fit", 0.0)
        findings += evidence.against("held_out_error", *errors.sizes, share=share, **errors.numbers)
    return findings


def of_cycles(case: Any, sums: HeldOut) -> LeftOut:
    """Errors of cycles of free responses that were left out, of sums of their squares."""
    from scipy.special import chdtri

    nothing = np.full(case.noise.shape, np.nan)
    alarm = RARE / case.responses
    numbers, squares = sums.numbers.sum(axis=2), sums.own.sum(axis=2)
    most = chdtri(np.maximum(numbers, 1), alarm)
    beyond, response = np.maximum(squares - most, 0.0), sums.response.sum(axis=2) - numbers
    seen = response > np.maximum(most - numbers, 0.0)
    fit = np.where(seen, 1.0 - np.sqrt(beyond / np.where(seen, response, 1.0)), np.nan)
    total = response[seen].sum()
    worst = (strongest(np.where(seen, 1.0 - fit, 0.0)) or [(0, 0)])[0]
    whole = _worst(squares, numbers, alarm, ERROR)
    along = _worst(sums.own, sums.numbers, alarm / sums.numbers.shape[2], 1.0 + 2.0 * (ERROR - 1.0))
    channel, hit, stretch = along[2]
    part = ("first", "middle", "last")[min(3 * stretch // sums.numbers.shape[2], 2)]
    error = np.sqrt(np.divide(sums.squares.sum(axis=2), numbers, out=nothing.copy(), where=numbers > 0))
    return LeftOut(
        arrays={"fit": fit, "held_out_error": error},
        sizes={"held_out_error": (*whole[:2], FAILING * whole[1]), "held_out_stretch": (*along[:2], 2.0 * along[1])},
        numbers={"ratio": along[0], "part": f"{part} part", **case.place(channel, hit)},
        fit=float(1.0 - np.sqrt(beyond[seen].sum() / total)) if total else 1.0,
        least={"least": fit[worst], **case.place(*worst)},
    )


def _worst(squares: Floats, numbers: Integers, alarm: float, least: float) -> tuple[float, float, tuple[int, ...]]:
    """The root of a mean square that most exceeds its limit, the limit, and where it is."""
    from scipy.special import chdtri

    size = np.maximum(numbers, 1)
    ratio = np.sqrt(np.maximum(squares, 0.0) / size)
    limit = np.maximum(np.sqrt(chdtri(size, alarm) / size), least)
    place = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio / limit)), ratio.shape))
    return float(ratio[place]), float(limit[place]), place


def quiet_for(inputs: Floats) -> int:
    """Samples at the start of a record in which no input moves; none where none ever does."""
    return int((inputs != inputs[:, :1]).any(axis=0).argmax())


def without_last(samples: Samples) -> tuple[Samples, Mask]:
    """The samples, those after the first three quarters of each record not measured, and the mask of the others."""
    # They are not cut off: the states of modes that grow are followed backwards, from the end of each record.
    mask = first_part(samples)[1]
    fitted = mask & samples.there
    return replace(samples, values=samples.values * fitted, known=samples.known * fitted, there=fitted), mask


def first_part(samples: Samples) -> tuple[Samples, Mask]:
    """The first three quarters of each record, and their mask over the samples of all (samples,)."""
    # What is at its begin before any input moves is none of the four: a model needs inputs.
    kept = []
    for piece in samples.records:
        quiet = quiet_for(samples.inputs[:, piece])
        kept.append(slice(piece.start, piece.start + quiet + int(KEPT * (piece.stop - piece.start - quiet))))
    mask = np.zeros(samples.n_samples, bool)
    for piece in kept:
        mask[piece] = True
    return samples.only(mask, (0, *np.cumsum([piece.stop - piece.start for piece in kept]).tolist())), mask


Clocks = Sequence[PhaseClock]


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Sums of squares that the prediction of held-out cycles leaves, over the noise squared."""

    numbers: Integers  # samples predicted (channels, hits, stretches)
    squares: Floats  # Σ e²/σ² (channels, hits, stretches)
    own: Floats  # Σ e r/σ², with r what the model fitted to all cycles leaves: chi-square (channels, hits, stretches)
    response: Floats  # Σ y²/σ² (channels, hits, stretches)


def held_out(
    model: PeriodicModel, records: Sequence[Record], clocks: Clocks, cycles: Sequence[Integers], noise: Floats
) -> HeldOut | None:
    r"""Interleaved pieces of the record, in turn left out of the fit and predicted.

    With e the error of the prediction and r what the fit to all of the cycles leaves, linear least squares have
    e = (I - H)⁻¹ r, H the part of the hat matrix of the cycles left out, and so

    .. math:: \frac{e^T r}{\sigma^2} = e^T \big(\sigma^2 (I - H)^{-1}\big)^{-1} e \sim \chi^2_n

    which is the error over the noise *and* the prediction's own variance, without either being formed. Brief hits that
    share their shapes are left out one after the other, except for parts of each cycle that tell their states.

    `cycles` are those of the samples, as `cycles_of` tells them. None where there are too few; IdentificationError
    where the model cannot be fitted to what is left of the record.
    """
    alive = [only(record, numbers_of_hit >= 0) for record, numbers_of_hit in zip(records, cycles, strict=True)]
    whole = refit(model, alive, clocks, noise=noise, at_rest=REST, one_shape=model.one_shape)
    folds = _folds(whole, cycles)
    if folds is None:
        return None
    residuals = unexplained(whole, alive, clocks)
    shape = (len(model.channels), model.n_hits, folds.stretches)
    numbers, squares, products, response = np.zeros(shape, np.int64), *np.zeros((3, *shape))
    for mine in folds.masks:
        rest = [only(record, ~out) for record, out in zip(alive, mine, strict=True)]
        anew = refit(whole, rest, clocks, noise=noise, at_rest=REST, one_shape=whole.one_shape, hold=True)
        away = [only(record, out) for record, out in zip(alive, mine, strict=True)]
        for hit, errors in enumerate(unexplained(anew, away, clocks)):
            taken = np.flatnonzero(mine[hit])
            place = (cycles[hit][taken] - folds.first) * folds.stretches // (folds.end - folds.first)
            place = np.minimum(place, folds.stretches - 1)
            e, r, y = errors[:, taken], residuals[hit][:, taken], records[hit].values[:, taken]
            there = ~np.isnan(y)
            for target, values in ((numbers, there), (squares, e * e), (products, e * r), (response, y * y)):
                counted = np.where(there, values, 0.0)
                for channel, row in enumerate(counted):
                    target[channel, hit] += np.bincount(place, row, folds.stretches).astype(target.dtype)
    weight = 1.0 / noise[:, :, None] ** 2
    return HeldOut(numbers, squares * weight, products * weight, response * weight)


@dataclass(frozen=True, slots=True)
class Folds:
    """Samples left out together, a mask of each hit in each fold, and the cycles that they are of."""

    masks: list[list[Mask]]
    first: int
    end: int
    stretches: int


def _folds(model: PeriodicModel, cycles: Sequence[Integers]) -> Folds | None:
    """Pieces of some cycles in all hits, or parts of each cycle of some brief hits; None where there are too few."""
    last = max(int(numbers.max()) for numbers in cycles)
    # A cycle that alone contains a short-lived mode cannot be predicted by the others
    rates = model.exponents.real * model.period
    first, end = int((rates < -GONE).any()), last + 1 - int((rates > GONE).any())
    folds = min(FOLDS, (end - first) // 2)
    if model.one_shape and folds < 2:
        return _of_hits(cycles, last + 1)
    if folds < 2:
        return None
    shortest = float((1.0 / np.maximum(np.abs(model.exponents.real) * model.period, 1e-12)).min())
    piece = int(max(1, min((end - first) // (folds * FOLDS), 0.5 * shortest)))
    # A hit that one fold would take whole stays in all fits.
    long = [int(c.max()) + 1 >= first + 2 * piece for c in cycles]
    masks = [
        [
            (c >= first) & (c < end) & ((c - first) // piece % folds == fold) & enough
            for c, enough in zip(cycles, long, strict=True)
        ]
        for fold in range(folds)
    ]
    return Folds(masks, first, end, min(FOLDS, max(1, (end - first) // (folds * piece))))


def _of_hits(cycles: Sequence[Integers], end: int) -> Folds | None:
    """Every other part of the cycles of some hits, then the parts between, then those of other hits."""
    groups = min(FOLDS, len(cycles))
    parts = []
    for numbers in cycles:
        places = np.zeros(len(numbers), np.int64)
        for cycle in range(int(numbers.max()) + 1):
            inside = np.flatnonzero(numbers == cycle)
            places[inside] = np.arange(len(inside)) * PARTS // max(len(inside), 1)
        parts.append(places)
    masks = [
        [
            (numbers >= 0) & (place % 2 == side) & (hit % groups == group)
            for hit, (numbers, place) in enumerate(zip(cycles, parts, strict=True))
        ]
        for group in range(groups)
        for side in range(2)
    ]
    return Folds(masks, 0, end, 1) if end > 0 else None


def cycles_of(model: PeriodicModel, instants: Sequence[tuple[Floats, Floats]], noise: Floats) -> list[Integers]:
    """The whole cycle that each sample of each record is in, from its first sample on; -1 in none, or a dead one."""
    phases = np.linspace(0.0, model.period, 4 * len(model.harmonics), endpoint=False)
    shapes = model.shapes(phases) * np.exp(np.multiply.outer(model.exponents, phases))[:, None, None]
    cycles = []
    for hit, (times, angles) in enumerate(instants):
        turns = (angles - angles[0]) / (2.0 * np.pi)
        number = int(turns[-1] * (1.0 + 1.0 / max(len(turns) - 1, 1)) + 1e-9)
        decays = np.exp(np.multiply.outer(times[0] + np.arange(number) * model.period, model.exponents))
        response = np.einsum("nr,rcp->cnp", decays, shapes[:, :, hit], optimize=True).real
        power = np.mean((response / noise[:, hit, None, None]) ** 2, axis=2).max(axis=0)
        alive = np.flatnonzero(power > ALIVE**2)
        end = int(alive[-1]) + 1 if len(alive) else 0
        cycle = np.floor(turns + 1e-9).astype(np.int64)
        cycles.append(np.where(cycle < end, cycle, -1))
    return cycles


def only(record: Record, there: Mask) -> Record:
    """The record with the other samples left out."""
    values = np.where(there, record.values, np.nan)
    values.flags.writeable = False
    return replace(record, values=values)
