"""`floquid convert`: a record in another format, or the modes of a result for other programs."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from floquid._arrays import Floats
from floquid._checks import counted, input_error
from floquid.cli.arguments.options import Damping
from floquid.cli.arguments.shared import (
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
from floquid.cli.output.folder import identified_in
from floquid.cli.output.terminal import progress, terminal
from floquid.core import Record
from floquid.errors import InputError
from floquid.exports import MODE_FORMATS, export_modes
from floquid.io import readable_file
from floquid.readers import WRITTEN, read, write
from floquid.views import DampingUnit

OF = "floquid convert"

_CONVERTED = (
    f"The file to write; its suffix chooses the format: of a record {WRITTEN}; of a result's modes "
    f"{', '.join(MODE_FORMATS)}."
)
Converted = Annotated[Place, Parameter(help=_CONVERTED)]


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
