"""Output files of OpenFAST: what the text (.out) and the binary ones (.outb) have in common.

Both are columns with a name of few letters and a unit in parentheses each, the first of them the time. The azimuth of
the rotor is one of them, and is told by its name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from floquid.core import Channel
from floquid.io import Source
from floquid.readers._angles import is_shaft_angle
from floquid.tables import make_channels

_UNITS = {"": "-", "-": "-", "°": "deg"}


def channels_of(
    source: Source, labels: Sequence[str], units: Sequence[str]
) -> tuple[tuple[Channel, ...], tuple[str, ...]]:
    """The channels of columns with these `labels` and `units`, and notes."""
    plain = [_plain_unit(unit) for unit in units]
    quantities = ["angle" if is_shaft_angle(*pair) else None for pair in zip(labels, plain, strict=True)]
    channels = make_channels(source, labels, plain, quantity=quantities)
    invalid = [label for label, unit in zip(labels, plain, strict=True) if unit == "INVALID"]
    notes = (f"OpenFAST marks as invalid, and fills with zeros: {', '.join(invalid[:20])}.",) if invalid else ()
    return channels, notes


def _plain_unit(text: str) -> str:
    """«(m/sec^2)» as m/s^2."""
    unit = re.sub(r"\bsec\b", "s", text.strip().strip("()[]").strip())
    return _UNITS.get(unit, unit)
