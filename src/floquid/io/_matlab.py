"""MATLAB files of version 5 to 7: scipy reads them, behind a walk over their tags.

On a damaged tag in a file that is not packed scipy ends the process (1.17), so the tags are looked at first.

Source: MathWorks, "MAT-File Format", R2019b, chapter 1.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

_HEAD = 128
_MATRIX, _PACKED = 14, 15
_TYPES = range(1, 19)
_CELL, _WITH_FIELDS = 1, (2, 3)
_PLAIN, _COMPLEX = (4, *range(6, 16)), 0x0800
"""Classes of arrays: of cells, of structs and objects, of text and numbers; and the flag of imaginary parts."""


def mat_order(path: Path) -> str:
    """The byte order of a MATLAB file at `path` of version 5 to 7, "<" or ">"; "" if it is none."""
    with path.open("rb") as stream:
        return {b"IM": "<", b"MI": ">"}.get(stream.read(_HEAD)[126:128], "")


def load_variables(path: Path) -> dict[str, Any]:
    """The variables of a file at `path`, as scipy has them: text as letters, a struct as records.

    Each is read by itself: of objects of MATLAB's classes scipy tells the names in the place of their content alone.
    """
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    order, data = mat_order(path), memoryview(path.read_bytes())
    codec = "utf-16-le" if order == "<" else "utf-16-be"
    variables: dict[str, Any] = {}
    for kind, inner, element in _elements(data[_HEAD:], order):
        _check(kind, inner, order)
        whole = BytesIO(bytes(data[:_HEAD]) + element)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # of sparse arrays
            found = scipy.io.loadmat(whole, chars_as_strings=False, uint16_codec=codec)
        for name, value in found.items():
            if isinstance(value, MatlabOpaque):
                name = value["s0"].item().decode("latin-1")
            if name in variables:
                raise ValueError(f"it has `{name}` twice")
            if name and not name.startswith("__"):  # MATLAB keeps the content of its objects without a name
                variables[name] = value
    return variables


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview, memoryview]]:
    """The elements in `data`: the type of each, what is in it, and all of it; one of no type or too long is refused."""
    at = 0
    while at < len(data):
        if at + 8 > len(data):
            raise ValueError("it ends in the middle of a variable")
        kind, length = struct.unpack_from(f"{order}II", data, at)
        start, after = at + 8, at + 8 + length + (-length % 8 if kind != _PACKED else 0)
        if kind >> 16:  # a small element: type, length and data in eight bytes
            kind, length, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if kind not in _TYPES or start + length > len(data):
            raise ValueError("it has no variable where one is due, or ends in the middle of one")
        yield kind, data[start : start + length], data[at:after]
        at = after


def _check(kind: int, inner: memoryview, order: str) -> None:
    """Refuse an array whose elements are not all there."""
    if kind == _PACKED:
        for packed, content, _ in _elements(memoryview(zlib.decompress(inner)), order):
            _check(packed, content, order)
    elif kind == _MATRIX and len(inner):
        parts, own = [], []
        for part, content, _ in _elements(inner, order):
            _check(part, content, order)
            parts.append(part)
            own += [content] if part != _MATRIX else []
        word = struct.unpack_from(f"{order}I", inner, 8)[0]
        if word & 0xFF in (_CELL, *_WITH_FIELDS):  # scipy makes as many as the shape says, however long that takes
            count = prod(np.frombuffer(own[1], f"{order}i4").tolist())
            if word & 0xFF != _CELL:
                count *= len(own[-1]) // max(1, int.from_bytes(own[-2][:4], "little" if order == "<" else "big"))
            if count != parts.count(_MATRIX):
                raise ValueError("it has a struct or a cell array without all that is in it")
        if word & 0xFF in _PLAIN and (len(parts) < 4 + bool(word & _COMPLEX) or _MATRIX in parts):
            raise ValueError("it has an array without its numbers")


def letters(value: Any) -> list[str] | None:
    """The rows of a character array `value` without their last blanks, or the texts in a cell array; else None."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "UO":
        return None
    if value.dtype.kind == "U":
        rows = value.reshape(len(value), -1) if value.size else np.array([[""]])
        return ["".join(row).rstrip(" ") for row in rows]
    cells = [letters(cell) if np.size(cell) else [""] for cell in value.ravel(order="F")]
    texts = [cell[0] for cell in cells if cell is not None and len(cell) == 1]
    return texts if len(texts) == len(cells) else None
