"""Words of findings on the fit of a record: its modes, the period, whether it is periodic."""

from __future__ import annotations

from collections.abc import Callable

FIT: dict[str, str | Callable[..., str]] = {}
"""By code."""
