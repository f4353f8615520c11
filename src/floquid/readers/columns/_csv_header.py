"""What the header of a text table says: the delimiter, the channels with their units, and which column is the time."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass

from floquid.core import Channel
from floquid.io import Source
from floquid.readers.columns._stated import Stated
from floquid.tables import check_distinct, find_time, make_channel, name_and_unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The columns of a table: `channels` at `columns`, the time at `time_column` in units of `time_scale` seconds."""

    cells: tuple[str, ...]
    channels: tuple[Channel, ...]
    columns: tuple[int, ...]
    time_column: int | None = None
    time_scale: float = 1.0


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, stripped."""
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(delimiter)]


def find_delimiter(header: str, first_row: str) -> str:
    """The delimiter that gives the header and the first row the same number of cells, at least two; else a comma."""
    counts = {
        delimiter: len(split_cells(header, delimiter))
        for delimiter in ",;\t"
        if len(split_cells(header, delimiter)) == len(split_cells(first_row, delimiter))
    }
    best = max(counts, key=lambda delimiter: counts[delimiter], default=",")
    if counts.get(best, 0) >= 2:
        return best
    return max(",;\t", key=lambda delimiter: len(split_cells(header, delimiter)))


def parse_header(source: Source, cells: Sequence[str], line: int, stated: Stated) -> Header:
    """The columns that the header names; one that our comment line describes is taken from there."""
    if all(_is_number(cell) for cell in cells):
        raise source.error(
            "begin with a header row that names the columns",
            f"begins with numbers (line {line})",
            "Write a first line such as `time [s],x [m],y [m]`.",
        )
    parts = [name_and_unit(cell) for cell in cells]
    time_column, scale = find_time(source, parts)
    columns = tuple(column for column in range(len(cells)) if column != time_column)
    if not columns:
        raise source.error(
            "have a column for each channel", f"has the time alone (line {line})", "Export the channels too."
        )
    own = {channel.label: channel for channel in stated.channels}
    channels = []
    for column in columns:
        name, unit = parts[column]
        if not name:
            raise source.error(
                "name every column in its header",
                f"has no name for column {column + 1} (line {line})",
                "Name it, or delete it.",
            )
        channels.append(own.get(cells[column]) or make_channel(source, name=name, unit=unit or "-"))
    check_distinct(source, [channel.name for channel in channels])
    return Header(
        cells=tuple(cells), channels=tuple(channels), columns=columns, time_column=time_column, time_scale=scale
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return cell == ""
    return True
