"""Words of findings on A(t) and its structure."""

from __future__ import annotations

from collections.abc import Callable

SYSTEM: dict[str, str | Callable[..., str]] = {
    "structure_found": "Structure found: {structure}.",
    "structure_widened": "{name}: chi-square from {before:.4g} to {after:.4g}.",
}
"""By code."""
