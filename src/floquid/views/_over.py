"""Names of operating points as people write them."""

from __future__ import annotations

UNITS = {
    "_rpm": "rpm",
    "_m_s": "m/s",
    "_hz": "Hz",
    "_rad_s": "rad/s",
    "_c": "°C",
    "_n": "N",
    "_nm": "N m",
    "_deg": "deg",
}
"""Units by the endings of names."""


def over_unit(name: str) -> tuple[str, str]:
    """Words and unit of a quantity by its `name`: speed and rpm of `speed_rpm`; an empty unit where none is named."""
    for ending, unit in sorted(UNITS.items(), key=lambda one: -len(one[0])):
        if name.endswith(ending) and len(name) > len(ending):
            return name[: -len(ending)].replace("_", " "), unit
    return name.replace("_", " "), ""


def over_label(name: str) -> str:
    """Words of a quantity by its `name`, with its unit in brackets."""
    words, unit = over_unit(name)
    return f"{words} [{unit}]" if unit else words
