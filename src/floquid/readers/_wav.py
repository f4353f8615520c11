"""WAV files: samples of full scale ±1, or whatever the file says of its own.

The chunks of the file (RIFF, and RF64 for more than 4 GB) are walked here, each held against the size of the file; see
decision 0008 for what scipy does with a file cut short. A WAV states its rate as a whole number and has no place for
names or units. A chunk of ours, `flqd`, has them (see `_stated`); other programs skip what they do not know.

Sources: IBM and Microsoft, "Multimedia Programming Interface and Data Specifications 1.0", 1991, chapter 3; Microsoft,
"Multiple Channel Audio Data and WAVE Files", 2007; EBU Tech 3306, "RF64", 2009.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Channel, Record, channels_named
from floquid.errors import InputError
from floquid.readers._stated import DamagedLineError, Stated, own_orbit, parse_stated, stated_text
from floquid.readers._table import Source, Table, check_distinct

_OWN = b"flqd"
_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_GUID = bytes.fromhex("000000001000800000aa00389b71")
_PACKED = {2: "Microsoft ADPCM", 6: "A-law", 7: "µ-law", 17: "IMA ADPCM", 80: "MPEG", 85: "MP3"}
_LARGEST = 0xFFFFFFFF
_MOST_CHANNELS = 0xFFFF // 8
_BLOCK = 1 << 16
_AGAIN = "Copy or export it again."


@dataclass(frozen=True, slots=True, kw_only=True)
class _Chunk:
    """A chunk: its four letters, and where its `size` bytes begin."""

    name: bytes
    start: int
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Samples:
    """How the samples are kept: `width` bytes each, whole numbers or not, at `rate` a second."""

    is_float: bool
    width: int
    n_channels: int
    rate: int

    @property
    def frame(self) -> int:
        """Bytes of one sample of all channels."""
        return self.width * self.n_channels

    @property
    def words(self) -> str:
        """As in «16-bit whole numbers»."""
        return f"{8 * self.width}-bit {'floating-point' if self.is_float else 'whole'} numbers"


def load_wav(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a WAV file. Whole numbers are divided by full scale, which is 1; others are as they are.

    Raises
    ------
    InputError
        The file is no WAV file, is damaged, cut short or packed, or our own chunk contradicts it.
    """
    with source.path.open("rb") as stream:
        chunks = _chunks(source, stream)
        samples = _samples(source, stream, chunks)
        stated, notes = _stated(source, stream, chunks, samples, ignore_time=ignore_time)
        named = stated.channels or _named(samples)
        check_distinct(source, [channel.name for channel in named])
        rows = list(range(len(named)))
        if channels is not None:
            rows = channels_named(named, channels, argument="channels", of=source.of)
        values = _values(source, stream, chunks[b"data"], samples, rows)
    if not stated.channels and not samples.is_float:
        notes += (f"The samples are {samples.words}: full scale is 1. A unit is theirs times a channel's sensitivity.",)
    return Table(
        values=values,
        channels=tuple(named[row] for row in rows),
        sample_rate=stated.sample_rate or float(samples.rate),
        start=stated.start,
        period=stated.period,
        origin=stated.origin,
        orbit=own_orbit(stated, [named[row] for row in rows]),
        notes=notes,
    )


def _chunks(source: Source, stream: BinaryIO) -> dict[bytes, _Chunk]:
    """The chunks by name; of those that may come often, the last."""
    end = stream.seek(0, 2)
    stream.seek(0)
    head = stream.read(12)
    declared = 8 + int.from_bytes(head[4:8], "little")
    if head[:4] == b"RIFF" and 12 < declared < end:
        end = declared  # some recorders fill a sector up behind it
    if head[:4] not in (b"RIFF", b"RF64", b"BW64") or head[8:] != b"WAVE":
        raise source.error("be a WAV file", "is not one, or is damaged", f"{_AGAIN} It begins with RIFF and WAVE.")
    found: dict[bytes, _Chunk] = {}
    for chunk in _walk(source, stream, end, is_large=head[:4] != b"RIFF"):
        if chunk.name in found and chunk.name in (b"fmt ", b"data", _OWN):
            raise source.error("have one chunk of a kind", f"has {chunk.name.decode()!r} twice", _AGAIN)
        found[chunk.name] = chunk
    for name in (b"fmt ", b"data"):
        if name not in found:
            raise source.error("be a whole WAV file", f"has no chunk {name.decode().strip()!r}", _AGAIN)
    return found


