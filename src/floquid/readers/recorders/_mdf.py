"""MDF files of vehicles by asammdf, and COMTRADE files of protection relays by the library comtrade."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid.io import Source, load_package
from floquid.tables import Table, TimeColumn, make_channels, numbered, rows_of

_AGAIN = "Copy or export it again."
SAMPLES = (".dat", ".DAT", ".Dat")
"""Suffixes of the samples beside a head."""


def load_comtrade(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a COMTRADE file (.cfg with its .dat, or .cff)."""
    comtrade = load_package("comtrade", source.of)
    path = source.path
    beside = [path.with_suffix(end) for end in SAMPLES] if path.suffix.lower() == ".cfg" else [path]
    samples = next((place for place in beside if place.exists()), None)
    if samples is None:
        got = f"has no {path.with_suffix('.dat').name} beside it"
        raise source.error("have its samples beside it", got, "Copy both files into one folder.")
    options = {"ignore_warnings": True, "use_numpy_arrays": True, "use_double_precision": True}
    with source.taken_apart("COMTRADE file", _AGAIN):
        file = comtrade.Comtrade(**options)
        try:
            file.load(str(path), str(samples))
        except UnicodeDecodeError:
            file.load(str(path), str(samples), encoding="latin-1")
        times = np.asarray(file.time)
    notes = () if file.start_timestamp is None else (f"The first sample was taken at {file.start_timestamp}.",)
    there = len(times) if len(times) < 2 else int(np.flatnonzero(times).max(initial=0)) + 1  # zero: never filled
    if there < len(times):
        if file.ft.upper() == "ASCII" and not samples.read_bytes().endswith(b"\n"):
            there -= 1  # the last line may have lost some of its digits
        notes += (f"The file is cut short: it declares {len(times)} samples, and {there} are there.",)
    names = numbered([name or f"ch{row}" for row, name in enumerate(file.analog_channel_ids, 1)])
    units = [channel.uu or "-" for channel in file.cfg.analog_channels]
    if file.status_count and channels is None:
        notes += (f"{file.status_count} signals of one bit are not read: name those you need by `channels`.",)
    elif file.status_count:
        names = numbered([*names, *(name or f"bit{row}" for row, name in enumerate(file.status_channel_ids, 1))])
        units += ["-"] * file.status_count
    if not names:
        raise source.error("hold a channel of numbers", "holds none", "Export the analog channels.")
    named = make_channels(source, names, units)
    rows = rows_of(source, named, channels)
    late = [names[row] for row in rows if row < file.analog_count and file.cfg.analog_channels[row].skew]
    if late:
        notes += (f"The file states that these are sampled later, which is passed over: {', '.join(late[:20])}.",)
    values = np.array([[*file.analog, *file.status][row][:there] for row in rows], np.float64)
    rates = list(dict.fromkeys(rate for rate, _ in file.cfg.sample_rates))
    if len(rates) > 1 and not ignore_time:
        got = f"has {' and then '.join(f'{rate:g} Hz' for rate in rates)}"
        raise source.error("have one rate", got, "Export a part of one rate, or pass `rate=` [Hz].")
    stated = rates[0] if rates else 0.0
    column = TimeColumn(values=times[:there], scale=1.0, label="time")
    return Table(
        values=values,
        channels=tuple(named[row] for row in rows),
        sample_rate=float(stated) or None,
        time=None if stated or ignore_time else column,
        notes=notes,
    )


_TIME = 1  # of MDF's kinds of a master channel; 0 is none said, those above are angles, distances and numbers
_PART = 1 << 18  # samples that are asked for at a time


def load_mdf(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in an MDF file, of version 3 or 4: channels that share their times."""
    asammdf = load_package("asammdf", source.of, extra="mdf")
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    with source.taken_apart("MDF file", "Copy or export it again."), asammdf.MDF(source.path) as file:
        places = [
            (group, index)
            for group, held in enumerate(file.groups)
            for index in range(len(held.channels))
            if held.channel_group.cycles_nr and index != file.masters_db.get(group)
        ]
        names = _mdf_names(file, places)
        rows = rows_of(source, make_channels(source, names), channels)
        found = _signals(file, {names[row]: places[row] for row in rows})
        start = file.start_time
    others, lengths = found.others, found.lengths
    if not lengths or (others and channels is not None):
        got = f"has other things in {', '.join(others[:10])}" if others else "holds no channel"
        raise source.error("hold a channel of numbers", got, "Name channels of numbers by `channels=`.")
    if not found.together:
        words = ", ".join(f"{name} has {length}" for name, length in list(lengths.items())[:10])
        remedy = "Choose channels of one group with `channels=`, by the names above."
        raise source.error("hold channels that were sampled together", f"does not: {words} samples", remedy)
    label, kind = found.master or ("time", _TIME)
    column = TimeColumn(values=found.times, scale=1.0, label=label) if kind <= _TIME else None
    return Table(
        values=found.values,
        channels=make_channels(source, list(lengths), found.units),
        time=None if ignore_time else column,
        notes=(
            f"The first sample was taken at {start}.",
            *(f"Channel {name!r} is not of numbers, and is not used." for name in others[:20]),
        ),
    )


@dataclass(slots=True)
class _Signals:
    """Samples (channels, samples) of those that hold numbers, with what the first says of its times."""

    values: Floats = field(default_factory=lambda: np.empty((0, 0)))
    times: Floats = field(default_factory=lambda: np.empty(0))
    master: tuple[str, int] | None = None
    lengths: dict[str, int] = field(default_factory=dict)  # of the channels, by name
    units: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)  # names of what is no number
    together: bool = True


def _signals(file: Any, places: Mapping[str, tuple[int, int]]) -> _Signals:
    """The signals at `places` by name, in parts: asammdf makes several copies of what it is asked for at once."""
    found = _Signals()
    for name, (group, index) in places.items():
        count, row, length = file.groups[group].channel_group.cycles_nr, len(found.lengths), 0
        for begin in range(0, count, _PART):
            part = file.get(group=group, index=index, record_offset=begin, record_count=min(_PART, count - begin))
            if part.samples.ndim != 1 or part.samples.dtype.kind not in "biuf":
                found.others.append(name)
                break
            if not begin:
                found.units.append(part.unit.strip() or "-")
            if not row and not begin:
                found.values, found.times = np.empty((len(places), count)), np.empty(count)
                found.master = part.master_metadata
            place, length = slice(begin, begin + len(part)), begin + len(part)
            if not row:
                found.times[place] = part.timestamps
            found.together = found.together and np.array_equal(part.timestamps, found.times[place])
            if found.together:
                found.values[row, place] = part.samples
            if found.together and part.invalidation_bits is not None:
                found.values[row, place][np.asarray(part.invalidation_bits)] = np.nan
        else:
            found.lengths[name] = length
    shortest = min(found.lengths.values(), default=0)
    found.together = found.together and shortest == max(found.lengths.values(), default=0)
    found.values, found.times = found.values[: len(found.lengths), :shortest], found.times[:shortest]
    return found


def _mdf_names(file: Any, places: Sequence[tuple[int, int]]) -> list[str]:
    """A name for each channel; where several have one, with that of its group, or its number, before it."""
    names = [file.groups[group].channels[index].name.strip() or f"channel {index}" for group, index in places]
    count = Counter(names)
    groups = {group: getattr(file.groups[group].channel_group, "acq_name", "") or str(group) for group, _ in places}
    pairs = zip(names, places, strict=True)
    return numbered([name if count[name] == 1 else f"{groups[group]}/{name}" for name, (group, _) in pairs])
