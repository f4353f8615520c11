"""Records as commands are given them; `floquid convert`: to another format."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from floquid._arrays import Floats
from floquid._checks import counted, input_error
from floquid.cli._arguments import (
    Frequency,
    Header,
    Names,
    Place,
    Point,
    Rate,
    RecordFile,
    SettingsFile,
    is_saved,
    period_of,
    point_given,
    split,
)
from floquid.cli._folder import identified_in
from floquid.cli._info import TELLS, options
from floquid.cli._options import Choices, Damping
from floquid.cli._terminal import progress, terminal
from floquid.core import Record
from floquid.errors import InputError
from floquid.exports import MODE_FORMATS, export_modes
from floquid.io import readable_file
from floquid.preparation import propose, with_events
from floquid.readers import WRITTEN, read, read_and_describe, write
from floquid.views import DampingUnit

OF = "floquid convert"

_CONVERTED = (
    f"The file to write; its suffix chooses the format: of a record {WRITTEN}; of a result's modes "
    f"{', '.join(MODE_FORMATS)}."
)
Converted = Annotated[Place, Parameter(help=_CONVERTED)]


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
    records, named = choices.reading().records(files, replace(chosen, events=None) if tables else chosen, report)
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


def _likely(file: Path, rate: float | None, header: bool) -> str:
    """The option for the clock that the file seems to hold, in a sentence; empty if there is none."""
    found, record = read_and_describe(file, rate=rate, header=header)
    clock = None if record is None else propose(record, found.clock_candidates).clock
    return f"\n  This file seems to have one: {options(clock.settings)}" if clock and clock.settings else ""


def convert(
    file: RecordFile,
    out: Converted,
    /,
    *,
    channels: str | None = None,
    names: Names = None,
    rate: Rate = None,
    period: float | None = None,
    frequency: Frequency = None,
    origin: float = 0.0,
    header: Header = True,
    point: Point = None,
    coordinates: SettingsFile = None,
    damping_unit: Damping = "percent",
) -> None:
    """Write a record in another format, and say what that format could not hold; or the modes of a result.

    Of a result.h5, or of the folder that it is in, the modes are written for other programs: OUT ends in .uff, .unv,
    .mat, .csv, .json, .tex or .md then, and options of records do not go with it.

    Parameters
    ----------
    file
        The record, or the result.
    channels
        The channels to keep, comma-separated, in that order; all when not given.
    period
        The period of the system [s], to be kept with the record.
    origin
        The time of phase zero [s].
    coordinates
        Of modes in a universal file: a text table of the nodes, `name,x,y,z` a row, by which a viewer draws the shapes.
        A line is drawn from row to row; an empty row begins another.
    """
    _refuse_same(file, out)
    if file.is_dir() or is_saved([file]):
        options: dict[str, object] = {"channels": channels, "names": names, "rate": rate}
        options |= {"period": period, "frequency": frequency}
        options |= {"origin": origin or None, "no-header": None if header else True, "point": point}
        _convert_modes(file, out, options, coordinates, damping_unit)
        return
    if coordinates is not None:
        remedy = "Give the folder that `floquid identify --out` wrote."
        raise input_error("--coordinates", OF, "come with a result", f"{file} is a record", remedy)
    with progress(3) as report:
        report(f"reading {file.name}")
        chosen, called = (None if words is None else split(words) for words in (channels, names))
        period = period_of(period, frequency, OF)
        record = read(file, rate=rate, period=period, channels=chosen, names=called, origin=origin, header=header)
        record = record.with_point(point_given(point or (), OF))
        report(f"writing {out.name}")
        _write(record, out)
        report("reading it back")
        lost = differences(record, read(out))
    console = terminal()
    console.print(
        f"Written to {out}: {counted(record.n_channels, 'channel')}, {counted(record.n_samples, 'sample')} at "
        f"{record.sample_rate:.10g} Hz.",
        soft_wrap=True,
    )
    for words in lost:
        console.print(f"Not kept: {words}.", soft_wrap=True)


def _refuse_same(file: Path, out: Path) -> None:
    with suppress(OSError):
        if out.resolve() == file.resolve() or out.samefile(file):
            got = f"{out} is the file that is read"
            raise input_error("OUT", OF, "be another file", got, "Give the new file a name of its own.")


def _write(record: Record, out: Path) -> None:
    try:
        write(record, out)
    except InputError as error:  # the path of `write` is an option elsewhere, and OUT here
        raise InputError(str(error).replace("`path` of `write`", f"`OUT` of `{OF}`")) from None


def differences(record: Record, found: Record) -> list[str]:
    """In words, what of `record` is not in `found`, which was read from the file that it was written to."""
    pairs = {
        "every sample as it was": _same(record.values, found.values),
        f"the rate of {record.sample_rate!r} Hz": record.sample_rate == found.sample_rate,
        f"the start at {record.start!r} s": record.start == found.start,
        "the words on the channels (names, units, places)": record.channels == found.channels,
        "the clock": record.clock == found.clock,
        "the orbit": _same(record.orbit, found.orbit),
        "the operating point": record.point == found.point,
    }
    return [words for words, kept in pairs.items() if not kept]


def _same(one: Floats | None, other: Floats | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)


def _convert_modes(
    result: Path, out: Path, options: Mapping[str, object], coordinates: Path | None, unit: DampingUnit
) -> None:
    """Write the modes of a result, a file or the folder that it is in; `options` are those of records."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        got, remedy = f"{result} is a result of `floquid identify`", "Leave the option out: modes have all of it."
        raise input_error(f"--{given[0]}", OF, "come with a record", got, remedy)
    if out.suffix.lower() not in MODE_FORMATS:
        remedy = f"Use one of {', '.join(MODE_FORMATS)}."
        raise input_error("OUT", OF, "have a suffix that modes can be written to", f"is {out}", remedy)
    places, lines = (None, None) if coordinates is None else _nodes(coordinates)
    with progress(2) as report:
        report("reading the result")
        analysis = identified_in(result, OF)
        report(f"writing {out.name}")
        export_modes(analysis, out, coordinates=places, lines=lines, damping_unit=unit)
    model = analysis.model
    modes, harmonics = counted(len(model.upper_modes), "mode"), counted(len(model.harmonics), "harmonic")
    terminal().print(f"Written to {out}: {modes}, of {harmonics}.", soft_wrap=True)


