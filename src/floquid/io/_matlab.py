"""MATLAB files of version 5 to 7, which scipy reads.

A damaged tag can end scipy (1.17), or keep it busy without end: to be called behind `GUARD`.

Source: MathWorks, "MAT-File Format", R2019b, chapter 1.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

_HEAD = 128
_MATRIX, _PACKED = 14, 15
_TYPES = range(1, 19)


def mat_order(path: Path) -> str:
    """The byte order of a MATLAB file at `path` of version 5 to 7, "<" or ">"; "" if it is none."""
    with path.open("rb") as stream:
        return {b"IM": "<", b"MI": ">"}.get(stream.read(_HEAD)[126:128], "")


def load_variables(path: Path) -> dict[str, Any]:
    """The variables of a file at `path`, as scipy has them: text as letters, a struct as records.

    Each is read alone: of objects of MATLAB's classes scipy tells the names in the place of their content alone.
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
    """Refuse what is not packed, so has no checksum, if it names types that there are not: scipy would guess."""
    if kind == _MATRIX:
        for part, content, _ in _elements(inner, order):
            _check(part, content, order)


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
