"""TDMS files of National Instruments, which npTDMS takes apart.

They have groups of channels, each with its step of time and its unit. An index file beside one is not looked at. Values
are scaled as the file says.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid._checks import printable
from floquid.io import Source, load_package
from floquid.tables import Table, TimeColumn, find_time, make_channels, name_and_unit, rate_of_step, rows_of, times_of

_AGAIN = "Copy or export it again."
_DECIMALS = 9  # of a time stamp [s]: clocks of computers count no finer than 1 ns
_CHOOSE = "Choose channels that go together with `channels=`, as in `group/channel`."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Signal:
    """A channel of numbers: `held` is npTDMS's own, `name` and `unit` are what the file calls it."""

    held: Any
    group: str
    name: str
    unit: str

    @property
    def path(self) -> str:
        """Path of the channel, as in «group/channel»."""
        return f"{self.group}/{self.name}"

    @property
    def parts(self) -> tuple[str, str | None]:
        """The name and the unit, None without one."""
        return self.name, None if self.unit == "-" else self.unit

    def get(self, key: str) -> Any:
        """A property of the channel, None if it has none."""
        return self.held.properties.get(key)


def load_tdms(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a TDMS file."""
    nptdms = load_package("nptdms", source.of, extra="tdms")
    nptdms.log.log_manager.set_level(logging.CRITICAL)
    again = source.taken_apart("TDMS file", _AGAIN)
    with again, source.path.open("rb") as stream:  # given the path, npTDMS would trust an index file beside it
        file = nptdms.TdmsFile.open(stream, raw_timestamps=True)
        unclosed = _unclosed(source, file)
        signals, dates, others = _signals(source, file)
        if not signals:
            count = len(others) + len(dates)
            got = f"holds {count} channels of other kinds" if count else "holds no channel"
            raise source.error("hold a channel of numbers", got, "Export the signals.")
        times, signals = _split(source, signals)
        for one in dates:
            has_step = any(signal.group == one.group and signal.get("wf_increment") is not None for signal in signals)
            is_time = _is_time(source, one) or not has_step
            if is_time and not any(time.group == one.group for time in times):
                times.append(one)
            else:
                others.append(one.path)
        several = len({signal.group for signal in signals}) > 1
        names = [signal.path if several else signal.name for signal in signals]
        named = make_channels(source, names, [signal.unit for signal in signals])
        paths = {signal.path: channel.name for signal, channel in zip(signals, named, strict=True)}
        rows = rows_of(source, named, None if channels is None else [paths.get(name, name) for name in channels])
        chosen = [signals[row] for row in rows]
        time = next((t for t in times if t.group == chosen[0].group), None)
        lengths = {signal.path: len(signal.held) for signal in (*chosen, *([] if time is None else [time]))}
        if len(set(lengths.values())) > 1:
            words = ", ".join(f"{path} has {length}" for path, length in list(lengths.items())[:10])
            raise source.error("hold channels of one length", f"does not: {words} samples", _CHOOSE)
        rate, start, notes = _even(source, chosen, ignore_time=ignore_time)
        values = np.empty((len(chosen), len(chosen[0].held)))
        for row, signal in zip(values, chosen, strict=True):
            row[:] = signal.held.read_data()
        column = None
        if time is not None and not ignore_time:
            _, scale = find_time(source, [time.parts])
            column, said = _times(source, time, scale)
            notes += said
    notes += unclosed + tuple(f"Channel {path!r} is not of numbers, and is not used." for path in others[:20])
    return Table(
        values=values,
        time=column,
        sample_rate=rate,
        start=start,
        notes=notes,
        channels=tuple(named[row] for row in rows),
    )


def _unclosed(source: Source, file: Any) -> tuple[str, ...]:
    """A note on a file whose last segment was never closed."""
    status = file.file_status
    short = [path for path, one in (status.channel_statuses or {}).items() if one.read_length != one.expected_length]
    if short:
        got = f"is cut short: its last segment has not all samples of {', '.join(short[:10])}"
        raise source.error("be a whole TDMS file", got, _AGAIN)
    return ("The last segment of the file was never closed; its samples are used.",) * status.incomplete_final_segment


def _signals(source: Source, file: Any) -> tuple[list[_Signal], list[_Signal], list[str]]:
    """The channels of numbers, those of dates, and the paths of the others."""
    signals, dates, others = [], [], []
    for group in file.groups():
        for channel in group.channels():
            if len(channel) == 0:
                continue
            name, unit = name_and_unit(channel.name)
            words = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
            if isinstance(words, str) and words.strip():
                name, unit = channel.name, words.strip()
            signal = _Signal(held=channel, group=group.name, name=name, unit=unit or "-")
            if channel.dtype.kind in "biuf":
                signals.append(signal)
            elif channel.dtype.kind == "M" or (channel.dtype.kind == "O" and _is_time(source, signal)):
                dates.append(signal)
            else:
                others.append(signal.path)
    return signals, dates, others


def _is_time(source: Source, signal: _Signal) -> bool:
    return find_time(source, [signal.parts])[0] is not None


def _times(source: Source, time: _Signal, scale: float | None) -> tuple[TimeColumn, tuple[str, ...]]:
    """The times in a channel of numbers, of time stamps, or of dates as text, and notes."""
    values = time.held.read_data()
    if time.held.dtype.kind == "M":  # as dates they would be cut, not rounded, to microseconds
        seconds = (values.seconds - values.seconds[0]) + values.second_fractions * 2.0**-64
        notes = (f"The times are dates: they count from the first, {values[0]}.",)
        return TimeColumn(values=np.round(seconds - seconds[0], _DECIMALS), scale=1.0, label=time.path), notes
    if values.dtype.kind == "O":
        try:
            dates = values.astype("M8[ns]")
        except ValueError:
            got = f"has {printable(str(values[0]))[:40]!r} first in {time.path!r}"
            must = "have its times as numbers, as time stamps, or as text such as 2026-03-01T12:00:00.5"
            raise source.error(must, got, "Write them so, or pass `rate=` [Hz] to ignore them.") from None
        found = times_of(dates, scale=1.0, label=time.path)
        assert found is not None
        return found
    return TimeColumn(values=values, scale=scale, label=time.path), ()


def _split(source: Source, signals: Sequence[_Signal]) -> tuple[list[_Signal], list[_Signal]]:
    """The channels of times, at most one a group, and the others."""
    times = []
    for group in dict.fromkeys(signal.group for signal in signals):
        members = [signal for signal in signals if signal.group == group]
        place, _ = find_time(source, [member.parts for member in members])
        if place is not None and len(members) > 1:
            times.append(members[place])
    return times, [signal for signal in signals if signal not in times]


def _even(
    source: Source, chosen: Sequence[_Signal], *, ignore_time: bool
) -> tuple[float | None, float | None, tuple[str, ...]]:
    """The rate [Hz] and the start [s] that the channels state, None if they state none, and notes."""
    steps = {signal.path: signal.get("wf_increment") for signal in chosen}
    starts = {signal.path: (str(signal.get("wf_start_time")), signal.get("wf_start_offset")) for signal in chosen}
    for what, found in (("step of time (`wf_increment`)", steps), ("start (`wf_start_time`)", starts)):
        if len(set(map(str, found.values()))) > 1:
            words = ", ".join(f"{path} has {value}" for path, value in list(found.items())[:10])
            raise source.error(f"hold channels of one {what}", f"does not: {words}", _CHOOSE)
    step, (date, offset) = next(iter(steps.values())), next(iter(starts.values()))
    notes = () if date == "None" else (f"The first sample was taken at {date}.",)
    if step is None:
        return None, None, notes
    if not isinstance(step, (int, float)) or not 0.0 < step < np.inf or not np.isfinite(1.0 / step):
        if ignore_time:
            return None, None, notes
        must, got = "state a positive step of time (`wf_increment`) [s]", f"states {step!r}"
        raise source.error(must, got, "Pass `rate=` [Hz] to say what it is.")
    start = float(offset) if isinstance(offset, (int, float)) and np.isfinite(offset) else 0.0
    return rate_of_step(step), start, notes
