"""Channel of a record: quantity, unit and place of a sensor."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from floquid._checks import answers_slips, finite, input_error, integer, wrong_value
from floquid._show import Brief

Quantity = Literal["displacement", "velocity", "acceleration", "strain", "force", "angle", "pulse", "other"]

_UNITS_OF: dict[tuple[Quantity, ...], str] = {
    ("displacement",): "m mm um µm μm nm cm km in ft mil",
    ("displacement", "angle"): "rad deg mrad urad",
    ("velocity",): "m/s mm/s cm/s um/s µm/s in/s ft/s rad/s deg/s",
    ("acceleration",): "m/s^2 m/s2 m/s² mm/s^2 mm/s2 mm/s² g in/s^2 ft/s^2 rad/s^2 rad/s2 rad/s² deg/s^2",
    ("force",): "N kN mN lbf",
    ("strain",): "strain ue µε με m/m",
}
_UNITS = {unit: quantities for quantities, units in _UNITS_OF.items() for unit in units.split()}

_NAMES: dict[Quantity, str] = {
    "force": r"force|hammer|torque",
    "acceleration": r"acc(?:el(?:eration|erometer)?)?[xyz]?",
    "velocity": r"vel(?:ocity)?[xyz]?",
    "displacement": r"di?sp(?:lacement)?[xyz]?",
    "strain": r"strain",
    "pulse": r"tach(?:o|ometer)?|pulses?|key ?phas\w*|encoder",
    "angle": r"azimuth|encoder|(?:shaft|rotor|crank) ?(?:angle|position|phase)|lss ?(?:tip|gag) ?(?:p|pxa|pxs)",
}
"""Words in names that say what is measured, where the unit leaves it open; OpenFAST's names of the azimuth, too."""


@answers_slips('Channel(name="x", unit="m")', {"units": 'unit="m"', "label": 'name="x"'})
@dataclass(frozen=True, slots=True, kw_only=True)
class Channel(Brief):
    """One measured quantity.

    Raises InputError where the name is empty, the quantity is unknown, or the unit is not a unit of that quantity.

    Parameters
    ----------
    name
        The name by which the channel is chosen (`channels`, `states`).
    quantity
        What is measured. If not given it is taken from the unit, and where that leaves it open from a word in the name
        (acc, vel, disp, strain, force, torque, tacho, azimuth); with neither it is a displacement.
    unit
        The unit of the values, or "-" when there is none. An unknown unit (a raw "V") is kept; with neither a
        `quantity` nor a name that says it, what is measured is "other".
    location, direction
        Free words for people.
    frame
        The frame in which it measures: "fixed", "rotating" with the shaft, or None where that is not known. If neither
        `frame`, `group` nor `member` is given they are taken from names such as flap1, blade 2 edge or RootMyb3.
    group, member
        The channels that measure the same on each blade have one group, "flap" say, and the numbers 1, 2, 3 of the
        blades; "" and None where it belongs to none.
    axis
        The axis of the frame along which it measures, "x", "y" or "z". If not given it is that of the `direction`, or
        the last of several words in the name.
    angle
        The angle of the member on the shaft [rad], in the sense of rotation; None where members are evenly spaced.
    """

    name: str
    quantity: Quantity | None = None
    unit: str = "-"
    location: str = ""
    direction: str = ""
    frame: Frame | None = None
    group: str = ""
    member: int | None = None
    axis: Axis | None = None
    angle: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise wrong_value("name", "Channel", "be a word", self.name, "Give each channel a name.")
        unit = self.unit.strip() if isinstance(self.unit, str) else None
        if unit is None:
            raise wrong_value("unit", "Channel", "be a text", self.unit, 'Use "-" for no unit.')
        unit = "-" if unit in ("", "1") else unit
        object.__setattr__(self, "unit", unit)
        object.__setattr__(self, "name", self.name.strip())
        possible = ("displacement",) if unit == "-" else _UNITS.get(unit, ("other",))
        if self.quantity is None:
            open_to = possible if unit in _UNITS else get_args(Quantity)
            object.__setattr__(self, "quantity", _by_name(self.name, open_to) or possible[0])
        elif self.quantity not in get_args(Quantity):
            raise wrong_value("quantity", "Channel", f"be one of {', '.join(get_args(Quantity))}", self.quantity)
        elif unit in _UNITS and self.quantity not in (*possible, "pulse", "other"):
            must = f"be a unit of {self.quantity}"
            got = f"is {unit!r}, a unit of {' or '.join(possible)} (channel {self.name!r})"
            raise input_error("unit", "Channel", must, got, f'Correct the unit, or pass quantity="{possible[0]}".')
        self._check_place()

    def _check_place(self) -> None:
        """Take the place from the name where it is not given, and refuse one that is impossible."""
        put = object.__setattr__
        if self.frame is None and self.group == "" and self.member is None:
            for key, value in place_by_name(self.name).items():
                if getattr(self, key) in (None, ""):
                    put(self, key, value)
        if self.axis is None:
            put(self, "axis", axis_by_words(self.name, self.direction))
        for key, words in (("frame", get_args(Frame)), ("axis", get_args(Axis))):
            if getattr(self, key) not in (None, *words):
                raise wrong_value(key, "Channel", f"be {', '.join(words)} or None", getattr(self, key))
        if not isinstance(self.group, str) or not (self.group.isprintable() and ";" not in self.group):
            raise wrong_value("group", "Channel", "be a word", self.group)
        if self.member is not None:
            put(self, "member", integer(self.member, "member", "Channel", at_least=1))
        if self.angle is not None:
            put(self, "angle", finite(self.angle, "angle", "Channel", unit="rad"))

    @property
    def place(self) -> str:
        """Frame, group, member, axis and angle in one text, as files hold it; empty where none is known."""
        return place_text({key: getattr(self, key) for key in PLACE})

    @property
    def label(self) -> str:
        """The name with its unit, as an axis shows it."""
        return f"{self.name} [{self.unit}]"


def channel_of(words: Mapping[str, Any]) -> Channel:
    """The channel by its words as files hold them, its `place` in one text; ValueError where that is none."""
    given = {key: value for key, value in words.items() if value is not None}
    place = place_of(str(given.pop("place", "")))
    return Channel(**given, **place)


def _by_name(name: str, possible: Sequence[str]) -> str | None:
    """First of the `possible` quantities with a word in the name; None without one."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|_", " ", name).lower()
    matching = (
        quantity
        for quantity in _NAMES
        if quantity in possible and re.search(rf"(?<![a-z])(?:{_NAMES[quantity]})(?![a-z])", words)
    )
    return next(matching, None)


def channels_named(channels: Sequence[Channel], names: Sequence[str], *, argument: str, of: str) -> list[int]:
    """The indices of the channels called `names`, in that order.

    `names`, each at most once, are looked for among the `channels`; `argument` is what they are called in the caller's
    signature, and `of` the caller, for the message. Raises InputError where a name is unknown, or given twice.
    """
    known = [channel.name for channel in channels]
    listing = "The channels are: " + ", ".join(known) + "."
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise wrong_value(argument, of, "be a list of channel names", names, listing)
    for position, name in enumerate(names):
        if name not in known:
            raise input_error(argument, of, "name channels of the record", f"has {name!r}", listing)
        if name in names[:position]:
            raise input_error(argument, of, "name each channel once", f"has {name!r} twice", listing)
    return [known.index(name) for name in names]


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
