"""Start of the fit of the samples: the records lifted, the forced response taken off, and the poles of the rest."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import BRIDGED, Cycles, PhaseClock, Record, longest_run, over_gaps, runs_of
from floquid.errors import IdentificationError, NotSynchronousError
from floquid.findings import note
from floquid.fit import HALF_DIGITS, QUIET
from floquid.lifting import Lifted, lift, whitened
from floquid.lti import ModalModel, Outcome
from floquid.order import Choice
from floquid.periodic import Known, ModeParameters, followed, without_known
from floquid.pipeline.free._doubts import quiet
from floquid.pipeline.free._find_poles import UnsettledError, find_poles, first_filter
from floquid.preparation import (
    Options,
    Prepared,
    Settings,
    blas_threads,
    prepare,
    refuse_excited,
    refuse_few,
    settings_of,
    takes_settings,
)
from floquid.sync import ShaftAngle, resample, segment

FLOORS = (QUIET, 10.0 * QUIET, 100.0 * QUIET)
"""Shares of a channel's largest value, above its noise, down to which a record is believed, one after another, where
what modes leave is no noise."""

SHORTEST = 0.25  # the share of a record that must be there in one piece for the rest to be left out of the start
FAR = 0.05  # the wander of the shaft's angle [rad of the system] from which on lifting in angle makes modes of its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Lifting:
    """Responses lifted, with the forced response in them."""

    cycles: tuple[Cycles, ...]  # the responses cut into periods
    lifted: Lifted
    synchronous: bool  # whether they are the samples themselves, and not resampled
    speeds: tuple[Floats, ...] | None = None
    """Factors by which a forced response follows the speed (factors, cycles), one array a hit; None at a steady one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Poles of the lifted responses, and what they were found beside."""

    whole: Lifted  # the responses with the forced response in them, through the filter that whitens the noise
    lifted: Lifted  # the same without the forced response
    raw: Lifted  # those before the filter
    known: Known | None  # what the forced response was taken to be; None where none was to be looked for
    modal: ModalModel | None
    choice: Choice | None
    """The poles, and what speaks for their number; None where the record itself is searched for them: the speed wanders
    too far for lifting, or samples are missing."""
    floor: float | None = None
    """The share of the largest value down to which the record is believed; None for that of the settings."""
    begin: ModeParameters | None = None
    """Modes that the samples are fitted from where there are no poles of lifted responses; None for none."""


def cut(prepared: Prepared) -> Lifting:
    """The responses cut into whole samples a period, resampled where they have none, and lifted."""
    settings, speeds = prepared.settings, None
    synchronous = not out_of_step(prepared.responses, prepared.clocks)
    if synchronous:
        cycles = segment(prepared.responses)
    else:
        periods = [BRIDGED * clock.period for clock in prepared.clocks]
        cycles = resample(filled(prepared.responses, periods), prepared.clocks)
        if prepared.shafts:
            if any(np.ptp(hit.periods) > HALF_DIGITS * hit.period for hit in cycles):
                speeds = tuple(followed(1.0 / hit.periods) for hit in cycles)
            period = float(np.mean([shaft.period for shaft in prepared.shafts]))
            cycles = tuple(replace(hit, periods=np.full(hit.n_cycles, period)) for hit in cycles)
    refuse_impossible(settings, cycles)
    lifted = lift(cycles, floor=settings.noise_floor)
    return Lifting(cycles=cycles, lifted=lifted, synchronous=synchronous, speeds=speeds)


def filled(records: Sequence[Record], longest: Sequence[float]) -> tuple[Record, ...]:
    """The records with cubics over missing samples: good enough to start from, and for nothing else."""
    whole = []
    for record, limit in zip(records, longest, strict=True):
        missing = np.isnan(record.values)
        if missing.any():
            most = limit * record.sample_rate
            long = np.zeros(record.n_samples, bool)
            for absent in missing:
                for begin, end in runs_of(absent):
                    long[begin:end] |= end - begin > most
            if np.diff(longest_run(~long))[0] < SHORTEST * record.n_samples:
                long[:] = False
            rows = zip(record.values, missing, strict=True)
            values = np.concatenate([over_gaps(own[None], absent) for own, absent in rows])
            record = replace(record, values=np.where(long, np.nan, values))
        whole.append(record)
    return tuple(whole)


def out_of_step(responses: Sequence[Record], clocks: Sequence[PhaseClock]) -> str:
    """The code for why responses are not whole samples a period as they are; empty where they are."""
    if any(clock.measured for clock in clocks):
        return "angle"
    if any(clock.fitted for clock in clocks):
        return "own period"
    if any(np.isnan(record.values).any() for record in responses):
        return "missing"
    try:
        segment(responses)
    except NotSynchronousError:
        return "no whole number"
    return ""


def start_of(prepared: Prepared, cutting: Lifting, report: Callable[[str], None]) -> Start:
    """The poles of the lifted responses beside their forced response."""
    settings, lifted = prepared.settings, cutting.lifted
    by_default = settings.identifier is None and settings.order is None and settings.constrained
    floors = [None, *(floor for floor in FLOORS if by_default and quiet(lifted, floor))]
    until = time.process_time() + settings.seconds
    while True:
        chosen = settings if floors[0] is None else replace(settings, noise_floor=floors[0])
        whole = lifted if floors[0] is None else lift(cutting.cycles, floor=floors[0])
        raw, known, taps = without_forced(whole, prepared, cutting)
        turning = zip(prepared.shafts, prepared.responses, strict=False)
        from_lines = Start(whole=whole, lifted=raw, raw=raw, known=known, modal=None, choice=None)
        gaps = by_default and any(np.isnan(record.values).any() for record in prepared.responses)
        if gaps or any(_wander(shaft, record) > FAR for shaft, record in turning):
            return from_lines  # samples that are filled in make poles of their own, or hide those of the record
        try:
            free, modal, choice = find_poles(raw, chosen, report, taps=taps)
        except UnsettledError:
            if len(floors) > 1 and time.process_time() < until:
                floors = floors[1:]
                continue
            if cutting.synchronous or not by_default:
                raise
            return from_lines  # what is left may be that of samples that were resampled
        except IdentificationError as error:
            if known is None or not known.turns:
                raise
            raise IdentificationError(f"{error} {note('beside_steady', turns=known.turns)}") from None
        if modal.outcome is Outcome.OUT_OF_TIME and by_default and not cutting.synchronous:
            return from_lines  # the samples themselves are searched, and hold what resampled ones do
        if free.whitening is not None:
            whole = whitened(whole, free.whitening)
        return Start(
            whole=replace(whole, floor=free.floor).with_noise(free.noise) if known else free,
            lifted=free,
            raw=raw,
            known=known,
            modal=modal,
            choice=choice,
            floor=floors[0],
        )


def _wander(shaft: ShaftAngle, record: Record) -> float:
    """Largest difference of the system's angle from that of a steady speed [rad]."""
    since, angles = record.times - record.times[0], shaft.angle(record.times) * shaft.periods_per_revolution
    return float(np.abs(angles - np.polyval(np.polyfit(since, angles, 1), since)).max())


