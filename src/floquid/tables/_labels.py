"""What the heading of a column says: a name, a unit in brackets, and whether the column is the time."""

from __future__ import annotations

import re
from collections.abc import Sequence

from floquid.core import Channel
from floquid.io import Source
from floquid.tables._time_axis import SECONDS

_TIME_NAME = re.compile(
    r"(?:elapsed |relative )?(t|times?|time ?stamps?|zeit|temps|tiempo)(?:[ _.-](\w+))?", re.IGNORECASE
)
_OTHER_UNITS = {
    "-",
    "%",
    "V",
    "mV",
    "uV",
    "A",
    "mA",
    "Pa",
    "kPa",
    "MPa",
    "bar",
    "Nm",
    "N.m",
    "N m",
    "Hz",
    "rpm",
    "RPM",
    "°",
}


def name_and_unit(cell: str) -> tuple[str, str | None]:
    """The name and the unit in a `cell`: «x [m]», or «x (m)» where m is a unit and no remark; None without a unit."""
    match = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", cell)
    if match:
        return match[1], match[2].strip()
    match = re.fullmatch(r"(.*?)\s*\(([^()]*)\)", cell)
    if match and _is_unit(match[2].strip()):
        return match[1], match[2].strip()
    return cell, None


def _is_unit(text: str) -> bool:
    return text in _OTHER_UNITS or text in SECONDS or (text != "" and Channel(name="x", unit=text).quantity != "other")


def find_time(source: Source, parts: Sequence[tuple[str, str | None]]) -> tuple[int | None, float]:
    """The first column of a `source` that is a time, and its unit in seconds; of `parts`, a name and a unit each.

    A time by its name, or the very first column by its unit.
    """
    for column, (name, unit) in enumerate(parts):
        known = SECONDS.get(unit or "")
        if column == 0 and known is not None:
            return column, known
        if name.lower() in SECONDS and len(name) > 1 and unit is None:  # a column headed «ms»
            return column, SECONDS[name.lower()]
        match = _TIME_NAME.fullmatch(name)
        if match is None or (match[2] is not None and match[2].lower() not in SECONDS):
            continue
        if unit in (None, "", "-"):
            return column, SECONDS.get((match[2] or "s").lower(), 1.0)
        if known is not None:
            return column, known
        if len(match[1]) > 1:
            raise source.error(
                "have its times in one of s, ms, us, ns, min, h",
                f"has column {column + 1}, {name!r}, in {unit!r}",
                "Export the times as numbers in seconds.",
            )
    return None, 1.0
