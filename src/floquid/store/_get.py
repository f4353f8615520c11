"""What one dataset of a result file holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.store._layout import Item

if TYPE_CHECKING:
    import h5py


def get_fields(group: h5py.Group, items: Sequence[Item]) -> dict[str, Any]:
    return {item.name: get(group, item) for item in items}


def get(group: Any, item: Item) -> Any:
    """What one dataset holds: None, a number, a text, a tuple of texts, or a read-only array."""
    dataset = group[item.name]
    if dataset.shape is None:
        return None
    if item.kind == "text":
        texts = np.asarray(dataset.asstr()[()]).tolist()
        return tuple(texts) if item.axes else texts
    value = dataset[()]
    if not item.axes:
        return value.item()
    value.flags.writeable = False
    return value
