"""Time series that OpenFAST writes: text (.out) and binary (.outb).

In binary files all numbers are little-endian. The layout, by `ReadFASTbinary.m` of OpenFAST's MATLAB toolbox:

    int16        1 with a time for each sample, 2 without, 3 not packed, 4 as 2 with the length of names
    int16        the length L of names and units; of 4 alone, elsewhere it is 10
    int32 (2)    channels C, samples N
    float64 (2)  of 1: scale and offset of the times; else: the first time and the step [s]
    float32 (2C) scales, then offsets, of the channels; not of 3
    int32        the length D of the description
    D letters    the description
    L(C+1)       the names, the first of them that of the time
    L(C+1)       the units, in parentheses
    int32 (N)    of 1: each time its product with the scale, plus the offset
    N times C    int16, or float64 of 3: each sample likewise
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from floquid._arrays import Floats
from floquid.core import Channel
from floquid.io import Source
from floquid.tables import Table, TimeColumn, WholeLines, make_channels, number_in, numbered, rate_of_step, rows_of

_UNITS = {"": "-", "-": "-", "°": "deg"}


def channels_of(source: Source, labels: Sequence[str], units: Sequence[str]) -> tuple[Channel, ...]:
    """The channels of columns with these `labels` and `units`; a label that comes again has its number."""
    bare = [re.sub(r"\bsec\b", "s", unit.strip().strip("()[]").strip()) for unit in units]  # «(m/sec^2)» as m/s^2
    return make_channels(source, numbered(labels), [_UNITS.get(unit, unit) for unit in bare])


def _channel_notes(
    labels: Sequence[str], named: Sequence[Channel], rows: Sequence[int], values: Floats, channels: Sequence[str] | None
) -> tuple[list[int], tuple[str, ...]]:
    """Places among the `rows` that stay, and notes: of all channels those of equal label and samples are one."""
    invalid = [channel.name for channel in named if channel.unit == "INVALID"]
    notes = (f"OpenFAST marks as invalid, and fills with zeros: {', '.join(invalid[:20])}.",) if invalid else ()
    stay: list[int] = []
    for place, row in enumerate(rows):
        again = [k for k in stay if labels[rows[k]] == labels[row]] if channels is None else []
        if any(np.array_equal(values[k], values[place], equal_nan=True) for k in again):
            notes += (f"{labels[row]!r} is there again with the same samples: read once.",)
            continue
        if again:
            notes += (f"{labels[row]!r} is there again with other samples: read as {named[row].name!r}.",)
        stay.append(place)
    return stay, notes


_MOST_WORDS = 60  # lines above the names, at most
_NO_E = re.compile(r"(\d)([-+]\d{3})\b")  # an exponent of three digits as Fortran prints it: 1.0-101

_FORTRAN = re.compile(r"(?<=[\d.])[Dd](?=[-+\d])")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Head:
    """The names and the units; the numbers begin in line `first` (from 1)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    first: int