def _walk(source: Source, stream: BinaryIO, end: int, *, is_large: bool) -> Iterator[_Chunk]:
    at, large_size = 12, None
    while at + 8 <= end:
        stream.seek(at)
        name, size = struct.unpack("<4sI", stream.read(8))
        if name == b"data" and is_large and size == _LARGEST and large_size is not None:
            size = large_size
        if not name.isascii() or not name.decode().isprintable():
            raise source.error("be a whole WAV file", f"has no chunk at byte {at}", _AGAIN)
        if at + 8 + size > end:
            got = f"is cut short: chunk {name.decode()!r} declares {size} bytes, and {end - at - 8} are left"
            raise source.error("be a whole WAV file", got, _AGAIN)
        if name == b"ds64" and size >= 16:
            large_size = struct.unpack("<QQ", stream.read(16))[1]
        yield _Chunk(name=name, start=at + 8, size=size)
        at += 8 + size + size % 2


def _samples(source: Source, stream: BinaryIO, chunks: dict[bytes, _Chunk]) -> _Samples:
    """What the chunk `fmt ` says, held against itself and against the size of the data."""
    chunk = chunks[b"fmt "]
    stream.seek(chunk.start)
    data = stream.read(min(chunk.size, 40))
    if len(data) < 16:
        raise source.error("say how its samples are kept", f"has a chunk 'fmt' of {len(data)} bytes", _AGAIN)
    tag, n_channels, rate, _, frame, bits = struct.unpack_from("<HHIIHH", data)
    if tag == _EXTENSIBLE and len(data) == 40 and data[26:] == _GUID:
        tag = int.from_bytes(data[24:26], "little")
    if tag not in (_PCM, _FLOAT):
        kind = _PACKED.get(tag, f"format {tag:#06x}")
        raise source.error("hold plain samples", f"holds {kind}", "Save it as PCM (whole or floating-point numbers).")
    width = -(-bits // 8)
    if width not in ((4, 8) if tag == _FLOAT else (1, 2, 3, 4, 8)):
        raise source.error("hold samples of 8 to 64 bits", f"states {bits} bits a sample", _AGAIN)
    if not n_channels or not rate or frame != width * n_channels:
        got = f"states {n_channels} channels, {rate} Hz and {frame} bytes for a sample of {bits} bits of each"
        raise source.error("state channels and a rate that are possible", got, _AGAIN)
    if chunks[b"data"].size % frame:
        got = f"has {chunks[b'data'].size} bytes of {frame} each"
        raise source.error("hold whole samples of all channels", got, _AGAIN)
    return _Samples(is_float=tag == _FLOAT, width=width, n_channels=n_channels, rate=rate)


def _named(samples: _Samples) -> tuple[Channel, ...]:
    unit = "-" if samples.is_float else "FS"
    return tuple(Channel(name=f"ch{row}", quantity="other", unit=unit) for row in range(1, samples.n_channels + 1))


def _stated(
    source: Source, stream: BinaryIO, chunks: dict[bytes, _Chunk], samples: _Samples, *, ignore_time: bool
) -> tuple[Stated, tuple[str, ...]]:
    """What our own chunk states, and notes; nothing where there is none, or it is of other channels.

    Raises
    ------
    InputError
        It is damaged, or states another rate than the file.
    """
    chunk = chunks.get(_OWN)
    if chunk is None:
        return Stated(), ()
    stream.seek(chunk.start)
    try:
        stated = parse_stated(stream.read(chunk.size))
    except DamagedLineError:
        must, got = "have its chunk 'flqd' as floquid wrote it", "has another"
        raise source.error(must, got, "Copy it again, or save it by a program that keeps samples alone.") from None
    if len(stated.channels) != samples.n_channels:
        return Stated(), ("Its chunk 'flqd' is of other channels, and is passed over.",)
    if (stated.sample_rate is None or _whole_rate(stated.sample_rate) != samples.rate) and not ignore_time:
        raise source.error(
            "have a chunk 'flqd' that agrees with its header",
            f"states {stated.sample_rate} Hz there and {samples.rate} Hz in the header",
            "The samples were changed since. Pass `rate` (`--rate`) [Hz] to say what it is.",
        )
    if not samples.is_float or samples.width != 8:
        return Stated(), ("Its chunk 'flqd' is of samples that were converted since, and is passed over.",)
    return stated, ()


def _whole_rate(rate: float) -> int:
    """The rate as a header can state it [Hz]."""
    return min(max(round(rate), 1), _LARGEST)


def _values(
    source: Source, stream: BinaryIO, data: _Chunk, samples: _Samples, rows: Sequence[int]
) -> NDArray[np.float64]:
    """The samples of the channels asked for (channels, samples)."""
    n_samples = data.size // samples.frame
    values = np.empty((len(rows), n_samples))
    stream.seek(data.start)
    for first in range(0, n_samples, _BLOCK):
        count = min(_BLOCK, n_samples - first)
        raw = np.frombuffer(stream.read(count * samples.frame), np.uint8)
        if raw.size != count * samples.frame:
            raise source.error("be readable to its end", "is not", _AGAIN)
        values[:, first : first + count] = _decoded(raw.reshape(count, -1), samples)[:, rows].T
    return values


def _decoded(raw: NDArray[np.uint8], samples: _Samples) -> NDArray[np.float64]:
    """Bytes (samples, bytes) as numbers (samples, channels)."""
    if samples.is_float:
        return raw.view(f"<f{samples.width}").astype(np.float64)
    if samples.width == 1:
        return (raw.astype(np.float64) - 128.0) / 128.0
    if samples.width == 3:  # the low byte of four is empty, so that full scale is that of four
        whole = np.zeros((raw.size // 3, 4), np.uint8)
        whole[:, 1:] = raw.reshape(-1, 3)
        return whole.view("<i4").reshape(len(raw), -1).astype(np.float64) / 2.0**31
    values = raw.view(f"<i{samples.width}").astype(np.float64)
    return values / 2.0 ** (8 * samples.width - 1)


def save_wav(record: Record, path: Path) -> None:
    """Write `record` as 64-bit floating-point numbers, in its own units, with a chunk of ours that says all the rest.

    Raises
    ------
    InputError
        There are more channels, or more samples, than a WAV file can count.
    """
    if record.n_channels > _MOST_CHANNELS:
        got = f"has {record.n_channels}"
        raise input_error("record", "write", f"have at most {_MOST_CHANNELS} channels in a WAV file", got, _OTHER)
    own = stated_text(record).encode()
    own += b" " * (len(own) % 2)
    size = record.values.nbytes
    whole = 4 + (8 + 18) + (8 + 4) + (8 + len(own)) + (8 + size)
    if whole > _LARGEST:
        raise _too_large(whole)
    rate, frame = _whole_rate(record.sample_rate), 8 * record.n_channels
    with path.open("wb") as stream:
        stream.write(struct.pack("<4sI4s", b"RIFF", whole, b"WAVE"))
        layout = (_FLOAT, record.n_channels, rate, min(rate * frame, _LARGEST), frame, 64, 0)
        stream.write(struct.pack("<4sIHHIIHHH", b"fmt ", 18, *layout))
        stream.write(struct.pack("<4sII", b"fact", 4, record.n_samples))
        stream.write(struct.pack("<4sI", _OWN, len(own)) + own)
        stream.write(struct.pack("<4sI", b"data", size))
        for first in range(0, record.n_samples, _BLOCK):
            stream.write(record.values[:, first : first + _BLOCK].T.astype("<f8").tobytes())


_OTHER = "Write it as .h5 or .npz."


def _too_large(size: int) -> InputError:
    must = "have less than 4 GiB of samples to fit a WAV file"
    return input_error("record", "write", must, f"takes {size / (1 << 30):.3g} GiB", _OTHER)