def without_forced(lifted: Lifted, prepared: Prepared, cutting: Lifting) -> tuple[Lifted, Known | None, Floats | None]:
    """The responses without their forced response, what that is (None: not asked for), and filters that whiten them."""
    if prepared.settings.forced == "none":
        return lifted, None, first_filter(lifted)
    nu = prepared.clocks[0].periods_per_revolution or prepared.settings.periods_per_revolution
    halves = not prepared.shafts and prepared.settings.forced == "auto"
    return without_known(lifted, nu, speeds=cutting.speeds, halves=halves)


def refuse_impossible(settings: Settings, cycles: Sequence[Cycles]) -> None:
    """Refuse what cannot end well before any long work."""
    of, periods, phases = "identify", max(c.n_cycles for c in cycles), cycles[0].n_phases
    refuse_few(max(c.n_cycles for c in cycles))
    if getattr(settings.identifier, "band", None) is not None:
        must = "look at the whole band, since what is left out would count as noise"
        got = f"has band={settings.identifier.band}"  # type: ignore[union-attr]
        raise input_error("identifier", of, must, got, "Use the identifier's own `extract` on lifted responses.")
    if settings.order is not None and settings.order >= periods:
        got = f"is {settings.order}"
        raise input_error("order", of, f"be less than the {periods} periods of the record", got, "Ask for fewer poles.")
    if settings.harmonics is not None and 2 * settings.harmonics >= phases:
        must = f"be less than half the {phases} samples a period"
        raise input_error("harmonics", of, must, f"is {settings.harmonics}", "Ask for fewer, or sample faster.")


@takes_settings
def lifted(
    records: Record | Sequence[Record] | Prepared,
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: Unpack[Options],
) -> Lifted:
    """The lifted responses of records, with the noise of each channel and hit: what `identify` searches for poles.

    The channels and cycles are those of `identify`. Records with a tachometer, a rate out of step or missing samples
    are resampled to whole samples a period. Where the noise is coloured along the record, the responses are whitened.

    `records`, or what `prepare` made of them, `settings`, `report`, `options` and the errors are those of `identify`;
    what is set of the stages after lifting changes nothing.
    """
    if not isinstance(records, Prepared):
        chosen = settings_of(settings, options, "lifted")
        refuse_excited(chosen)
        records = prepare(records, chosen, report=report, of="lifted")
    elif settings is not None or options:
        must, got = "be left out with records that are prepared", "is given"
        name = "settings" if settings is not None else next(iter(options))
        raise input_error(name, "lifted", must, got, "Give it to `prepare`.")
    with blas_threads(records.responses):
        report("cutting into periods")
        found = cut(records).lifted
        report("estimating the noise")
        taps = first_filter(found)
        return found if taps is None else whitened(found, taps)
