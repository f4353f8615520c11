"""The datasets of a universal file: where each begins and ends, and the headers of functions (dataset 58).

A dataset stands between two lines `    -1`. The second is looked for where a binary block ends by its own count and not
among its bytes, in which a pattern of that kind may occur.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from floquid.io import Source
from floquid.tables import Printed, printed

N_LINES = 11

DIRECTIONS = {0: ""} | {
    sign * number: f"{'+' if sign > 0 else '-'}{word}"
    for number, word in enumerate(("X", "Y", "Z", "RX", "RY", "RZ"), start=1)
    for sign in (1, -1)
}  # the directions of a degree of freedom; R is a rotation, 0 a scalar

_POINT = (5, 10, 5, 10, 11, 10, 4, 11, 10, 4)
_FORM = (10, 10, 10, 13, 13, 13)
_AXIS = (10, 5, 5, 5, 21, 21)
_NUMBER_SIZES = {2: (4, 1), 4: (8, 1), 5: (4, 2), 6: (8, 2)}
"""Bytes of a number, and numbers an ordinate, by the type of the ordinates: single, double, complex, complex double."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A degree of freedom: an entity by its name ("" when unused), a node and a direction from -6 to 6."""

    entity: str
    node: int
    direction: int

    @property
    def words(self) -> str:
        """«12:+X», or nothing when neither node nor direction is given."""
        return f"{self.node}:{DIRECTIONS[self.direction]}".removesuffix(":") if self.node or self.direction else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Quantity of an axis: the number of the specific data type, and the texts for people, "" when unused."""

    kind: int
    label: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionHeader:
    """The 11 lines of a header; `first` is the byte in the file where its dataset begins.

    `data_type` is 2 or 4 for real ordinates in single and double precision, 5 or 6 for complex ones.
    """

    first: int
    ids: tuple[str, ...]
    function: int
    response: Point
    reference: Point
    data_type: int
    n_points: int
    is_even: bool
    start: Printed
    step: Printed
    abscissa: Axis
    ordinate: Axis

    @property
    def is_complex(self) -> bool:
        """True where each ordinate is a complex number."""
        return self.data_type in (5, 6)

    @property
    def number_size(self) -> int:
        """Bytes of an ordinate's number in a binary dataset."""
        return _NUMBER_SIZES[self.data_type][0]

    @property
    def sizes(self) -> tuple[int, ...]:
        """The bytes that a binary dataset may have: uneven abscissas are in single precision, or as the ordinates."""
        size, numbers = _NUMBER_SIZES[self.data_type]
        abscissas = (0,) if self.is_even else (4, 8) if size == 8 else (4,)
        return tuple(self.n_points * (numbers * size + abscissa) for abscissa in abscissas)


def parse_header(source: Source, lines: Sequence[bytes], first: int) -> FunctionHeader:
    """The header in the 11 lines of a dataset that begins at byte `first`."""
    if not lines[-1].endswith(b"\n"):
        got = f"ends inside the header of the one of type 58 that begins at byte {first}: it is cut short"
        raise source.error("hold whole datasets", got, "Copy or export it again.")
    texts = [_text(line) for line in lines]
    line = 6
    try:
        function, _, _, _, *points = _fields(texts[5], _POINT, "iiiisiisii")
        response, reference = (Point(entity=e, node=n, direction=d) for e, n, d in (points[:3], points[3:]))
        if not 0 <= function <= 99 or {response.direction, reference.direction} - DIRECTIONS.keys():
            raise ValueError(texts[5])
        line = 7
        data_type, n_points, even, start, step, _ = _fields(texts[6], _FORM, "iiifff")
        if data_type not in _NUMBER_SIZES or n_points < 0 or even not in (0, 1):
            raise ValueError(texts[6])
        axes = []
        for line in (8, 9, 10, 11):
            kind, _, _, _, label, unit = _fields(texts[line - 1], _AXIS, "iiiiss")
            axes.append(Axis(kind=kind, label=label, unit=unit))
        controls = (n for n, text in enumerate(texts, 1) if any(unicodedata.category(c) == "Cc" for c in text))
        line = next(controls, 0)
        if line:
            raise ValueError(texts[line - 1])
    except ValueError:
        must = "have headers of dataset 58 as the format defines them"
        got = f"has {texts[line - 1].strip()[:60]!r} in line {line} of the one that begins at byte {first}"
        raise source.error(must, got, "Mend that line, or export or copy the file again.") from None
    return FunctionHeader(
        first=first,
        ids=tuple(_word(text) for text in texts[:5]),
        function=function,
        response=response,
        reference=reference,
        data_type=data_type,
        n_points=n_points,
        is_even=even == 1,
        start=start,
        step=step,
        abscissa=axes[0],
        ordinate=axes[1],
    )


def _text(line: bytes) -> str:
    """A line as text: UTF-8, or else as programs of western Windows write it, so that «µm» is read from either."""
    line = line.removesuffix(b"\n").removesuffix(b"\r").replace(b"\t", b" ")
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def _word(text: str) -> str:
    """The text without the blanks around it; the format's word for none is "NONE"."""
    word = text.strip()
    return "" if word == "NONE" else word


def _fields(text: str, widths: Sequence[int], kinds: str) -> list[Any]:
    """The fields of a line: i an integer, f a float, s a word."""
    cells, place = [], 0
    for width in widths:
        cells.append(text[place : place + width])
        place += width
    split = text.split()
    if len(split) == len(widths) and "s" not in kinds:
        cells = split  # the same unless two fields touch, when the count is less; and right for other widths
    try:
        if text[place:].strip() and cells is not split:
            raise ValueError(text)
        return [_field(cell, kind) for cell, kind in zip(cells, kinds, strict=True)]
    except ValueError:
        return [_field(cell, kind) for cell, kind in zip(split, kinds, strict=True)]


