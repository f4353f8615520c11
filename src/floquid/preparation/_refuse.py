"""Refusals of records before any long work: a period that cannot be, and channels that tell nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from hashlib import sha256

import numpy as np

from floquid._checks import input_error, refuse_size
from floquid.core import PhaseClock, Record
from floquid.errors import IdentificationError, InputError
from floquid.preparation._settings import Settings
from floquid.sync import LARGEST_DRIFT, wrapped

FEWEST = 4  # whole periods that a record must hold: fewer cannot hold a mode and the noise beside it
LEAST = 2.0
"""Sampling intervals that a period must last: of shorter ones, a harmonic of the period would alias onto its mean."""

SLACK = 0.5  # samples that a record may lack of the fewest periods: rates and periods are rounded
NAMED = 3  # of many gaps, or slips of the unit, those that are named one by one
NO_NEWS = "a copy adds no knowledge, but would make the deviations too small."


def refuse_period(records: Sequence[Record], of: str, *, near: float = 1.0) -> None:
    r"""Refuse a constant period that is too short for the sampling, or too long for the record.

    .. math:: 2 / f_s \le T \le D / 4

    with D the duration of the longest record. A record that is sampled once a period, to the sample over its length,
    is let through: lifted, it is that of a constant system. Where the period would be possible in another unit, the
    message says so. `near` is the factor by which the period may still change, where it is a first value.

    A record of fewer than 4 periods is an IdentificationError.
    """
    clocked = [(r, r.period) for r in records if r.period is not None]
    for record, period in clocked:
        samples = period * record.sample_rate
        if near * samples < LEAST * (1.0 - 1e-9) and not _once_a_period(samples, record):
            least = LEAST / record.sample_rate
            must, got = f"be two sampling intervals or more ({least:.6g} s)", f"is {period:.6g} s"
            remedy = _slip(period, record) or "Check the units of the period and of the sampling rate."
            raise input_error("period", of, must, got, remedy)
    if not clocked:
        return
    longest, period = max(clocked, key=lambda one: _held(*one))
    if near * longest.duration < period:
        must, got = f"be shorter than the record ({longest.duration:.6g} s)", f"is {period:.6g} s"
        remedy = _slip(period, longest) or "Check the unit of the period, or use a longer record."
        raise input_error("period", of, must, got, remedy)
    if near == 1.0:
        refuse_few(_held(longest, period), slip=_slip(period, longest))


def refuse_short(records: Sequence[Record], clocks: Sequence[PhaseClock]) -> None:
    """Refuse records that are all shorter than 4 periods."""
    turned = any(clock.measured for clock in clocks)
    check = (
        "the pulses and periods of a revolution (`pulses_per_revolution=`, `periods_per_revolution=`)" if turned else ""
    )
    refuse_few(max(_held(r, clock.period) for r, clock in zip(records, clocks, strict=True)), check)


def refuse_few(periods: float, check: str = "", slip: str = "") -> None:
    """Refuse a record of fewer than 4 periods, one whose last lacks a little among them."""
    if periods < FEWEST:
        whole = int(periods)
        raise IdentificationError(
            f"The record holds {whole} whole period{'' if whole == 1 else 's'}: fewer than {FEWEST} cannot hold a mode "
            f"and the noise beside it. Record longer, or check {check or 'the period'}."
            + (f"\n  {slip}" if slip else "")
        )


def _once_a_period(samples: float, record: Record) -> bool:
    """True where a period of this number of samples is the only one in the record."""
    return abs(samples - 1.0) * record.n_samples <= LARGEST_DRIFT


def _held(record: Record, period: float) -> float:
    """Length of a record in periods."""
    return (record.n_samples + SLACK) / (period * record.sample_rate)


def _slip(period: float, record: Record) -> str:
    """In which other unit the period, or the sampling rate, would be possible; empty where it would be in none."""
    rate, duration = record.sample_rate, record.duration
    inverse, minute = 1.0 / period, 60.0 / period
    frequency = f"if {inverse:.6g} was meant in s, and no frequency"
    hertz = frequency if period * rate < LEAST else f"1/{period:.6g}, if {period:.6g} was meant in Hz"
    fits = [
        f"{value:.6g} s ({meant}) would fit: `period={value:.6g}`"
        for value, meant in (
            (inverse, hertz),
            (minute, f"if {period:.6g} was meant in revolutions a minute"),
            (period / 1e3, "if it was meant in ms"),
            (60.0 * period, f"if the frequency of {inverse:.6g} was meant in revolutions a minute"),
        )
        if value * rate >= LEAST and FEWEST * value <= duration
    ]
    if 1e3 * period * rate >= LEAST and 1e3 * FEWEST * period <= duration:
        fits.append(
            f"a sampling rate of {1e3 * rate:.6g} Hz (if times or rate were meant in ms or kHz) would fit: "
            f"`rate={1e3 * rate:.6g}`"
        )
    return f"{'; or '.join(fits[:NAMED])}." if fits else ""


def refuse_unusable(records: Sequence[Record], of: str = "identify") -> None:
    """Refuse a response that has no samples, does not vary, wrapped round, or cannot be computed with."""
    from floquid.lifting import refuse_values

    for number, record in enumerate(records, start=1):
        rows = [row for row, channel in enumerate(record.channels) if channel.name != record.clock_channel]
        refuse_values([record.channels[row] for row in rows], record.values[rows], f"record {number}", of=of)
        for fault in wrapped(record):
            must, remedy = "hold the samples that were measured", "Read them as wider integers, or measure anew."
            raise input_error("records", of, must, f"in record {number} {fault.clause}", remedy)


def refuse_sizes(records: Sequence[Record], of: str) -> None:
    """Refuse a channel that cannot be computed with, whatever it is used for but a clock."""
    for number, record in enumerate(records, start=1):
        for channel, values in zip(record.channels, record.values, strict=True):
            if channel.name != record.clock_channel:
                largest = float(np.fmax.reduce(np.abs(values), initial=0.0))
                refuse_size(largest, f"channel {channel.name!r} of record {number}", "records", of)


def refuse_copies(records: Sequence[Record], of: str = "identify") -> None:
    """Refuse a channel or a hit that is a copy of another: its noise would count as independent of the other's."""
    seen: dict[bytes, str] = {}
    for hit, record in enumerate(records, start=1):
        for channel, values in zip(record.channels, record.values, strict=True):
            name = name_of(channel.name, hit, len(records))
            found = seen.setdefault(sha256(values.tobytes()).digest(), name)
            if found != name and np.ptp(values) > 0.0:
                must, got = "be independent measurements", f"{name} is a copy of {found}, sample by sample"
                raise input_error("records", of, must, got, f"Leave one of them out: {NO_NEWS}")


def name_of(channel: str, hit: int, hits: int) -> str:
    """Name of a channel of a hit in messages."""
    return f"channel {channel!r}" + (f" of record {hit}" if hits > 1 else "")


_SUBJECT = re.compile(r"Argument `([^`]*)` of `([^`]*)` must ")

_STRUCTURES = ("structure_of", "Block", "SecondOrder", "FirstOrder")

_OWN = {"names": "channels", "channel": "tach", "shortest": "period", "longest": "period"}
"""Options by the arguments of inner functions where these have other names; what is none is of the records."""


@contextmanager
def own_names(of: str) -> Iterator[None]:
    """The errors of what is called within, as errors of the callable `of` that takes records and the settings."""
    try:
        yield
    except InputError as error:
        match = _SUBJECT.match(str(error))
        if match is None or match[2] in (of, "Settings"):
            raise
        name = "structure" if match[2] in _STRUCTURES else _OWN.get(match[1], match[1])
        name = name if name in {field.name for field in fields(Settings)} else "records"
        raise type(error)(f"Argument `{name}` of `{of}` must {str(error)[match.end() :]}") from error
