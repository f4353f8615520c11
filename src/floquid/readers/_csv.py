"""Text tables: a header row, a time column, then channels with their units in brackets; what floquid states beside.

A table cannot say everything that a record says: an exact rate, a period, a quantity. A line of JSON that other
programs skip has it:

    {"sample_rate": 2533.333333333334, "start": -0.25, "period": 0.0157, "origin": 0.001,
     "channels": [["tip x", "displacement", "m", "disc", "+x"], ...], "orbit": [[...], ...],
     "point": {"speed_rpm": 742.0}}
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid.core import Channel, Record, as_point, channel_of
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers._body import Text, read_body, text_in, text_of_workbook
from floquid.readers._layout import RECORD_LINE, Layout, find_layout, is_date, is_number
from floquid.tables import (
    Table,
    TimeColumn,
    check_distinct,
    counts_rows,
    find_time,
    make_channel,
    name_and_unit,
    numbers_of,
    refuse_blurred_times,
    rows_of,
)

_WORDS = ("name", "quantity", "unit", "location", "direction", "place")
_LEAST = 5  # words of a channel: earlier files have no place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stated:
    """Statements of our own line, None for those it has not; `orbit` is (channels, phases)."""

    sample_rate: float | None = None
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    channels: tuple[Channel, ...] = ()
    orbit: Floats | None = None
    point: Mapping[str, float] = field(default_factory=dict)

    def of(self, channels: Sequence[Channel]) -> dict[str, Any]:
        """The fields of a table of `channels` that do not depend on the samples."""
        known = self.orbit is not None and all(channel in self.channels for channel in channels)
        rows = [self.channels.index(channel) for channel in channels] if known else []
        orbit = self.orbit[rows] if known and self.orbit is not None else None
        numbers = {"period": self.period, "origin": self.origin, "point": self.point}
        return {"channels": tuple(channels), "orbit": orbit, **numbers}


def stated_text(record: Record, *, ascii_only: bool = True) -> str:
    """The line of JSON for `record`."""
    said: dict[str, Any] = {**numbers_of(record)}
    words = _WORDS if any(channel.place for channel in record.channels) else _WORDS[:_LEAST]
    said["channels"] = [[getattr(channel, word) for word in words] for channel in record.channels]
    if record.orbit is not None:
        said["orbit"] = record.orbit.tolist()
    if record.point:
        said["point"] = dict(record.point)
    return json.dumps(said, ensure_ascii=ascii_only)


def stated_in(source: Source, text: str | bytes | None, place: str, remedy: str) -> Stated:
    """Statements of our own line at `place` of a file; empty where there is none."""
    if text is None:
        return Stated()
    try:
        said = json.loads(text)
        keys = [key for key in ("sample_rate", "start", "period", "origin") if said.get(key) is not None]
        numbers = {key: float(said[key]) for key in keys}
        channels = tuple(_channel_stated(words) for words in said.get("channels", []))
        orbit = np.array(said["orbit"], np.float64) if "orbit" in said else None
        point = dict(as_point(said.get("point"), "Record"))
        if not np.isfinite([*numbers.values()]).all() or (orbit is not None and len(orbit) != len(channels)):
            raise ValueError(text)
        return Stated(**numbers, channels=channels, orbit=orbit, point=point)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        raise source.error(f"have {place} as floquid wrote it", "has another", remedy) from None


def _channel_stated(words: Sequence[str]) -> Channel:
    """The channel by its words in our own line; ValueError where they are too few or too many."""
    return channel_of(dict(zip(_WORDS[: max(len(words), _LEAST)], words, strict=True)))


def stated_line(source: Source, lines: Sequence[str]) -> Stated:
    """Statements of our own line among those of a text; empty where there is none."""
    text = next((line.removeprefix(RECORD_LINE) for line in lines if line.startswith(RECORD_LINE)), None)
    remedy = "Delete that line: the table can be read without it."
    return stated_in(source, text, f"the line `{RECORD_LINE.strip()}`", remedy)


_BLOCK = 1 << 16


def load_csv(source: Source, *, channels: Sequence[str] | None, ignore_time: bool, header: bool = True) -> Table:
    """The table in a text file, with a `header` or without one."""
    return _load(text_in(source), channels, ignore_time=ignore_time, header=header)


def load_xlsx(source: Source, *, channels: Sequence[str] | None, ignore_time: bool, header: bool = True) -> Table:
    """The table in the largest sheet of a workbook, with a `header` or without one."""
    return _load(text_of_workbook(source), channels, ignore_time=ignore_time, header=header)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Columns:
    """The columns of a table: `channels` at `places`, the times at `time` in units of `scale` seconds, or `are_dates`.

    Where `is_open`, only the numbers of the first column say what it is: times, a count of the rows, or a channel.
    """

    channels: tuple[Channel, ...]
    places: tuple[int, ...]
    time: int | None
    scale: float | None
    are_dates: bool
    is_open: bool
    notes: tuple[str, ...] = ()


def _columns(source: Source, layout: Layout, stated: Stated, *, is_open: bool) -> _Columns:
    """The columns by their names and their first row; the first column may be `is_open`, as it is without a name."""
    parts = [name_and_unit(label) for label in layout.labels]
    dates = [place for place, cell in enumerate(layout.row[: len(parts)]) if is_date(cell) and not is_number(cell)]
    time, scale = find_time(source, parts)
    are_dates = bool(dates) and time in (None, *dates)
    empty = None
    if are_dates:
        time, scale = dates[0], 1.0
    elif time is not None and layout.rate is not None and layout.row[time : time + 1] == ("",):
        empty, time = time, None  # LabVIEW's X_Value over no numbers
    is_open = time != 0 and (not parts[0][0] or (is_open and time is None and len(parts) > 1))
    places = [place for place in range(int(is_open), len(parts)) if place not in (time, empty, *dates)]
    beside = [f"`{layout.labels[place]}`" for place in dates if place != time]
    return _Columns(
        channels=_channels(source, layout, places, stated),
        places=tuple(places),
        time=time,
        scale=scale,
        are_dates=are_dates,
        is_open=is_open,
        notes=(f"{', '.join(beside)} holds dates and is no channel.",) if beside else (),
    )


def _load(text: Text, named: Sequence[str] | None, *, ignore_time: bool, header: bool) -> Table:
    """The table in a `text`, of the channels `named`, and with its times or without them."""
    source, layout = text.source, find_layout(text.source, text.lines(), header=header)
    stated = stated_line(source, layout.comments)
    columns = _columns(source, layout, stated, is_open=not header and "1" not in (named or ()))
    chosen = rows_of(source, columns.channels, named)
    channels, time = [columns.channels[row] for row in chosen], None if ignore_time else columns.time
    beside = [*([0] if columns.is_open else []), *([] if time is None else [time])]
    places = [*(columns.places[row] for row in chosen), *beside]
    dates = time if columns.are_dates else None
    body = read_body(text, layout, places, dates=dates, are_timed=bool(beside) and not ignore_time)
    values, notes = body.values[: len(chosen)], (*text.notes, *layout.notes, *columns.notes, *body.notes)
    column = None
    if time is not None:
        column = TimeColumn(values=body.values[-1], scale=columns.scale, label=layout.labels[time] or "column 1")
    elif columns.time is not None:
        notes += (f"The time column `{layout.labels[columns.time]}` was ignored.",)
    if body.first_date:
        notes += (f"The times are dates: they count from the first, {body.first_date}.",)
    if columns.is_open:
        first = body.values[len(chosen)]
        if counts_rows(first):
            notes += ("Column 1 counts the rows: it is no channel.",)
        elif column is None and (np.diff(first) > 0.0).all():
            column = None if ignore_time else TimeColumn(values=first, scale=None, label="column 1")
            notes += (f"Column 1 increases: it is taken for the time{', and ignored' if ignore_time else ''}.",)
        elif header:
            raise _nameless(source, 0, layout)
        elif named is None:
            values, channels = np.vstack([first, values]), [*_channels(source, layout, [0], stated), *channels]
    rate = stated.sample_rate or (layout.rate if column is None else None)
    return Table(
        values=values,
        time=column,
        sample_rate=rate,
        rate_note=layout.rate_note if stated.sample_rate is None and rate is not None else None,
        notes=notes,
        **stated.of(channels),
    )


def _channels(source: Source, layout: Layout, places: Sequence[int], stated: Stated) -> tuple[Channel, ...]:
    """The channels in the columns at `places`; one that our own line describes is taken from there."""
    if not places:
        must, where = "have a column for each channel", f" (line {layout.top})" if layout.top else ""
        raise source.error(must, f"has the time alone{where}", "Export the channels too.")
    own = {channel.label: channel for channel in stated.channels}
    channels = []
    for place in places:
        name, unit = name_and_unit(layout.labels[place])
        if not name:
            raise _nameless(source, place, layout)
        channels.append(own.get(layout.labels[place]) or make_channel(source, name=name, unit=unit or "-"))
    check_distinct(source, [channel.name for channel in channels])
    return tuple(channels)


def _nameless(source: Source, place: int, layout: Layout) -> InputError:
    got = f"has no name for column {place + 1} (line {layout.top})"
    return source.error("name every column in its header", got, "Name it, or delete it.")


def save_csv(record: Record, path: Path) -> None:
    """Write `record` so that every number is read back as it is."""
    refuse_blurred_times(record)
    times = record.times
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(["time [s]", *(channel.label for channel in record.channels)])
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"{RECORD_LINE}{stated_text(record, ascii_only=False)}\n{head.getvalue()}")
        for first in range(0, record.n_samples, _BLOCK):
            part = slice(first, first + _BLOCK)
            block = np.vstack([times[part], record.values[:, part]]).T.tolist()
            stream.writelines(",".join(map(repr, row)) + "\n" for row in block)
