"""Preparation of records for every consumer: the responses and their clocks, as the settings ask for them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Unpack

from floquid._checks import describe, input_error
from floquid._show import Brief
from floquid.core import (
    AzimuthSignal,
    Clock,
    ConstantPeriod,
    PulseTimes,
    Record,
    TachometerSignal,
    channels_named,
)
from floquid.errors import IdentificationError
from floquid.findings import Finding, texts, warning
from floquid.lti import TimeResponses
from floquid.periodic import estimate_period
from floquid.pipeline._settings import EXAMPLE, Options, Settings, settings_of, takes_settings
from floquid.pipeline._state import check_states
from floquid.pipeline.preparation._before import (
    faults_of,
    hits_of,
    later,
    missing_of,
    parted,
    repaired,
    responses_of,
    without_orbit,
)
from floquid.pipeline.preparation._driven import forces_of, refuse_driven, refuse_excited, refuse_random
from floquid.pipeline.preparation._own_names import own_names
from floquid.pipeline.preparation._refuse import (
    refuse_copies,
    refuse_period,
    refuse_short,
    refuse_unlike,
    refuse_unusable,
)
from floquid.sync import ShaftAngle, shaft_angle

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

LARGE = 20_000_000  # samples in all from which linear algebra may use all threads
NEAR = 1.5  # largest factor between the period and a first value of it
SIGNALS = (TachometerSignal, AzimuthSignal, PulseTimes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared(Brief):
    """Records as they are used, whoever uses them: which channels are responses, and what ties them to the phase.

    Parameters
    ----------
    settings
        The options.
    records
        The records after hits were cut out, the first periods and the orbit taken off and channels chosen, each with
        its clock, and with the channel of the clock if it has one.
    responses
        The same without the channel of the clock.
    clocks
        What ties each response to the phase: a constant period, or the angle of the shaft.
    shafts
        The angle of the shaft in each record; empty where the period is constant.
    findings
        What was done to the records, and how well the angle of the shaft is known.
    faults
        What is wrong with samples.
    """

    settings: Settings
    records: tuple[Record, ...]
    responses: tuple[Record, ...]
    clocks: tuple[ConstantPeriod | ShaftAngle, ...]
    shafts: tuple[ShaftAngle, ...] = ()
    findings: tuple[Finding, ...] = ()
    faults: tuple[Finding, ...] = ()


@takes_settings
def prepare(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    of: str = "identify",
    **options: Unpack[Options],
) -> Prepared:
    """The responses and their clocks, of records and settings: what `identify`, `lifted` and `floquid scan` start from.

    The clock of the settings is put on, hits are cut out or first periods left out, and so are channels that are no
    responses. The orbit of the file is subtracted, and the period or the angle of the shaft is found. What cannot end
    well is refused before any long work.

    `records`, `settings`, `report` and `options` are those of `identify`; `of` is the callable that was asked, for
    messages. Raises InputError where a record or an option is not possible. Raises IdentificationError where the record
    is too short, or its period or shaft angle is unknown or not constant enough.
    """
    chosen = settings_of(settings, options, of)
    refuse_excited(chosen, of)
    with own_names(of):
        used = clocked(records, chosen, of)
        faults = faults_of(used, repair=chosen.repair)
        try:
            found = _tied(*_free(used, chosen, of), report, of)
        except IdentificationError as error:
            raise IdentificationError("\n  ".join([str(error), *texts(faults)])) from None
    return replace(found, faults=faults)


def blas_threads(records: Sequence[Record | TimeResponses]) -> AbstractContextManager[object]:
    """Linear algebra in one thread, unless the records are large.

    The matrices are many and small: threads inside BLAS would wait for each other, on a busy machine for seconds.
    """
    few = sum(record.values.size for record in records) < LARGE
    return _thread_pools("scipy.linalg" in sys.modules).limit(limits=1 if few else None, user_api="blas")


@cache
def _thread_pools(scipy: bool) -> ThreadpoolController:  # noqa: ARG001  # scipy has a BLAS of its own
    """The thread pools of the libraries that are loaded: to look for them takes two milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def without_clock(record: Record) -> Record:
    """The record without the channel of its clock, if it has one."""
    clock = record.clock
    if not isinstance(clock, (TachometerSignal, AzimuthSignal)):
        return record
    return record.select([c.name for c in record.channels if c.name != clock.channel])


