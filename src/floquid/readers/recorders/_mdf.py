"""MDF files of vehicles, which asammdf takes apart: groups of channels, each group with times of its own."""

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
