"""The skeleton of a TDMS file, walked before npTDMS is given the file.

npTDMS believes what a file declares: it takes memory for as many values as an object is said to have, and goes through
every object of every segment and every chunk of data one by one. Here each count is held against the bytes that are
there, and the steps are counted that reading would take.

Source: National Instruments, "TDMS File Format Internal Structure", 2024.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

from floquid.errors import InputError
from floquid.readers._table import Source

_LEAD = 28
_META, _NEW_LIST, _RAW, _BIG_ENDIAN = 2, 4, 8, 64
_NONE, _SAME, _SCALERS, _LINES = 0xFFFFFFFF, 0, 0x1269, 0x126A
_UNFINISHED = 0xFFFFFFFFFFFFFFFF
_STRING = 0x20
_SIZES = {
    1: 1,
    2: 2,
    3: 4,
    4: 8,
    5: 1,
    6: 2,
    7: 4,
    8: 8,
    9: 4,
    10: 8,
    0x19: 4,
    0x1A: 8,
    0x21: 1,
    0x44: 16,
    0x08000C: 8,
    0x10000D: 16,
}
_MOST_STEPS = 2_000_000
_MOST_SHARED = 8
"""Channels that may share a byte: lines of a digital port."""

_AGAIN = "Copy or export it again."


class _DamagedError(Exception):
    """What is wrong with the skeleton, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Object:
    """The data of one object in a chunk: its values and bytes; DAQmx data are in `buffers` (values, bytes of each)."""

    n_values: int
    n_bytes: int
    buffers: tuple[tuple[int, int], ...] = ()


@dataclass(slots=True, kw_only=True)
class _State:
    """What a segment leaves to the next: its `listed` objects, None for one without data; and all `known` ones."""

    listed: dict[bytes, _Object | None] = field(default_factory=dict)
    known: dict[bytes, _Object] = field(default_factory=dict)
    steps: int = 0
    n_bytes: int = 0
    n_values: int = 0


class _Cursor:
    """Reads numbers from the metadata of a segment and never beyond them."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data, self._order, self._at = data, order, 0

    def take(self, size: int) -> bytes:
        if self._at + size > len(self._data):
            raise _DamagedError("it ends in the middle of the description of its objects")
        self._at += size
        return self._data[self._at - size : self._at]

    def numbers(self, layout: str) -> tuple[int, ...]:
        return struct.unpack(self._order + layout, self.take(struct.calcsize(f"={layout}")))

    def number(self) -> int:
        return self.numbers("I")[0]

    def text(self) -> bytes:
        return self.take(self.number())


def check_layout(source: Source, path: Path) -> None:
    """Refuse a TDMS file that does not hold what it declares, or would take minutes to go through.

    Raises
    ------
    InputError
        It is no TDMS file, is damaged or cut short, or is in too many pieces.
    """
    try:
        _walk(path)
    except _DamagedError as error:
        raise _refusal(source, str(error)) from None


def _refusal(source: Source, words: str) -> InputError:
    return source.error("be a whole TDMS file", f"is not: {words}", _AGAIN)


def _walk(path: Path) -> None:
    size, state, at = path.stat().st_size, _State(), 0
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            lead = stream.read(_LEAD)
            if lead[:4] != b"TDSm":
                raise _DamagedError(f"there is no segment at byte {at}")
            if len(lead) < _LEAD:
                raise _DamagedError("it is cut short")
            (contents,) = struct.unpack_from("<I", lead, 4)
            order = ">" if contents & _BIG_ENDIAN else "<"
            _, length, offset = struct.unpack_from(f"{order}IQQ", lead, 8)
            end = size if length == _UNFINISHED else at + _LEAD + length
            if end > size or at + _LEAD + offset > end:
                raise _DamagedError(f"the segment at byte {at} declares more than is there: it is cut short")
            if contents & _META:
                if contents & _NEW_LIST:
                    state.listed.clear()
                _objects(_Cursor(stream.read(offset), order), state)
            _data(state, end - at - _LEAD - offset)
            at = end


def _objects(cursor: _Cursor, state: _State) -> None:
    """The objects that a segment describes."""
    for _ in range(cursor.number()):
        path, index = cursor.text(), cursor.number()
        if index == _NONE:
            state.listed[path] = None
        elif index == _SAME:
            if path not in state.known:
                raise _DamagedError("an object refers to data described before, and there are none")
            state.listed[path] = state.known[path]
        else:
            state.listed[path] = state.known[path] = _index(cursor, index)
        for _ in range(cursor.number()):
            cursor.text()
            kind = cursor.number()
            if kind not in _SIZES and kind != _STRING:
                raise _DamagedError(f"a property is of an unknown type ({kind:#x})")
            cursor.take(cursor.number() if kind == _STRING else _SIZES[kind])


def _index(cursor: _Cursor, index: int) -> _Object:
    """The data of an object: its type, dimension and number of values."""
    kind, dimension, n_values = cursor.numbers("IIQ")
    if dimension != 1:
        raise _DamagedError(f"an object has {dimension} dimensions, where 1 is allowed")
    if index in (_SCALERS, _LINES):
        scaler = "IIIII" if index == _SCALERS else "IIIBI"
        buffers = {cursor.numbers(scaler)[1] for _ in range(cursor.number())}
        widths = [cursor.number() for _ in range(cursor.number())]
        if any(buffer >= len(widths) for buffer in buffers):
            raise _DamagedError("a channel is in a buffer that is not there")
        found = tuple((n_values if at in buffers else 0, width) for at, width in enumerate(widths))
        return _Object(n_values=n_values, n_bytes=0, buffers=found)
    if kind == _STRING:
        return _Object(n_values=n_values, n_bytes=cursor.numbers("Q")[0])
    if n_values and kind not in _SIZES:
        raise _DamagedError(f"an object is of an unknown type ({kind:#x})")
    return _Object(n_values=n_values, n_bytes=n_values * _SIZES.get(kind, 0))


def _count(state: _State, steps: int) -> None:
    state.steps += steps
    if state.steps > _MOST_STEPS:
        raise _DamagedError("it is in millions of pieces; defragment it first (TDMS Defragment in LabVIEW)")


def _data(state: _State, n_bytes: int) -> None:
    """Hold the data of a segment against its objects, and count what reading them takes."""
    if not n_bytes:  # properties alone: the objects of the segment before are listed still
        _count(state, 1 + len(state.listed))
        return
    held = [found for found in state.listed.values() if found is not None]
    buffers: dict[int, int] = {}
    for found in held:
        for place, (n_values, width) in enumerate(found.buffers):
            buffers[place] = max(buffers.get(place, 0), n_values * width)
    chunk = sum(found.n_bytes for found in held) + sum(buffers.values())
    if (n_bytes % chunk if chunk else n_bytes) or any(found.n_values > n_bytes for found in held):
        raise _DamagedError(f"{n_bytes} bytes of data are not whole chunks of {chunk}")
    n_chunks = n_bytes // chunk if chunk else 0
    _count(state, 1 + len(state.listed) + n_chunks * len(held))
    state.n_bytes += n_bytes
    state.n_values += n_chunks * sum(found.n_values for found in held if found.buffers)
    if state.n_values > _MOST_SHARED * state.n_bytes:
        raise _DamagedError("it declares more values than its bytes can hold")
