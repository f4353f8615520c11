"""Names of the options of Python on the command line."""

from __future__ import annotations

import re
from dataclasses import fields

from floquid.pipeline import Settings

SHORT = {"pulses_per_revolution": "pulses_per_rev", "periods_per_revolution": "periods_per_rev"}
"""Settings that have shorter names on the command line."""

_KNOWN = {*(field.name for field in fields(Settings)), "rate", "origin"}


def for_command(text: str) -> str:
    """The text with options as the command has them: `skip=` is `--skip`, `form="delayed"` is `--form delayed`."""
    return re.sub(r"`(\w+)=([^`]*)`", _flag, text)


def _flag(match: re.Match[str]) -> str:
    name, value = match[1], match[2].strip("\"'")
    if name not in _KNOWN:
        return match[0]
    flag = SHORT.get(name, name).replace("_", "-")
    if value == "False":
        return f"`--no-{flag}`"
    return f"`--{flag}`" if value in ("", "True") else f"`--{flag} {value}`"
