"""Words of findings on the order."""

from __future__ import annotations

from collections.abc import Callable

ORDER: dict[str, str | Callable[..., str]] = {}
"""By code."""
