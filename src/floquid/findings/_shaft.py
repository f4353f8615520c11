"""Words of findings on the angle of a shaft."""

from __future__ import annotations

from collections.abc import Callable

SHAFT: dict[str, str | Callable[..., str]] = {}
"""By code."""
