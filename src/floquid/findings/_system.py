"""Words of findings on A(t) and its structure."""

from __future__ import annotations

from collections.abc import Callable

SYSTEM: dict[str, str | Callable[..., str]] = {
    "structure_found": "Structure found: {structure}.",
    "structure_widened": "{name}: chi-square from {before:.4g} to {after:.4g}.",
    "structure_tested": (
        "{name} is left out: its {more} numbers take {gain:.3g} off the chi-square (p = {p_value:.2g}), and the "
        "deviations count what it could hide."
    ),
    "structure_conditional": (
        "{name} cannot be told from none by this record: the deviations are conditional on there being none."
    ),
}
"""By code."""
