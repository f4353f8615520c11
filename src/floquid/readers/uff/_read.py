"""Universal files: the time responses in datasets 58, as text and as bytes (58b).

Source: "Universal Dataset Number 58: Function at Nodal DOF", Structural Dynamics Research Laboratory, University of
Cincinnati.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid.core import Channel, Record, channels_named
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._channels import (
    KINDS,
    Axis,
    OwnLines,
    check_names,
    id_lines,
    make_channel,
    name_functions,
    own_lines,
    shared_axis,
    unit_label,
)
from floquid.readers.uff._datasets import Dataset, FunctionHeader, find_datasets
from floquid.tables import Table, TimeColumn

_TIME_RESPONSE, _UNITS = 1, 164
_TYPES = {
    15: "nodes",
    18: "coordinate systems",
    55: "data at nodes",
    82: "trace lines",
    151: "header",
    164: "units",
    1858: "qualifiers of functions",
    2411: "nodes",
    2412: "elements",
    2414: "analysis data",
    2420: "coordinate systems",
}
_FUNCTIONS = {
    0: "general or unknown",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response",
    6: "coherence",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    12: "spectrum",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Function:
    """A time response: its dataset and header, what our ID lines in it state, and its channel."""

    dataset: Dataset
    header: FunctionHeader
    own: OwnLines | None
    channel: Channel
    notes: tuple[str, ...]


def load_uff(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a universal file: its datasets 58 of function type 1, one a channel."""
    # The header prints the step to six digits. The rate is the one in ID line 2 where floquid wrote it, else the round
    # rate that the digits clearly mean, else one over the step; `Table.rate_note` says which.
    data = source.path.read_bytes()
    datasets = find_datasets(source, data)
    system = _unit_system(data, datasets)
    functions = _functions(source, datasets, system)
    if channels is not None:
        named = [function.channel for function in functions]
        asked = _by_lines(functions, channels)
        functions = [functions[row] for row in channels_named(named, asked, argument="channels", of=source.of)]
    names = [function.channel.name for function in functions]
    for function in functions:
        check_size(source, function.dataset, function.header, function.channel.name)
    own = [function.own for function in functions]
    axis = shared_axis(source, [function.header for function in functions], own, names, ignore_time=ignore_time)
    values, times = _values(source, data, functions)
    column = None
    if times is not None and not ignore_time:
        column = TimeColumn(values=times, scale=axis.scale, label="abscissa")
    lines = next((lines for lines in own if lines is not None), None)
    return Table(
        values=values,
        channels=tuple(function.channel for function in functions),
        time=column,
        sample_rate=axis.sample_rate,
        rate_note=axis.rate_note,
        start=axis.start,
        period=lines.period if lines else None,
        origin=lines.origin if lines else None,
        notes=_notes(axis, datasets, functions, system),
    )


def _by_lines(functions: Sequence[_Function], channels: Sequence[str]) -> list[str]:
    """The names of `channels`, some of them by ID line 1 of a function, as other programs show it."""
    names = {function.channel.name for function in functions}
    lines = [function.header.ids[0] for function in functions]
    called = {line: f.channel.name for line, f in zip(lines, functions, strict=True) if lines.count(line) == 1}
    return [name if name in names else called.get(name, name) for name in channels]


def _unit_system(data: bytes, datasets: Sequence[Dataset]) -> int | None:
    """The code of the first dataset 164, None if there is none that says one."""
    for dataset in datasets:
        if dataset.number == _UNITS:
            code = data[dataset.start : dataset.end][:10].strip()
            return int(code) if code.isdigit() else None
    return None


def _functions(source: Source, datasets: Sequence[Dataset], system: int | None) -> list[_Function]:
    found = [(d, d.header) for d in datasets if d.header is not None and d.header.function == _TIME_RESPONSE]
    if not found:
        must = "hold time responses: datasets of type 58 and function type 1"
        raise source.error(must, f"holds {', '.join(_aside(datasets))}", "Export the time histories.")
    headers = [header for _, header in found]
    own = [own_lines(source, header) for header in headers]
    names = name_functions(headers, own)
    check_names(source, headers, names)
    functions = []
    for (dataset, header), lines, name in zip(found, own, names, strict=True):
        channel, notes = make_channel(header, lines, name, system)
        functions.append(_Function(dataset=dataset, header=header, own=lines, channel=channel, notes=notes))
    return functions


def _aside(datasets: Sequence[Dataset]) -> list[str]:
    """Datasets that are no time responses, as in «3 datasets of type 15 (nodes)»."""
    others = Counter(d.number for d in datasets if d.header is None)
    functions = Counter(d.header.function for d in datasets if d.header and d.header.function != _TIME_RESPONSE)
    words = [_counted(count, "dataset", number, _TYPES) for number, count in others.items()]
    return words + [_counted(count, "function", number, _FUNCTIONS) for number, count in functions.items()]


