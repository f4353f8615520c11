"""Pairs of directions, groups of blades and scales, as users name them, and the channels that they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floquid._arrays import Indices, Integers
from floquid._checks import describe, finite, input_error
from floquid.core import Channel, channels_named

OF = "read_shapes"
APART = 0.02  # share by which periods may differ from one part of a revolution: a speed is often said in whole numbers

Pairs: TypeAlias = Sequence[str | tuple[str, str]]
"""Pairs of channels: "x:y", several joined by commas, or (x, y); from x to y is the sense of rotation."""

Blades: TypeAlias = Mapping[str, Sequence[str]] | Sequence[str]
"""Groups of channels, one a blade: {"flap": ["b1", "b2", "b3"]}, or "flap=b1,b2,b3" each."""

_EVEN = 0.02  # rad: errors of stated angles of blades within which they are evenly spaced


@dataclass(frozen=True, slots=True)
class Pair:
    """Two channels at right angles in one plane."""

    name: str
    x: int
    y: int


@dataclass(frozen=True, slots=True)
class Family:
    """Channels that measure the same thing: one a blade, evenly spaced on the rotor, or one in the fixed frame."""

    name: str
    rows: Indices
    """In the order of the blades: each is ahead of the one before, in the sense of rotation."""
    scale: float

    @property
    def is_fixed(self) -> bool:
        """True of one channel in the fixed frame."""
        return len(self.rows) == 1

    @property
    def waves(self) -> Integers:
        """The space harmonics n (waves,)."""
        count = len(self.rows)
        return np.arange(-((count - 1) // 2), count // 2 + 1)


def pairs_of(pairs: Pairs, channels: Sequence[Channel]) -> tuple[Pair, ...]:
    """The `pairs` among `channels`; InputError where they differ in unit, or turn with the shaft."""
    words = [pairs] if isinstance(pairs, str) else list(pairs)
    named: list[tuple[str, str]] = []
    for word in words:
        for part in word.split(",") if isinstance(word, str) else [word]:
            both = tuple(part.split(":")) if isinstance(part, str) else tuple(part)
            if len(both) != 2 or not all(isinstance(name, str) for name in both):
                must, remedy = "be two channels each", 'Pass "x:y": from x to y is the sense of rotation.'
                raise input_error("pairs", OF, must, f"has {describe(part)}", remedy)
            named.append((both[0].strip(), both[1].strip()))
    found = []
    for x, y in named:
        rows = channels_named(channels, [x, y], argument="pairs", of=OF)
        for row in rows:
            if channels[row].frame == "rotating":
                must = "be in the fixed frame"
                remedy = "Whirl is that of the fixed frame; name turning members by `blades`."
                raise input_error("pairs", OF, must, f"has {channels[row].name!r}, which turns", remedy)
        found.append(Pair(f"{x}:{y}", *rows))
    _refuse_units([channels[row] for pair in found for row in (pair.x, pair.y)], "pairs")
    return tuple(found)


def families_of(
    blades: Blades, fixed: Sequence[str], scales: Mapping[str, float], channels: Sequence[Channel]
) -> tuple[Family, ...]:
    """Groups of `blades`, then channels of the `fixed` frame, with scales; InputError where one is impossible."""
    named = _named(blades) if blades else _stated(channels)
    found = [Family(name, _members(name, members, channels), _scale(scales, name)) for name, members in named.items()]
    rows = channels_named(channels, fixed, argument="fixed", of=OF)
    found += [Family(name, np.array([row]), _scale(scales, name)) for name, row in zip(fixed, rows, strict=True)]
    if unknown := [name for name in scales if name not in {family.name for family in found}]:
        listing = f"There are: {', '.join(family.name for family in found) or 'none'}."
        raise input_error("scales", OF, "be of groups of blades or fixed channels", f"has {unknown[0]!r}", listing)
    return tuple(found)


def _scale(scales: Mapping[str, float], name: str) -> float:
    return finite(scales.get(name, 1.0), f"scales[{name!r}]", OF)


def _named(blades: Blades) -> dict[str, list[str]]:
    if isinstance(blades, Mapping):
        return {name: list(members) for name, members in blades.items()}
    found: dict[str, list[str]] = {}
    for number, word in enumerate([blades] if isinstance(blades, str) else blades, start=1):
        name, equals, members = word.partition("=")
        listed = [member.strip() for member in (members if equals else name).split(",")]
        found[name.strip() if equals else _stem(listed) or f"group {number}"] = listed
    return found


def _stem(members: Sequence[str]) -> str:
    """The name of a group by what the names of its members have in common."""
    stems = {re.sub(r"[ _.\-]*\d+$", "", member) for member in members}
    return stems.pop() if len(stems) == 1 else ""


def _stated(channels: Sequence[Channel]) -> dict[str, list[str]]:
    """Groups by what channels say of themselves: turning members 1, 2, … of one group."""
    groups: dict[str, dict[int, str]] = {}
    for channel in channels:
        if channel.group and channel.member is not None and channel.frame == "rotating":
            groups.setdefault(channel.group, {})[channel.member] = channel.name
    whole = {name: members for name, members in groups.items() if set(members) == set(range(1, len(members) + 1))}
    return {name: [members[j] for j in sorted(members)] for name, members in whole.items() if len(members) > 1}


def _members(name: str, members: Sequence[str], channels: Sequence[Channel]) -> Indices:
    """The rows of the members of a group, in the order of their angles where these are stated."""
    rows = np.array(channels_named(channels, members, argument="blades", of=OF))
    if len(rows) < 2:
        remedy = "A pattern over blades needs one channel a blade: name the others too."
        raise input_error("blades", OF, "name two blades at least", f"has one in {name!r}", remedy)
    own = [channels[row] for row in rows]
    _refuse_units(own, "blades")
    if still := [channel.name for channel in own if channel.frame == "fixed"]:
        remedy = "Name it by `fixed`, or `pairs`."
        raise input_error("blades", OF, "turn with the rotor", f"has {still[0]!r}, which is in the fixed frame", remedy)
    angles = [channel.angle for channel in own]
    if None in angles:
        return rows
    offs = (np.array(angles, float) - float(angles[0] or 0.0)) % (2.0 * np.pi) / (2.0 * np.pi / len(rows))
    places = np.rint(offs).astype(int) % len(rows)
    uneven = np.abs((offs + 0.5) % 1.0 - 0.5).max() * 2.0 * np.pi / len(rows) > _EVEN
    if uneven or len(set(places.tolist())) < len(rows):
        listing = ", ".join(f"{channel.angle:g}" for channel in own)
        raise input_error("blades", OF, "be evenly spaced", f"has angles of {listing} rad in {name!r}")
    return rows[np.argsort(places)]


def _refuse_units(channels: Sequence[Channel], argument: str) -> None:
    """Refuse channels of different units, whose sizes cannot be compared."""
    for channel in channels[1:]:
        if channel.unit != channels[0].unit:
            got = f"has {channels[0].name!r} in {channels[0].unit} and {channel.name!r} in {channel.unit}"
            raise input_error(argument, OF, "have one unit", got, "Convert one of them before it is identified.")
