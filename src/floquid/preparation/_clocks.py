"""Clocks of records and states of A(t): the channels that the settings name for them, and the angle of a shaft."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import describe, input_error
from floquid.core import (
    AzimuthSignal,
    Channel,
    Clock,
    ConstantPeriod,
    Cycles,
    LazyRecord,
    PhaseClock,
    PulseTimes,
    Record,
    TachometerSignal,
    channels_named,
)
from floquid.errors import InputError
from floquid.findings import Finding, note
from floquid.fit import ROUNDS
from floquid.lifting import FLOOR
from floquid.lti import Ensemble, TimeResponses, pooled_noise
from floquid.preparation._settings import ALL, EXAMPLE, Settings
from floquid.reconstruction import AbstractStructure, displacement_rows, structure_of
from floquid.sync import ShaftAngle, between_events, pulse_times, refuse_unlike, rejoin, shaft_angle, tied

OF = "identify"


def clocked(records: Record | Sequence[Record], settings: Settings, of: str) -> tuple[Record, ...]:
    """The records with the channels and the clock of the settings."""
    several = (records,) if isinstance(records, Record) else tuple(records) if isinstance(records, Iterable) else ()
    if not several or not all(isinstance(r, Record) for r in several):
        remedy = f"Read files with `read`; of arrays write `{of}({EXAMPLE}, period=T)`."
        if isinstance(records, LazyRecord):
            remedy = "One that is larger than memory is identified by `identify_large`; others are read without `lazy`."
        raise input_error("records", of, "be a Record or a list of them", f"is {describe(records)}", remedy)
    used = []
    for record in several:
        if settings.events is not None and not (record.clock is not None and record.clock.cycles):
            record = _marked(record, settings.events)
        clock = _clock(record, settings)
        own = [clock.channel] if clock is not None and clock.channel is not None else []
        option = "records" if clock is None else clock.option
        if channels_named(record.channels, own, argument=option, of=of) and record.n_channels == 1:
            got = f"one has {own[0]!r} alone, which is its clock"
            raise input_error("records", of, "have a channel of responses", got, "Read the responses, too.")
        if settings.channels:
            beside = [name for name in (*own, *settings.inputs) if name not in settings.channels]
            record = record.select([*settings.channels, *beside])
        used.append(record if clock is None else record.with_clock(clock))
    return tuple(used)


def _clock(record: Record, settings: Settings) -> Clock | None:
    """The clock that the settings name, or the record's own."""
    turns = settings.periods_per_revolution
    if settings.tach is not None:
        return TachometerSignal(
            channel=settings.tach,
            pulses_per_revolution=settings.pulses_per_revolution,
            periods_per_revolution=turns,
        )
    if settings.azimuth is not None:
        return AzimuthSignal(channel=settings.azimuth, periods_per_revolution=turns)
    if settings.period is not None:
        return ConstantPeriod(period=settings.period, origin=record.origin)
    return record.clock


def _marked(record: Record, channel: str) -> Record:
    """The record without its channel of events, and with their times as its clock."""
    channels_named(record.channels, [channel], argument="events", of=OF)
    try:
        record = with_events(record, pulse_times(record, channel))
    except InputError as error:
        raise InputError(str(error).replace("`channel` of `pulse_times`", f"`events` of `{OF}`")) from error
    names = [own.name for own in record.channels if own.name != channel]
    if not names:
        remedy = "Read the responses, too."
        raise input_error("events", OF, "leave a channel of responses", "is the only one", remedy)
    return record.select(names)


def with_events(record: Record, times: Floats) -> Record:
    """The record whose periods lie between events at these `times` [s]."""
    return record.with_clock(PulseTimes(times=times, cycles=True))


def without_clock(record: Record) -> Record:
    """The record without the channel of its clock, if it has one."""
    if record.clock_channel is None:
        return record
    return record.select([c.name for c in record.channels if c.name != record.clock_channel])


def refuse_no_clock(records: Sequence[Record], of: str) -> None:
    """Refuse records that nothing ties to the phase."""
    if any(record.clock is None for record in records):
        got = "the record has none" if len(records) == 1 else "one has none"
        remedy = "Give the period: `period=`, or `read(path, period=...)`."
        raise input_error("records", of, "have a clock", got, remedy)


def shafts_of(records: Sequence[Record], report: Callable[[str], None], of: str) -> tuple[ShaftAngle, ...]:
    """Angle of the shaft in each record; none where all state their period."""
    shafts: list[ShaftAngle] = []
    for record in records:
        if record.period is None:
            report("finding the angle of the shaft")
            shafts.append(shaft_angle(record))
    if shafts and len(shafts) < len(records):
        must, got = "all have a measured shaft angle, or none", "some have"
        raise input_error("records", of, must, got, "Give each its clock.")
    return tuple(shafts)


def clocks_of(records: Sequence[Record], shafts: tuple[ShaftAngle, ...]) -> tuple[PhaseClock, ...]:
    """Clocks that say the phase in each record: its own, or the angle of its shaft where that is measured."""
    return shafts or tuple(map(tied, records))


def steadied(records: Sequence[Record], shafts: Sequence[ShaftAngle]) -> Record | None:
    """The response with a constant period, a first value, where a shaft's pulses are coarse and say no more.

    It is at the phase of the shaft in the middle of the record. None where pulses say more, and of several records:
    what pulses say to a sample does not tell whether all turned equally fast.
    """
    if len(shafts) != 1 or not shafts[0].coarse:
        return None
    (record,), (shaft,) = records, shafts
    origin = shaft.phase_zero(record.start + 0.5 * record.duration)
    return without_clock(record).with_clock(ConstantPeriod(period=shaft.period, origin=origin, fitted=True))


