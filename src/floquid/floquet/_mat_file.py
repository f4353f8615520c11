"""Arrays and texts of MATLAB files of version 5 to 7.

A file is a head of 128 bytes and then variables, each an element of type 14 (or 15, packed by zlib): a tag of a type
and a length, and data, which are elements again: flags, shape, name, and numbers. scipy reads such files, but on a
damaged tag the process may end in it (scipy 1.17), which no caller can make a message of; and the readers of records
are a room that this one does not know. Every tag is held against the element that it is in, and only what is asked for
is decoded.

Source: MathWorks, "MAT-File Format", R2019b, chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_CELL, _CHAR, _OPAQUE = 1, 4, 17
_NUMBERS = range(6, 16)
_COMPLEX = 0x0800
_DTYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CODECS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_LARGEST = 1 << 30


class DamagedError(Exception):
    """What is wrong with a file, in words."""


class _Element(NamedTuple):
    """The type of an element, where its data begin and end, and where the next one begins."""

    kind: int
    start: int
    stop: int
    after: int


class _Array(NamedTuple):
    """The head of an array, and the elements behind it."""

    kind: int
    is_complex: bool
    shape: tuple[int, ...]
    name: str
    body: tuple[_Element, ...]


def read_variables(data: bytes, wanted: tuple[str, ...]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The variables that are `wanted`, arrays of numbers or lists of texts, and the names of all.

    Raises
    ------
    DamagedError
        The file is damaged, is cut short, or a variable that is wanted is of another kind.
    """
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise DamagedError("it has not the mark of version 5 to 7.3")
    order = ">" if data[126:128] == b"MI" else "<"
    found: dict[str, Any] = {}
    names: list[str] = []
    for content, element in _variables(data, order):
        array = _head(content, element, order)
        if not array.name:
            continue  # where MATLAB keeps the content of its objects
        names.append(array.name)
        if array.name in wanted:
            found[array.name] = _value(content, array, order)
    return found, tuple(names)


def _variables(data: bytes, order: str) -> Iterator[tuple[memoryview, _Element]]:
    """Each variable, unpacked: what it is in, and its element there."""
    at, whole = 128, memoryview(data)
    while at < len(data):
        element = _element(whole, at, len(data), order)
        if element.kind == _MATRIX:
            yield whole, element
        elif element.kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            inner = memoryview(unpacker.decompress(whole[element.start : element.stop], _LARGEST))
            if not unpacker.eof:
                raise DamagedError(f"what is packed at byte {at} does not end, or is of more than 1 GiB")
            unpacked = _element(inner, 0, len(inner), order)
            if unpacked.kind != _MATRIX:
                raise DamagedError(f"what is packed at byte {at} is no variable")
            yield inner, unpacked
        else:
            raise DamagedError(f"there is no variable at byte {at}")
        at = element.stop if element.kind == _COMPRESSED else element.after


def _element(data: memoryview, at: int, limit: int, order: str) -> _Element:
    if at + 8 > limit:
        raise DamagedError("it ends in the middle of a variable")
    kind, length = struct.unpack_from(f"{order}II", data, at)
    start, after = at + 8, at + 8 + length + (-length % 8)
    if kind >> 16:  # a small element: type, length and data in eight bytes
        kind, length, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if length > 4:
            raise DamagedError(f"there is no element at byte {at}")
    if start + length > limit:
        raise DamagedError("it ends in the middle of a variable")
    return _Element(kind, start, start + length, min(after, limit))


def _head(data: memoryview, element: _Element, order: str) -> _Array:
    """The head of the array in `element`."""
    parts, at = [], element.start
    while at < element.stop:
        parts.append(_element(data, at, element.stop, order))
        at = parts[-1].after
    if not parts or parts[0].kind != _UINT32 or parts[0].stop - parts[0].start != 8:
        raise DamagedError("an array in it has no flags")
    word = struct.unpack_from(f"{order}I", data, parts[0].start)[0]
    kind = word & 0xFF
    if kind == _OPAQUE:
        name = bytes(data[parts[1].start : parts[1].stop]) if len(parts) > 1 else b""
        return _Array(kind, False, (), name.decode("latin-1"), ())
    if len(parts) < 3 or parts[1].kind != _INT32 or parts[2].kind != _INT8:
        raise DamagedError("an array in it has no shape or no name")
    count = (parts[1].stop - parts[1].start) // 4
    shape = struct.unpack_from(f"{order}{count}i", data, parts[1].start)
    if not 2 <= count <= 32 or min(shape) < 0:
        raise DamagedError(f"an array in it has shape {shape}")
    name = bytes(data[parts[2].start : parts[2].stop]).decode("latin-1")
    return _Array(kind, bool(word & _COMPLEX), shape, name, tuple(parts[3:]))


def _value(data: memoryview, array: _Array, order: str) -> NDArray[Any] | list[str]:
    if array.kind in _NUMBERS:
        parts = [_numbers(data, array, index, order) for index in range(2 if array.is_complex else 1)]
        return parts[0] + 1j * parts[1] if array.is_complex else parts[0]
    if array.kind == _CHAR:
        return _rows(data, array, order)
    if array.kind == _CELL:
        return [_cell(data, element, array, order) for element in array.body]
    raise DamagedError(f"`{array.name}` is neither numbers nor text; MATLAB's string arrays become text by `cellstr`")


def _cell(data: memoryview, element: _Element, array: _Array, order: str) -> str:
    inner = _head(data, element, order) if element.kind == _MATRIX and element.stop > element.start else None
    if inner is None or inner.kind != _CHAR:
        raise DamagedError(f"`{array.name}` is a cell array of other things than texts")
    return "".join(_rows(data, inner, order))


def _numbers(data: memoryview, array: _Array, index: int, order: str) -> NDArray[Any]:
    """The real parts, or the imaginary ones, kept column by column."""
    if index >= len(array.body) or array.body[index].kind not in _DTYPES:
        raise DamagedError(f"`{array.name}` has no numbers")
    element = array.body[index]
    dtype = np.dtype(_DTYPES[element.kind]).newbyteorder(order)  # type: ignore[arg-type]
    if element.stop - element.start != prod(array.shape) * dtype.itemsize:
        raise DamagedError(f"the numbers of `{array.name}` are not those of shape {array.shape}")
    values = np.frombuffer(data[element.start : element.stop], dtype).reshape(array.shape, order="F")
    return values.astype(dtype.newbyteorder("="))


def _rows(data: memoryview, array: _Array, order: str) -> list[str]:
    """The rows of a character array, kept column by column, without the blanks that fill them up."""
    if not prod(array.shape):
        return [""]
    if not array.body or array.body[0].kind not in _CODECS:
        raise DamagedError(f"`{array.name}` has text that cannot be decoded")
    element = array.body[0]
    codec = _CODECS[element.kind]
    if codec in ("utf-16", "utf-32"):
        codec += "-le" if order == "<" else "-be"
    text = bytes(data[element.start : element.stop]).decode(codec)
    n_rows = array.shape[0]
    if n_rows > 1 and len(text) != prod(array.shape):
        raise DamagedError(f"the texts of `{array.name}` are not those of shape {array.shape}")
    return [text[row::n_rows].rstrip(" ") for row in range(n_rows)]