def uneven_speed(shafts: Sequence[ShaftAngle]) -> tuple[Finding, ...]:
    """Findings on shafts at whose speed a periodic model does not hold."""
    return tuple(warning("uneven_speed", reasons=shaft.reasons) for shaft in shafts if not shaft.steady)


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


def _free(
    records: tuple[Record, ...], settings: Settings, of: str
) -> tuple[tuple[Record, ...], Settings, tuple[Finding, ...]]:
    """The free responses that the records hold, cut and without other channels, the settings, and what was done."""
    if not settings.estimate_period:
        refuse_period(records, of)
    elif settings.period is not None:
        refuse_period(records, of, near=NEAR)
    forces = forces_of(records, settings)
    said = missing_of(records)
    refuse_unusable(records, of)
    if settings.repair:
        if not settings.find_hits:
            refuse_driven(records, settings)
        records, more = repaired(records)
        said += more
    if settings.find_hits:
        records, more = hits_of(records, settings)
        said += more
    elif settings.skip:
        records, more = later(records, settings.skip)
        said += more
    elif settings.repair:
        records, more = parted(records, settings)
        said += more
    records, more = responses_of(records, settings)
    said += more
    if settings.repair and not settings.estimate_period:
        refuse_random(records, forces)
    if settings.orbit:
        records, more = without_orbit(records)
        said += more
    return records, settings, said


def _tied(
    records: tuple[Record, ...], settings: Settings, said: tuple[Finding, ...], report: Callable[[str], None], of: str
) -> Prepared:
    """The responses with what ties them to the phase; what cannot be used is refused."""
    if not settings.estimate_period and any(record.clock is None for record in records):
        raise input_error(
            "records",
            of,
            "have a clock",
            "the record has none" if len(records) == 1 else "one has none",
            "Give the period: `period=`, or `read(path, period=...)`.",
        )
    responses = tuple(without_clock(record) for record in records)
    refuse_unlike(responses, of)
    refuse_copies(responses, of)
    check_states(responses[0].channels, settings)
    if settings.estimate_period:
        with blas_threads(responses):
            responses, more = _with_own_period(responses, settings.period, report)
        records, said = responses, (*said, *more)
    clocks, shafts = _clocks(records, report, of)
    refuse_short(responses, clocks)
    uneven = uneven_speed(shafts)
    if uneven and not settings.trust_period:
        raise IdentificationError(str(uneven[0]))
    said = (*said, *dict.fromkeys(own for shaft in shafts for own in shaft.findings))
    return Prepared(
        settings=settings, records=records, responses=responses, clocks=clocks, shafts=shafts, findings=said
    )


def _with_own_period(
    records: tuple[Record, ...], about: float | None, report: Callable[[str], None]
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records with the period that the response has, near `about` where that is given, and how it is known."""
    report("finding the period")
    shortest, longest, where = None, None, ""
    if about is not None:
        shortest, longest = about / NEAR, about * NEAR
        where = f" between {shortest:.6g} and {longest:.6g} s"
    found = estimate_period(records, shortest=shortest, longest=longest, report=report)
    if not found.told or found.period is None:
        wrong = "another first value (`period=`)" if about else "the period (`period=`)"
        raise IdentificationError(
            f"The response does not tell its period{where}. {' '.join(found.reasons)}\n  Give {wrong}, a tachometer "
            "(`tach=`), or a record with more cycles or less noise."
        )
    clocked = tuple(record.with_clock(ConstantPeriod(period=found.period, origin=record.start)) for record in records)
    return clocked, found.findings


def _clocks(
    records: tuple[Record, ...], report: Callable[[str], None], of: str
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
