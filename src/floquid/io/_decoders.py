"""MATLAB files of version 4 to 7, and datasets of HDF5 files, as arrays and texts.

A damaged tag of a MATLAB file can end scipy (1.17), or keep it busy without end: to be called behind `GUARD`.

In HDF5, MATLAB keeps an array turned round (its first axis is HDF5's last), marks it by the attribute `MATLAB_class`,
keeps text as codes of UTF-16, and a cell array as references to datasets elsewhere. Arrays without that mark are taken
as they are.

Source: MathWorks, "MAT-File Format", R2019b, chapter 1, "MAT-File Versions" (version 7.3), and files that MATLAB
writes.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from io import RawIOBase
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from floquid._checks import printable
from floquid.io._files import DamagedError
from floquid.io._guard import GUARD

_HEAD = 128
_MATRIX, _PACKED = 14, 15
_TYPES = range(1, 19)


def mat_order(path: Path) -> str:
    """The byte order of a MATLAB file at `path` of version 5 to 7, "<" or ">"; "" if it is none."""
    with path.open("rb") as stream:
        return {b"IM": "<", b"MI": ">"}.get(stream.read(_HEAD)[126:128], "")


def is_mat_4(path: Path) -> bool:
    """True where `path` is a MATLAB file of version 4: it begins with the kind and the shape of a matrix."""
    with path.open("rb") as stream:
        head = stream.read(20)
    for order in "<>" if len(head) == 20 else "":
        kind, rows, columns, is_complex, letters_of_name = struct.unpack(f"{order}5i", head)
        machine, form = divmod(kind, 100)
        known = machine in (0, 10, 20, 30, 40) and form // 10 < 6 and form % 10 < 3
        if known and min(rows, columns) >= 0 and is_complex in (0, 1) and 1 < letters_of_name < 10_000:
            return True
    return False


def load_variables(path: Path) -> dict[str, Any]:
    """The variables of a file at `path`, as scipy has them: text as letters, a struct as records.

    Each is read alone: of objects of MATLAB's classes scipy tells the names in the place of their content alone.
    """
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    order = mat_order(path)
    if not order:
        found = scipy.io.loadmat(path, chars_as_strings=False, appendmat=False)  # of version 4
        return {name: value for name, value in found.items() if not name.startswith("__")}
    tags = np.memmap(path, np.uint8, "r").data[_HEAD:]  # few of its pages are ever in memory
    codec, at = "utf-16-le" if order == "<" else "utf-16-be", _HEAD
    variables: dict[str, Any] = {}
    with path.open("rb") as stream:
        for kind, inner, element in _elements(tags, order):
            _check(kind, inner, order)
            alone, at = _Alone(stream, at, len(element)), at + len(element)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FutureWarning)  # of sparse arrays
                found = scipy.io.loadmat(alone, chars_as_strings=False, uint16_codec=codec)
            for name, value in found.items():
                if isinstance(value, MatlabOpaque):
                    name = value["s0"].item().decode("latin-1")
                if name in variables:
                    raise ValueError(f"it has `{name}` twice")
                if name and not name.startswith("__"):  # MATLAB keeps the content of its objects without a name
                    variables[name] = value
    return variables


class _Alone(RawIOBase):
    """A MATLAB file of one element of another, in a `stream`: the head, and `length` bytes from `start` on."""

    def __init__(self, stream: BinaryIO, start: int, length: int) -> None:
        self._stream, self._start, self._end, self._at = stream, start, _HEAD + length, 0

    def readable(self) -> bool:
        """Always true."""
        return True

    def seekable(self) -> bool:
        """Always true."""
        return True

    def tell(self) -> int:
        """The place that is read next."""
        return self._at

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go to a place, counted from the beginning, from here or from the end."""
        self._at = max(offset + (0, self._at, self._end)[whence], 0)
        return self._at

    def readinto(self, buffer: Any, /) -> int:
        """Read into a buffer; the number of bytes."""
        in_head = self._at < _HEAD
        self._stream.seek(self._at if in_head else self._start + self._at - _HEAD)
        left = max((_HEAD if in_head else self._end) - self._at, 0)
        count = self._stream.readinto(memoryview(buffer)[:left])  # type: ignore[attr-defined]
        self._at += count
        return int(count)


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


_CHARACTERS = "char"
_CHECKSUM = 4


