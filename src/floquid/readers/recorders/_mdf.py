"""MDF files of vehicles, which asammdf takes apart: groups of channels, each group with times of its own."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.io import Source, load_package
from floquid.tables import Table, TimeColumn, make_channels, numbered, rows_of

_TIME = 1  # of MDF's kinds of a master channel; 0 is none said, those above are angles, distances and numbers


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
        signals = [(names[row], file.get(group=places[row][0], index=places[row][1])) for row in rows]
        start = file.start_time
    others = [name for name, signal in signals if not _is_plain(signal)]
    signals = [(name, signal) for name, signal in signals if _is_plain(signal)]
    if not signals or (others and channels is not None):
        got = f"has other things in {', '.join(others[:10])}" if others else "holds no channel"
        raise source.error("hold a channel of numbers", got, "Name channels of numbers by `channels=`.")
    first = signals[0][1]
    if not all(np.array_equal(signal.timestamps, first.timestamps) for _, signal in signals):
        words = ", ".join(f"{name} has {len(signal)}" for name, signal in signals[:10])
        got = f"does not: {words} samples"
        remedy = "Choose channels of one group with `channels=`, by the names above."
        raise source.error("hold channels that were sampled together", got, remedy)
    label, kind = first.master_metadata or ("time", _TIME)
    column = TimeColumn(values=first.timestamps, scale=1.0, label=label) if kind <= _TIME else None
    return Table(
        values=np.array([_mdf_samples(signal) for _, signal in signals]),
        channels=make_channels(
            source, [name for name, _ in signals], [signal.unit.strip() or "-" for _, signal in signals]
        ),
        time=None if ignore_time else column,
        notes=(
            f"The first sample was taken at {start}.",
            *(f"Channel {name!r} is not of numbers, and is not used." for name in others[:20]),
        ),
    )


def _is_plain(signal: Any) -> bool:
    return signal.samples.ndim == 1 and signal.samples.dtype.kind in "biuf"


def _mdf_names(file: Any, places: Sequence[tuple[int, int]]) -> list[str]:
    """A name for each channel; where several have one, with that of its group, or its number, before it."""
    names = [file.groups[group].channels[index].name.strip() or f"channel {index}" for group, index in places]
    count = Counter(names)
    groups = {group: getattr(file.groups[group].channel_group, "acq_name", "") or str(group) for group, _ in places}
    pairs = zip(names, places, strict=True)
    return numbered([name if count[name] == 1 else f"{groups[group]}/{name}" for name, (group, _) in pairs])


def _mdf_samples(signal: Any) -> NDArray[np.float64]:
    """The samples, NaN where the file marks them as invalid."""
    values = signal.samples.astype(np.float64)
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits)] = np.nan
    return values
