"""Records as commands are given them: read, with the clock and the events that were asked for."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.cli.arguments.options import Choices
from floquid.cli.arguments.shared import TELLS, options, split
from floquid.core import Record
from floquid.errors import InputError
from floquid.io import readable_file
from floquid.preparation import Settings, propose, with_events
from floquid.readers import read_and_describe

OPTION = "--events"


def check_files(files: Sequence[Path], of: str) -> None:
    """Refuse no record at all, and one record as two: its noise would count as two independent ones."""
    if not files:
        example = f"For example: {of} run.npz --period 0.02"
        raise input_error("FILES", of, "name at least one record", "none was given", example)
    seen: dict[Path, Path] = {}
    for file in files:
        place = file.resolve()
        if place in seen:
            got = f"{seen[place]} is given twice" if file == seen[place] else f"{seen[place]} and {file} are one file"
            remedy = "A record counted twice would halve its variance, and nothing more would be known."
            raise input_error("FILES", of, "name each record once", got, remedy)
        seen[place] = file


def read_records(
    files: Sequence[Path], choices: Choices, of: str, report: Callable[[str], None]
) -> tuple[list[Record], Choices]:
    """The records, and the choices with the names that the channels have from here on."""
    chosen, tables = choices.settings, event_files(choices.settings.events)
    records, named = records_in(files, choices, report)
    clocked = chosen.tach or chosen.azimuth or chosen.events or chosen.estimate_period
    for file, record in zip(files, records, strict=True):
        if record.clock is None and not clocked:
            got = f"neither it nor --frequency is, and {file} does not state one"
            free = not chosen.inputs and chosen.excitation == "none"
            remedy = (
                "Give the period [s] (--period 0.02), its frequency [Hz] (--frequency 50), or the channel of a "
                f"tachometer (--tach tach). {'--estimate-period finds it from the response.' if free else TELLS}"
                f"{_likely(file, choices.rate, choices.header)}"
            )
            raise input_error("--period", of, "be given", got, remedy)
    if tables:
        records = [with_events(*both) for both in zip(records, read_events(tables, files, of), strict=True)]
    if chosen.channels:
        choices = choices.with_given(channels=named.channels, asked=chosen.channels if choices.names else None)
    return records, choices


def records_in(
    files: Sequence[Path], choices: Choices, report: Callable[[str], None] = lambda _: None
) -> tuple[list[Record], Settings]:
    """The records in files as they are read for `choices`, and their settings with the names that channels have then.

    Raises InputError as `read` does.
    """
    chosen = choices.settings
    return choices.reading().records(
        files, replace(chosen, events=None) if event_files(chosen.events) else chosen, report
    )


def _likely(file: Path, rate: float | None, header: bool) -> str:
    """The option for the clock that the file seems to hold, in a sentence; empty if there is none."""
    try:
        found, record = read_and_describe(file, rate=rate, header=header)
    except InputError:  # it has to be told which variables are its channels
        return ""
    clock = None if record is None else propose(record, found.clock_candidates).clock
    return f"\n  This file seems to have one: {options(clock.settings)}" if clock and clock.settings else ""


def event_files(words: str | None) -> tuple[Path, ...]:
    """The tables that are named, comma-separated; none where the words are the name of a channel."""
    paths = tuple(Path(word) for word in split(words or ""))
    return paths if any(path.is_file() for path in paths) else ()


def read_events(tables: Sequence[Path], files: Sequence[Path], of: str) -> list[Floats]:
    """The times [s] of the events of each of the record `files` by tables, for the command `of`.

    One table has a column of times [s], and before it one of records, by name or number from 1, where there are
    several. Several tables are one a record, in their order.

    Raises InputError where a table is none, or a record has fewer than two events.
    """
    found: list[list[float]] = [[] for _ in files]
    if len(tables) not in (1, len(files)):
        must, got = "name one table, or one a record", f"names {len(tables)} for {len(files)} records"
        raise input_error(OPTION, of, must, got, "Name as many as there are records, in their order.")
    for number, table in enumerate(tables):
        readable_file(table, of=of, argument=OPTION)
        for line, cells in _rows(table, of):
            where = f"{table}, line {line},"
            alone = len(tables) > 1 or len(cells) == 1 == len(files)
            record = number if alone else _record(cells, files, where, of)
            if record is not None:
                found[record].append(_time(cells[-1], where, of))
    for file, times in zip(files, found, strict=True):
        if len(set(times)) < 2:
            got = f"{', '.join(map(str, tables))} has {len(times)} for {file}"
            raise input_error(OPTION, of, "have two events or more for each record", got, "Leave that record out.")
    return [np.unique(times) for times in found]


def _rows(table: Path, of: str) -> list[tuple[int, list[str]]]:
    """The rows of a table without its header, with their lines."""
    try:
        text = table.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        remedy = "Save it as text, a record and a time in each row."
        raise input_error(OPTION, of, "name text tables", f"{table} is none", remedy) from None
    mark = next((mark for mark in ",;\t" if mark in text), " ")
    rows = list(enumerate(csv.reader(text.splitlines(), delimiter=mark, skipinitialspace=True), start=1))
    rows = [(line, [cell.strip() for cell in cells if cell.strip()]) for line, cells in rows]
    rows = [(line, cells) for line, cells in rows if cells and not cells[0].startswith("#")]
    return rows[1:] if rows and not _is_number(rows[0][1][-1]) else rows


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def _time(cell: str, where: str, of: str) -> float:
    """The time in a cell [s]."""
    if not _is_number(cell):
        remedy = "Put the time [s] last in each row."
        raise input_error(OPTION, of, "have a number last in each row", f"{where} has {cell!r}", remedy)
    return float(cell)


def _record(cells: Sequence[str], files: Sequence[Path], where: str, of: str) -> int | None:
    """The place of the record that a row names by its file, with or without folder and suffix, or by number from 1."""
    word = cells[0] if len(cells) > 1 else ""
    named = [number for number, file in enumerate(files) if word in (str(file), file.name, file.stem)]
    if len(named) == 1:
        return named[0]
    if word.isdigit() and 1 <= int(word) <= len(files):
        return int(word) - 1
    if word and not _is_number(word):
        return None
    remedy = f"Write the name of a file such as {files[0].name}, or its number, 1 to {len(files)}."
    raise input_error(OPTION, of, "name a record in the first column of each row", f"{where} has {word!r}", remedy)
