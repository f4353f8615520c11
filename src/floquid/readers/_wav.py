"""WAV files, which scipy reads: samples of full scale ±1, or whatever the file has of its own.

A WAV states its rate as a whole number and has no place for names or units. scipy takes a file cut short for whole, so
that the sizes of the chunks are looked at here.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import printable
from floquid.core import Channel
from floquid.io import DamagedError, Source
from floquid.tables import Table, rows_of

_UNKNOWN = 0xFFFFFFFF
_AGAIN = "Copy or export it again, as PCM (whole or floating-point numbers)."


def load_wav(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a WAV file. Whole numbers are divided by full scale, which is 1; others are as they are."""
    from scipy.io import wavfile

    del ignore_time  # there are no times
    _check_whole(source)
    with source.taken_apart("WAV file", _AGAIN), warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that it does not know
        rate, found = wavfile.read(source.path)
        samples: NDArray[Any] = found[:, None] if found.ndim == 1 else found
        if not (rate and samples.shape[1]):
            raise DamagedError(f"it states {rate} Hz and {samples.shape[1]} channels")
    is_float, notes = samples.dtype.kind == "f", ()
    if not is_float:
        words = f"{8 * samples.dtype.itemsize}-bit numbers"
        notes = (f"The samples are whole {words}: full scale is 1. A unit is theirs times a channel's sensitivity.",)
    named = tuple(
        Channel(name=f"ch{row}", quantity="other", unit="-" if is_float else "FS")
        for row in range(1, samples.shape[1] + 1)
    )
    rows = rows_of(source, named, channels)
    return Table(
        values=_scaled(samples[:, rows].T),
        channels=tuple(named[row] for row in rows),
        sample_rate=float(rate),
        notes=notes,
    )


def _check_whole(source: Source) -> None:
    """Refuse a file that ends in the middle of a chunk."""
    end, large = source.path.stat().st_size, 0
    with source.path.open("rb") as stream:
        head = stream.read(12)
        if head[8:] != b"WAVE":
            raise source.error("be a WAV file", "is not one, or is damaged", f"{_AGAIN} It begins with RIFF and WAVE.")
        declared = 8 + int.from_bytes(head[4:8], "little")
        if head[:4] == b"RIFF" and 12 < declared < end:
            end = declared  # some recorders fill a sector up behind it
        while stream.tell() + 8 <= end:
            name, size = struct.unpack("<4sI" if head[:4] != b"RIFX" else ">4sI", stream.read(8))
            size, start = large if name == b"data" and size == _UNKNOWN and large else size, stream.tell()
            if start + size > end:
                got = f"is cut short: chunk {printable(str(name)[2:-1])!r} declares {size} bytes, and {end - start} are"
                raise source.error("be a whole WAV file", f"{got} left", _AGAIN)
            if name == b"ds64":
                large = int.from_bytes(stream.read(16)[8:], "little")  # of RF64: the data may be of more than 4 GB
            stream.seek(start + size + size % 2)


def _scaled(samples: NDArray[Any]) -> Floats:
    """Samples over full scale, which is what their type holds (scipy shifts those of 24 bits into 32); or as is."""
    values = samples.astype(np.float64, order="C")
    if samples.dtype.kind == "u":
        values -= 128.0
    if samples.dtype.kind in "iu":
        values /= 2.0 ** (8 * samples.dtype.itemsize - 1)
    return values
