"""Arrays of NumPy's own format (.npy), where NumPy itself would take minutes or end the process.

A head that is no Python literal is handed by NumPy to a tokenizer that takes ten seconds for four thousand blanks
(NumPy 2.4, Python 3.11), and letters beyond those that there are become texts on which the interpreter fails.

Source: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays".
"""

from __future__ import annotations

import ast
import re
import struct
from io import BytesIO
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

_LONGEST_HEAD = 10_000
_LONG = re.compile(r"(\d)L\b")
"""A whole number as Python 2 wrote it."""

_LAST_LETTER = 0x10FFFF


def read_head(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """The shape and the type that an array declares; its data come next in the stream.

    Raises
    ------
    ValueError
        There is no such head.
    """
    version = np.lib.format.read_magic(stream)
    width = 2 if version == (1, 0) else 4
    size = stream.read(width)
    length = int.from_bytes(size, "little")
    text = stream.read(min(length, _LONGEST_HEAD))
    if len(size) < width or length != len(text):
        raise ValueError("its head is cut short or too long")
    words = text.decode("latin-1" if version < (3, 0) else "utf-8")
    try:
        ast.literal_eval(_LONG.sub(r"\1", words))
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"its head is no description of an array: {error}") from None
    first = version == (1, 0)
    read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(BytesIO(struct.pack("<H" if first else "<I", length) + text))
    return shape, dtype


def read_array(stream: IO[bytes]) -> NDArray[Any]:
    """The array in a stream whose head has been read once; nothing is unpickled.

    Raises
    ------
    ValueError
        It is cut short, holds Python objects, or has letters that there are none of.
    """
    array = np.lib.format.read_array(stream, allow_pickle=False)
    if array.dtype.kind == "U" and array.dtype.itemsize and array.size:
        codes = np.frombuffer(array.tobytes(), np.dtype(np.uint32).newbyteorder(array.dtype.byteorder))
        if codes.max() > _LAST_LETTER:
            raise ValueError(f"it has a letter of number {codes.max()}")
    return array
