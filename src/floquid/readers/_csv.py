"""Text tables: a header row, a time column, then channels with their units in brackets; what floquid states beside.

A table cannot say everything that a record says: an exact rate, a period, a quantity. A line of JSON that other
programs skip has it:

    {"sample_rate": 2533.333333333334, "start": -0.25, "period": 0.0157, "origin": 0.001,
     "channels": [["tip x", "displacement", "m", "disc", "+x"], ...], "orbit": [[...], ...]}
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid.core import Channel, Record
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables import (
    MISSING,
    Table,
    TimeColumn,
    check_distinct,
    find_time,
    make_channel,
    name_and_unit,
    number_in,
    numbers_of,
    refuse_blurred_times,
    rows_of,
)

RECORD_LINE = "# floquid record: "  # begin of the line in a text file

_WORDS = ("name", "quantity", "unit", "location", "direction")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stated:
    """Statements of our own line, None for those it has not; `orbit` is (channels, phases)."""

    sample_rate: float | None = None
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    channels: tuple[Channel, ...] = ()
    orbit: Floats | None = None

    def of(self, channels: Sequence[Channel]) -> dict[str, Any]:
        """The fields of a table of `channels` that do not depend on the samples."""
        known = self.orbit is not None and all(channel in self.channels for channel in channels)
        rows = [self.channels.index(channel) for channel in channels] if known else []
        orbit = self.orbit[rows] if known and self.orbit is not None else None
        return {"channels": tuple(channels), "period": self.period, "origin": self.origin, "orbit": orbit}


def stated_text(record: Record, *, ascii_only: bool = True) -> str:
    """The line of JSON for `record`."""
    said: dict[str, Any] = {**numbers_of(record)}
    said["channels"] = [[getattr(channel, word) for word in _WORDS] for channel in record.channels]
    if record.orbit is not None:
        said["orbit"] = record.orbit.tolist()
    return json.dumps(said, ensure_ascii=ascii_only)


def stated_in(source: Source, text: str | bytes | None, place: str, remedy: str) -> Stated:
    """Statements of our own line at `place` of a file; empty where there is none."""
    if text is None:
        return Stated()
    try:
        said = json.loads(text)
        keys = [key for key in ("sample_rate", "start", "period", "origin") if said.get(key) is not None]
        numbers = {key: float(said[key]) for key in keys}
        channels = tuple(Channel(**dict(zip(_WORDS, words, strict=True))) for words in said.get("channels", []))
        orbit = np.array(said["orbit"], np.float64) if "orbit" in said else None
        if not np.isfinite([*numbers.values()]).all() or (orbit is not None and len(orbit) != len(channels)):
            raise ValueError(text)
        return Stated(**numbers, channels=channels, orbit=orbit)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        raise source.error(f"have {place} as floquid wrote it", "has another", remedy) from None


def stated_line(source: Source, lines: Sequence[str]) -> Stated:
    """Statements of our own line among those of a text; empty where there is none."""
    text = next((line.removeprefix(RECORD_LINE) for line in lines if line.startswith(RECORD_LINE)), None)
    remedy = "Delete that line: the table can be read without it."
    return stated_in(source, text, f"the line `{RECORD_LINE.strip()}`", remedy)


_BLOCK = 1 << 16
_MOST_ABOVE = 100  # lines of words above the numbers, at most

_BLANK = ' \t,;"\n'


@dataclass(frozen=True, slots=True, kw_only=True)
class _Body:
    """The rows under the header: the lines `first` to `last` of the file (from 1), with `count` lines of numbers."""

    path: Path
    first: int
    last: int
    count: int
    delimiter: str
    decimal_comma: bool

    def rows(self) -> Iterator[tuple[int, str]]:
        """The line number and the text of each line that is a row of numbers."""
        for number, line in _lines(self.path, self.first, self.last):
            if not _is_skipped(line):
                yield number, line.replace(",", ".") if self.decimal_comma else line


def load_csv(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a text file."""
    _refuse_other_than_text(source)
    comments, (top, head), above = _head(source)
    stated = stated_line(source, comments)
    body = _body(source, top, head)
    cells = split_cells(head, body.delimiter)
    header = parse_header(source, cells[:-1] if cells[-1] == "" else cells, top, stated)
    chosen = rows_of(source, header.channels, channels)
    use_time = header.time_column is not None and not ignore_time
    columns = [header.columns[index] for index in chosen] + ([header.time_column] if use_time else [])
    if not use_time:  # a blank line may be a missing sample, and skipping it would move all that follow
        for number, line in _lines(body.path, body.first, body.last):
            if not line.strip():
                must = "have no blank line between its rows when the times are not read"
                remedy = "Write `nan` for a missing sample, or delete the line."
                raise source.error(must, f"has one at line {number}", remedy)
    values = _numbers(source, header, body, [column for column in columns if column is not None])
    time = None
    if use_time and header.time_column is not None:
        time = TimeColumn(values=values[-1], scale=header.time_scale, label=header.cells[header.time_column])
    above += (
        (f"The time column `{header.cells[header.time_column]}` was ignored.",)
        if (header.time_column is not None and ignore_time)
        else ()
    )
    return Table(
        values=values[: len(chosen)],
        time=time,
        sample_rate=stated.sample_rate,
        notes=above,
        **stated.of([header.channels[index] for index in chosen]),
    )


