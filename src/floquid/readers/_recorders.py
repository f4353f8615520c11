"""Files of recorders that libraries take apart: COMTRADE of relays (comtrade) and MDF of vehicles (asammdf).

COMTRADE is a pair of files, or one (.cff): channels with their units and scales, and one rate or several. Its signals
of one bit are read where they are named.

MDF has groups of channels, each group with times of its own.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel
from floquid.io import Source, load_package
from floquid.tables import Table, TimeColumn, make_channels, numbered, rows_of

_AGAIN = "Copy or export it again."
_TIME = 1  # of MDF's kinds of a master channel; 0 is none said, those above are angles, distances and numbers


def load_comtrade(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a COMTRADE file (.cfg with its .dat, or .cff)."""
    comtrade = load_package("comtrade", source.of)
    path = source.path
    if path.suffix.lower() == ".cfg" and not any(path.with_suffix(end).exists() for end in (".dat", ".DAT", ".Dat")):
        got = f"has no {path.with_suffix('.dat').name} beside it"
        raise source.error("have its samples beside it", got, "Copy both files into one folder.")
    options = {"ignore_warnings": True, "use_numpy_arrays": True, "use_double_precision": True}
    with source.taken_apart("COMTRADE file", _AGAIN):
        file = comtrade.Comtrade(**options)
        try:
            file.load(str(path))
        except UnicodeDecodeError:
            file.load(str(path), encoding="latin-1")
        times = np.asarray(file.time)
    notes = () if file.start_timestamp is None else (f"The first sample was taken at {file.start_timestamp}.",)
    there = len(times) if len(times) < 2 else int(np.flatnonzero(times).max(initial=0)) + 1  # zero: never filled
    if there < len(times):
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


def load_mdf(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in an MDF file, of version 3 or 4: channels that share their times."""
    asammdf = load_package("asammdf", source.of, extra="mdf")
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    with source.taken_apart("MDF file", _AGAIN), asammdf.MDF(source.path) as file:
        places = [
            (group, index)
            for group, held in enumerate(file.groups)
            for index in range(len(held.channels))
            if held.channel_group.cycles_nr and index != file.masters_db.get(group)
        ]
        names = _mdf_names(file, places)
        rows = rows_of(source, [Channel(name=name) for name in names], channels)
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
    names = [file.groups[group].channels[index].name for group, index in places]
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
