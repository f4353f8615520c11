"""COMTRADE files of protection relays, which the library comtrade takes apart.

There is a pair of files, or one (.cff): channels with their units and scales, and one rate or several. Signals of one
bit are read where they are named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
