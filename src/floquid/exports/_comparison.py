"""A comparison for other programs: `comparison.json`, and a row a pair or a mode that is missing."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._json import for_json
from floquid.comparison import Comparison


def comparison_summary(found: Comparison) -> dict[str, Any]:
    """The content of `comparison.json` of a comparison `found`, modes counted from 0.

    Of several points missing modes are [point, mode].
    """
    several = found.over is not None
    pairs = [
        {
            **({"point": pair.point} if several else {}),
            "a": pair.a,
            "b": pair.b,
            "difference": np.complex128(pair.difference),
            "std": np.complex128(pair.std),
            "z": pair.z,
            "mac": pair.mac,
            "mac_noise": pair.mac_noise,
            "counted": pair.counted,
        }
        for pair in found.pairs
    ]
    missing = {
        f"missing_in_{side}": [place if several else place[1] for place in places]
        for side, places in (("a", found.missing_in_a), ("b", found.missing_in_b))
    }
    points = {"over": found.over, "points": [point.value for point in found.points]} if several else {}
    return for_json(
        {
            "format": "floquid-comparison/1",
            "compared": [found.a, found.b],
            **points,
            "pairs": pairs,
            **missing,
            "chi2": found.chi2,
            "dof": found.dof,
            "p": found.p,
            "warnings": found.warnings,
        }
    )


def comparison_columns(found: Comparison) -> dict[str, list[Any]]:
    """The pairs of a comparison `found`, a row each, then the modes that one side alone has."""
    rows: list[dict[str, Any]] = []
    for pair in found.pairs:
        (hertz_a, hertz_b), (ratio_a, ratio_b) = pair.frequencies_hz, pair.damping_ratios
        rows.append(
            {
                found.over or "point": found.points[pair.point].value, "a": pair.a, "b": pair.b,
                "re_a": pair.exponent_a.real, "im_a": pair.exponent_a.imag,
                "re_b": pair.exponent_b.real, "im_b": pair.exponent_b.imag,
                "re_difference": pair.difference.real, "im_difference": pair.difference.imag,
                "re_std": pair.std.real, "im_std": pair.std.imag, "z": pair.z, "mac": pair.mac,
                "frequency_difference_hz": hertz_a - hertz_b, "damping_ratio_difference": ratio_a - ratio_b,
                "counted": pair.counted,
            }
        )  # fmt: skip
    for side, places in (("b", found.missing_in_a), ("a", found.missing_in_b)):
        for number, mode in places:
            point = found.points[number]
            lam = (point.model_a if side == "a" else point.model_b).exponents[mode]
            exponent = {f"re_{side}": lam.real, f"im_{side}": lam.imag}
            rows.append({found.over or "point": point.value, side: mode, **exponent})
    names = dict.fromkeys(name for row in rows for name in row)
    cells = {name: [row.get(name) for row in rows] for name in names}
    return {name: [None if _empty(cell) else cell for cell in column] for name, column in cells.items()}


def _empty(cell: Any) -> bool:
    return isinstance(cell, float) and not np.isfinite(cell)
