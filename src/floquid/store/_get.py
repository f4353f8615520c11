"""What one dataset or group of a result file holds, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.store import _layout as layout
from floquid.store._layout import Item

if TYPE_CHECKING:
    import h5py


class DamagedError(Exception):
    """What is wrong with the content, in words."""


def get_fields(group: h5py.Group, items: Sequence[Item]) -> dict[str, Any]:
    return {item.name: get(group, item) for item in items}


def get(group: h5py.Group, item: Item) -> Any:
    """What one dataset holds: None, a number, a text, a tuple of texts, or a read-only array."""
    import h5py

    dataset = dataset_in(group, item.name)
    if dataset.shape is None and item.optional:
        return None
    text = h5py.check_string_dtype(dataset.dtype) is not None
    fits = text if item.kind == "text" else dataset.dtype == layout.DTYPES[item.kind]
    if not fits or dataset.shape is None or len(dataset.shape) != len(item.axes):
        words = f"({', '.join(item.axes)})" if item.axes else "a single value"
        raise DamagedError(
            f"{dataset.name} must be {item.kind}, {words}, but is {dataset.dtype} of shape {dataset.shape}"
        )
    if item.kind == "text":
        texts = np.asarray(dataset.asstr()[()]).tolist()
        return tuple(texts) if item.axes else texts
    value = dataset[()]
    if not item.axes:
        return value.item()
    value.flags.writeable = False
    return value


def dataset_in(group: h5py.Group, name: str) -> h5py.Dataset:
    import h5py

    found = group.get(name)
    if not isinstance(found, h5py.Dataset):
        raise DamagedError(f"it has no dataset {_joined(group, name)}")
    return found


def group_in(parent: h5py.Group, name: str) -> h5py.Group:
    import h5py

    found = parent.get(name)
    if not isinstance(found, h5py.Group):
        raise DamagedError(f"it has no group {_joined(parent, name)}")
    return found


def _joined(group: h5py.Group, name: str) -> str:
    return f"{str(group.name).rstrip('/')}/{name}"
