"""Records that stay on the disk: HDF5 files by our names, and NumPy arrays as memory maps."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from floquid._checks import input_error
from floquid.core import Channel, ConstantPeriod, LazyRecord
from floquid.io import Source, readable_file
from floquid.readers.variables import refuse_packed

LAZY = (".h5", ".hdf5", ".npy")
"""Suffixes of files whose records may stay on the disk."""


def read_lazily(
    path: str | PathLike[str],
    *,
    period: float | None,
    rate: float | None,
    channels: Sequence[str] | None,
    origin: float,
) -> LazyRecord:
    """The record of a file without its values: what `read` with `lazy=True` gives."""
    file, of = readable_file(path, of="read"), "read"
    if file.suffix.lower() not in LAZY:
        must, got = f"end in one of {', '.join(LAZY)} with `lazy=True`", f"is {file}"
        raise input_error("path", of, must, got, "Other formats are read whole, without it.")
    source = Source(of=of, name=str(file))
    said: dict[str, Any] = {}
    if file.suffix.lower() == ".npy":
        array = np.load(file, mmap_mode="r")
        if channels is not None:
            raise input_error("channels", of, "be left out of a lazy .npy", "is given", "Rows have no names there.")
    else:
        array, said = _hdf5(source, file, channels)
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        must = "hold one matrix of real numbers (channels, samples)"
        raise source.error(must, f"has {array.dtype} of shape {array.shape}", "Save it as such.")
    hertz = rate if rate is not None else said.get("sample_rate")
    if hertz is None:
        raise source.error("say its `sample_rate` [Hz]", "does not", "Pass `rate=`.")
    seconds = period if period is not None else said.get("period")
    names = said.get("channels") or [f"{row}" for row in range(1, array.shape[0] + 1)]
    units = said.get("units") or ["-"] * len(names)
    return LazyRecord(
        array=array,
        sample_rate=float(hertz),
        channels=tuple(Channel(name=name, unit=unit) for name, unit in zip(names, units, strict=False)),
        clock=None if seconds is None else ConstantPeriod(period=float(seconds), origin=origin),
        start=float(said.get("start", 0.0)),
        source=str(file),
    )


def _hdf5(source: Source, file: Path, channels: Sequence[str] | None) -> tuple[Any, dict[str, Any]]:
    """The matrix of an HDF5 file, which stays open with it, and what the file says of it."""
    import h5py

    if channels is not None and len(channels) != 1:
        must, got = "name one matrix of a lazy HDF5 file", f"has {len(channels)} names"
        raise input_error("channels", "read", must, got, "Its rows are all channels.")
    name = "values" if channels is None else channels[0]
    try:
        opened = h5py.File(file, "r")
        array = opened[name]
        said: dict[str, Any] = {}
        for key in ("sample_rate", "period", "start"):
            if key in opened:
                said[key] = float(np.asarray(opened[key]).reshape(-1)[0])
        for key in ("channels", "units"):
            if key in opened and channels is None:
                said[key] = [str(text) for text in opened[key].asstr()[()].tolist()]
    except (OSError, KeyError, TypeError, ValueError) as error:
        must = f"hold a matrix `{name}` (channels, samples) that can be read"
        raise source.error(must, f"does not ({str(error).splitlines()[0]})", "Name it by `channels=`.") from None
    if not isinstance(array, h5py.Dataset):
        raise source.error(f"hold a matrix `{name}` (channels, samples)", "has a group there", "Name the matrix.")
    refuse_packed(source, opened, array)
    return array, said
