"""Clocks of records: those that the settings name, and the angle of a shaft."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from floquid._checks import describe, input_error
from floquid.core import AzimuthSignal, Clock, ConstantPeriod, PulseTimes, Record, TachometerSignal, channels_named
from floquid.preparation._settings import EXAMPLE, Settings
from floquid.sync import ShaftAngle, shaft_angle

SIGNALS = (TachometerSignal, AzimuthSignal, PulseTimes)


def clocked(records: Record | Sequence[Record], settings: Settings, of: str) -> tuple[Record, ...]:
    """The records with the channels and the clock of the settings."""
    several = (records,) if isinstance(records, Record) else tuple(records) if isinstance(records, Iterable) else ()
    if not several or not all(isinstance(r, Record) for r in several):
        remedy = f"Read files with `read`; of arrays write `{of}({EXAMPLE}, period=T)`."
        raise input_error("records", of, "be a Record or a list of them", f"is {describe(records)}", remedy)
    used = []
    for record in several:
        clock = _clock(record, settings)
        own = [clock.channel] if isinstance(clock, (TachometerSignal, AzimuthSignal)) else []
        option = "azimuth" if isinstance(clock, AzimuthSignal) else "tach"
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
        origin = record.clock.origin if isinstance(record.clock, ConstantPeriod) else 0.0
        return ConstantPeriod(period=settings.period, origin=origin)
    return record.clock


def without_clock(record: Record) -> Record:
    """The record without the channel of its clock, if it has one."""
    clock = record.clock
    if not isinstance(clock, (TachometerSignal, AzimuthSignal)):
        return record
    return record.select([c.name for c in record.channels if c.name != clock.channel])


def refuse_no_clock(records: Sequence[Record], of: str) -> None:
    """Refuse records that nothing ties to the phase."""
    if any(record.clock is None for record in records):
        got = "the record has none" if len(records) == 1 else "one has none"
        remedy = "Give the period: `period=`, or `read(path, period=...)`."
        raise input_error("records", of, "have a clock", got, remedy)


def clocks_of(
    records: Sequence[Record], report: Callable[[str], None], of: str
) -> tuple[tuple[ConstantPeriod | ShaftAngle, ...], tuple[ShaftAngle, ...]]:
    """Clock of each record, and those of them that are angles of a shaft."""
    clocks: list[ConstantPeriod | ShaftAngle] = []
    for record in records:
        if isinstance(record.clock, SIGNALS):
            report("finding the angle of the shaft")
            clocks.append(shaft_angle(record))
        else:
            assert record.clock is not None
            clocks.append(record.clock)
    shafts = tuple(clock for clock in clocks if isinstance(clock, ShaftAngle))
    if shafts and len(shafts) < len(clocks):
        must, got = "all have a measured shaft angle, or none", "some have"
        raise input_error("records", of, must, got, "Give each its clock.")
    return tuple(clocks), shafts
