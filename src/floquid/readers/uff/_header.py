"""The header of a function in a universal file (dataset 58): what is measured where, and its time axis."""

from __future__ import annotations

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
}
"""The directions of a degree of freedom; R is a rotation, 0 a scalar."""

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
    """What an axis measures: the number of the specific data type, and the texts for people, "" when unused."""

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
        """Whether each ordinate is a complex number."""
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
    """The header in the 11 lines of a dataset that begins at byte `first`.

    Fields are taken by their columns, as the format has them, or by blanks where a program kept to none.
    """
    if not lines[-1].endswith(b"\n"):
        raise source.error(
            "hold whole datasets",
            f"ends inside the header of the one of type 58 that begins at byte {first}: it is cut short",
            "Copy or export it again.",
        )
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
        raise source.error(
            "have headers of dataset 58 as the format defines them",
            f"has {texts[line - 1].strip()[:60]!r} in line {line} of the one that begins at byte {first}",
            "Mend that line, or export or copy the file again.",
        ) from None
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
