"""Words of findings on records and their samples."""

from __future__ import annotations

from collections.abc import Callable

RECORDS: dict[str, str | Callable[..., str]] = {}
"""By code."""