def _counted(count: int, what: str, number: int, known: dict[int, str]) -> str:
    meaning = f" ({known[number]})" if number in known else ""
    return f"{count} {what}{'' if count == 1 else 's'} of type {number}{meaning}"


def _values(source: Source, data: bytes, functions: Sequence[_Function]) -> tuple[Floats, NDArray[np.floating] | None]:
    """The ordinates (channels, samples), and the uneven abscissas (samples,) that all must share."""
    values = np.empty((len(functions), functions[0].header.n_points))
    shared: NDArray[np.floating] | None = None
    for row, function in enumerate(functions):
        values[row], times = read_values(source, data, function.dataset, function.header, function.channel.name)
        if times is not None and shared is not None and not np.array_equal(times, shared, equal_nan=True):
            got = f"has others for {function.channel.name!r} than for {functions[0].channel.name!r}"
            remedy = "Choose channels that go together with `channels=`, or export them on one time axis."
            raise source.error("hold channels of the same times", got, remedy)
        shared = times if shared is None else shared
    return values, shared


def _notes(
    axis: Axis, datasets: Sequence[Dataset], functions: Sequence[_Function], system: int | None
) -> tuple[str, ...]:
    """Further statements of the file, and parts of it that are not used."""
    notes = [*axis.notes, *(note for function in functions for note in function.notes)]
    notes += [f"The file also holds {words}, not used." for words in _aside(datasets) if "type 164 " not in words]
    if system is not None:
        notes.append(f"Dataset 164 states the unit system {system}: it names the units that the functions do not.")
    foreign = [function for function in functions if function.own is None]
    if foreign:
        lines = " | ".join(line for line in foreign[0].header.ids if line)
        notes += [f"ID lines of {foreign[0].channel.name!r}: {lines}"] if lines else []
    references = dict.fromkeys(f.header.reference.words for f in functions if f.header.reference.words)
    if references:
        notes.append(f"Reference of the functions: {', '.join(references)}.")
    singles = sum(function.header.data_type == 2 for function in functions)
    if singles:
        notes.append(f"Stored in single precision, about 7 digits: {singles} of {len(functions)} channels.")
    return tuple(notes)


def save_uff(record: Record, path: Path) -> None:
    """Write `record` as binary functions (58b), one a channel, in double precision: every bit of a number is kept.

    A missing sample is NaN. What the headers cannot keep (the rate beyond seven digits, the period, words) is in the ID
    lines, as `_channels` describes.
    """
    with path.open("wb") as stream:
        for row, channel in enumerate(record.channels):
            values = record.values[row].astype("<f8").tobytes()
            stream.write(_header(record, channel, row + 1, len(values)).encode())
            stream.write(values)
            stream.write(b"    -1\n")


def _header(record: Record, channel: Channel, node: int, n_bytes: int) -> str:
    kind = KINDS[str(channel.quantity)]
    lines = [
        f"{-1:6d}",
        f"{58:6d}b{1:6d}{2:6d}{11:12d}{n_bytes:12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        *id_lines(record, channel),
        f"{_TIME_RESPONSE:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{node:10d}{0:4d} {'NONE':10s}{0:10d}{0:4d}",
        f"{4:10d}{record.n_samples:10d}{1:10d}{record.start:13.5e}{1.0 / record.sample_rate:13.6e}{0.0:13.5e}",
        _axis(17, "Time", "s"),
        _axis(kind, str(channel.quantity).capitalize(), unit_label(channel.unit)),
        _axis(0, "NONE", "NONE"),
        _axis(0, "NONE", "NONE"),
    ]
    return "\n".join(lines) + "\n"


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}"


_ORDERS = {1: "<", 2: ">"}
_FLOATS = {1: "DEC VMS", 3: "IBM 370"}
_USUAL = 1e12  # numbers that are measured lie between the inverse of this and this, or are zero
_ENOUGH = 16  # numbers from which their magnitudes are evidence

_EXPORT = "Export or copy the file again."


def check_size(source: Source, dataset: Dataset, header: FunctionHeader, name: str) -> None:
    """Refuse a function that cannot hold what it declares, before memory is taken for it."""
    if header.is_complex:
        remedy = "Export the time history itself, or choose the other channels with `channels=`."
        raise source.error("hold time responses of real numbers", f"has complex ordinates in {name!r}", remedy)
    size = dataset.end - dataset.start
    if dataset.binary is None:
        numbers = header.n_points * (1 if header.is_even else 2)
        if numbers > (size + 1) // 2:
            raise _count(source, header, name, f"{size} characters, which cannot hold as many")
    elif dataset.binary.float_format != 2:
        must = "hold numbers in the format IEEE 754 (2)"
        got = f"declares {_FLOATS[dataset.binary.float_format]} ({dataset.binary.float_format}) for {name!r}"
        raise source.error(must, got, "Export it again, as text or with IEEE numbers.")
    elif size not in header.sizes:
        wanted = " or ".join(map(str, header.sizes))
        raise _count(source, header, name, f"{size} bytes, while as many take {wanted}")


