"""Text tables: a header row, a time column, then channels with their units in brackets."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Record, channels_named
from floquid.core._time_axis import TimeColumn
from floquid.readers._csv_header import (
    Header,
    find_delimiter,
    parse_header,
    parse_record_line,
    record_line,
    split_cells,
)
from floquid.readers._table import Source, Table

_BLOCK = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True)
class _Body:
    """The lines under the header; the first of them is line `first` of the file (from 1)."""

    lines: list[str]
    first: int
    delimiter: str

    def rows(self) -> Iterator[tuple[int, str]]:
        """The line number and the text of each line that is a row of numbers."""
        for number, line in enumerate(self.lines, self.first):
            if not _is_skipped(line):
                yield number, line


def load_csv(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a text file.

    Raises
    ------
    InputError
        The file is not text in UTF-8, has no header or no samples, a row is ragged, a cell is not a number.
    """
    lines = _lines(source)
    top = next((index for index, line in enumerate(lines) if not _is_skipped(line)), None)
    if top is None:
        raise source.error("hold a header row and samples", "holds nothing but comments", "Export it again.")
    stated = parse_record_line(source, lines[:top])
    while not lines[-1].strip(' \t,;"'):
        lines.pop()  # blank lines, and the rows of bare delimiters that spreadsheets leave at the end
    first_row = next((line for line in lines[top + 1 :] if not _is_skipped(line)), None)
    if first_row is None:
        raise source.error("hold samples", "holds a header and no rows", "Export the samples too.")
    delimiter = find_delimiter(lines[top], first_row)
    cells = split_cells(lines[top], delimiter)
    header = parse_header(source, cells[:-1] if cells[-1] == "" else cells, top + 1, stated)
    body = _Body(lines=lines[top + 1 :], first=top + 2, delimiter=delimiter)
    chosen = (
        list(range(len(header.channels)))
        if channels is None
        else channels_named(header.channels, channels, argument="channels", of=source.of)
    )
    use_time = header.time_column is not None and not ignore_time
    columns = [header.columns[index] for index in chosen] + ([header.time_column] if use_time else [])
    if not use_time:
        _refuse_blank_rows(source, body)
    table = _numbers(source, header, body, [column for column in columns if column is not None])
    values = np.ascontiguousarray(table[: len(chosen)])
    time = None
    if use_time and header.time_column is not None:
        time = TimeColumn(values=table[-1], scale=header.time_scale, label=header.cells[header.time_column])
    ignored = (
        (f"The time column `{header.cells[header.time_column]}` was ignored.",)
        if (header.time_column is not None and ignore_time)
        else ()
    )
    return Table(
        values=values,
        channels=tuple(header.channels[index] for index in chosen),
        time=time,
        sample_rate=stated.sample_rate,
        period=stated.period,
        origin=stated.origin,
        notes=ignored,
    )


def _lines(source: Source) -> list[str]:
    data = source.path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise source.error("be text in UTF-8", "is text in UTF-16", "Save it as CSV UTF-8.")
    if b"\0" in data:
        raise source.error("be text", f"is binary (a NUL byte at {data.index(0)})", "Export it as text.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise source.error(
            "be text in UTF-8",
            f"has a byte 0x{data[error.start]:02x} at {error.start} that is not",
            "Save it as CSV UTF-8; if it is not a text table at all, name it by its format.",
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _is_skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _refuse_blank_rows(source: Source, body: _Body) -> None:
    """Without times a blank line may be a missing sample, and skipping it would move all that follow."""
    for number, line in enumerate(body.lines, body.first):
        if not line.strip():
            raise source.error(
                "have no blank line between its rows when the times are not read",
                f"has one at line {number}",
                "Write `nan` for a missing sample, or delete the line.",
            )


def _numbers(source: Source, header: Header, body: _Body, columns: Sequence[int]) -> NDArray[np.float64]:
    """The numbers of the chosen columns (columns, rows): in one go, or cell by cell if something is odd."""
    if (
        body.delimiter != ","
        and any("," in line for line in body.lines)
        and not any("." in row for _, row in body.rows())
    ):
        body = _Body(lines=[line.replace(",", ".") for line in body.lines], first=body.first, delimiter=body.delimiter)
    lines = [line for line in body.lines if not _is_skipped(line)]
    try:
        table = np.loadtxt(lines, delimiter=body.delimiter, comments=None, quotechar='"', ndmin=2)
        if table.shape == (len(lines), len(header.cells)) and not np.isinf(table[:, columns]).any():
            return table.T[columns]
    except ValueError:
        pass  # empty cells, or something to be named: the way below is slower and knows the line
    table = np.empty((len(lines), len(columns)))
    order = sorted((column, place) for place, column in enumerate(columns))  # the first odd cell of a line is named
    for row, (number, line) in enumerate(body.rows()):
        cells = split_cells(line, body.delimiter)
        if len(cells) == len(header.cells) + 1 and cells[-1] == "":
            cells.pop()
        if len(cells) != len(header.cells):
            raise source.error(
                f"have {len(header.cells)} cells in every row, as in its header",
                f"has {len(cells)} in line {number}",
                "Mend that line; a missing sample is an empty cell or `nan`.",
            )
        for column, place in order:
            table[row, place] = _number(source, cells[column], number, header.cells[column])
    return table.T


def _number(source: Source, cell: str, line: int, column: str) -> float:
    try:
        if "_" in cell or not cell.isascii():  # Python reads 1_000 and foreign digits, no other tool does
            raise ValueError(cell)
        number = float(cell) if cell else np.nan
    except ValueError:
        raise source.error(
            "have a number in every cell",
            f"has {cell[:40]!r} in line {line}, column {column!r}",
            "Mend that cell (empty or `nan` for a missing sample), or read the other columns with `channels` "
            "(`--channels`); times must be numbers, too.",
        ) from None
    if np.isinf(number):
        raise source.error(
            "have finite numbers",
            f"has {cell[:40]!r} in line {line}, column {column!r}",
            "Mend that cell: empty or `nan` for a missing sample.",
        )
    return number


def save_csv(record: Record, path: Path) -> None:
    """Write `record` so that every number is read back as it is.

    Raises
    ------
    InputError
        The record starts so late that its times cannot be told apart.
    """
    times = record.times
    if np.spacing(np.abs(times).max()) * record.sample_rate > 0.01:
        raise input_error(
            "record",
            "write",
            "have times that a table of numbers can tell apart",
            f"starts at {record.start:.6g} s with steps of {1.0 / record.sample_rate:.3g} s",
            "Write it as .npz, or count its time from a nearer start.",
        )
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(["time [s]", *(channel.label for channel in record.channels)])
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"{record_line(record)}\n{head.getvalue()}")
        for first in range(0, record.n_samples, _BLOCK):
            part = slice(first, first + _BLOCK)
            block = np.vstack([times[part], record.values[:, part]]).T.tolist()
            stream.writelines(",".join(map(repr, row)) + "\n" for row in block)
