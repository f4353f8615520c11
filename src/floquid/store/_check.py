"""A result file held against what `save` writes, before anything of it is read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from floquid._checks import printable
from floquid.io import is_whole
from floquid.store._get import DamagedError

if TYPE_CHECKING:
    import h5py


def attributes_of(file: h5py.File) -> dict[str, Any]:
    """What the file says of itself."""
    return {name: file.attrs[name] for name in ("format", "version", "floquid") if name in file.attrs}


def check_content(file: h5py.File) -> None:
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
