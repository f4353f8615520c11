"""Files of results: how they are known from other files of HDF5."""

from __future__ import annotations

from pathlib import Path

from floquid.io._decoders import attribute
from floquid.io._files import DamagedError
from floquid.io._guard import GUARD

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
