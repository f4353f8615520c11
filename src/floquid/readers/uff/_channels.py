"""The channels of the functions in a universal file: distinct names, quantities and units from their headers."""

from __future__ import annotations

from collections.abc import Sequence

from floquid.core import Channel, Quantity
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._header import DIRECTIONS, FunctionHeader, Point
from floquid.readers.uff._ids import OwnLines

_QUANTITIES: dict[int, Quantity] = {
    2: "other",
    3: "strain",
    5: "other",
    6: "other",
    8: "displacement",
    9: "force",
    11: "velocity",
    12: "acceleration",
    13: "force",
    15: "other",
    16: "other",
    17: "other",
    18: "other",
    19: "other",
    20: "other",
}
"""What the specific data type of an ordinate says; 0 (unknown) and 1 (general) leave it to the unit."""

_SYSTEMS = {1: ("m", "N"), 2: ("ft", "lbf"), 5: ("mm", "mN"), 6: ("cm", "cN"), 7: ("in", "lbf")}
"""Units of length and force, by the code of dataset 164; others name none that could be taken over."""

_SPELLINGS = {
    "m/s**2": "m/s^2",
    "m/s/s": "m/s^2",
    "m/sec^2": "m/s^2",
    "m/sec2": "m/s^2",
    "m/sec": "m/s",
    "mm/s**2": "mm/s^2",
    "rad/s**2": "rad/s^2",
    "M": "m",
    "MM": "mm",
    "M/S": "m/s",
    "M/S^2": "m/s^2",
    "M/S2": "m/s^2",
    "M/S**2": "m/s^2",
    "RAD": "rad",
    "DEG": "deg",
    "G": "g",
}


def name_functions(headers: Sequence[FunctionHeader], own: Sequence[OwnLines | None]) -> list[str]:
    """A name for each function: ours, or else the shortest of the kinds of names below that tells all apart.

    The degree of freedom («12:+X»; without one the entity, or ID line 1), then the entity with it, ID line 1, and both.
    """
    entities = [header.response.entity for header in headers]
    points = [header.response.words or header.response.entity or header.ids[0] for header in headers]
    lines = [header.ids[0] for header in headers]
    listed: list[str] = []
    for parts in ((points,), (entities, points), (lines,), (points, lines), (entities, points, lines)):
        listed = [_joined(*words) for words in zip(*parts, strict=True)]
        for row, stated in enumerate(own):
            if stated is not None:
                listed[row] = stated.words.get("name") or lines[row] or listed[row]
        if all(listed) and len(set(listed)) == len(listed):
            return listed
    return [name or f"function {row}" for row, name in enumerate(listed, start=1)]


def _joined(*words: str) -> str:
    """The words that are there, each once."""
    return " ".join(dict.fromkeys(word for word in words if word))


def make_channel(
    header: FunctionHeader, own: OwnLines | None, name: str, unit_system: int | None
) -> tuple[Channel, tuple[str, ...]]:
    """The channel of a function, and notes on what was made of its header."""
    notes = (own.doubt,) if own and own.doubt else ()
    if own and own.words:
        return Channel(**(own.words | {"name": name})), notes  # type: ignore[arg-type]  # checked where it was read
    quantity = _QUANTITIES.get(header.ordinate.kind)
    unit = header.ordinate.unit.strip("[]() ")
    unit = _SPELLINGS.get(unit, unit) or _unit_of(quantity, header.response, unit_system)
    words = {
        "location": _joined(header.response.entity, str(header.response.node or "")),
        "direction": DIRECTIONS[header.response.direction],
    }
    try:
        return Channel(name=name, quantity=quantity, unit=unit or "-", **words), notes
    except InputError:
        doubt = f"The header of {name!r} says {quantity} and {unit!r}, which contradict each other: taken as other."
        return Channel(name=name, quantity="other", unit=unit, **words), (*notes, doubt)


def _unit_of(quantity: Quantity | None, point: Point, unit_system: int | None) -> str:
    """The unit that dataset 164 gives a quantity, "" if there is none."""
    if unit_system not in _SYSTEMS:
        return ""
    length, force = _SYSTEMS[unit_system]
    if abs(point.direction) > 3:
        length, force = "rad", ""
    units = {"displacement": length, "velocity": f"{length}/s", "acceleration": f"{length}/s^2", "force": force}
    return units.get(quantity or "", "")


def check_names(source: Source, headers: Sequence[FunctionHeader], names: Sequence[str]) -> None:
    """Refuse two functions that nothing tells apart."""
    first: dict[str, int] = {}
    for row, name in enumerate(names):
        if name in first:
            one, other = headers[first[name]].first, headers[row].first
            raise source.error(
                "tell its time responses apart by node, direction, entity or ID line 1",
                f"has {name!r} twice, at bytes {one} and {other}",
                "Export one run a file, or name the functions in their ID lines.",
            )
        first[name] = row
