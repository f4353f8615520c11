"""Results as JSON holds them."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np


def for_json(value: Any) -> Any:
    """The value in mappings, lists and numbers: a complex number as [real, imaginary], what is not finite as None."""
    if isinstance(value, Mapping):
        return {name: for_json(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [for_json(one) for one in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return for_json((np.stack([value.real, value.imag], axis=-1) if np.iscomplexobj(value) else value).tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


def attributes(thing: object, *names: str) -> dict[str, Any]:
    """Attributes of a result by their names."""
    return {name: getattr(thing, name) for name in names}
