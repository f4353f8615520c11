"""Summary of a file, as `floquid info` prints it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Floats
from floquid._checks import positive
from floquid.core import Channel, Quantity, Record
from floquid.errors import InputError
from floquid.readers._read import load_table
from floquid.tables import TimeAxis, record_of, settle_axis, with_names

ClockKind: TypeAlias = Literal["period", "pulses", "azimuth", "speed"]
"""Kinds of candidates for the clock: `identify` takes all but a speed, which is only a hint."""

_CLOCK_NAME = re.compile(
    r"(?<![a-z])(tacho?s?|tachometer|pulses?|key ?phas\w*|encoder|azimuth|trigger|revs?|revolutions?"
    r"|(?:shaft|rotor|crank|phase) ?(?:angle|position|phase)|theta|psi|rpm)(?![a-z])",
    re.IGNORECASE,
)  # a word in the name of a channel that may be a clock

_TURNS = {"deg": 360.0, "rad": 6.283185307179586}  # a revolution in the units of an angle
_SPEEDS = ("rpm", "RPM", "Hz", "rad/s", "deg/s")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelSummary:
    """One channel in numbers.

    Parameters
    ----------
    name, quantity, unit
        As in `Channel`.
    minimum, maximum, std
        Extremes and standard deviation of the samples that are there [unit]; None if all are missing.
    n_missing
        How many are missing.
    place
        Frame, group, member and axis as `Channel.place` has them, given or understood by the name.
    """

    name: str
    quantity: Quantity | None
    unit: str
    minimum: float | None
    maximum: float | None
    std: float | None
    n_missing: int
    place: str = ""

    @property
    def is_constant(self) -> bool:
        """True where every sample that is there has one value."""
        return self.minimum is not None and self.minimum == self.maximum


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockCandidate:
    """Something in the file that may tie its time to the phase of the system.

    Parameters
    ----------
    name
        The name of a channel, or "period" for the period that the file states.
    why
        The reasons for thinking so, in words.
    kind
        What it is: a "period", a channel of "pulses" (a tachometer), an "azimuth", or a "speed", which is no clock.
    is_sure
        Whether the samples or the quantity say so, not the name alone.
    """

    name: str
    why: str
    kind: ClockKind = "pulses"
    is_sure: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class FileSummary:
    """Summary of a file.

    Parameters
    ----------
    path, format
        The file, and the name of its format.
    channels
        One summary a channel.
    n_samples
        Samples of each channel, those missing in a gap counted.
    sample_rate
        [Hz], or None when the file does not say it or its times cannot be used; `notes` has the reason.
    duration, start
        Samples over rate, and the time of the first sample [s]; None without a rate.
    period
        The period that the file states [s], or None.
    clock_candidates
        What may tie time to phase, with the reason for thinking so.
    notes
        How the rate was found, and what deserves attention.
    time_axis
        How the times were understood: the first of the notes.
    point
        The operating point that the file states: numbers by name.
    """

    path: str
    format: str
    channels: tuple[ChannelSummary, ...]
    n_samples: int
    sample_rate: float | None
    duration: float | None
    start: float | None
    period: float | None
    clock_candidates: tuple[ClockCandidate, ...]
    notes: tuple[str, ...]
    time_axis: tuple[str, ...] = ()
    point: Mapping[str, float] = field(default_factory=dict)


def describe_file(
    path: str | PathLike[str],
    *,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    header: bool = True,
) -> FileSummary:
    """Summary of a file: channels, units, rate, candidates for the clock.

    It is what `floquid info` prints. A file whose time axis cannot be settled is described all the same, without a
    rate, and a note says why. Raises InputError where the file cannot be read, or is not what its format must be; an
    argument is not possible. `path` is the file, `rate` the sampling rate [Hz], overriding what the file says, and
    `channels` those to describe, in that order; None describes all. `names` are their names, as `read` takes them.
    `header` is False for a text table without names.
    """
    return read_and_describe(path, rate=rate, channels=channels, names=names, header=header)[0]


def read_and_describe(
    path: str | PathLike[str],
    *,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    header: bool = True,
) -> tuple[FileSummary, Record | None]:
    """The summary of a file as `describe_file` has it, and its record where it can be read as one."""
    if rate is not None:
        rate = positive(rate, "rate", "describe_file", unit="Hz", remedy="Pass the number of samples a second.")
    source, kind, table = load_table(
        path, of="describe_file", channels=channels, ignore_time=rate is not None, header=header
    )
    table = table if names is None else with_names(table, names, source)
    notes: tuple[str, ...]
    try:
        axis = settle_axis(table, source, rate)
        notes = axis.notes if axis else ("No sampling rate in the file: pass `rate=` [Hz] to read it.",)
    except InputError as error:
        axis, notes = None, (" ".join(str(error).split()),)
    time_axis = notes
    values = table.values if axis is None else axis.place(table.values)
    found = tuple(_summary(channel, row) for channel, row in zip(table.channels, values, strict=True))
    for channel in found:
        if channel.minimum is None:
            notes += (f"Channel {channel.name!r} has no sample at all.",)
        elif channel.is_constant:
            notes += (f"Channel {channel.name!r} is constant ({channel.minimum:g} {channel.unit}): nothing moves it.",)
    if values.shape[1] < 2:
        notes += ("One sample is too few to be read as a record.",)
    record = None
    if axis is not None and values.shape[1] > 1:
        with suppress(InputError):  # what else is wrong with the file is said when it is read
            record = record_of(table, source, rate=rate, period=None, origin=0.0)
    summary = FileSummary(
        path=str(source.path),
        format=f"{kind.name} ({kind.suffix})",
        channels=found,
        n_samples=values.shape[1],
        sample_rate=axis.sample_rate if axis else None,
        duration=values.shape[1] / axis.sample_rate if axis else None,
        start=axis.start if axis else None,
        period=table.period,
        clock_candidates=_candidates(table.period, table.channels, values, axis),
        notes=(*notes, *table.notes),
        time_axis=time_axis,
        point=table.point,
    )
    return summary, record


def _summary(channel: Channel, row: Floats) -> ChannelSummary:
    there = row[np.isfinite(row)]
    return ChannelSummary(
        name=channel.name,
        quantity=channel.quantity,
        unit=channel.unit,
        minimum=float(there.min()) if there.size else None,
        maximum=float(there.max()) if there.size else None,
        std=_std(there) if there.size else None,
        n_missing=len(row) - len(there),
        place=channel.place,
    )


def _std(there: Floats) -> float:
    """The standard deviation, also of numbers whose squares overflow, as damage makes them."""
    scale = float(np.abs(there).max())
    with np.errstate(over="ignore"):
        return float((there / scale).std() * scale) if scale > 1e100 else float(there.std())


def _candidates(
    period: float | None, channels: tuple[Channel, ...], values: Floats, axis: TimeAxis | None
) -> tuple[ClockCandidate, ...]:
    found = []
    if period is not None:
        phases = f", {period * axis.sample_rate:.9g} samples" if axis else ""
        why = f"the file states a period of {period:.9g} s{phases}"
        found.append(ClockCandidate(name="period", why=why, kind="period", is_sure=True))
    for channel, row in zip(channels, values, strict=True):
        row = np.where(np.abs(row) < 1e300, row, np.nan)  # damage; its differences would overflow
        reasons = []
        if channel.quantity in ("pulse", "angle"):
            reasons.append(f"its quantity is {channel.quantity}")
        name = _CLOCK_NAME.search(channel.name.replace("_", " "))
        if name:
            reasons.append(f"its name has the word {name[0]!r}")
        if channel.unit.lower() == "rpm":
            reasons.append(f"its unit is {channel.unit}")
        wraps = _wraps(channel, row)
        signal = wraps or ("" if channel.quantity == "force" else _pulses(row, axis))
        if signal:
            reasons.append(signal)
        if reasons:
            turns = bool(wraps) or channel.quantity == "angle" or (channel.unit in _TURNS and name is not None)
            kind: ClockKind = "azimuth" if turns else "speed" if channel.unit in _SPEEDS else "pulses"
            is_sure = bool(signal) or not name  # by the name alone there may be a quantity, too
            found.append(ClockCandidate(name=channel.name, why="; ".join(reasons), kind=kind, is_sure=is_sure))
    return tuple(found)


def _wraps(channel: Channel, row: Floats) -> str:
    """True where an angle runs round and jumps back by a turn, as an encoder's does."""
    turn = _TURNS.get(channel.unit)
    there = row[np.isfinite(row)]
    if turn is None or there.size < 3 or not 0.5 * turn < np.ptp(there) <= 1.02 * turn:
        return ""
    steps = np.diff(there)
    wraps = np.abs(steps) > 0.5 * turn
    rest = steps[~wraps]
    if not wraps.any() or not rest.size or not ((rest >= 0).mean() > 0.95 or (rest <= 0).mean() > 0.95):
        return ""
    return f"it runs round and jumps back by a turn of {turn:.6g} {channel.unit}, {int(wraps.sum())} times"


def _pulses(row: Floats, axis: TimeAxis | None) -> str:
    """True where a signal has two levels and changes between them regularly, as a pulse once per revolution does."""
    there = np.flatnonzero(np.isfinite(row))
    if there.size < 8:
        return ""
    low, high = float(row[there].min()), float(row[there].max())
    level = (row[there] - low) / (high - low) if high > low else np.zeros(there.size)
    if ((level > 0.2) & (level < 0.8)).mean() > 0.05:
        return ""
    state = level[(level <= 0.2) | (level >= 0.8)] > 0.5
    rises = there[(level <= 0.2) | (level >= 0.8)][1:][state[1:] & ~state[:-1]]
    gaps = np.diff(rises)
    if gaps.size < 2 or np.percentile(gaps, 90) > 1.5 * np.percentile(gaps, 10):
        return ""
    every = f"{gaps.mean() / axis.sample_rate:.4g} s" if axis else f"{gaps.mean():.4g} samples"
    return f"it has two levels and rises {rises.size} times, every {every} on average"