def _refuse_other_than_text(source: Source) -> None:
    with source.path.open("rb") as stream:
        if stream.read(2) in (b"\xff\xfe", b"\xfe\xff"):
            raise source.error("be text in UTF-8", "is text in UTF-16", "Save it as CSV UTF-8.")
        stream.seek(0)
        for number, line in enumerate(stream, 1):
            if b"\0" in line:
                raise source.error("be text", f"is binary (a NUL byte in line {number})", "Export it as text.")
            try:
                line.decode()
            except UnicodeDecodeError as error:
                got = f"has a byte 0x{line[error.start]:02x} in line {number} that is not"
                remedy = "Save it as CSV UTF-8; if it is not a text table at all, name it by its format."
                raise source.error("be text in UTF-8", got, remedy) from None


def _lines(path: Path, first: int = 1, last: int | None = None) -> Iterator[tuple[int, str]]:
    """The lines `first` to `last` with their numbers."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        yield from islice(enumerate(stream, 1), first - 1, last)


def _head(source: Source) -> tuple[list[str], tuple[int, str], tuple[str, ...]]:
    """The comments above the header, the header with the number of its last line, and what was read past.

    Analysers write lines of their own above it: the header is then the line of names that stands right above the
    numbers, as many as they, or has a line of units in between.
    """
    comments: list[str] = []
    lines: list[tuple[int, str]] = []
    for number, line in _lines(source.path):
        if not _is_skipped(line):
            lines.append((number, line.rstrip("\n")))
        elif not lines:
            comments.append(line.rstrip("\n"))
        if len(lines) > _MOST_ABOVE or (len(lines) == 3 and _named_by(lines)):
            break
    if not lines:
        raise source.error("hold a header row and samples", "holds nothing but comments", "Export it again.")
    place = next((k for k in range(len(lines)) if _named_by(lines[k:])), 0)
    top, head = lines[place]
    if place == 0:
        _refuse_words_above(source, lines)
        return comments, lines[0], ()
    delimiter = _named_by(lines[place:])
    names, units = (_filled(line, delimiter) for _, line in lines[place - 1 : place + 1])
    if len(names) == len(units) and not any(map(_is_number, names)):
        if any(name_and_unit(f"x ({unit})")[1] is None for unit in units):
            raise _unclear(source, lines[place - 1][0], top)
        pairs = zip(names, units, strict=True)
        head = delimiter.join('"' + f"{name} [{unit}]".replace('"', '""') + '"' for name, unit in pairs)
        place -= 1
    past = (f"What is above the header, down to line {lines[place - 1][0]}, was read past.",) if place else ()
    return comments, (top, head), past


def _named_by(lines: Sequence[tuple[int, str]]) -> str:
    """The delimiter by which the first line has a name for each cell of numbers in the next two; empty without one."""
    for delimiter in ",;\t":
        names, rows = _filled(lines[0][1], delimiter), [split_cells(line, delimiter) for _, line in lines[1:3]]
        fit = all(_are_numbers(row) and len(names) in (len(row), len(row) - (row[-1] == "")) for row in rows)
        bare = len(names) == 1 and any(set(line) & set(",;\t") for _, line in lines[:3])  # by another delimiter
        if rows and fit and not bare and not any(map(_is_number, names)):
            return delimiter
    return ""


def _filled(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without an empty one at its end."""
    cells = split_cells(line, delimiter)
    return cells[:-1] if cells[-1] == "" else cells


def _refuse_words_above(source: Source, lines: Sequence[tuple[int, str]]) -> None:
    """Refuse lines of words above numbers that none of them has the names of; odd rows under a header are no such."""
    for place, (number, line) in enumerate(lines):
        for delimiter in ",;\t":
            cells = _filled(line, delimiter)
            like = len(cells) == len(_filled(lines[0][1], delimiter))
            if place > 1 and _are_numbers(cells):
                raise _unclear(source, lines[0][0], number - 1)
            if place and (_are_numbers(cells) or (like and any(cell and _is_number(cell) for cell in cells))):
                return


