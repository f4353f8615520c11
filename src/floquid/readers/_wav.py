"""WAV files, which scipy reads and writes: samples of full scale ±1, or whatever the file says of its own.

A WAV states its rate as a whole number and has no place for names or units. A chunk of ours, `flqd`, has them (see
`_stated`); other programs skip what they do not know. scipy takes a file cut short for whole, so that the sizes of the
chunks are looked at here.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, printable
from floquid.core import Channel, Record
from floquid.io import Source
from floquid.readers._stated import Stated, stated_in, stated_text
from floquid.tables import Table, check_distinct, rows_of

_OWN = b"flqd"
_LARGEST = 0xFFFFFFFF
_MOST_CHANNELS = 0xFFFF // 8
_AGAIN = "Copy or export it again, as PCM (whole or floating-point numbers)."


def load_wav(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a WAV file. Whole numbers are divided by full scale, which is 1; others are as they are.

    Raises
    ------
    InputError
        The file is no WAV file, is damaged, cut short or packed, or our own chunk contradicts it.
    """
    from scipy.io import wavfile

    own = _own_chunk(source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that it does not know
            rate, found = wavfile.read(source.path)
        samples: NDArray[Any] = found[:, None] if found.ndim == 1 else found
        if not (rate and samples.shape[1]):
            raise ValueError(f"it states {rate} Hz and {samples.shape[1]} channels")
    except (OSError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  # ValueError, struct.error, UnboundLocalError, ZeroDivisionError, ...
        got = f"is not one that can be read, or is damaged ({printable(f'{type(error).__name__}: {error}')})"
        raise source.error("be a WAV file", got.rstrip("."), _AGAIN) from None
    is_float, words = samples.dtype.kind == "f", f"{8 * samples.dtype.itemsize}-bit numbers"
    stated, notes = _stated(source, own, rate, samples, ignore_time=ignore_time)
    named = stated.channels or tuple(
        Channel(name=f"ch{row}", quantity="other", unit="-" if is_float else "FS")
        for row in range(1, samples.shape[1] + 1)
    )
    check_distinct(source, [channel.name for channel in named])
    rows = rows_of(source, named, channels)
    if not stated.channels and not is_float:
        notes += (f"The samples are whole {words}: full scale is 1. A unit is theirs times a channel's sensitivity.",)
    return Table(
        values=_scaled(samples[:, rows].T),
        sample_rate=stated.sample_rate or float(rate),
        start=stated.start,
        notes=notes,
        **stated.of([named[row] for row in rows]),
    )


def _own_chunk(source: Source) -> bytes | None:
    """Our own chunk if there is one; a file that ends in the middle of a chunk is refused."""
    found, end, large = None, source.path.stat().st_size, 0
    with source.path.open("rb") as stream:
        head = stream.read(12)
        if head[8:] != b"WAVE":
            raise source.error("be a WAV file", "is not one, or is damaged", f"{_AGAIN} It begins with RIFF and WAVE.")
        declared = 8 + int.from_bytes(head[4:8], "little")
        if head[:4] == b"RIFF" and 12 < declared < end:
            end = declared  # some recorders fill a sector up behind it
        while stream.tell() + 8 <= end:
            name, size = struct.unpack("<4sI" if head[:4] != b"RIFX" else ">4sI", stream.read(8))
            size, start = large if name == b"data" and size == _LARGEST and large else size, stream.tell()
            if start + size > end:
                got = f"is cut short: chunk {printable(str(name)[2:-1])!r} declares {size} bytes, and {end - start} are"
                raise source.error("be a whole WAV file", f"{got} left", _AGAIN)
            if name == b"ds64":
                large = int.from_bytes(stream.read(16)[8:], "little")  # of RF64: the data may be of more than 4 GB
            elif name == _OWN:
                found = stream.read(size)
            stream.seek(start + size + size % 2)
    return found


def _stated(
    source: Source, own: bytes | None, rate: int, samples: NDArray[Any], *, ignore_time: bool
) -> tuple[Stated, tuple[str, ...]]:
    """What our own chunk states, and notes; nothing where there is none, or it is of other channels.

    Raises
    ------
    InputError
        It is damaged, or states another rate than the file.
    """
    if own is None:
        return Stated(), ()
    remedy = "Copy it again, or save it by a program that keeps samples alone."
    stated = stated_in(source, own, "its chunk 'flqd'", remedy)
    if len(stated.channels) != samples.shape[1]:
        return Stated(), ("Its chunk 'flqd' is of other channels, and is passed over.",)
    if (stated.sample_rate is None or _whole_rate(stated.sample_rate, samples.shape[1]) != rate) and not ignore_time:
        raise source.error(
            "have a chunk 'flqd' that agrees with its header",
            f"states {stated.sample_rate} Hz there and {rate} Hz in the header",
            "The samples were changed since. Pass `rate` (`--rate`) [Hz] to say what it is.",
        )
    if samples.dtype != np.float64:
        return Stated(), ("Its chunk 'flqd' is of samples that were converted since, and is passed over.",)
    return stated, ()


def _whole_rate(rate: float, n_channels: int) -> int:
    """The rate as a header can state it [Hz], which counts the bytes of a second, too."""
    return min(max(round(rate), 1), _LARGEST // (8 * n_channels))


def _scaled(samples: NDArray[Any]) -> NDArray[np.float64]:
    """Samples over full scale, which is what their type holds (scipy shifts those of 24 bits into 32); or as is."""
    values = samples.astype(np.float64, order="C")
    if samples.dtype.kind == "u":
        values -= 128.0
    if samples.dtype.kind in "iu":
        values /= 2.0 ** (8 * samples.dtype.itemsize - 1)
    return values


def save_wav(record: Record, path: Path) -> None:
    """Write `record` as 64-bit floating-point numbers, in its own units, with a chunk of ours that says all the rest.

    Raises
    ------
    InputError
        There are more channels, or more samples, than a WAV file can count.
    """
    from scipy.io import wavfile

    if record.n_channels > _MOST_CHANNELS:
        must, got = f"have at most {_MOST_CHANNELS} channels in a WAV file", f"has {record.n_channels}"
        raise input_error("record", "write", must, got, _OTHER)
    own = stated_text(record).encode()
    own += b" " * (len(own) % 2)
    whole = record.values.nbytes + len(own) + 100
    if whole > _LARGEST:
        must = "have less than 4 GiB of samples to fit a WAV file"
        raise input_error("record", "write", must, f"takes {whole / (1 << 30):.3g} GiB", _OTHER)
    rate = _whole_rate(record.sample_rate, record.n_channels)
    with path.open("w+b") as stream:
        wavfile.write(stream, rate, np.ascontiguousarray(record.values.T))
        stream.seek(0, 2)
        stream.write(struct.pack("<4sI", _OWN, len(own)) + own)
        size = stream.tell() - 8
        stream.seek(4)
        stream.write(struct.pack("<I", size))


_OTHER = "Write it as .h5 or .npz."