def load_out(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a text output file of OpenFAST."""
    head = _head(source)
    named = channels_of(source, head.names[1:], head.units[1:])
    rows = rows_of(source, named, channels)
    values, times, cut = _numbers(source, head, rows)
    stay, notes = _channel_notes(head.names[1:], named, rows, values, channels)
    notes += cut
    if ignore_time:
        notes += ("The times in the file were ignored.",)
    return Table(
        values=values if len(stay) == len(rows) else values[stay],
        time=None if ignore_time else TimeColumn(values=times, scale=1.0, label=head.names[0]),
        channels=tuple(named[rows[place]] for place in stay),
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
    must = "have a line of names that begins with `Time`, as OpenFAST writes it"
    got = f"has none among its first {_MOST_WORDS} lines"
    raise source.error(must, got, "Name a text table of another program .csv, with a header row.")


def _with_units(source: Source, names: Sequence[str], at: int) -> _Head:
    units = next(islice(_lines(source.path), at, None), "").split()
    has_units = bool(units) and units[0].startswith("(")
    if has_units and len(units) != len(names):
        must, remedy = "have a unit for each name", "Names and units have no blanks in them: mend those lines."
        raise source.error(must, f"has {len(names)} names and {len(units)} units (lines {at} and {at + 1})", remedy)
    if len(names) < 2:
        raise source.error("have a column for each channel", f"has the time alone (line {at})", "Export the channels.")
    for name in names:
        if not name.isprintable():
            raise source.error("name its channels in plain letters", f"has {name!r} in line {at}", "Rename it.")
    plain = tuple(units) if has_units else ("(-)",) * len(names)
    return _Head(names=tuple(names), units=plain, first=at + 1 + has_units)


def _numbers(source: Source, head: _Head, rows: Sequence[int]) -> tuple[Floats, Floats, tuple[str, ...]]:
    """The samples of the channels asked for (channels, samples), the times (samples,), and a note on a cut end."""
    body = _rows(source.path, head)
    lines = (line for _, line in body)
    first = next(lines, None)
    if first is None:
        raise source.error("hold samples", "holds names and no rows", "Run OpenFAST to its end.")
    try:
        table = np.loadtxt(chain([first], lines), comments=None, ndmin=2)
        if table.shape[1] != len(head.names):
            raise ValueError(table.shape)
    except ValueError:  # something to be named, or a number as Fortran prints it
        table = _by_cell(source, head)
    values = np.empty((len(rows), len(table)))
    for place, row in enumerate(rows):
        values[place] = table[:, row + 1]
    return values, table[:, 0].copy(), body.notes


def _rows(path: Path, head: _Head) -> WholeLines:
    """The lines of numbers that are not blank, with their numbers."""
    lines = enumerate(islice(_lines(path), head.first - 1, None), head.first)
    return WholeLines((number, line) for number, line in lines if line.strip())


def _by_cell(source: Source, head: _Head) -> Floats:
    found = []
    remedy = "Mend that cell, or run OpenFAST again; stars are a number too long for its `OutFmt`."
    for number, line in _rows(source.path, head):
        cells, shown = _NO_E.sub(r"\1E\2", _FORTRAN.sub("E", line)).split(), line.split()
        if len(cells) != len(head.names):
            must = f"have {len(head.names)} numbers in every row, as it has names"
            remedy = "Mend that line, or leave it out: a run that was stopped may end in half a line."
            raise source.error(must, f"has {len(cells)} in line {number}", remedy)
        columns = zip(cells, shown, head.names, strict=True)
        found.append([number_in(source, cell, number, name, shown=own, remedy=remedy) for cell, own, name in columns])
    return np.array(found)


_WITH_TIME, _WITHOUT_TIME, _UNPACKED, _WITH_LENGTH = 1, 2, 3, 4
_LETTERS = 10
_BLOCK = 1 << 16
_AGAIN = "Run OpenFAST again, or copy the file again."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _BinaryHead:
    """All before the samples at `start`; `first`, `second`: first time and step [s], or scale and offset of times.

    `n_left_over` bytes are behind the samples: a shorter run does not cut the file of a longer one.
    """

    kind: int
    n_samples: int
    first: float
    second: float
    scales: Floats
    offsets: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: int
    n_left_over: int


def load_outb(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a binary output file of OpenFAST."""
    with source.path.open("rb") as stream:
        head = _binary_head(source, stream)
        named = channels_of(source, head.names[1:], head.units[1:])
        rows = rows_of(source, named, channels)
        time = None
        if head.kind == _WITH_TIME:
            time = _times(source, stream, head)
        values = _values(source, stream, head, rows)
    rate, start = (None, None) if head.kind == _WITH_TIME or ignore_time else _even(source, head)
    stay, notes = _channel_notes(head.names[1:], named, rows, values, channels)
    if head.kind != _UNPACKED:
        notes += ("The samples are packed into 16 bits: about 5 digits of each range.",)
    if head.n_left_over:
        notes += (f"The file has {head.n_left_over} bytes behind its {head.n_samples} samples, which are not used.",)
    return Table(
        values=values if len(stay) == len(rows) else values[stay],
        time=None if ignore_time else time,
        sample_rate=rate,
        start=start,
        notes=notes,
        channels=tuple(named[rows[place]] for place in stay),
    )


def _binary_head(source: Source, stream: BinaryIO) -> _BinaryHead:
    """The head, every length in it held against the size of the file before it is read."""
    size = stream.seek(0, 2)
    stream.seek(0)

    def numbers(layout: str) -> tuple[float, ...]:
        data = stream.read(struct.calcsize(layout))
        if len(data) < struct.calcsize(layout):
            raise source.error("be a whole output file of OpenFAST", "is cut short in its head", _AGAIN)
        return struct.unpack(layout, data)

    (kind,) = numbers("<h")
    if kind not in (_WITH_TIME, _WITHOUT_TIME, _UNPACKED, _WITH_LENGTH):
        remedy = f"{_AGAIN} A text output is called .out."
        raise source.error("begin with one of the numbers 1 to 4", f"begins with {kind}", remedy)
    letters = int(numbers("<h")[0]) if kind == _WITH_LENGTH else _LETTERS
    n_channels, n_samples = (int(number) for number in numbers("<ii"))
    width = 8 if kind == _UNPACKED else 2
    packing = 0 if kind == _UNPACKED else 8 * n_channels
    body = n_samples * (n_channels * width + (4 if kind == _WITH_TIME else 0))
    texts = 2 * letters * (n_channels + 1)
    if min(letters, n_channels) < 1 or n_samples < 0 or stream.tell() + 20 + packing + texts + body > size:
        got = f"declares {n_channels} channels of {n_samples} samples, with names of {letters} letters, in {size} bytes"
        raise source.error("hold the samples that it declares", got, _AGAIN)
    first, second = numbers("<dd")
    scaling = np.frombuffer(stream.read(packing), "<f4").astype(np.float64)
    length = int(numbers("<i")[0])
    n_left_over = size - (stream.tell() + length + texts + body)
    if n_left_over < 0 or length < 0:
        got = f"declares {n_channels} channels of {n_samples} samples and a description of {length} letters"
        raise source.error("hold what it declares", f"{got}, in {size} bytes", _AGAIN)
    stream.seek(length, 1)
    words = _words(source, stream.read(texts), letters)
    return _BinaryHead(
        kind=kind,
        n_samples=n_samples,
        first=first,
        second=second,
        scales=scaling[:n_channels] if packing else np.ones(n_channels),
        offsets=scaling[n_channels:] if packing else np.zeros(n_channels),
        names=words[: n_channels + 1],
        units=words[n_channels + 1 :],
        start=stream.tell(),
        n_left_over=n_left_over,
    )


def _words(source: Source, data: bytes, letters: int) -> tuple[str, ...]:
    words = tuple(data[at : at + letters].decode("latin-1").strip() for at in range(0, len(data), letters))
    for word in words:
        if not word.isprintable():
            raise source.error("name its channels in plain letters", f"has {word!r}", _AGAIN)
    return words


def _even(source: Source, head: _BinaryHead) -> tuple[float, float]:
    """The rate [Hz] and the start [s] of samples without times."""
    first, step = head.first, head.second
    if not np.isfinite([first, step]).all() or step <= 0.0 or not np.isfinite(1.0 / step):
        must, got = "state a first time and a positive step", f"states {first} s and {step} s"
        raise source.error(must, got, "Pass `rate=` [Hz] to say what it is.")
    return rate_of_step(step), first


def _times(source: Source, stream: BinaryIO, head: _BinaryHead) -> TimeColumn | None:
    """The times, to the decimals that 32 bits leave of them."""
    raw = np.frombuffer(stream.read(4 * head.n_samples), "<i4")
    scale, offset = head.first, head.second
    if not np.isfinite([scale, offset]).all() or scale <= 0.0 or not np.isfinite(1.0 / scale):
        raise source.error("have a positive scale of its times, and an offset", f"has {scale} and {offset}", _AGAIN)
    times = (raw - offset) / scale
    decimals = int(np.clip(np.floor(np.log10(scale)), 0, 15))
    if times.size > 1 and abs(times[-1] - times[0]) > 100.0 * times.size * 10.0**-decimals:
        times = np.round(times, decimals)  # what 32 bits cannot tell is no evidence against a round rate
    return TimeColumn(values=times, scale=1.0, label=head.names[0] or "Time")


def _values(source: Source, stream: BinaryIO, head: _BinaryHead, rows: Sequence[int]) -> Floats:
    """The samples of the channels asked for (channels, samples)."""
    bad = [row for row in rows if not (np.isfinite([head.scales[row], head.offsets[row]]).all() and head.scales[row])]
    if bad:
        got = f"has {head.scales[bad[0]]} and {head.offsets[bad[0]]} for {head.names[bad[0] + 1]!r}"
        must = "have a scale that is not zero, and an offset, for each channel"
        raise source.error(must, got, f"{_AGAIN} Or leave it out with `channels=`.")
    n_channels = len(head.scales)
    dtype = np.dtype("<f8" if head.kind == _UNPACKED else "<i2")
    scales, offsets = head.scales[rows, None], head.offsets[rows, None]
    values = np.empty((len(rows), head.n_samples))
    for first in range(0, head.n_samples, _BLOCK):
        count = min(_BLOCK, head.n_samples - first)
        raw = np.frombuffer(stream.read(count * n_channels * dtype.itemsize), dtype).reshape(count, n_channels)
        block = raw[:, rows].T
        values[:, first : first + count] = block if head.kind == _UNPACKED else (block - offsets) / scales
    return values
