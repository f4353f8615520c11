"""Words of findings on the verdict on a model."""

from __future__ import annotations

from collections.abc import Callable

VERDICT: dict[str, str | Callable[..., str]] = {}
"""By code."""
