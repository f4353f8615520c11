"""Words of findings on records drawn from a result."""

from __future__ import annotations

from collections.abc import Callable

DRAWS: dict[str, str | Callable[..., str]] = {}
"""By code."""
