"""MATLAB files of version 5 that GNU Octave reads too, the same content giving the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np

from floquid._version import __version__

PLAIN = str.maketrans({"µ": "u", "μ": "u", "ε": "e", "°": "deg", "²": "^2", "³": "^3", "·": "."})
"""Units in ASCII: GNU Octave reads texts of other letters byte by byte, and cuts them."""

_TEXT = 116  # bytes at the head of the file that are free text


def mat_file(content: Mapping[str, Any], what: str) -> bytes:
    """The file, named by what it holds; what is None is an empty matrix."""
    from scipy.io import savemat

    stream = BytesIO()
    empty = np.zeros((0, 0))
    savemat(stream, {name: empty if value is None else value for name, value in content.items()}, oned_as="column")
    whole = bytearray(stream.getbuffer())
    written = f"MATLAB 5.0 MAT-file, {what}, by floquid {__version__}"
    whole[:_TEXT] = written.encode().ljust(_TEXT)
    return bytes(whole)


def mat_cells(words: Any) -> Any:
    """A column of texts as MATLAB has it."""
    cells = np.empty((len(words), 1), dtype=object)
    cells[:, 0] = list(words)
    return cells
