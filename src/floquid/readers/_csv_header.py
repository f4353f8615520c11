"""What the header of a text table says: the delimiter, the channels with their units, and which column is the time."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

from floquid.core import Channel, ConstantPeriod, Quantity, Record
from floquid.core._time_axis import SECONDS
from floquid.errors import InputError
from floquid.readers._table import Source, check_distinct

RECORD_LINE = "# floquid record: "
"""A comment of ours, one line of JSON: what a table cannot say (the exact rate, the period, odd quantities)."""

_TIME_NAME = re.compile(
    r"(?:elapsed |relative )?(t|times?|time ?stamps?|zeit|temps|tiempo)(?:[ _.-](\w+))?", re.IGNORECASE
)
_OTHER_UNITS = {
    "-",
    "%",
    "V",
    "mV",
    "uV",
    "A",
    "mA",
    "Pa",
    "kPa",
    "MPa",
    "bar",
    "Nm",
    "N.m",
    "N m",
    "Hz",
    "rpm",
    "RPM",
    "°",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The columns of a table: `channels` at `columns`, the time at `time_column` in units of `time_scale` seconds."""

    cells: tuple[str, ...]
    channels: tuple[Channel, ...]
    columns: tuple[int, ...]
    time_column: int | None = None
    time_scale: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """What our own comment line states."""

    sample_rate: float | None = None
    period: float | None = None
    origin: float | None = None
    channels: dict[str, Channel] = field(default_factory=dict)


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
    """The columns that the header names; one that our comment line describes is taken from there.

    Raises
    ------
    InputError
        The header is a row of numbers, a name is empty or given twice, or the time has an unknown unit.
    """
    if all(_is_number(cell) for cell in cells):
        raise source.error(
            "begin with a header row that names the columns",
            f"begins with numbers (line {line})",
            "Write a first line such as `time [s],x [m],y [m]`.",
        )
    parts = [_name_and_unit(cell) for cell in cells]
    time_column, scale = _find_time(source, parts)
    columns = tuple(column for column in range(len(cells)) if column != time_column)
    if not columns:
        raise source.error(
            "have a column for each channel", f"has the time alone (line {line})", "Export the channels too."
        )
    channels = []
    for column in columns:
        name, unit = parts[column]
        if not name:
            raise source.error(
                "name every column in its header",
                f"has no name for column {column + 1} (line {line})",
                "Name it, or delete it.",
            )
        try:
            channels.append(stated.channels.get(cells[column]) or Channel(name=name, unit=unit or "-"))
        except InputError as error:
            raise source.wrapped(error) from None
    check_distinct(source, [channel.name for channel in channels])
    return Header(
        cells=tuple(cells), channels=tuple(channels), columns=columns, time_column=time_column, time_scale=scale
    )


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    """«x [m]», and «x (m)» where m is a unit and not a remark: the name and the unit, None if there is none."""
    match = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", cell)
    if match:
        return match[1], match[2].strip()
    match = re.fullmatch(r"(.*?)\s*\(([^()]*)\)", cell)
    if match and _is_unit(match[2].strip()):
        return match[1], match[2].strip()
    return cell, None


def _is_unit(text: str) -> bool:
    return text in _OTHER_UNITS or text in SECONDS or (text != "" and Channel(name="x", unit=text).quantity != "other")


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return cell == ""
    return True


def _find_time(source: Source, parts: Sequence[tuple[str, str | None]]) -> tuple[int | None, float]:
    """The first column that is a time by its name, or the very first by its unit; and its unit in seconds."""
    for column, (name, unit) in enumerate(parts):
        known = SECONDS.get(unit or "")
        if column == 0 and known is not None:
            return column, known
        if name.lower() in SECONDS and len(name) > 1 and unit is None:  # a column headed «ms»
            return column, SECONDS[name.lower()]
        match = _TIME_NAME.fullmatch(name)
        if match is None or (match[2] is not None and match[2].lower() not in SECONDS):
            continue
        if unit in (None, "", "-"):
            return column, SECONDS.get((match[2] or "s").lower(), 1.0)
        if known is not None:
            return column, known
        if len(match[1]) > 1:
            raise source.error(
                "have its times in one of s, ms, us, ns, min, h",
                f"has column {column + 1}, {name!r}, in {unit!r}",
                "Export the times as numbers in seconds.",
            )
    return None, 1.0


def record_line(record: Record) -> str:
    """Our comment line for `record`."""
    said: dict[str, Any] = {"sample_rate": record.sample_rate}
    if isinstance(record.clock, ConstantPeriod):
        said |= {"period": record.clock.period, "origin": record.clock.origin}
    said["channels"] = [[c.name, c.quantity, c.unit, c.location, c.direction] for c in record.channels]
    return RECORD_LINE + json.dumps(said, ensure_ascii=False)


def parse_record_line(source: Source, comments: Sequence[str]) -> Stated:
    """What our comment line states, if it is there.

    Raises
    ------
    InputError
        It is there and is not as we write it.
    """
    text = next((line.removeprefix(RECORD_LINE) for line in comments if line.startswith(RECORD_LINE)), None)
    if text is None:
        return Stated()
    try:
        said = json.loads(text)
        numbers = {key: _number_or_none(said.get(key)) for key in ("sample_rate", "period", "origin")}
        listed = [
            Channel(
                name=name, quantity=_quantity(quantity), unit=unit, location=str(location), direction=str(direction)
            )
            for name, quantity, unit, location, direction in said.get("channels", [])
        ]
        return Stated(
            **numbers,
            channels={channel.label: channel for channel in listed},
        )
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        raise source.error(
            f"have the line `{RECORD_LINE.strip()}` as floquid wrote it",
            "has another",
            "Delete that line: the table can be read without it.",
        ) from None


def _number_or_none(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        raise TypeError(value)
    return None if value is None else float(value)


def _quantity(text: object) -> Quantity:
    if text not in get_args(Quantity):
        raise ValueError(text)
    return text  # type: ignore[return-value]
