"""The numbers of a text table, a block of lines at a time: by NumPy, or cell by cell where something is odd."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from itertools import islice
from typing import Any, TextIO

import numpy as np

from floquid._arrays import Floats
from floquid.io import Source, load_package, seems_to_be
from floquid.readers._layout import Layout, is_comment, is_date, without_dates
from floquid.tables import MISSING, cut_note, is_cut, number_in


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """The text of a `source`: that of its file in an `encoding`, or else its `content`; `notes` say what is odd."""

    source: Source
    encoding: str = "utf-8-sig"
    content: str | None = None
    notes: tuple[str, ...] = ()

    def open(self) -> TextIO:
        """A stream of all of it."""
        if self.content is not None:
            return io.StringIO(self.content)
        return self.source.path.open(encoding=self.encoding, errors="replace")

    def lines(self) -> Iterator[tuple[int, str]]:
        """The lines with their numbers, from 1."""
        with closing(self.open()) as stream:
            yield from enumerate(stream, 1)


def text_in(source: Source) -> Text:
    """The text in a file: in UTF-8, in UTF-16 with its mark, or else in Windows-1252."""
    with source.path.open("rb") as stream:
        marked = stream.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    encoding, name = ("utf-16", "UTF-16") if marked else ("utf-8-sig", "UTF-8")
    wrong, is_cut = _undecodable(source, encoding)
    if not wrong:
        return Text(source=source, encoding=encoding)
    if marked or is_cut or _undecodable(source, "cp1252")[0]:
        remedy = "Save it as CSV UTF-8; if it is not a text table at all, name it by its format."
        raise source.error(f"be text in {name}", f"has {wrong} that is not", remedy)
    note = "The file is not in UTF-8: it was read as Windows-1252."
    return Text(source=source, encoding="cp1252", notes=(note,))


def _undecodable(source: Source, encoding: str) -> tuple[str, bool]:
    """The first byte of a file that is no text in this `encoding`, in words; empty where all are. True at a cut end."""
    decoder, lines = codecs.getincrementaldecoder(encoding)(), 0
    with source.path.open("rb") as stream:
        while True:
            block = stream.read(1 << 20)
            try:
                text = decoder.decode(block, not block)
            except UnicodeDecodeError as error:
                line = lines + error.object[: error.start].count(b"\n") + 1
                is_cut = not block and error.reason == "unexpected end of data"
                return f"a byte 0x{error.object[error.start]:02x} in line {line}", is_cut
            if "\0" in text:
                line = lines + text[: text.index("\0")].count("\n") + 1
                if found := seems_to_be(source.path):
                    raise source.error("be text", f"seems to be {found}", "Name it by its format.")
                raise source.error("be text", f"is binary (a NUL byte in line {line})", "Export it as text.")
            if not block:
                return "", False
            lines += text.count("\n")


def text_of_workbook(source: Source) -> Text:
    """The text of the largest sheet of a workbook, its cells parted by tabs, dates as ISO 8601 and times in seconds."""
    calamine = load_package("python_calamine", source.of, extra="excel")
    with (
        source.taken_apart("workbook", "Open it in a spreadsheet and save it again."),
        source.path.open("rb") as stream,
    ):
        book = calamine.CalamineWorkbook.from_filelike(stream)
        sheets = [book.get_sheet_by_index(place) for place in range(len(book.sheet_names))]
        sheet = max(sheets, key=lambda sheet: sheet.height * sheet.width)
        content = io.StringIO()
        writer = csv.writer(content, delimiter="\t", lineterminator="\n")
        writer.writerows([_as_text(cell) for cell in row] for row in sheet.iter_rows())
    others = sum(other.height > 0 for other in sheets) - 1
    notes = (f"Sheet {sheet.name!r} was read, the largest of {others + 1}.",) if others > 0 else ()
    return Text(source=source, content=content.getvalue(), notes=notes)


def _as_text(cell: Any) -> str:
    """A cell of a workbook as the text that it would have in an export."""
    if isinstance(cell, date):  # also a datetime
        return cell.isoformat(" ") if isinstance(cell, datetime) else cell.isoformat()
    if isinstance(cell, time):
        cell = datetime.combine(date.min, cell) - datetime.min
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    return repr(float(cell)) if isinstance(cell, (int, float)) else " ".join(str(cell).split())


_ROWS = 1 << 14  # rows that are taken apart at a time
_DIGITS = "0123456789+-."
_BARE = ' \t,;"\n'
_DATE = re.compile(r"(\S+?)[T ]?(?:(\d\d:\d\d)(:\d\d)?(?:[.,](\d+))?)? ?(Z|UTC|[+-]\d\d:?\d\d)?")
_REMEDY = f"{MISSING}, or read the other columns with `channels=`; times must be numbers, too."
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """The chosen columns of a table (columns, rows), the first date where one of them has dates, and notes."""

    values: Floats
    first_date: str = ""
    notes: tuple[str, ...] = ()


class _Dates:
    """Dates as seconds from the first of them, exact to the nanosecond."""

    __slots__ = ("first", "text")

    def __init__(self) -> None:
        self.first: int | None = None
        self.text = ""

    def __call__(self, cell: str) -> float:
        """The seconds [s] from the first cell to this one; NaN of an empty one. ValueError of one that is no date."""
        found = _DATE.fullmatch(cell)
        if not cell or found is None or not is_date(cell):
            if cell:
                raise ValueError(cell)
            return np.nan
        day, minute, second, fraction, zone = found.groups()
        text = f"{day.replace('/', '-')}T{minute or '00:00'}{second or ''}{(zone or '').replace('UTC', 'Z')}"
        moment = datetime.fromisoformat(text)
        since = (moment if zone else moment.replace(tzinfo=UTC)) - _EPOCH
        total = (since.days * 86400 + since.seconds) * 10**9 + int(f"{fraction or ''}000000000"[:9])
        if self.first is None:
            self.first, self.text = total, cell
        return (total - self.first) / 1e9


def read_body(text: Text, layout: Layout, columns: Sequence[int], *, dates: int | None, are_timed: bool) -> Body:
    """The numbers in the `columns` of a `text`, those of `dates` counted from the first.

    A blank line may be a missing sample where rows are not `are_timed`: skipping it would move all that follow.
    """
    source, since, blocks, notes = text.source, _Dates(), [], []
    rows = _rows(text, layout, are_timed=are_timed)
    commas, points, decimal = False, False, False
    mark = layout.parting.mark
    before: list[tuple[int, str]] = []
    while block := list(islice(rows, _ROWS)):
        if len(layout.labels) - 1 in columns and _is_cut([*before, *block], layout):
            notes.append(cut_note(block.pop()[0]))
            if not block:
                break
        before = block
        if mark != ",":
            lines = [line if dates is None else without_dates(line) for _, line in block]
            commas, points = commas or any("," in line for line in lines), points or any("." in line for line in lines)
            if decimal and points:
                got = f"has commas and, in lines {block[0][0]} to {block[-1][0]}, points"
                raise source.error("have one decimal mark in all its numbers", got, "Export it with points.")
            decimal = commas and not points
        lines = [layout.parting.mended(line) for _, line in block]
        if decimal:
            lines = [line.replace(",", ".") for line in lines]
        table = _parsed(lines, layout, dates, since)
        if table is not None and not np.isinf(table[:, columns]).any():
            blocks.append(table[:, columns])
            continue
        if not block[-1][1].endswith("\n") and len(layout.cells(block[-1][1])) < len(layout.labels):
            notes.append(cut_note(block.pop()[0]))
        blocks.append(_by_cell(source, layout, block, columns, dates, since, decimal=decimal))
    n_rows = sum(map(len, blocks))
    if not n_rows:
        raise source.error("hold samples", "holds a header and no rows", "Export the samples too.")
    values, first = np.empty((len(columns), n_rows)), 0
    for place, block in enumerate(blocks):
        values[:, first : first + len(block)] = block.T
        first, blocks[place] = first + len(block), block[:0].copy()
    return Body(values=values, first_date=since.text, notes=tuple(notes))


def _is_cut(block: Sequence[tuple[int, str]], layout: Layout) -> bool:
    """True where the last number of a `block` is at the end of the file, and may have lost digits there, or all."""
    last = block[-1][1]
    if last.endswith("\n") or len(layout.cells(last)) != len(layout.labels):
        return False
    ends = [cells[-1] for _, line in block if len(cells := layout.cells(line)) == len(layout.labels)]
    *others, end = ends
    return is_cut(end, others) or (not end and bool(others) and all(others))


def _parsed(lines: Sequence[str], layout: Layout, dates: int | None, since: _Dates) -> Floats | None:
    """The numbers in `lines` (rows, columns), NaN in empty cells; None where something is odd."""
    mark, n_rows, n_labels = layout.parting.mark, len(lines), len(layout.labels)
    converters: dict[int | str, Callable[[str], Any]] = {} if dates is None else {dates: since}
    for fills in (False, True) if mark else (False,):
        if fills:
            text = "".join(["\n", *lines, "\n"])
            for between in ("{0}{0}", "{0}{0}", "{0}\n", "\n{0}"):  # twice, as two empty cells share a mark
                ends = between.format(mark)
                text = text.replace(ends, f"{ends[0]}nan{ends[1]}")
            lines = text.split("\n")
        try:
            table = np.loadtxt(
                lines, delimiter=mark or None, comments=None, quotechar='"', ndmin=2, converters=converters
            )
        except ValueError:
            continue
        if len(table) == n_rows and table.shape[1] >= n_labels and np.isnan(table[:, n_labels:]).all():
            return table[:, :n_labels]
    return None


def _rows(text: Text, layout: Layout, *, are_timed: bool) -> Iterator[tuple[int, str]]:
    """The rows with the numbers of their lines: without comments, and without what spreadsheets leave at the end."""
    waiting: list[tuple[int, str]] = []
    for number, line in islice(text.lines(), layout.first - 1, None):
        if line[0] not in _DIGITS and not line.strip(_BARE):
            waiting.append((number, line))
        elif line[0] in _DIGITS or not is_comment(line):
            if waiting:
                for blank, bare in waiting:
                    if bare.strip():
                        yield blank, bare
                    elif not are_timed:
                        must = "have no blank line between its rows when the times are not read"
                        remedy = "Write `nan` for a missing sample, or delete the line."
                        raise text.source.error(must, f"has one at line {blank}", remedy)
                waiting.clear()
            yield number, line


def _by_cell(
    source: Source,
    layout: Layout,
    block: Sequence[tuple[int, str]],
    columns: Sequence[int],
    dates: int | None,
    since: _Dates,
    *,
    decimal: bool,
) -> Floats:
    """The numbers in the `columns` of a `block` of rows (rows, columns), the first cell that has none named."""
    values = np.empty((len(block), len(columns)))
    order = sorted((column, place) for place, column in enumerate(columns))  # the first odd cell of a line is named
    for row, (number, line) in enumerate(block):
        cells = layout.cells(line)
        if len(cells) != len(layout.labels):
            must = f"have {len(layout.labels)} cells in every row, as in its header"
            remedy = "Mend that line; a missing sample is an empty cell or `nan`."
            raise source.error(must, f"has {len(cells)} in line {number}", remedy)
        for column, place in order:
            cell, name = cells[column], layout.labels[column]
            if column == dates:
                try:
                    values[row, place] = since(cell)
                except ValueError:
                    got = f"has {cell[:40]!r} in line {number}, column {name!r}"
                    remedy = "Mend that cell, or pass `rate=` [Hz] to ignore the times."
                    raise source.error("have a date in every cell of its times", got, remedy) from None
                continue
            values[row, place] = _number(source, cell.replace(",", ".") if decimal else cell, number, name, cell)
    return values


def _number(source: Source, text: str, line: int, column: str, cell: str) -> float:
    """The finite number in a `cell`, read as `text`."""
    number = number_in(source, text, line, column, shown=cell, remedy=_REMEDY)
    if np.isinf(number):
        got = f"has {cell[:40]!r} in line {line}, column {column!r}"
        raise source.error("have finite numbers", got, "Mend that cell: empty or `nan` for a missing sample.")
    return number
