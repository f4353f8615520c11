"""Words of findings on a result as a whole: what a reader must be told."""

from __future__ import annotations

from collections.abc import Callable

MODEL: dict[str, str | Callable[..., str]] = {}
"""By code."""
