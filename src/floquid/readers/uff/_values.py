"""The ordinates of a function in a universal file (dataset 58), as text or as bytes."""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._blocks import Dataset
from floquid.readers.uff._header import FunctionHeader

_ORDERS = {1: "<", 2: ">"}
_FLOATS = {1: "DEC VMS", 3: "IBM 370"}
_USUAL = 1e12
"""Numbers that are measured lie between the inverse of this and this, or are zero."""

_ENOUGH = 16
"""Numbers from which their magnitudes are evidence."""

_EXPORT = "Export or copy the file again."


def check_size(source: Source, dataset: Dataset, header: FunctionHeader, name: str) -> None:
    """Refuse a function that cannot hold what it declares, before memory is taken for it."""
    if header.is_complex:
        raise source.error(
            "hold time responses of real numbers",
            f"has complex ordinates in {name!r}",
            "Export the time history itself, or choose the other channels with `channels` (`--channels`).",
        )
    size = dataset.end - dataset.start
    if dataset.binary is None:
        numbers = header.n_points * (1 if header.is_even else 2)
        if numbers > (size + 1) // 2:
            raise _count(source, header, name, f"{size} characters, which cannot hold as many")
    elif dataset.binary.float_format != 2:
        raise source.error(
            "hold numbers in the format IEEE 754 (2)",
            f"declares {_FLOATS[dataset.binary.float_format]} ({dataset.binary.float_format}) for {name!r}",
            "Export it again, as text or with IEEE numbers.",
        )
    elif size not in header.sizes:
        wanted = " or ".join(map(str, header.sizes))
        raise _count(source, header, name, f"{size} bytes, while as many take {wanted}")


def read_values(
    source: Source, data: bytes, dataset: Dataset, header: FunctionHeader, name: str
) -> tuple[NDArray[np.float64], NDArray[np.floating] | None]:
    """The ordinates (samples,), and the abscissas (samples,) where they are uneven, of a function of checked size."""
    if dataset.binary is None:
        numbers = _text_numbers(source, data[dataset.start : dataset.end], header, name)
        return (numbers, None) if header.is_even else (numbers[1::2], numbers[0::2])
    order, size = _ORDERS[dataset.binary.byte_order], header.number_size
    fields = [("y", f"{order}f{size}")]
    if not header.is_even:
        abscissa = 4 if dataset.end - dataset.start == header.sizes[0] else 8
        fields = [("x", f"{order}f{abscissa}"), *fields]
    table = np.frombuffer(data, dtype=np.dtype(fields), count=header.n_points, offset=dataset.start)
    with np.errstate(invalid="ignore"):  # a NaN of any kind is one
        _check_byte_order(source, table["y"], name, dataset.binary.byte_order)
        times = None if header.is_even else table["x"].astype(table["x"].dtype.newbyteorder("="))
        return table["y"].astype(np.float64), times


def _check_byte_order(source: Source, raw: NDArray[np.floating], name: str, declared: int) -> None:
    """Numbers in the wrong order are of all magnitudes; in the right one nearly all are usual."""

    def usual(values: NDArray[np.floating]) -> float:
        size = np.abs(values[np.isfinite(values)])
        return np.count_nonzero((size == 0.0) | ((size > 1.0 / _USUAL) & (size < _USUAL))) / max(len(values), 1)

    some = raw[:: len(raw) // 10000 + 1]
    some = some[~np.isnan(some)]
    if len(some) >= _ENOUGH and usual(some) < 0.5 and usual(some.view(some.dtype.newbyteorder())) > 0.9:
        raise source.error(
            "declare the byte order that its numbers have",
            f"declares {declared} for {name!r}, whose numbers make sense in the other order only",
            f"Set the first number after `58b` to {3 - declared}, or export it again.",
        )


def _text_numbers(source: Source, text: bytes, header: FunctionHeader, name: str) -> NDArray[np.float64]:
    """All numbers of a function's text: by blanks, or by the columns of the format where two numbers touch."""
    wanted = header.n_points * (1 if header.is_even else 2)
    if b"D" in text or b"d" in text:
        text = re.sub(rb"(?<=[\d.])[Dd](?=[-+\d])", b"E", text)
    numbers = _parsed(text)
    if numbers is None or len(numbers) != wanted:
        numbers = _parsed(b"\n".join(_cut(line, header) for line in text.splitlines()))
    if numbers is None:
        raise _no_number(source, text, name)
    if len(numbers) != wanted:
        raise _count(source, header, name, f"{len(numbers) // (1 if header.is_even else 2)}")
    return numbers


def _parsed(text: bytes) -> NDArray[np.float64] | None:
    """The numbers in a text, separated by blanks; None if something else is there."""
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older versions of numpy warn of what newer ones refuse
        try:
            return np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _cut(line: bytes, header: FunctionHeader) -> bytes:
    """A line of fixed columns with blanks put between them: 6E13.5, 4E20.12 or 2(E13.5,E20.12)."""
    ordinate = 20 if header.number_size == 8 else 13
    widths = [ordinate] if header.is_even else [13, ordinate]
    cells, place = [], 0
    while place < len(line):
        cells.append(line[place : place + widths[len(cells) % len(widths)]])
        place += len(cells[-1])
    return b" ".join(cells)


def _no_number(source: Source, text: bytes, name: str) -> InputError:
    for number, line in enumerate(text.splitlines(), start=1):
        for word in line.split():
            if _parsed(word) is None:
                shown = word[:40].decode("latin-1")
                where = f"has {shown!r} among those of {name!r}, in line {number} under its header"
                return source.error("hold numbers", where, f"Mend that line. {_EXPORT}")
    return source.error("hold numbers in the columns of the format", f"has others in {name!r}", _EXPORT)


def _count(source: Source, header: FunctionHeader, name: str, got: str) -> InputError:
    return source.error(
        "hold the points that it declares",
        f"declares {header.n_points} for {name!r} and holds {got}",
        f"Mend the second number in line 7 of its header if that is wrong. {_EXPORT}",
    )