def _unclear(source: Source, first: int, last: int) -> InputError:
    must = "have one header, with a name for each column, right above its numbers"
    remedy = "Delete what is not the header, or put # before those lines; units stand in brackets, as in `x [m]`."
    return source.error(must, f"has other words in lines {first} to {last}", remedy)


def _body(source: Source, top: int, head: str) -> _Body:
    """Rows under the header; blank lines and rows of bare delimiters at its end, as spreadsheets leave them, not."""
    last, count, first_row = 0, 0, ""
    waiting, commas, points = 0, False, False
    for number, line in _lines(source.path, top + 1):
        is_row = not _is_skipped(line)
        waiting += is_row
        if line.strip(_BLANK):
            last, count, waiting = number, count + waiting, 0
            first_row = first_row or (line if is_row else "")
        commas = commas or "," in line
        points = points or (is_row and "." in line)
    if not count:
        raise source.error("hold samples", "holds a header and no rows", "Export the samples too.")
    delimiter = find_delimiter(head, first_row.rstrip("\n"))
    return _Body(
        path=source.path,
        first=top + 1,
        last=last,
        count=count,
        delimiter=delimiter,
        decimal_comma=delimiter != "," and commas and not points,
    )


def _is_skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _numbers(source: Source, header: Header, body: _Body, columns: Sequence[int]) -> Floats:
    """The numbers of the chosen columns (columns, rows): in one go, or cell by cell if something is odd."""
    values = np.empty((len(columns), body.count))
    try:
        rows = (line for _, line in body.rows())
        table = np.loadtxt(rows, delimiter=body.delimiter, comments=None, quotechar='"', ndmin=2)
        if table.shape == (body.count, len(header.cells)) and not np.isinf(table[:, columns]).any():
            for place, column in enumerate(columns):
                values[place] = table[:, column]
            return values
    except ValueError:
        pass  # empty cells, or something to be named: the way below is slower and knows the line
    order = sorted((column, place) for place, column in enumerate(columns))  # the first odd cell of a line is named
    for row, (number, line) in enumerate(body.rows()):
        cells = split_cells(line, body.delimiter)
        if len(cells) == len(header.cells) + 1 and cells[-1] == "":
            cells.pop()
        if len(cells) != len(header.cells):
            must = f"have {len(header.cells)} cells in every row, as in its header"
            got = f"has {len(cells)} in line {number}"
            raise source.error(must, got, "Mend that line; a missing sample is an empty cell or `nan`.")
        for column, place in order:
            values[place, row] = _number(source, cells[column], number, header.cells[column])
    return values


def _number(source: Source, cell: str, line: int, column: str) -> float:
    remedy = f"{MISSING}, or read the other columns with `channels=`; times must be numbers, too."
    number = number_in(source, cell, line, column, remedy=remedy)
    if np.isinf(number):
        got = f"has {cell[:40]!r} in line {line}, column {column!r}"
        raise source.error("have finite numbers", got, "Mend that cell: empty or `nan` for a missing sample.")
    return number


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The columns of a table: `channels` at `columns`, the time at `time_column` in units of `time_scale` seconds."""

    cells: tuple[str, ...]
    channels: tuple[Channel, ...]
    columns: tuple[int, ...]
    time_column: int | None = None
    time_scale: float | None = None


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
        must = "begin with a header row that names the columns"
        got = f"begins with numbers (line {line})"
        raise source.error(must, got, "Write a first line such as `time [s],x [m],y [m]`.")
    parts = [name_and_unit(cell) for cell in cells]
    time_column, scale = find_time(source, parts)
    columns = tuple(column for column in range(len(cells)) if column != time_column)
    if not columns:
        must = "have a column for each channel"
        raise source.error(must, f"has the time alone (line {line})", "Export the channels too.")
    own = {channel.label: channel for channel in stated.channels}
    channels = []
    for column in columns:
        name, unit = parts[column]
        if not name:
            must = "name every column in its header"
            raise source.error(must, f"has no name for column {column + 1} (line {line})", "Name it, or delete it.")
        channels.append(own.get(cells[column]) or make_channel(source, name=name, unit=unit or "-"))
    check_distinct(source, [channel.name for channel in channels])
    return Header(
        cells=tuple(cells), channels=tuple(channels), columns=columns, time_column=time_column, time_scale=scale
    )


def _are_numbers(cells: Sequence[str]) -> bool:
    """True where cells are numbers or empty, and not all are empty."""
    return any(cells) and all(map(_is_number, cells))


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return cell == ""
    return True
