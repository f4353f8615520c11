"""MATLAB files of version 5 to 7: the tree of their elements is walked, and the arrays asked for are decoded.

A file is a head of 128 bytes and then elements: a tag (type, length), data, padding to 8 bytes. A variable is an
element of type miMATRIX, whose data are elements again; since version 7 it may be packed by zlib. scipy writes such
files but is not used to read them: it takes memory for whatever shape a file declares, makes an object of everything in
it, and on a damaged tag the process may end in it (scipy 1.17). Here every tag is held against the element that it is
in, and nothing but numbers and text is decoded. The tests hold the two against each other on whole files.

Source: MathWorks, "MAT-File Format", R2019b, chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from floquid.core._limits import LARGE, PACKED
from floquid.errors import InputError
from floquid.readers._table import Source
from floquid.readers._variables import MATLAB, Dialect, Kind, Variable, printable

HEAD = 128
_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMBERS = range(6, 16)
_KINDS: dict[int, Kind] = {
    _CELL: "a cell array",
    _STRUCT: "a struct array",
    _OBJECT: "a MATLAB object",
    _CHAR: "text",
    _SPARSE: "a sparse matrix",
    _FUNCTION: "a function handle",
    _OPAQUE: "a MATLAB object",
}
_COMPLEX = 0x0800
_DTYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CODECS = {
    "<": {1: "latin-1", 2: "latin-1", 4: "utf-16-le", 16: "utf-8", 17: "utf-16-le", 18: "utf-32-le"},
    ">": {1: "latin-1", 2: "latin-1", 4: "utf-16-be", 16: "utf-8", 17: "utf-16-be", 18: "utf-32-be"},
}
_DEEPEST, _MOST_AXES, _MOST_LETTERS = 30, 32, 1 << 20


class DamagedError(Exception):
    """What is wrong with the content of a file, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Element:
    """The data of one element: `data[start:stop]`; the one behind it begins at `after`."""

    kind: int
    start: int
    stop: int
    after: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Array:
    """The head of an array: what is in it, its shape and its name; its content begins at `body`."""

    kind: int
    is_complex: bool
    shape: tuple[int, ...]
    name: str
    body: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """Where a variable is: in the top-level element `top`, its own data at [start, stop) of the content."""

    top: _Element
    start: int
    stop: int


