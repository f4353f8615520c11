"""Places of channels on a machine: frame, group, member of the group, axis; as names tell them, and as one text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal

Frame = Literal["fixed", "rotating"]
Axis = Literal["x", "y", "z"]

PLACE = ("frame", "group", "member", "axis", "angle")  # the fields of a channel that say where it measures

_KINDS = r"(?:flap|edge|lag|lead ?lag|torsion|twist|pitch|oop|ip|out of plane|in plane)(?:wise)?"
"""Words for what blades do."""

_ENDING = re.compile(rf"(?:.* )?{_KINDS}(?: \w+)? ?(?P<member>[1-9])", re.IGNORECASE)  # flap1, tip edgewise 2
_AHEAD = re.compile(rf"(?:blade|bl|b) ?(?P<member>[1-9]) (?P<group>(?:.* )?{_KINDS}(?: .*)?)", re.IGNORECASE)

_OPENFAST = (
    re.compile(r"(?P<group>(?:Root[FM]|Tip[DR]D?|TipAL|TipML|Spn\d(?:AL|ML|FL|TD|RD))[xyz][bc]?)(?P<member>[1-9])"),
    re.compile(r"(?P<group>OoPDefl|IPDefl|BldPitch|PtchPM[xyz]c|TwstDefl|RollDefl|PtchDefl)(?P<member>[1-9])"),
    re.compile(r"(?P<ahead>QD?2?_)B(?P<member>[1-9])(?P<group>[FE]\d)"),
    re.compile(r"B(?P<member>[1-9])(?P<group>(?:Tip|Root|N\d+)\w+)"),
)  # of ElastoDyn, of its degrees of freedom, of BeamDyn and AeroDyn
_TOWER = re.compile(r"(?:TwrBs|YawBr|NcIMU|TTDsp|Ptfm|TwHt\d|QD?2?_(?:T[FS][AS]\d|Yaw))\w*?(?P<axis>[xyz]?)[pstn]?")


def place_by_name(name: str) -> dict[str, Any]:
    """Frame, group and member, or axis, that a name tells: `flap1`, `blade 2 edge`, `RootMyb3`; empty where none is."""
    for pattern in _OPENFAST:
        if match := pattern.fullmatch(name):
            group = match.groupdict().get("ahead", "") + match["group"]
            return {"frame": "rotating", "group": group, "member": int(match["member"])}
    if match := _TOWER.fullmatch(name):
        return {"frame": "fixed", "axis": match["axis"] or None}
    words = " ".join(re.sub(r"(?<=[a-z])(?=[A-Z])|[_.\-]", " ", name).split())
    if match := _AHEAD.fullmatch(words):
        return {"frame": "rotating", "group": match["group"].lower(), "member": int(match["member"])}
    if match := _ENDING.fullmatch(words):
        return {"frame": "rotating", "group": words[:-1].strip().lower(), "member": int(match["member"])}
    match = re.search(r"\b(fixed|rotating) frame\b", words, re.IGNORECASE)
    return {"frame": match[1].lower()} if match else {}


def axis_by_words(name: str, direction: str) -> str | None:
    """The axis that a direction names, or the last of several words of a name: `+X`, `disc y`; None without one."""
    if match := re.fullmatch(r"\+?([xyz])", direction.strip(), re.IGNORECASE):
        return match[1].lower()
    match = re.fullmatch(r".*\w[\s_.\-]+([xyz])", name, re.IGNORECASE)
    return match[1].lower() if match and not direction else None


def place_text(place: Mapping[str, Any]) -> str:
    """The fields of a place in one text, as `frame=rotating; group=flap; member=1`; empty for none."""
    return "; ".join(f"{key}={place[key]}" for key in PLACE if place[key] not in (None, ""))


def place_of(text: str) -> dict[str, Any]:
    """The fields of a channel by the text of its place; ValueError where it is none."""
    found: dict[str, Any] = dict(part.split("=", 1) for part in text.split("; ")) if text else {}
    if set(found) - set(PLACE):
        raise ValueError(text)
    for key, kind in (("member", int), ("angle", float)):
        if key in found:
            found[key] = kind(found[key])
    return found
