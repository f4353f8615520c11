"""Words of findings on A(t) and its structure."""

from __future__ import annotations

from collections.abc import Callable

SYSTEM: dict[str, str | Callable[..., str]] = {}
"""By code."""
