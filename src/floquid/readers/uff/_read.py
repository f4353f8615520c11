"""Universal files: the time responses in datasets 58, as text and as bytes (58b).

Source: "Universal Dataset Number 58: Function at Nodal DOF", Structural Dynamics Research Laboratory, University of
Cincinnati.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel, Record, channels_named
from floquid.io import Source
from floquid.readers.uff._axis import Axis, shared_axis
from floquid.readers.uff._blocks import Dataset, find_datasets
from floquid.readers.uff._channels import check_names, make_channel, name_functions
from floquid.readers.uff._header import FunctionHeader
from floquid.readers.uff._ids import KINDS, OwnLines, id_lines, own_lines, unit_label
from floquid.readers.uff._values import check_size, read_values
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
    """The table in a universal file: its datasets 58 of function type 1, one a channel.

    The header prints the step to six digits. The rate is the one in ID line 2 where floquid wrote it, else the round
    rate that the digits clearly mean, else one over the step; `Table.rate_note` says which.
    """
    data = source.path.read_bytes()
    datasets = find_datasets(source, data)
    system = _unit_system(data, datasets)
    functions = _functions(source, datasets, system)
    if channels is not None:
        named = [function.channel for function in functions]
        functions = [functions[row] for row in channels_named(named, channels, argument="channels", of=source.of)]
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
        raise source.error(
            "hold time responses: datasets of type 58 and function type 1",
            f"holds {', '.join(_aside(datasets))}",
            "Export the time histories.",
        )
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
    """What is not a time response, as in «3 datasets of type 15 (nodes)»."""
    others = Counter(d.number for d in datasets if d.header is None)
    functions = Counter(d.header.function for d in datasets if d.header and d.header.function != _TIME_RESPONSE)
    words = [_counted(count, "dataset", number, _TYPES) for number, count in others.items()]
    return words + [_counted(count, "function", number, _FUNCTIONS) for number, count in functions.items()]


def _counted(count: int, what: str, number: int, known: dict[int, str]) -> str:
    meaning = f" ({known[number]})" if number in known else ""
    return f"{count} {what}{'' if count == 1 else 's'} of type {number}{meaning}"


def _values(
    source: Source, data: bytes, functions: Sequence[_Function]
) -> tuple[NDArray[np.float64], NDArray[np.floating] | None]:
    """The ordinates (channels, samples), and the uneven abscissas (samples,) that all must share."""
    values = np.empty((len(functions), functions[0].header.n_points))
    shared: NDArray[np.floating] | None = None
    for row, function in enumerate(functions):
        values[row], times = read_values(source, data, function.dataset, function.header, function.channel.name)
        if times is not None and shared is not None and not np.array_equal(times, shared, equal_nan=True):
            raise source.error(
                "hold channels of the same times",
                f"has others for {function.channel.name!r} than for {functions[0].channel.name!r}",
                "Choose channels that go together with `channels` (`--channels`), or export them on one time axis.",
            )
        shared = times if shared is None else shared
    return values, shared


def _notes(
    axis: Axis, datasets: Sequence[Dataset], functions: Sequence[_Function], system: int | None
) -> tuple[str, ...]:
    """What else the file says, and what of it is not used."""
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
    lines, as `_uff_ids` describes.
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
