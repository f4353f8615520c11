"""The text of a table: that of a file by its encoding, or of a workbook as if it had been exported."""

from __future__ import annotations

import codecs
import csv
import io
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from typing import Any, TextIO

from floquid.io import Source, load_package, seems_to_be


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
