"""A dataset or a group of a result file, written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.store import _layout as layout
from floquid.store._layout import Item

if TYPE_CHECKING:
    import h5py


def put_numbers(group: h5py.Group, numbers: Mapping[str, float]) -> None:
    for name, value in numbers.items():
        put(group, Item(name), value)


def put_fields(group: h5py.Group, items: Sequence[Item], thing: object) -> None:
    for item in items:
        put(group, item, getattr(thing, item.name))


def put(group: h5py.Group, item: Item, value: Any) -> None:
    """One dataset. Arrays are compressed and carry checksums, so that damage is seen."""
    import h5py

    dtype = h5py.string_dtype() if item.kind == "text" else np.dtype(layout.DTYPES[item.kind])
    if value is None:
        assert item.optional, item
        dataset = group.create_dataset(item.name, data=h5py.Empty(dtype))
    elif item.kind == "text":
        data = np.array([_storable(text) for text in value], dtype=object) if item.axes else _storable(value)
        dataset = group.create_dataset(item.name, data=data, dtype=dtype)
    else:
        array = np.asarray(value, dtype=dtype)
        assert array.ndim == len(item.axes), item
        # Noise does not compress: more than the lowest level takes time and saves nothing.
        packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True}
        dataset = group.create_dataset(item.name, data=array, **(packed if array.ndim and array.size else {}))
    if item.axes:
        dataset.attrs["axes"] = ", ".join(item.axes)
    if item.unit:
        dataset.attrs["unit"] = item.unit


def _storable(text: str) -> str:
    """`text` with what HDF5 cannot hold written as an escape: undecodable bytes of a file name, a NUL."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")
