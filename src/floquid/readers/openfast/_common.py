"""Output files of OpenFAST: what the text (.out) and the binary ones (.outb) have in common.

Both are columns with a name of few letters and a unit in parentheses each, the first of them the time. The azimuth of
the rotor is one of them, and is told by its name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from floquid.core import Channel, Record
from floquid.io import Source
from floquid.readers._angles import is_shaft_angle
from floquid.readers._stated import Stated
from floquid.tables import make_channels

_UNITS = {"": "-", "-": "-", "°": "deg"}


def channels_of(
    source: Source, labels: Sequence[str], units: Sequence[str], stated: Stated, width: int
) -> tuple[tuple[Channel, ...], tuple[str, ...]]:
    """The channels of columns with these `labels` and `units`, and notes; from our own line, where it is of these.

    Raises
    ------
    InputError
        A name is empty or there twice.
    """
    if stated.channels and labels_of(stated.channels, width) == list(labels):
        return stated.channels, ()
    plain = [_plain_unit(unit) for unit in units]
    quantities = ["angle" if is_shaft_angle(*pair) else None for pair in zip(labels, plain, strict=True)]
    channels = make_channels(source, labels, plain, quantity=quantities)  # type: ignore[arg-type]
    notes = ("Its line of floquid's is of other channels, and is passed over.",) if stated.channels else ()
    invalid = [label for label, unit in zip(labels, plain, strict=True) if unit == "INVALID"]
    if invalid:
        notes += (f"OpenFAST marks as invalid, and fills with zeros: {', '.join(invalid[:20])}.",)
    return channels, notes


def _plain_unit(text: str) -> str:
    """«(m/sec^2)» as m/s^2."""
    unit = re.sub(r"\bsec\b", "s", text.strip().strip("()[]").strip())
    return _UNITS.get(unit, unit)


def labels_of(channels: Sequence[Channel], width: int) -> list[str]:
    """Names of at most `width` letters, without blanks and each once, for the heads of columns."""
    labels: list[str] = []
    taken = {"time"}  # in small letters, as some programs tell names apart by no more
    for channel in channels:
        label = re.sub(r"[^!-~]+", "_", channel.name)[:width]
        number = 1
        while label.lower() in taken:
            number += 1
            label = f"{label[: width - len(str(number)) - 1]}_{number}"
        taken.add(label.lower())
        labels.append(label)
    return labels


def units_of(record: Record, width: int) -> list[str]:
    """Units in parentheses, of at most `width` letters with them."""
    return [f"({re.sub(r'[^!-~]+', '_', channel.unit)[: width - 2]})" for channel in record.channels]