def attribute(thing: Any, name: str) -> str:
    """The text that is the attribute `name` of a dataset or a group `thing`; "" if there is none such."""
    value = thing.attrs.get(name, "")
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return value if isinstance(value, str) else ""


def is_whole(dataset: Any) -> bool:
    """True where all of a `dataset` was written, or the rest is told by NaN; HDF5 itself reads zeros in its place."""
    if not dataset.size or (dataset.dtype.kind == "f" and np.isnan(dataset.fillvalue)):
        return True
    if dataset.chunks is None:
        return dataset.id.get_storage_size() > 0
    pairs = list(zip(dataset.shape, dataset.chunks, strict=True))
    if dataset.id.get_num_chunks() < prod(-(-end // length) for end, length in pairs):
        return False
    there: set[tuple[int, ...]] = set()
    least = _CHECKSUM if dataset.fletcher32 else 0  # on a chunk shorter than its checksum HDF5 2.0 crashes
    dataset.id.chunk_iter(lambda chunk: there.add(chunk.chunk_offset) if chunk.size > least else None)
    return there.issuperset(product(*(range(0, end, length) for end, length in pairs)))


def is_elsewhere(dataset: Any) -> bool:
    """True where the data of a `dataset` are kept in another file, or put together from others."""
    return bool(dataset.external) or dataset.is_virtual


def array_in(dataset: Any) -> NDArray[Any]:
    """The numbers of a `dataset`, turned round if MATLAB wrote it."""
    array = _content(dataset)
    if not attribute(dataset, "MATLAB_class"):
        return array
    return (array["real"] + 1j * array["imag"] if array.dtype.names == ("real", "imag") else array).T


def texts_in(dataset: Any) -> list[str] | None:
    """The texts in a `dataset`, the rows of a character array, or the texts in a cell array; None for other things."""
    import h5py

    if h5py.check_string_dtype(dataset.dtype) is not None:
        try:
            return [text.decode() for text in _content(dataset).ravel().tolist()]
        except UnicodeDecodeError:
            raise DamagedError(f"`{_name(dataset)}` holds text that is not in UTF-8") from None
    cells, is_cell_array = [dataset], h5py.check_ref_dtype(dataset.dtype) is not None
    if is_cell_array:
        references = _content(dataset).ravel()
        cells = [dataset.file[reference] if reference else None for reference in references]
    if not all(isinstance(cell, h5py.Dataset) and attribute(cell, "MATLAB_class") == _CHARACTERS for cell in cells):
        return None
    rows = [_rows(_content(cell)) if _has_letters(cell) else [""] for cell in cells]
    if not is_cell_array:
        return rows[0]
    return [words[0] for words in rows] if all(len(words) == 1 for words in rows) else None


def _content(dataset: Any) -> NDArray[Any]:
    if not is_whole(dataset):
        lost = f"parts of `{_name(dataset)}` were never written, or are lost, and would be read as zeros"
        raise DamagedError(f"{lost}. Cut it to what was recorded, or save NaN in the rest")
    return np.asarray(dataset[()])


def _name(dataset: Any) -> str:
    return printable(dataset.name.lstrip("/"))


def _has_letters(dataset: Any) -> bool:
    return bool(dataset.size) and "MATLAB_empty" not in dataset.attrs


def _rows(codes: NDArray[Any]) -> list[str]:
    """The rows of a character array without the blanks that fill them up: codes of UTF-16, a column a row."""
    columns = codes.astype("<u2").reshape(len(codes), -1).T
    return [np.ascontiguousarray(row).tobytes().decode("utf-16-le").rstrip(" ") for row in columns]


RESULT_FORMAT, LARGE_FORMAT = "floquid-result", "floquid-large"
"""The attribute `format` of what `save` writes, and of what `identify_large` does."""

RESULT_ENDINGS = (".h5", ".hdf5")
"""Endings of the names of result files."""


def is_result(path: Path) -> bool:
    """True where the file at a `path` is one that `save` or `identify_large` wrote, of whatever version."""
    try:
        return path.suffix.lower() in RESULT_ENDINGS and path.is_file() and GUARD.call(path, _is_result, path)
    except (OSError, DamagedError):
        return False


def _is_result(file: Path) -> bool:
    import h5py

    if not h5py.is_hdf5(file):
        return False
    with h5py.File(file, "r") as stored:
        return attribute(stored, "format") in (RESULT_FORMAT, LARGE_FORMAT)