def _nodes(file: Path) -> tuple[dict[str, tuple[float, ...]], list[list[str]]]:
    """The coordinates of nodes by their names, and the lines between them, in a text table."""
    readable_file(file, of=OF, argument="--coordinates")
    places: dict[str, tuple[float, ...]] = {}
    lines: list[list[str]] = [[]]
    with file.open(encoding="utf-8-sig", newline="") as stream:
        for number, row in enumerate(csv.reader(stream), start=1):
            if not any(cell.strip() for cell in row):
                lines.append([])
                continue
            name, *where = (cell.strip() for cell in row)
            try:
                x, y, z = map(float, where)
            except ValueError:
                if number == 1:  # a header
                    continue
                must, got = "have rows of a name and three numbers", f"{file} has {','.join(row)!r} in line {number}"
                raise input_error("--coordinates", OF, must, got, "Write a row as hub,0,0,1.5.") from None
            places[name] = (x, y, z)
            lines[-1].append(name)
    return places, [line for line in lines if line]


OPTION = "--events"


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
    """The place of the record that a row names by its file, with or without folder and suffix, or by number from 1.

    None where it names a file that was not given.
    """
    word = cells[0] if len(cells) > 1 else ""
    named = [number for number, file in enumerate(files) if word in (str(file), file.name, file.stem)]
    if len(named) == 1:
        return named[0]
    if word.isdigit() and 1 <= int(word) <= len(files):
        return int(word) - 1
    if word and not _is_number(word):
        return None
    must, got = "name a record in the first column of each row", f"{where} has {word!r}"
    remedy = f"Write the name of a file such as {files[0].name}, or its number, 1 to {len(files)}."
    raise input_error(OPTION, of, must, got, remedy)