class Mat5File:
    """The variables of a file, found by its tags; nothing is decoded before it is asked for."""

    def __init__(self, source: Source, data: bytes) -> None:
        self._source = source
        self._data = data
        self._order: Literal["<", ">"] = ">" if data[126:128] == b"MI" else "<"
        self._places: dict[str, _Place] = {}
        self.variables: dict[str, Variable] = {}
        self.dialect: Dialect = MATLAB
        tops = list(self._tops())
        self._check_packing(tops)
        for top in tops:
            self._find(top)

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        if not self.variables[path].size:
            return np.zeros(self.variables[path].shape)
        content, array, stop = self._located(path)
        data = self._element(content, array.body, stop)
        dtype = np.dtype(_DTYPES.get(data.kind, "V")).newbyteorder(self._order)
        if data.kind not in _DTYPES or data.stop - data.start != prod(array.shape) * dtype.itemsize:
            raise self._damaged(path, f"its data are not those of shape {array.shape}")
        return np.frombuffer(content[data.start : data.stop], dtype).reshape(array.shape, order="F")

    def texts(self, path: str) -> list[str] | None:
        """The rows of a character array without the blanks that fill them up, or the texts in a cell array."""
        if self.variables[path].size > _MOST_LETTERS:
            return None
        content, array, stop = self._located(path)
        if array.kind == _CHAR:
            return [row.rstrip(" ") for row in self._rows(path, content, array, stop)]
        at, found = array.body, []
        while at < stop:
            element = self._element(content, at, stop)
            cell = self._array_in(content, element)
            if not (cell.kind == _CHAR or not prod(cell.shape)) or prod(cell.shape[:1]) > 1:
                return None
            found.append("".join(self._rows(path, content, cell, element.stop)))
            at = element.after
        if len(found) != prod(array.shape):
            raise self._damaged(path, f"it declares {prod(array.shape)} cells and has {len(found)}")
        return found

    def _rows(self, path: str, content: memoryview, array: _Array, stop: int) -> list[str]:
        """The rows of a character array, which is kept column by column."""
        if not prod(array.shape):
            return [""]
        data = self._element(content, array.body, stop)
        codec = _CODECS[self._order].get(data.kind)
        try:
            text = bytes(content[data.start : data.stop]).decode(codec or "ascii")
        except UnicodeDecodeError:
            codec, text = None, ""
        n_rows = array.shape[0]
        if codec is None or (n_rows > 1 and len(text) != prod(array.shape)):
            raise self._damaged(path, "it has text that cannot be decoded")
        return [text[row::n_rows] for row in range(n_rows)]

    def _located(self, path: str) -> tuple[memoryview, _Array, int]:
        """The content that a variable is in, its head, and where it stops."""
        place = self._places[path]
        content = self._content(place.top)
        return content, self._head(content, place.start, place.stop), place.stop

    def _tops(self) -> Iterator[_Element]:
        at, end = HEAD, len(self._data)
        while at < end:
            top = self._element(self._data, at, end)
            if top.kind not in (_MATRIX, _COMPRESSED):
                raise DamagedError(f"there is no variable at byte {at}")
            yield top
            at = top.stop if top.kind == _COMPRESSED else top.after

    def _check_packing(self, tops: list[_Element]) -> None:
        """Refuse what would unpack into far more than a measurement ever does, before any of it is unpacked."""
        sizes = []
        for top in tops:
            inner = self._content(top, 8)
            if len(inner) < 8:
                raise DamagedError(f"the variable at byte {top.start} cannot be unpacked")
            sizes.append(self._words(inner, 0)[1])
        if sum(sizes) > LARGE and sum(sizes) > PACKED * len(self._data):
            raise DamagedError(f"its {len(self._data)} bytes declare to unpack into {sum(sizes)}")

    def _content(self, top: _Element, limit: int | None = None) -> memoryview:
        """A top-level array with its tag, unpacked if it is packed; at most `limit` bytes of it."""
        whole = memoryview(self._data)[top.start - (8 if top.kind == _MATRIX else 0) : top.stop]
        if top.kind == _MATRIX:
            return whole[:limit]
        unpacker = zlib.decompressobj()
        if limit is not None:
            return memoryview(unpacker.decompress(whole[: limit + 4096], limit))
        declared = self._words(self._content(top, 8), 0)[1]
        data = unpacker.decompress(whole, declared + 16)
        if len(data) not in (declared + 8, declared + 8 + (-declared % 8)) or not unpacker.eof:
            raise DamagedError(
                f"the variable at byte {top.start} does not unpack into the {declared} bytes it declares"
            )
        return memoryview(data)

    def _words(self, data: bytes | memoryview, at: int) -> tuple[int, int]:
        return struct.unpack_from(f"{self._order}II", data, at)

    def _find(self, top: _Element) -> None:
        """Enter a top-level variable, and all that is in it if it is a struct."""
        content = self._content(top, 1 << 16)
        declared = self._words(content, 0)[1] + 8
        array = self._head(content, 8, len(content))
        if array.name == "":
            return  # where MATLAB keeps the content of its objects
        if array.kind in (_CELL, _STRUCT):
            content = self._content(top)
        self._enter(top, content, array, array.name, 8, declared)

    def _enter(self, top: _Element, content: memoryview, array: _Array, path: str, start: int, stop: int) -> None:
        """Enter the array of `path`, whose data are at [start, stop) of the content."""
        if path in self.variables:
            raise DamagedError(f"it has `{printable(path)}` twice")
        if array.kind == _STRUCT and prod(array.shape) == 1:
            if path.count("/") >= _DEEPEST:
                raise DamagedError(f"its structs are nested more than {_DEEPEST} deep")
            for name, field in self._fields(content, array.body, stop):
                its = self._array_in(content, field)
                self._enter(top, content, its, f"{path}/{name}", field.start, field.stop)
            return
        kind: Kind = _KINDS.get(array.kind, "numbers")
        if array.kind in _NUMBERS:
            kind = "complex numbers" if array.is_complex else "numbers"
            if prod(array.shape) > stop - start:  # a number takes a byte at least
                raise DamagedError(f"`{printable(path)}` declares shape {array.shape} in {stop - start} bytes")
        self.variables[path] = Variable(path=path, shape=array.shape, kind=kind)
        self._places[path] = _Place(top=top, start=start, stop=stop)

    def _fields(self, content: memoryview, at: int, stop: int) -> Iterator[tuple[str, _Element]]:
        """The name and the element of each field of a struct."""
        length = self._element(content, at, stop)
        names = self._element(content, length.after, stop)
        if length.stop - length.start != 4 or names.kind != _INT8:
            raise DamagedError("a struct in it has no field names")
        width = struct.unpack_from(f"{self._order}i", content, length.start)[0]
        text = bytes(content[names.start : names.stop])
        if width < 1 or len(text) % width:
            raise DamagedError("a struct in it has no field names")
        at = names.after
        for first in range(0, len(text), width):
            field = self._element(content, at, stop)
            yield text[first : first + width].split(b"\0")[0].decode("latin-1"), field
            at = field.after

    def _array_in(self, content: memoryview, element: _Element) -> _Array:
        """The head of an array that is a field or a cell; one without any content stands for []."""
        if element.kind != _MATRIX:
            raise DamagedError("there is no array where one is due")
        if element.start == element.stop:
            return _Array(kind=6, is_complex=False, shape=(0, 0), name="", body=element.stop)
        return self._head(content, element.start, element.stop)

    def _head(self, content: memoryview, at: int, stop: int) -> _Array:
        flags = self._element(content, at, stop)
        if flags.kind != _UINT32 or flags.stop - flags.start != 8:
            raise DamagedError("an array in it has no flags")
        word = struct.unpack_from(f"{self._order}I", content, flags.start)[0]
        kind = word & 0xFF
        if kind == _OPAQUE:
            name = self._element(content, flags.after, stop)
            text = bytes(content[name.start : name.stop]).decode("latin-1")
            return _Array(kind=kind, is_complex=False, shape=(), name=text, body=name.after)
        if kind not in _NUMBERS and kind not in _KINDS:
            raise DamagedError(f"an array in it is of an unknown class ({kind})")
        axes = self._element(content, flags.after, stop)
        n_axes = (axes.stop - axes.start) // 4
        if axes.kind != _INT32 or not 0 < n_axes <= _MOST_AXES:
            raise DamagedError("an array in it has no shape")
        shape = struct.unpack_from(f"{self._order}{n_axes}i", content, axes.start)
        name = self._element(content, axes.after, stop)
        if min(shape) < 0 or name.kind != _INT8:
            raise DamagedError("an array in it has no shape or no name")
        text = bytes(content[name.start : name.stop]).decode("latin-1")
        return _Array(kind=kind, is_complex=bool(word & _COMPLEX), shape=shape, name=text, body=name.after)

    def _element(self, data: bytes | memoryview, at: int, end: int) -> _Element:
        if at + 8 > end:
            raise DamagedError("it ends in the middle of a variable")
        kind, length = self._words(data, at)
        start, after = at + 8, at + 8 + length + (-length % 8)
        if kind >> 16:  # a small element: type, length and data in eight bytes
            kind, length, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if length > 4:
                raise DamagedError(f"there is no element at byte {at}")
        if start + length > end:
            raise DamagedError("it ends in the middle of a variable")
        return _Element(kind=kind, start=start, stop=start + length, after=min(after, end))

    def _damaged(self, path: str, why: str) -> InputError:
        return self._source.error(
            f"hold a readable array `{printable(path)}`", f"does not ({why})", "Copy or save the file again."
        )
