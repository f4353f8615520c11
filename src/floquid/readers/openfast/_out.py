"""Text output of OpenFAST (.out): lines of words, a line of names that begins with Time, one of units, and numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid.io import Source
from floquid.readers.openfast._common import channels_of
from floquid.tables import Table, TimeColumn, rows_of

_MOST_WORDS = 60
"""Lines above the names, at most."""

_NO_E = re.compile(r"(\d)([-+]\d{3})\b")
"""How Fortran prints an exponent of three digits: 1.0-101."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Head:
    """The names and the units; the numbers begin in line `first` (from 1)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int


def load_out(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a text output file of OpenFAST."""
    head = _head(source)
    named, notes = channels_of(source, head.names[1:], head.units[1:])
    rows = rows_of(source, named, channels)
    values, times = _numbers(source, head, rows)
    if ignore_time:
        notes += ("The times in the file were ignored.",)
    return Table(
        values=values,
        time=None if ignore_time else TimeColumn(values=times, scale=1.0, label=head.names[0]),
        channels=tuple(named[row] for row in rows),
        notes=notes,
    )


def _lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="replace") as stream:
        yield from stream


def _head(source: Source) -> _Head:
    for at, line in enumerate(islice(_lines(source.path), _MOST_WORDS), 1):
        if "\0" in line:
            raise source.error("be text", "is binary", "A binary output of OpenFAST is called .outb.")
        names = line.split()
        if names and names[0].lower() == "time":
            return _with_units(source, names, at)
    raise source.error(
        "have a line of names that begins with `Time`, as OpenFAST writes it",
        f"has none among its first {_MOST_WORDS} lines",
        "Name a text table of another program .csv, with a header row.",
    )


def _with_units(source: Source, names: Sequence[str], at: int) -> _Head:
    units = next(islice(_lines(source.path), at, None), "").split()
    has_units = bool(units) and units[0].startswith("(")
    if has_units and len(units) != len(names):
        got = f"has {len(names)} names and {len(units)} units (lines {at} and {at + 1})"
        raise source.error(
            "have a unit for each name", got, "Names and units have no blanks in them: mend those lines."
        )
    if len(names) < 2:
        raise source.error("have a column for each channel", f"has the time alone (line {at})", "Export the channels.")
    for name in names:
        if not name.isprintable():
            raise source.error("name its channels in plain letters", f"has {name!r} in line {at}", "Rename it.")
    plain = tuple(units) if has_units else ("(-)",) * len(names)
    return _Head(names=tuple(names), units=plain, first=at + 1 + has_units)


def _numbers(source: Source, head: _Head, rows: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The samples of the channels asked for (channels, samples), and the times (samples,)."""
    body = (line for line in islice(_lines(source.path), head.first - 1, None) if line.strip())
    first = next(body, None)
    if first is None:
        raise source.error("hold samples", "holds names and no rows", "Run OpenFAST to its end.")
    try:
        table = np.loadtxt(chain([first], body), comments=None, ndmin=2)
        if table.shape[1] != len(head.names):
            raise ValueError(table.shape)
    except ValueError:  # something to be named, or a number as Fortran prints it
        table = _by_cell(source, head)
    values = np.empty((len(rows), len(table)))
    for place, row in enumerate(rows):
        values[place] = table[:, row + 1]
    return values, table[:, 0].copy()


def _by_cell(source: Source, head: _Head) -> NDArray[np.float64]:
    found = []
    for number, line in enumerate(islice(_lines(source.path), head.first - 1, None), head.first):
        cells = line.split()
        if not cells:
            continue
        if len(cells) != len(head.names):
            raise source.error(
                f"have {len(head.names)} numbers in every row, as it has names",
                f"has {len(cells)} in line {number}",
                "Mend that line, or leave it out: a run that was stopped may end in half a line.",
            )
        found.append(np.array([_number(source, cell, number, head.names[at]) for at, cell in enumerate(cells)]))
    return np.array(found)


def _number(source: Source, cell: str, line: int, name: str) -> float:
    try:
        if "_" in cell or not cell.isascii():
            raise ValueError(cell)
        return float(_NO_E.sub(r"\1E\2", cell.upper().replace("D", "E")))
    except ValueError:
        raise source.error(
            "have a number in every cell",
            f"has {cell[:40]!r} in line {line}, column {name!r}",
            "Mend that cell (`nan` for a missing sample); stars are a number too long for `OutFmt`.",
        ) from None
