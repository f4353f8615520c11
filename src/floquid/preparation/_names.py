"""Options as the command has them."""

from __future__ import annotations

import re
from dataclasses import fields

from floquid.preparation._settings import Settings

SHORT = {"pulses_per_revolution": "pulses_per_rev", "periods_per_revolution": "periods_per_rev"}
"""Settings that have shorter names on the command line."""

_KNOWN = {*(field.name for field in fields(Settings)), "rate", "origin", "header", "method", "repeat", "drop"}


def for_command(text: str) -> str:
    """The text with options as the command has them: `skip=` or (`skip`) is `--skip`, `order=4` is `--order 4`."""
    return re.sub(r"`(\w+)=([^`]*)`|(?<=\()`(\w+)`(?=\))", _flag, text)


def _flag(match: re.Match[str]) -> str:
    name, value = match[1] or match[3], (match[2] or "").strip("\"'")
    if name not in _KNOWN:
        return match[0]
    flag = SHORT.get(name, name).replace("_", "-")
    if value == "False":
        return f"`--no-{flag}`"
    return f"`--{flag}`" if value in ("", "True") else f"`--{flag} {value}`"
