"""How much a file may make of its bytes before it is taken for a bomb."""

from __future__ import annotations

from floquid.core._time_axis import Source
from floquid.errors import InputError

LARGE = 1 << 30
"""Bytes that may be declared whatever the file is: what fits any memory."""

PACKED = 200
"""Beyond that, by how much a packed file may grow: no measurement packs so well."""


def impossible(source: Source, key: str, declared: str, size: int) -> InputError:
    """The message of an array that declares what its bytes cannot be."""
    return source.error(
        f"hold `{key}` whole", f"declares {declared}, which its {size} bytes cannot be", "Copy or save the file again."
    )
