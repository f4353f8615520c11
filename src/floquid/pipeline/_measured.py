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

from floquid.core import ConstantPeriod, Estimates, Record
from floquid.errors import IdentificationError, InputError, NotSynchronousError
from floquid.lifting import floor_of, lift
from floquid.lti import fit_residues
from floquid.order import Choice
from floquid.periodic import EndlessError, Fit, estimate_at, fit, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._doubts import ambiguity, warnings, wrong_angles, wrong_measured_period
from floquid.pipeline._find_poles import find_poles
from floquid.pipeline._prepare import SIGNALS, Prepared, unsteady
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import state_of
from floquid.sync import ShaftAngle, rejoin, resample, samples_per_period, segment

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


def measured(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    """The chain for records as they were sampled.

    Parameters
    ----------
    prepared
        The responses and their clocks.
    report
        Is told of each stage.

    Returns
    -------
    Analysis
        The result; its `records` are the free response resampled to whole samples a period.
    """
    settings, responses, clocks, shafts = prepared.settings, prepared.responses, prepared.clocks, prepared.shafts
    uneven = tuple(unsteady(shaft) for shaft in shafts if not shaft.steady)
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
        measured=prepared.records,
        shafts=shafts,
        held=True,
        # Without `lifted`: resampling moves lines by more than their deviations.
        periodicity=None if model.unselected is None else periodicity(model),
        synchronisation=(*prepared.findings, *_said_of(found)),
        warnings=tuple(" ".join(word.split()) for word in (doubt, *uneven, blurred) if word)
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


def _steady(clock: ConstantPeriod | ShaftAngle, record: Record, period: float) -> ConstantPeriod:
    """A clock of constant period, its phase zero at that of the record's begin."""
    if isinstance(clock, ConstantPeriod):
        return ConstantPeriod(period=period, origin=record.start - clock.phase(record.start) * clock.period)
    turns = float(clock.angle(np.array([record.start]))[0]) * clock.periods_per_revolution / (2.0 * np.pi)
    begin = clock.time_at(np.array([2.0 * np.pi * np.floor(turns + 1e-9) / clock.periods_per_revolution]))
    return ConstantPeriod(period=period, origin=float(begin[0]))


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
