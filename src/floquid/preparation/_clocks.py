"""Clocks of records and states of A(t): the channels that the settings name for them, and the angle of a shaft."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from floquid._arrays import Floats
from floquid._checks import input_error, wrong_value
from floquid.core import (
    AzimuthSignal,
    Channel,
    Clock,
    ConstantPeriod,
    LazyRecord,
    PhaseClock,
    PulseTimes,
    Record,
    TachometerSignal,
    channels_named,
)
from floquid.errors import InputError
from floquid.findings import Finding
from floquid.preparation._settings import ALL, EXAMPLE, Settings
from floquid.sync import ShaftAngle, pulse_times, shaft_angle, tied

OF = "identify"


def clocked(records: Record | Sequence[Record], settings: Settings, of: str) -> tuple[Record, ...]:
    """The records with the channels and the clock of the settings."""
    several = (records,) if isinstance(records, Record) else tuple(records) if isinstance(records, Iterable) else ()
    if not several or not all(isinstance(r, Record) for r in several):
        remedy = f"Read files with `read`; of arrays write `{of}({EXAMPLE}, period=T)`."
        if isinstance(records, LazyRecord):
            remedy = "One that is larger than memory is identified by `identify_large`; others are read without `lazy`."
        raise wrong_value("records", of, "be a Record or a list of them", records, remedy)
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
        raise input_error("events", OF, "leave a channel of responses", "is the only one", "Read the responses, too.")
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
        must, got = "have a clock", "the record has none" if len(records) == 1 else "one has none"
        raise input_error("records", of, must, got, "Give the period: `period=`, or `read(path, period=...)`.")


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
    from floquid.reconstruction import AbstractStructure, as_they_are, displacements, structure_of

    names = states_of(channels, settings)
    if isinstance(names, str):
        return
    if settings.form == "second-order":
        displacements(channels, names, of=OF)
    elif settings.form == "first-order":
        as_they_are(channels, names, of=OF)
    else:
        channels_named(channels, names, argument="states", of=OF)
    structure = structure_of(settings.structure) if settings.structure else None
    if isinstance(structure, AbstractStructure):
        structure.basis(len(names))


def states_of(channels: Sequence[Channel], settings: Settings) -> str | tuple[str, ...]:
    """The states as `reconstruct` takes them: "all" is a channel where one is called so."""
    alone = settings.states == (ALL,) and ALL not in {channel.name for channel in channels}
    return ALL if alone else settings.states


def in_phase(findings: Sequence[Finding]) -> bool:
    """True where these findings say that periods lie between events: their phase is given, and not to be doubted."""
    return any(own.code == "between_events" for own in findings)
