"""The ID lines of a function in a universal file, as floquid writes them.

The format keeps six digits of a step, and has no place for a period or for the words of a channel. It has five lines of
free text, which other programs show and keep:

    1   the name of the channel, or 80 letters of it
    2   floquid rate=2533.333333333334 Hz start=-0.25 s
    3   NONE (elsewhere the date)
    4   floquid period=0.015789473684210523 s origin=0.001 s, or NONE
    5   floquid {"quantity": "pulse", "unit": "V", "location": "disc", "direction": "+x"}

Line 5 is JSON in ASCII; it has a "name" where line 1 is not the whole of it, and may be longer than the 80 columns that
other programs read.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from floquid.core import Channel, ConstantPeriod, Quantity, Record
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._datasets import DIRECTIONS, FunctionHeader, Point

KINDS: dict[str, int] = {
    "strain": 3,
    "displacement": 8,
    "velocity": 11,
    "acceleration": 12,
    "force": 13,
    "angle": 1,
    "pulse": 0,
    "other": 0,
}
"""The specific data type of an ordinate, by what is measured; 1 is "general", 0 "unknown"."""

_COLUMNS, _LABEL = 80, 20
_RATE = re.compile(r"floquid rate=(\S+) Hz start=(\S+) s")
_CLOCK = re.compile(r"floquid period=(\S+) s origin=(\S+) s")
_WORDS = "floquid {"


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnLines:
    """Content of ID lines of ours: numbers in Hz and s, `words` of the channel, and the `doubt` about them."""

    sample_rate: float
    start: float
    period: float | None = None
    origin: float | None = None
    words: dict[str, str] = field(default_factory=dict)
    doubt: str = ""


def id_lines(record: Record, channel: Channel) -> tuple[str, ...]:
    """The five ID lines of a channel."""
    line = " ".join(channel.name.split())[:_COLUMNS].strip()
    words = {} if line == channel.name != "NONE" else {"name": channel.name}
    words |= {"quantity": str(channel.quantity), "unit": channel.unit}
    words |= {key: getattr(channel, key) for key in ("location", "direction") if getattr(channel, key)}
    return (
        line,
        f"floquid rate={record.sample_rate!r} Hz start={record.start!r} s",
        "NONE",
        "NONE" if record.period is None else f"floquid period={record.period!r} s origin={record.origin!r} s",
        f"floquid {json.dumps(words)}",
    )


def unit_label(unit: str) -> str:
    """A unit in the 20 columns of an axis, or "NONE"."""
    return "NONE" if unit == "-" else " ".join(unit.split())[:_LABEL].strip()


def own_lines(source: Source, header: FunctionHeader) -> OwnLines | None:
    """Statements of the ID lines if floquid wrote them, else None."""
    rate = _RATE.fullmatch(header.ids[1])
    if rate is None:
        return None
    clock = _CLOCK.fullmatch(header.ids[3])
    where = f"the function that begins at byte {header.first}"
    try:
        numbers = [float(text) for text in rate.groups()] + [float(text) for text in (clock.groups() if clock else ())]
        steps = [numbers[0], *numbers[2:3]]
        if not np.isfinite(numbers).all() or min(steps) <= 0.0:
            raise ValueError(numbers)
        if clock:
            ConstantPeriod(period=numbers[2], origin=numbers[3])  # refuses an origin that is too far off
    except ValueError:
        must = "have ID lines 2 and 4 as floquid wrote them"
        remedy = "Mend them, or let line 2 be `NONE`: the function can be read without it."
        raise source.error(must, f"has {header.ids[1]!r} and {header.ids[3]!r} in {where}", remedy) from None
    words, doubt = _words(header)
    return OwnLines(
        sample_rate=numbers[0],
        start=numbers[1],
        period=numbers[2] if clock else None,
        origin=numbers[3] if clock else None,
        words=words,
        doubt=doubt,
    )


def _words(header: FunctionHeader) -> tuple[dict[str, str], str]:
    """The words of line 5 and "", or none and the reason why they are not used."""
    name, line = header.ids[0], header.ids[4]
    if not line.startswith(_WORDS):
        return {}, ""
    try:
        words = json.loads(line.removeprefix("floquid "))
        if not all(isinstance(word, str) for word in words.values()) or words["quantity"] not in get_args(Quantity):
            raise ValueError(line)
        Channel(**({"name": name} | words))
    except (ValueError, TypeError, KeyError, RecursionError):  # an `InputError` of `Channel` is a ValueError
        return {}, f"ID line 5 of {name!r} is not as floquid wrote it, and is passed over."
    axis = (header.ordinate.kind, header.ordinate.unit or "NONE")
    if (KINDS[words["quantity"]], unit_label(words["unit"])) != axis:
        stated = f"{words['quantity']} in {words['unit']!r}"
        return {}, f"ID line 5 of {name!r} states {stated}, but its axis was changed since: the line is passed over."
    return words, ""


_MEASURED: tuple[Quantity, ...] = ("strain", "displacement", "velocity", "acceleration", "force")
_QUANTITIES: dict[int, Quantity] = {KINDS[quantity]: quantity for quantity in _MEASURED}
_QUANTITIES[9] = "force"
for _code in (2, 5, 6, *range(15, 21)):
    _QUANTITIES[_code] = "other"
"""Quantity by the specific data type of an ordinate; 0 (unknown) and 1 (general) leave it to the unit."""

_SYSTEMS = {1: ("m", "N"), 2: ("ft", "lbf"), 5: ("mm", "mN"), 6: ("cm", "cN"), 7: ("in", "lbf")}
"""Units of length and force, by the code of dataset 164; others name none that could be taken over."""

_SPELLINGS = {
    **dict.fromkeys(("m/s**2", "m/s/s", "m/sec^2", "m/sec2", "M/S^2", "M/S2", "M/S**2"), "m/s^2"),
    **{unit.upper(): unit for unit in ("m", "mm", "m/s", "rad", "deg", "g")},
    "m/sec": "m/s",
    "mm/s**2": "mm/s^2",
    "rad/s**2": "rad/s^2",
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
    for header, name in zip(headers, names, strict=True):
        if first.setdefault(name, header.first) != header.first:
            must = "tell its time responses apart by node, direction, entity or ID line 1"
            got = f"has {name!r} twice, at bytes {first[name]} and {header.first}"
            raise source.error(must, got, "Export one run a file, or name the functions in their ID lines.")
