"""TDMS files of National Instruments: groups of channels, each with its step of time and its unit.

npTDMS reads them; an index file beside it is not looked at. Values are scaled as the file says.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid.core import Channel
from floquid.io import Source, load_package
from floquid.tables import Table, TimeColumn, find_time, make_channels, name_and_unit, rate_of_step, rows_of

_AGAIN = "Copy or export it again."
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
        file = nptdms.TdmsFile.open(stream)
        unclosed = _unclosed(source, file)
        signals, others = _signals(file)
        if not signals:
            got = f"holds {len(others)} channels of other kinds" if others else "holds no channel"
            raise source.error("hold a channel of numbers", got, "Export the signals.")
        times, signals = _split(source, signals)
        named = _named(source, signals)
        paths = {signal.path: channel.name for signal, channel in zip(signals, named, strict=True)}
        rows = rows_of(source, named, None if channels is None else [paths.get(name, name) for name in channels])
        chosen = [signals[row] for row in rows]
        time = next((t for t in times if t.group == chosen[0].group), None)
        _check_lengths(source, chosen, time)
        rate, start, notes = _even(source, chosen, ignore_time=ignore_time)
        values = np.empty((len(chosen), len(chosen[0].held)))
        for row, signal in zip(values, chosen, strict=True):
            row[:] = signal.held.read_data()
        column = None
        if time is not None and not ignore_time:
            _, scale = find_time(source, [time.parts])
            column = TimeColumn(values=time.held.read_data(), scale=scale, label=time.path)
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


def _signals(file: Any) -> tuple[list[_Signal], list[str]]:
    """The channels of numbers, and the paths of the others."""
    signals, others = [], []
    for group in file.groups():
        for channel in group.channels():
            path = f"{group.name}/{channel.name}"
            if len(channel) == 0:
                continue
            if channel.dtype.kind not in "biuf":
                others.append(path)
                continue
            name, unit = name_and_unit(channel.name)
            words = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
            if isinstance(words, str) and words.strip():
                name, unit = channel.name, words.strip()
            signals.append(_Signal(held=channel, group=group.name, name=name, unit=unit or "-"))
    return signals, others


def _split(source: Source, signals: Sequence[_Signal]) -> tuple[list[_Signal], list[_Signal]]:
    """The channels of times, at most one a group, and the others."""
    times = []
    for group in dict.fromkeys(signal.group for signal in signals):
        members = [signal for signal in signals if signal.group == group]
        place, _ = find_time(source, [member.parts for member in members])
        if place is not None and len(members) > 1:
            times.append(members[place])
    return times, [signal for signal in signals if signal not in times]


def _named(source: Source, signals: Sequence[_Signal]) -> tuple[Channel, ...]:
    """The channels, by their names alone where all are of one group."""
    several = len({signal.group for signal in signals}) > 1
    names = [signal.path if several else signal.name for signal in signals]
    units = [signal.unit for signal in signals]
    return make_channels(source, names, units)


def _check_lengths(source: Source, chosen: Sequence[_Signal], time: _Signal | None) -> None:
    lengths = {signal.path: len(signal.held) for signal in (*chosen, *([] if time is None else [time]))}
    if len(set(lengths.values())) > 1:
        words = ", ".join(f"{path} has {length}" for path, length in list(lengths.items())[:10])
        raise source.error("hold channels of one length", f"does not: {words} samples", _CHOOSE)


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
