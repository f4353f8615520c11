"""The datasets of a universal file: where each begins and ends, before anything in it is believed.

A dataset stands between two lines `    -1`. The second is looked for where a binary block ends by its own count and not
among its bytes, in which a pattern of that kind may occur.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._header import N_LINES, FunctionHeader, parse_header

_MARK = b"    -1"
_BLANK = b" \t\r\n\x1a"
"""What may stand between datasets; 0x1A is the end mark of old text files."""

_CLOSING = re.compile(rb"[\r\n]{0,4}    -1[ \t]*(?:\r?\n|\Z)")
"""After a binary block: some programs begin a new line before it, some do not."""

_TYPE = re.compile(r" {0,6}(\d{1,6})([bB]?)(.*)")
_COPY = "Copy it again as a binary file, or export it again."


@dataclass(frozen=True, slots=True, kw_only=True)
class BinaryBlock:
    """What the first line of a binary dataset says of its bytes."""

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
            raise _outside(source, line, place, first=not datasets)
        dataset, place = _dataset(source, data, after)
        datasets.append(dataset)
    if not datasets:
        raise source.error("be a universal file", "holds nothing but blank lines", "Export it again.")
    return datasets


def _outside(source: Source, line: bytes, place: int, *, first: bool) -> InputError:
    shown = repr(line[:24].rstrip(b"\r\n").decode("latin-1"))
    if first:
        return source.error(
            "be a universal file, whose first line is `    -1`",
            f"begins with {shown}",
            "Name it by its format, or export it as a universal file (dataset 58).",
        )
    return source.error(
        "have its content in datasets, each between two lines `    -1`",
        f"has {shown} after one, at byte {place}",
        _COPY,
    )


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
        raise source.error(
            "say the byte order (1 or 2), the float format (1 to 3), lines and bytes of each binary dataset",
            f"has {text.strip()[:40]!r} at byte {place}",
            _COPY,
        ) from None
    return BinaryBlock(byte_order=order, float_format=form, n_lines=lines, n_bytes=size)


def _end_of_text(source: Source, data: bytes, place: int, number: int, first: int) -> tuple[int, int]:
    """Where the text from `place` on ends, and where the line after its closing mark begins."""
    found = place - 1
    while (found := data.find(b"\n" + _MARK, found)) >= 0:
        line, following = _line(data, found + 1)
        if line.rstrip() == _MARK:
            return max(found, place), following
        found = following - 1
    raise source.error(
        "close each dataset with a line `    -1`",
        f"ends inside the one of type {number} that begins at byte {first}: it is cut short",
        _COPY,
    )


def _end_of_bytes(
    source: Source, data: bytes, place: int, binary: BinaryBlock, header: FunctionHeader | None, first: int
) -> tuple[int, int]:
    """The same for binary content: by its own count of bytes, or else by its count of values."""
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
