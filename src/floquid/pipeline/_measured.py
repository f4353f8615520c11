"""Records as they really come: fitted at the times at which they were sampled.

This way is gone where the samples are not a whole number a period, a tachometer tells the angle, samples are missing,
the period is to be found, or a forced response lies beside the free one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import AzimuthSignal, ConstantPeriod, Estimates, PulseTimes, Record, TachometerSignal
from floquid.errors import IdentificationError, InputError, NotSynchronousError
from floquid.lifting import floor_of, lift
from floquid.lti import fit_residues
from floquid.order import Choice
from floquid.periodic import EndlessError, Fit, estimate_at, estimate_period, fit, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._doubts import ambiguity, warnings, wrong_angles, wrong_measured_period
from floquid.pipeline._find_poles import find_poles
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import state_of
from floquid.sync import ShaftAngle, rejoin, resample, samples_per_period, segment, shaft_angle

NOT_WHOLE = "a period that is no whole number of samples"

UNCUT = {
    "whole number": NOT_WHOLE,
    "phases": "records sampled at different phases",
    "rates": "records sampled at different rates",
}
"""Why records cannot be cut into whole samples a period, by what `NotSynchronousError` says."""

FEW = 8
"""Modes, a pair counted once, at which it is looked whether the record holds any."""

NOT_MODES = (
    "As it was sampled, it falls into ever more lines of a spectrum, as noise that is not white does, an impulse or a "
    "step."
)

NEAR = 1.5
"""How far from a first value the period may be, as a factor."""

SIGNALS = (TachometerSignal, AzimuthSignal, PulseTimes)


def why_measured(records: tuple[Record, ...], settings: Settings) -> str:
    """Why the records cannot be cut into periods as they are; empty where they can."""
    if any(isinstance(record.clock, SIGNALS) for record in records):
        return "a shaft angle that is measured"
    if settings.estimate_period:
        return "a period that is to be found"
    if settings.forced not in ("auto", "none"):
        return "a forced response"
    if any(np.isnan(record.values).any() for record in records):
        return "missing samples"
    return _why_uncut(records)


def _why_uncut(records: tuple[Record, ...]) -> str:
    """Why records of constant period cannot be cut into whole samples; empty where they can."""
    try:
        for record in records:
            samples_per_period(record)
        segment(records)
    except NotSynchronousError as error:
        return UNCUT[error.why]
    return ""


def measured(
    records: tuple[Record, ...],
    settings: Settings,
    report: Callable[[str], None],
    *,
    said: tuple[str, ...] = (),
) -> Analysis:
    """The chain for records as they were sampled.

    Parameters
    ----------
    records
        The records with their clocks.
    settings
        The options.
    report
        Is told of each stage.
    said
        What was done to the records before, a sentence each.

    Returns
    -------
    Analysis
        The result; its `records` are the free response resampled to whole samples a period.
    """
    if settings.estimate_period:
        records, words = _with_own_period(records, settings.period, report)
        said += words
    responses, clocks, shafts = _clocks(records, report)
    unsteady = tuple(_unsteady(shaft) for shaft in shafts if not shaft.steady)
    if unsteady and not settings.trust_period:
        raise IdentificationError(unsteady[0])
    found = _fitted(responses, clocks, settings, report)
    report("resampling the free response")
    period = found.model.period
    steady = [_steady(clock, record, period) for clock, record in zip(clocks, responses, strict=True)]
    cycles = resample(found.free, steady)
    synchronous = tuple(rejoin(hit) for hit in cycles)
    lifted = lift(cycles, floor=settings.noise_floor)
    doubt = ""
    if not (shafts or settings.estimate_period):
        doubt = wrong_measured_period(found, lifted, responses)
    if doubt and not settings.trust_period:
        raise IdentificationError(doubt)
    most = max(hit.n_cycles for hit in cycles)
    if found.model.order >= most - 1:
        raise IdentificationError(
            f"The record holds {most} whole periods, too few for the {found.model.order} poles that were found in it. "
            "Record longer, or check the period."
        )
    blurred = wrong_angles(found, shafts, responses) if shafts else ""
    modal = fit_residues(found.model.multipliers, lifted.responses)
    model = replace(found.model, provenance=lifted.provenance)

    def again(exponents: NDArray[np.complex128]) -> Estimates:
        free, forced = found.free, found.forced
        return estimate_at(model, exponents, records=free, clocks=clocks, noise=found.noise, forced=forced)

    state, refinement = state_of(model, settings, again, report)
    choice = Choice(order=model.order, model=modal, reasons=found.reasons, doubts=found.doubts)
    own = tuple(dict.fromkeys(reason for shaft in shafts for reason in shaft.reasons))
    return Analysis(
        settings=settings,
        records=synchronous,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        refinement=refinement,
        choice=None if settings.order is not None else choice,
        fit=found,
        measured=records,
        shafts=shafts,
        held=True,
        # Without `lifted`: resampling moves lines by more than their deviations.
        periodicity=None if model.unselected is None else periodicity(model),
        synchronisation=(*said, *own, *_said_of(found)),
        warnings=tuple(" ".join(word.split()) for word in (doubt, *unsteady, blurred) if word)
        + (ambiguity(choice) if settings.order is None else ())
        + warnings(model),
    )


def _fitted(
    records: Sequence[Record],
    clocks: Sequence[ConstantPeriod | ShaftAngle],
    settings: Settings,
    report: Callable[[str], None],
) -> Fit:
    """The fit; where it finds many modes, only if the records, lifted and whitened, hold a mode at all.

    As it was sampled, a record is not whitened: of coloured noise, of an impulse or of a step, the search would make
    modes without end.
    """
    fitted = partial(
        fit,
        records,
        clocks,
        forced=settings.forced_harmonics,
        periods_per_revolution=settings.periods_per_revolution,
        order=settings.order,
        harmonics=settings.harmonics,
        free_period=settings.estimate_period,
        noise_floor=floor_of((row for record in records for row in record.values), settings.noise_floor),
        mode_false_alarm=settings.mode_false_alarm,
        harmonic_false_alarm=settings.harmonic_false_alarm,
        report=report,
    )
    try:
        return fitted(few=FEW)
    except EndlessError:
        report("looking whether there is a mode at all")
    try:
        find_poles(lift(resample(records, clocks), floor=settings.noise_floor), settings)
    except InputError:
        pass  # samples are missing, or too few: that tells nothing
    except IdentificationError as error:
        raise IdentificationError(f"{error}\n  {NOT_MODES}") from None
    return fitted()


def _with_own_period(
    records: tuple[Record, ...], about: float | None, report: Callable[[str], None]
) -> tuple[tuple[Record, ...], tuple[str, ...]]:
    """The records with the period that the response has, near `about` where that is given, and how it is known.

    Raises
    ------
    InputError
        `about` is too short for the sampling.
    IdentificationError
        The response does not tell its period.
    """
    report("finding the period")
    shortest, longest, where = None, None, ""
    if about is not None:
        shortest, longest = about / NEAR, about * NEAR
        least = 2.0 / min(record.sample_rate for record in records)
        if longest <= least:
            must, got = f"be two sampling intervals ({least:.6g} s) or more", f"is {about:.6g} s"
            raise input_error("period", "Settings", must, got, "Check its unit and that of the sampling rate.")
        where = f" between {shortest:.6g} and {longest:.6g} s"
    found = estimate_period(records, shortest=shortest, longest=longest, report=report)
    if not found.told or found.period is None:
        wrong = "another first value (`--period`)" if about else "the period (`--period`)"
        raise IdentificationError(
            f"The response does not tell its period{where}. {' '.join(found.reasons)}\n  Give {wrong}, a tachometer "
            "(`--tach`), or a record with more cycles or less noise."
        )
    clocked = tuple(record.with_clock(ConstantPeriod(period=found.period, origin=record.start)) for record in records)
    return clocked, found.reasons


def _clocks(
    records: tuple[Record, ...], report: Callable[[str], None]
) -> tuple[list[Record], list[ConstantPeriod | ShaftAngle], tuple[ShaftAngle, ...]]:
    """The responses without the channel of the clock, and what ties each to the phase."""
    responses, clocks, shafts = [], [], []
    for record in records:
        clock = record.clock
        if isinstance(clock, SIGNALS):
            report("finding the angle of the shaft")
            shaft = shaft_angle(record)
            shafts.append(shaft)
            clocks.append(shaft)
            if not isinstance(clock, PulseTimes):
                record = record.select([c.name for c in record.channels if c.name != clock.channel])
        else:
            assert clock is not None
            clocks.append(clock)
        responses.append(record)
    if shafts and len(shafts) < len(clocks):
        must, got = "all have a measured shaft angle, or none", "some have"
        raise input_error("records", "identify", must, got, "Give each its clock.")
    return responses, clocks, tuple(shafts)


def _steady(clock: ConstantPeriod | ShaftAngle, record: Record, period: float) -> ConstantPeriod:
    """A clock of constant period, its phase zero at that of the record's begin."""
    if isinstance(clock, ConstantPeriod):
        return ConstantPeriod(period=period, origin=record.start - clock.phase(record.start) * clock.period)
    turns = float(clock.angle(np.array([record.start]))[0]) * clock.periods_per_revolution / (2.0 * np.pi)
    begin = clock.time_at(np.array([2.0 * np.pi * np.floor(turns + 1e-9) / clock.periods_per_revolution]))
    return ConstantPeriod(period=period, origin=float(begin[0]))


def _unsteady(shaft: ShaftAngle) -> str:
    return (
        f"The speed of the shaft is not constant enough for a periodic model: {' '.join(shaft.reasons)} Use a part of "
        "the record where it is, or pass `trust_period=True` (`--trust-period`)."
    )


def _said_of(found: Fit) -> tuple[str, ...]:
    """The forced response, in words."""
    forced = found.forced
    if forced is None:
        return ()
    said = []
    if len(forced.harmonics):
        largest = forced.amplitudes.max(axis=1) / found.noise[:, :1]
        parts = [
            f"{j} a revolution (up to {largest[:, k].max():.3g} times the noise)"
            for k, j in enumerate(forced.harmonics)
        ]
        follows = ", let follow the speed" if forced.speed_dependent else ""
        said.append(f"A forced response was fitted beside the modes{follows}: {', '.join(parts)}.")
    else:
        said.append("No harmonic of the revolution rises above the noise beside the modes.")
    if forced.offset.any():
        said.append("An offset of the channels was fitted beside the modes.")
    if forced.drift.any():
        said.append("A drift of the channels, linear in time, was fitted beside the modes.")
    return tuple(said)
