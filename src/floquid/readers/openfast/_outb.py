"""Binary output of OpenFAST (.outb).

All numbers are little-endian. The layout, by `ReadFASTbinary.m` of OpenFAST's MATLAB toolbox:

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

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from floquid.io import Source
from floquid.readers.openfast._common import channels_of
from floquid.tables import Table, TimeColumn, rate_of_step, rows_of

_WITH_TIME, _WITHOUT_TIME, _UNPACKED, _WITH_LENGTH = 1, 2, 3, 4
_LETTERS = 10
_BLOCK = 1 << 16
_AGAIN = "Run OpenFAST again, or copy the file again."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Head:
    """All that is before the samples, which begin at byte `start`.

    `first`, `second` are the first time and the step [s], or the scale and offset of the times.
    """

    kind: int
    n_samples: int
    first: float
    second: float
    scales: NDArray[np.float64]
    offsets: NDArray[np.float64]
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: int


def load_outb(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a binary output file of OpenFAST."""
    with source.path.open("rb") as stream:
        head = _head(source, stream)
        named, notes = channels_of(source, head.names[1:], head.units[1:])
        rows = rows_of(source, named, channels)
        time = None
        if head.kind == _WITH_TIME:
            time = _times(source, stream, head)
        values = _values(source, stream, head, rows)
    rate, start = (None, None) if head.kind == _WITH_TIME or ignore_time else _even(source, head)
    packed = () if head.kind == _UNPACKED else ("The samples are packed into 16 bits: about 5 digits of each range.",)
    return Table(
        values=values,
        time=None if ignore_time else time,
        sample_rate=rate,
        start=start,
        notes=(*notes, *packed),
        channels=tuple(named[row] for row in rows),
    )


def _head(source: Source, stream: BinaryIO) -> _Head:
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
    if stream.tell() + length + texts + body != size or length < 0:
        got = f"declares {n_channels} channels of {n_samples} samples and a description of {length} letters"
        raise source.error("hold what it declares, and no more", f"{got}, in {size} bytes", _AGAIN)
    stream.seek(length, 1)
    words = _words(source, stream.read(texts), letters)
    return _Head(
        kind=kind,
        n_samples=n_samples,
        first=first,
        second=second,
        scales=scaling[:n_channels] if packing else np.ones(n_channels),
        offsets=scaling[n_channels:] if packing else np.zeros(n_channels),
        names=words[: n_channels + 1],
        units=words[n_channels + 1 :],
        start=stream.tell(),
    )


def _words(source: Source, data: bytes, letters: int) -> tuple[str, ...]:
    words = tuple(data[at : at + letters].decode("latin-1").strip() for at in range(0, len(data), letters))
    for word in words:
        if not word.isprintable():
            raise source.error("name its channels in plain letters", f"has {word!r}", _AGAIN)
    return words


def _even(source: Source, head: _Head) -> tuple[float, float]:
    """The rate [Hz] and the start [s] of samples without times."""
    first, step = head.first, head.second
    if not np.isfinite([first, step]).all() or step <= 0.0 or not np.isfinite(1.0 / step):
        must, got = "state a first time and a positive step", f"states {first} s and {step} s"
        raise source.error(must, got, "Pass `rate` (`--rate`) [Hz] to say what it is.")
    return rate_of_step(step), first


def _times(source: Source, stream: BinaryIO, head: _Head) -> TimeColumn | None:
    """The times, to the decimals that 32 bits leave of them."""
    raw = np.frombuffer(stream.read(4 * head.n_samples), "<i4")
    scale, offset = head.first, head.second
    if not np.isfinite([scale, offset]).all() or scale <= 0.0 or not np.isfinite(1.0 / scale):
        got = f"has {scale} and {offset}"
        raise source.error("have a positive scale of its times, and an offset", got, _AGAIN)
    times = (raw - offset) / scale
    decimals = int(np.clip(np.floor(np.log10(scale)), 0, 15))
    if times.size > 1 and abs(times[-1] - times[0]) > 100.0 * times.size * 10.0**-decimals:
        times = np.round(times, decimals)  # what 32 bits cannot tell is no evidence against a round rate
    return TimeColumn(values=times, scale=1.0, label=head.names[0] or "Time")


def _values(source: Source, stream: BinaryIO, head: _Head, rows: Sequence[int]) -> NDArray[np.float64]:
    """The samples of the channels asked for (channels, samples)."""
    bad = [row for row in rows if not (np.isfinite([head.scales[row], head.offsets[row]]).all() and head.scales[row])]
    if bad:
        got = f"has {head.scales[bad[0]]} and {head.offsets[bad[0]]} for {head.names[bad[0] + 1]!r}"
        raise source.error(
            "have a scale that is not zero, and an offset, for each channel",
            got,
            f"{_AGAIN} Or leave it out with `channels` (`--channels`).",
        )
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