def check_states(channels: Sequence[Channel], settings: Settings) -> None:
    """Refuse states that are not in the records, and a structure that cannot be one of them, before any long work."""
    names = states_of(channels, settings)
    if isinstance(names, str):
        return
    if settings.form == "second-order":
        displacement_rows(channels, names, of=OF)
    else:
        channels_named(channels, names, argument="states", of=OF)
    structure = structure_of(settings.structure) if settings.structure else None
    if isinstance(structure, AbstractStructure):
        structure.basis(len(names))


def states_of(channels: Sequence[Channel], settings: Settings) -> str | tuple[str, ...]:
    """The states as `reconstruct` takes them: "all" is a channel where one is called so."""
    alone = settings.states == (ALL,) and ALL not in {channel.name for channel in channels}
    return ALL if alone else settings.states


def by_events(
    records: tuple[Record, ...], settings: Settings, of: str
) -> tuple[tuple[Record, ...], Settings, tuple[Finding, ...]]:
    """The records in phase as of one constant period, without their common orbit, the settings for them, and notes.

    The period is the mean over all records. Of one record or two the orbit is left to the fit, as a forced response.
    Records without events are returned as they are.
    """
    if not any(record.clock is not None and record.clock.cycles for record in records):
        return records, settings, ()
    refuse_unlike(records, of)
    cycles = between_events(records)
    lengths = np.concatenate([hit.periods for hit in cycles])
    period, findings = float(lengths.mean()), []
    numbers = {"periods": len(lengths), "period": period, "spread": float(lengths.std() / period)}
    findings.append(note("between_events", records=len(cycles), phases=cycles[0].n_phases, **numbers))
    forced = settings.forced
    if forced == "auto" and len(cycles) > 2 and not any(np.isnan(hit.values).any() for hit in cycles):
        orbit = common_orbit(cycles, settings.mode_false_alarm)
        cycles = tuple(replace(hit, values=hit.values - orbit[:, :, None]) for hit in cycles)
        findings.append(note("common_orbit", records=len(cycles), periods=len(lengths)))
        forced = "none"
    used = [
        replace(rejoin(replace(hit, periods=np.full(hit.n_cycles, period))), point=record.point)
        for hit, record in zip(cycles, records, strict=True)
    ]
    return tuple(used), replace(settings, events=None, forced=forced), tuple(findings)


def in_phase(findings: Sequence[Finding]) -> bool:
    """True where these findings say that periods lie between events: their phase is given, and not to be doubted."""
    return any(own.code == "between_events" for own in findings)


def common_orbit(cycles: Sequence[Cycles], false_alarm: float) -> Floats:
    r"""The orbit that all records are about, beside decays of their own (channels, phases).

    .. math:: y_{r}[k] = o + \sum_j \psi_j\, l_{r,j}\, \mu_j^k

    Differences of successive periods have no orbit: they give the multipliers μ and the states l μ^k, beside which o is
    the constant of a linear regression over all periods of all records. The modes are then fitted without that orbit,
    and the orbit is taken again. Without a mode it is the mean.
    """
    values = [np.concatenate(list(hit.values)) for hit in cycles]  # (channels · phases, periods)
    channels, phases, _ = cycles[0].values.shape
    orbit, order = np.concatenate(values, axis=1).mean(axis=1), None
    identifier, several = Ensemble(false_alarm=false_alarm), [own for own in values if own.shape[1] > 1]
    for look in range(ROUNDS if several else 0):
        part = [own - orbit[:, None] for own in several] if look else [np.diff(own) for own in several]
        data = _responses(part, channels)
        model = identifier.extract(identifier.prepare(data), order)
        order = model.order
        if not order:
            break
        lengths = [own.shape[1] for own in several]
        columns = [np.ones(sum(lengths)), *_states(model.multipliers, model.residues, lengths)]
        whole = np.concatenate(several, axis=1)
        orbit = np.linalg.lstsq(np.array(columns).T, whole.T, rcond=None)[0][0]
    return orbit.reshape(channels, phases)


def _states(multipliers: Complexes, residues: Complexes, lengths: Sequence[int]) -> Floats:
    """Real and imaginary parts of the state of each mode in all periods of all records (2 modes, periods)."""
    largest = np.abs(residues).max(axis=2).argmax(axis=1)  # the output where a mode is seen best
    first = residues[np.arange(len(multipliers)), largest]
    steps = np.arange(max(lengths))
    each = [first[:, [hit]] * multipliers[:, None] ** steps[:length] for hit, length in enumerate(lengths)]
    states = np.concatenate(each, axis=1)[multipliers.imag >= 0.0]
    return np.concatenate([states.real, states[np.abs(states.imag).max(axis=1) > 0.0].imag])


def _responses(values: Sequence[Floats], channels: int) -> TimeResponses:
    """The periods of all records (outputs, periods), one a hit, with the noise of each channel."""
    lengths = [own.shape[1] for own in values]
    padded = np.zeros((len(values[0]), len(values), max(lengths)))
    for hit, own in enumerate(values):
        padded[:, hit, : lengths[hit]] = own
    phases = len(padded) // channels
    noise = pooled_noise([[own[row * phases : (row + 1) * phases] for own in values] for row in range(channels)])
    floor = np.abs(padded).max() * FLOOR
    return TimeResponses(
        values=padded, dt=1.0, noise=np.repeat(np.maximum(noise, floor), phases, axis=0), lengths=lengths
    )