def read_values(
    source: Source, data: bytes, dataset: Dataset, header: FunctionHeader, name: str
) -> tuple[Floats, NDArray[np.floating] | None]:
    """The ordinates (samples,), and the abscissas (samples,) where they are uneven, of a function of checked size."""
    if dataset.binary is None:
        numbers = _text_numbers(source, data[dataset.start : dataset.end], header, name)
        return (numbers, None) if header.is_even else (numbers[1::2], numbers[0::2])
    order, size = _ORDERS[dataset.binary.byte_order], header.number_size
    fields = [("y", f"{order}f{size}")]
    if not header.is_even:
        abscissa = 4 if dataset.end - dataset.start == header.sizes[0] else 8
        fields = [("x", f"{order}f{abscissa}"), *fields]
    table = np.frombuffer(data, dtype=np.dtype(fields), count=header.n_points, offset=dataset.start)
    with np.errstate(invalid="ignore"):  # a NaN of any kind is one
        _check_byte_order(source, table["y"], name, dataset.binary.byte_order)
        times = None if header.is_even else table["x"].astype(table["x"].dtype.newbyteorder("="))
        return table["y"].astype(np.float64), times


def _check_byte_order(source: Source, raw: NDArray[np.floating], name: str, declared: int) -> None:
    """Numbers in the wrong order are of all magnitudes; in the right one nearly all are usual."""

    def usual(values: NDArray[np.floating]) -> float:
        size = np.abs(values[np.isfinite(values)])
        return np.count_nonzero((size == 0.0) | ((size > 1.0 / _USUAL) & (size < _USUAL))) / max(len(values), 1)

    some = raw[:: len(raw) // 10000 + 1]
    some = some[~np.isnan(some)]
    if len(some) >= _ENOUGH and usual(some) < 0.5 and usual(some.view(some.dtype.newbyteorder())) > 0.9:
        must = "declare the byte order that its numbers have"
        got = f"declares {declared} for {name!r}, whose numbers make sense in the other order only"
        raise source.error(must, got, f"Set the first number after `58b` to {3 - declared}, or export it again.")


def _text_numbers(source: Source, text: bytes, header: FunctionHeader, name: str) -> Floats:
    """All numbers of a function's text: by blanks, or by the columns of the format where two numbers touch."""
    wanted = header.n_points * (1 if header.is_even else 2)
    if b"D" in text or b"d" in text:
        text = re.sub(rb"(?<=[\d.])[Dd](?=[-+\d])", b"E", text)
    numbers = _parsed(text)
    if numbers is None or len(numbers) != wanted:
        numbers = _parsed(b"\n".join(_cut(line, header) for line in text.splitlines()))
    if numbers is None:
        raise _no_number(source, text, name)
    if len(numbers) != wanted:
        raise _count(source, header, name, f"{len(numbers) // (1 if header.is_even else 2)}")
    return numbers


def _parsed(text: bytes) -> Floats | None:
    """The numbers in a text, separated by blanks; None if something else is there."""
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older versions of numpy warn of what newer ones refuse
        try:
            return np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _cut(line: bytes, header: FunctionHeader) -> bytes:
    """A line of fixed columns with blanks put between them: 6E13.5, 4E20.12 or 2(E13.5,E20.12)."""
    ordinate = 20 if header.number_size == 8 else 13
    widths = [ordinate] if header.is_even else [13, ordinate]
    cells, place = [], 0
    while place < len(line):
        cells.append(line[place : place + widths[len(cells) % len(widths)]])
        place += len(cells[-1])
    return b" ".join(cells)


def _no_number(source: Source, text: bytes, name: str) -> InputError:
    lines = enumerate(text.splitlines(), start=1)
    bad = ((word, number) for number, line in lines for word in line.split() if _parsed(word) is None)
    word, line = next(bad, (b"", 0))
    where = f"{word[:40].decode('latin-1')!r} among those of {name!r}, in line {line} under its header"
    return source.error("hold numbers", f"has {where if line else f'others in {name!r}'}", f"Mend that line. {_EXPORT}")


def _count(source: Source, header: FunctionHeader, name: str, got: str) -> InputError:
    must = "hold the points that it declares"
    got = f"declares {header.n_points} for {name!r} and holds {got}"
    return source.error(must, got, f"Mend the second number in line 7 of its header if that is wrong. {_EXPORT}")