def _field(cell: str, kind: str) -> object:
    if kind == "s":
        return _word(cell)
    if kind == "f":
        return printed(cell if cell.strip() else "0.")
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return int(cell) if cell.strip() else 0


_MARK = b"    -1"
_BLANK = b" \t\r\n\x1a"  # bytes that may stand between datasets; 0x1A is the end mark of old text files

_CLOSING = re.compile(rb"[\r\n]{0,4}    -1[ \t]*(?:\r?\n|\Z)")
"""After a binary block: some programs begin a new line before it, some do not."""

_TYPE = re.compile(r" {0,6}(\d{1,6})([bB]?)(.*)")
_COPY = "Copy it again as a binary file, or export it again."


@dataclass(frozen=True, slots=True, kw_only=True)
class BinaryBlock:
    """Layout of the bytes of a binary dataset, from its first line."""

    byte_order: int
    float_format: int
    n_lines: int
    n_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """A dataset: its type, and where its content lies in the file, from `start` to `end`.

    `header` is that of a function (type 58), None for other types; `binary` is None where the content is text.
    """

    number: int
    start: int
    end: int
    header: FunctionHeader | None
    binary: BinaryBlock | None


def find_datasets(source: Source, data: bytes) -> list[Dataset]:
    """All datasets in the bytes of a file, in their order."""
    datasets: list[Dataset] = []
    place = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while True:
        line, after = _line(data, place)
        if not line.strip(_BLANK):
            if after == len(data):
                break
            place = after
            continue
        if line.rstrip() != _MARK:
            shown = repr(line[:24].rstrip(b"\r\n").decode("latin-1"))
            if datasets:
                must = "have its content in datasets, each between two lines `    -1`"
                raise source.error(must, f"has {shown} after one, at byte {place}", _COPY)
            remedy = "Name it by its format, or export it as a universal file (dataset 58)."
            raise source.error("be a universal file, whose first line is `    -1`", f"begins with {shown}", remedy)
        dataset, place = _dataset(source, data, after)
        datasets.append(dataset)
    if not datasets:
        raise source.error("be a universal file", "holds nothing but blank lines", "Export it again.")
    return datasets


def _line(data: bytes, place: int) -> tuple[bytes, int]:
    """The line at `place` with its end, and where the next begins."""
    end = data.find(b"\n", place) + 1 or len(data)
    return data[place:end], end


def _dataset(source: Source, data: bytes, place: int) -> tuple[Dataset, int]:
    """The dataset whose first line is at `place`, and where the line after its closing mark begins."""
    line, after = _line(data, place)
    words = _TYPE.fullmatch(line.decode("latin-1").rstrip())
    if words is None or (words[1] == "58" and words[3].strip() and not words[2]):
        got = f"has {line[:24].decode('latin-1').rstrip()!r}" if line.strip() else "has nothing"
        raise source.error("state the type of each dataset", f"{got} after the `    -1` before byte {place}", _COPY)
    number = int(words[1])
    header = None
    binary = _binary(source, words[3], place) if words[2] else None
    if number == 58:
        lines = []
        for _ in range(N_LINES):
            line, after = _line(data, after)
            lines.append(line)
        header = parse_header(source, lines, place)
    if binary is None:
        end, following = _end_of_text(source, data, after, number, place)
    else:
        for _ in range(binary.n_lines if header is None else 0):
            _, after = _line(data, after)
        end, following = _end_of_bytes(source, data, after, binary, header, place)
    return Dataset(number=number, start=after, end=end, header=header, binary=binary), following


def _binary(source: Source, text: str, place: int) -> BinaryBlock:
    columns = [text[:6], text[6:12], text[12:24], text[24:36]]
    words = columns if all(word.strip().isdigit() for word in columns) else text.split()[:4]
    try:
        order, form, lines, size = (int(word) for word in words)
        if not (order in (1, 2) and form in (1, 2, 3) and 0 <= lines <= 99 and size >= 0):
            raise ValueError(text)
    except ValueError:
        must = "say the byte order (1 or 2), the float format (1 to 3), lines and bytes of each binary dataset"
        raise source.error(must, f"has {text.strip()[:40]!r} at byte {place}", _COPY) from None
    return BinaryBlock(byte_order=order, float_format=form, n_lines=lines, n_bytes=size)


def _end_of_text(source: Source, data: bytes, place: int, number: int, first: int) -> tuple[int, int]:
    """End of the text from `place` on, and begin of the line after its closing mark."""
    found = place - 1
    while (found := data.find(b"\n" + _MARK, found)) >= 0:
        line, following = _line(data, found + 1)
        if line.rstrip() == _MARK:
            return max(found, place), following
        found = following - 1
    got = f"ends inside the one of type {number} that begins at byte {first}: it is cut short"
    raise source.error("close each dataset with a line `    -1`", got, _COPY)


def _end_of_bytes(
    source: Source, data: bytes, place: int, binary: BinaryBlock, header: FunctionHeader | None, first: int
) -> tuple[int, int]:
    """Extent of binary content, by its count of bytes, or else by its count of values."""
    sizes = [binary.n_bytes, *(() if header is None else header.sizes)]
    for size in sizes:
        closing = _CLOSING.match(data, place + size) if size <= len(data) - place else None
        if closing:
            return place + size, closing.end()
    left = len(data) - place
    got = f"declares {binary.n_bytes} bytes for the binary dataset at byte {first}"
    if header is not None:
        got += f", of {header.n_points} points"
    where = f", and only {left} are left in it" if left < min(sizes) else ", which does not end there"
    raise source.error("hold its binary datasets whole, each closed by `    -1`", got + where, _COPY)
