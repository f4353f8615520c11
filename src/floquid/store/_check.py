"""A result file held against what `save` writes, before anything of it is read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from floquid._checks import printable
from floquid.core import Cycles
from floquid.core._hdf5 import is_whole
from floquid.store._get import DamagedError

if TYPE_CHECKING:
    import h5py

_LARGE, _PACKED = 1 << 30, 200
"""Bytes that may be needed whatever the file is, and beyond that, by how much the file may grow."""


def attributes_of(file: h5py.File, _path: Path) -> dict[str, Any]:
    """What the file says of itself."""
    return {name: file.attrs[name] for name in ("format", "version", "floquid") if name in file.attrs}


def check_content(file: h5py.File, _path: Path) -> None:
    """Refuse a file of which parts are lost: HDF5 would read zeros in their place.

    Raises
    ------
    DamagedError
        A dataset has not all of its parts.
    """
    import h5py

    def check(name: str, thing: Any) -> None:
        if isinstance(thing, h5py.Dataset) and thing.shape is not None and not is_whole(thing):
            raise DamagedError(f"/{printable(name)} has not all of its parts")

    file.visititems(check)


def check_padding(file: h5py.File, cycles: Sequence[Cycles]) -> None:
    """Refuse many short hits beside a long one, all of which are filled up to its length when they are lifted.

    Raises
    ------
    DamagedError
        That would take more than so large a file can hold.
    """
    longest = max((hit.n_cycles for hit in cycles), default=0)
    filled = 8 * longest * sum(hit.n_channels * hit.n_phases for hit in cycles)
    if filled > _LARGE and filled > _PACKED * Path(file.filename).stat().st_size:
        raise DamagedError(f"its {len(cycles)} hits, filled up to {longest} periods, would take {filled} bytes")
