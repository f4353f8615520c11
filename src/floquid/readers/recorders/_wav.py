"""WAV files, which scipy takes apart.

A WAV has samples of full scale ±1, or whatever the file has of its own. It states its rate as a whole number and has no
place for names or units. scipy takes a file cut short for whole, and believes the size that the whole states, so that
the sizes of the chunks are looked at here.
"""

from __future__ import annotations

import io
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
_AS_PCM = "Copy or export it again, as PCM (whole or floating-point numbers)."


def load_wav(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a WAV file. Whole numbers are divided by full scale, which is 1; others are as they are."""
    from scipy.io import wavfile

    del ignore_time  # there are no times
    with _WavFile(source) as stream, source.taken_apart("WAV file", _AS_PCM), warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that it does not know
        stream.check()
        rate, found = wavfile.read(stream)
        samples: NDArray[Any] = found[:, None] if found.ndim == 1 else found
        if not (rate and samples.shape[1]):
            raise DamagedError(f"it states {rate} Hz and {samples.shape[1]} channels")
    is_float, notes = samples.dtype.kind == "f", stream.notes
    if not is_float:
        words = f"{8 * samples.dtype.itemsize}-bit numbers"
        scale = f"The samples are whole {words}: full scale is 1. A unit is theirs times a channel's sensitivity."
        notes = (*stream.notes, scale)
    named = tuple(
        Channel(name=f"ch{row}", quantity="other", unit="-" if is_float else "FS")
        for row in range(1, samples.shape[1] + 1)
    )
    rows = rows_of(source, named, channels)
    return Table(
        values=_scaled(samples, rows),
        channels=tuple(named[row] for row in rows),
        sample_rate=float(rate),
        notes=notes,
    )


class _WavFile(io.FileIO):
    """A WAV file with the sizes in its heads as they are.

    The size of the whole is often wrong, and what was written as a stream does not know its sizes: the samples then go
    to the end of the file, and `notes` says so.
    """

    def __init__(self, source: Source) -> None:
        super().__init__(source.path)
        self._source, self._size = source, source.path.stat().st_size
        self._changes: dict[int, bytes] = {}
        self._order = "<"
        self.notes: tuple[str, ...] = ()

    def check(self) -> None:
        """Refuse the file if its samples are not all there."""
        head = super().read(12)
        if head[8:] != b"WAVE":
            remedy = f"{_AS_PCM} It begins with RIFF and WAVE."
            raise self._source.error("be a WAV file", "is not one, or is damaged", remedy)
        self._order = ">" if head[:4] == b"RIFX" else "<"
        (declared,) = struct.unpack(f"{self._order}I", head[4:8])
        end = self._end_of_chunks(declared)
        if head[:4] != b"RF64":
            self._changes[4] = struct.pack(f"{self._order}I", min(end - 8, _UNKNOWN))
        self.seek(0)

    def _end_of_chunks(self, declared: int) -> int:
        """The end of the last chunk, those beyond the declared size of the whole looked at until there are samples."""
        large, frame, end, has_samples = 0, 1, 12, False
        while (at := self.tell()) + 8 <= self._size and (at < 8 + declared or not has_samples):
            name, size = struct.unpack(f"{self._order}4sI", super().read(8))
            left = self._size - at - 8
            if name == b"data" and size == _UNKNOWN and large:
                size = large
            elif name == b"data" and _is_unknown(declared) and _is_unknown(size) and left <= _UNKNOWN:
                size = left - left % frame
                self._changes[at + 4] = struct.pack(f"{self._order}I", size)
                self.notes = ("The file does not state its length: its samples go to its end.",)
            if size > left:
                got = f"is cut short: chunk {printable(str(name)[2:-1])!r} declares {size} bytes, and {left} are left"
                raise self._source.error("be a whole WAV file", got, _AS_PCM)
            if name == b"ds64":
                large = int.from_bytes(super().read(16)[8:], "little")  # of RF64: the data may be of more than 4 GB
            if name == b"fmt " and size >= 14:
                frame = struct.unpack(f"{self._order}12xH", super().read(14))[0] or 1
            end, has_samples = at + 8 + size, has_samples or name == b"data"
            self.seek(end + size % 2)
        return end

    def read(self, size: int | None = -1, /) -> bytes:
        """Bytes from here on, sizes in the heads as they are."""
        at = self.tell()
        data = super().read(-1 if size is None else size)
        for place, number in self._changes.items():
            if at <= place and place + len(number) <= at + len(data):
                data = data[: place - at] + number + data[place - at + len(number) :]
        return data


def _is_unknown(size: int) -> bool:
    """True for the sizes that programs write before they know them: zero, or nearly the largest number."""
    return size == 0 or any(0 <= largest - size <= 64 for largest in (_UNKNOWN, 0x7FFFFFFF, 0x7FFFF000))


def _scaled(samples: NDArray[Any], rows: Sequence[int]) -> Floats:
    """Channels of samples over full scale, what their type holds (scipy shifts 24 bits into 32); or as is."""
    values = np.empty((len(rows), len(samples)))
    for row, column in zip(values, rows, strict=True):  # one at a time: a copy of all would be as large as the file
        row[:] = samples[:, column]
    if samples.dtype.kind == "u":
        values -= 128.0
    if samples.dtype.kind in "iu":
        values /= 2.0 ** (8 * samples.dtype.itemsize - 1)
    return values
