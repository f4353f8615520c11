"""Options: the fields of `Settings`, whose names and help are written there, stricter words, and `settings.toml`."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from cyclopts import Group, Parameter

from floquid._checks import finite, input_error, positive, wrong_value
from floquid.cli.arguments.shared import (
    FREQUENCY_HELP,
    HEADER_HELP,
    NAMES_HELP,
    OUTPUT,
    POINT_HELP,
    period_of,
    point_given,
    split,
    whole_number,
)
from floquid.core import Branch, Form, Hold, as_point
from floquid.errors import InputError
from floquid.io import readable_file
from floquid.preparation import FORBIDDEN, SHORT, WORDS, Excitation, IdentifierName, Reading, Settings
from floquid.views import DampingUnit, SpeedUnit

ShaftSpeed = Annotated[
    SpeedUnit, Parameter(group=OUTPUT, help="The unit of the speed of the shaft; frequencies of vibration stay in Hz.")
]
Damping = Annotated[
    DampingUnit,
    Parameter(
        group=OUTPUT, help="Damping as the ratio ζ in percent, or as the logarithmic decrement δ = 2πζ/√(1 - ζ²)."
    ),
]
RECORDS = (  # the settings that say what records are taken for: those of every command that starts from records
    *("period", "tach", "azimuth", "events", "estimate_period", "pulses_per_revolution", "periods_per_revolution"),
    *(
        "channels",
        "inputs",
        "hold",
        "excitation",
        "orbit",
        "find_hits",
        "skip",
        "repair",
        "forced",
        "trust_period",
        "noise_floor",
    ),
)

SYSTEM = ("states", "form", "delay", "structure", "output_error", "system_times")
CHECKS = ("validate",)
MODEL = tuple(f.name for f in fields(Settings) if f.name not in (*RECORDS, *SYSTEM, *CHECKS))

READING = {  # what is said of records beside the settings
    "frequency": (float, FREQUENCY_HELP),
    "origin": (float, "The time of phase zero [s]; 0 if not given."),
    "rate": (float, "The sampling rate [Hz], overriding what the files say."),
    "names": (str, NAMES_HELP),
    "header": (bool, HEADER_HELP),
    "point": (list[str], POINT_HELP),
}

RECORD = "Record"
ORDER = (RECORD, "Model", "State matrix A(t)", "Checks")  # the groups of options, in the order of the help

KINDS: dict[str, Any] = {
    "form": Form,
    "hold": Hold,
    "excitation": Excitation,
    "identifier": IdentifierName,
    "branch": Branch,
}


def _words() -> dict[str, str]:
    """The first sentence on each setting."""
    found = re.findall(r"^    (\w+)\n((?: {8}.+\n)+)", str(Settings.__doc__), re.MULTILINE)
    texts = {name: re.sub(r"\s+", " ", text.replace("`", "")).strip() for name, text in found}
    return {name: re.split(r"(?<=\.)\s(?=[A-Z\"\d])", text)[0] for name, text in texts.items()}


def _option(name: str, kind: Any, words: str, default: Any, group: Group, shown: bool = True) -> tuple[str, Any, None]:
    """One option, None where it is not given."""
    words += " Comma-separated." if default == () else ""
    more: dict[str, Any] = {"help": words, "group": group, "show": shown}
    if kind is int:
        more["converter"] = whole_number
    if (kind is bool and default is False) or kind == list[str]:
        more["negative"] = ()
    elif kind is not bool and default not in (None, (), "", 0.0):
        more["help"] = f"{words} [default: {default:g}]" if kind in (int, float) else f"{words} [default: {default}]"
    return SHORT.get(name, name), Annotated[kind | None, Parameter(**more)], None


def _forbidden(name: str) -> str:
    """A sentence on the kinds of records that cannot have an option, and the reason why."""
    kinds = [kind for kind, reasons in FORBIDDEN.items() if name in reasons]
    words = " or ".join(WORDS[kind] for kind in kinds)
    return f" Not {words}: {FORBIDDEN[kinds[0]][name]}." if kinds else ""


def _options(title: str, *groups: tuple[str, tuple[str, ...]], hidden: tuple[str, ...] = ()) -> type:
    """A class of options, those of each group together; `hidden` are not in the help."""
    words, own = _words(), {f.name: f for f in fields(Settings)}
    found = []
    for label, names in groups:
        group = Group(label, sort_key=ORDER.index(label))
        for name in names:
            kind = KINDS.get(
                name, {"int": int, "float": float, "bool": bool}.get(str(own[name].type).split(" |")[0], str)
            )
            told = words.get(name, "")
            if not hidden:
                told += _forbidden(name)
            found.append(_option(name, kind, told, own[name].default, group, name not in hidden))
        if label == RECORD:
            found += [_option(name, kind, text, None, group) for name, (kind, text) in READING.items()]
    made = make_dataclass(title, [(name, kind, default) for name, kind, default in found], frozen=True, kw_only=True)
    made.__module__ = __name__
    return Parameter(name="*")(made)


def _states(text: str, of: str) -> tuple[str, ...]:
    """States by name, or sums with the weights of a CSV file: channels in its header, a state a row."""
    path = Path(text)
    if path.suffix.lower() != ".csv" or not path.is_file():
        return split(text)
    try:
        with path.open(encoding="utf-8-sig", newline="") as table:
            names, *rows = filter(None, csv.reader(table, skipinitialspace=True))
        weights = [[float(word) for word in row] for row in rows]
        each = [zip(row, names, strict=True) for row in weights]
        return tuple("+".join(f"{weight!r}*{name.strip()}" for weight, name in pairs if weight) for pairs in each)
    except ValueError:
        must, remedy = "be a table of weights, a number for each channel in every row", "Its header names the channels."
        raise input_error("--states", of, must, f"{path} is another", remedy) from None


def given(options: object, of: str) -> dict[str, Any]:
    """The fields of `Choices` that were said, by name, with options of one of the classes here; `of` the command."""
    if options is None:
        return {}
    long = {short: name for name, short in SHORT.items()}
    said = {long.get(f.name, f.name): getattr(options, f.name) for f in fields(options)}  # type: ignore[arg-type]
    if "frequency" in said:
        said["period"] = period_of(said["period"], said.pop("frequency"), of)
    if said.get("point") is not None:
        said["point"] = point_given(said["point"], of)
    for name in ("channels", "names", "inputs", "states"):
        if said.get(name) is not None:
            said[name] = split(text := said[name]) if name != "states" else _states(text := said[name], of)
            if not said[name]:  # an empty variable of a shell would have the record identified as another one
                raise wrong_value(f"--{name}", of, "name a channel", text, "Name one, or leave it out.")
    return {name: value for name, value in said.items() if value is not None}


if TYPE_CHECKING:
    RecordOptions: TypeAlias = Any
    FreeOptions: TypeAlias = Any
    ModelOptions: TypeAlias = Any
else:
    RecordOptions = _options("RecordOptions", (RECORD, RECORDS))
    FreeOptions = _options("FreeOptions", (RECORD, RECORDS), hidden=("inputs", "hold", "excitation"))
    ModelOptions = _options("ModelOptions", ("Model", MODEL), ("State matrix A(t)", SYSTEM), ("Checks", CHECKS))


_HOW = ("rate", "names", "origin", "header", "identifier", "point")  # the choices that are not settings as they stand


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """The settings of the identification, and how the files are read."""

    settings: Settings = field(default_factory=Settings)
    rate: float | None = None  # the sampling rate [Hz], overriding what the files say; None for theirs
    names: tuple[str, ...] = ()  # names to give the channels, or the path of a variable that holds them
    asked: tuple[str, ...] = ()  # the channels as the files call them, where they have been given other names
    origin: float = 0.0  # the time of phase zero [s]
    header: bool = True  # a text table has a line of names
    identifier: IdentifierName | None = None  # the algorithm that finds the poles; None for the usual one
    point: Mapping[str, float] = field(default_factory=dict)  # the operating point beside what the files say of it

    def resolved(self) -> Settings:
        """The settings with the algorithm that was named."""
        return self.settings if self.identifier is None else replace(self.settings, identifier=self.identifier)  # type: ignore[arg-type]

    def reading(self) -> Reading:
        """The options of the reading of files."""
        return Reading(rate=self.rate, names=self.names, origin=self.origin, header=self.header, point=self.point)

    def with_given(self, **given: Any) -> Choices:
        """Choices with the given ones (not None) put over them."""
        given = {name: value for name, value in given.items() if value is not None}
        reading = {name: given.pop(name) for name in (*_HOW, "asked") if name in given}
        return replace(self, settings=replace(self.settings, **given), **reading)

    def text(self) -> str:
        """The choices as TOML; those that are None are left out, and mean the same when read back."""
        import tomli_w

        content = {name.name: getattr(self.settings, name.name) for name in fields(Settings)}
        content |= {
            "channels": self.asked or self.settings.channels,
            "rate": self.rate,
            "names": self.names or None,
            "origin": self.origin or None,
            "header": None if self.header else False,
            "identifier": self.identifier,
            "point": dict(self.point) or None,
        }
        lists = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
        return tomli_w.dumps({name: value for name, value in lists.items() if value is not None})


def choices_of(file: Path | None) -> Choices:
    """The choices of a TOML file, the usual ones without; an InputError where it holds what is not a setting."""
    import tomllib

    if file is None:
        return Choices()
    of = "floquid identify"
    readable_file(file, of=of, argument="--settings")
    try:
        content: dict[str, Any] = tomllib.loads(file.read_bytes().decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        remedy = "Mend it, or write it again with --out."
        raise input_error("--settings", of, "name a file in TOML", f"{file} is not: {error}", remedy) from None
    known = list(dict.fromkeys([*(f.name for f in fields(Settings)), *_HOW]))
    for name in content:
        if name not in known:
            raise InputError(f"{file} has `{name}`, which is not a setting.\n  The settings are: {', '.join(known)}.")
    try:
        reading: dict[str, Any] = {}
        if "rate" in content:
            reading["rate"] = positive(content.pop("rate"), "rate", "Settings", unit="Hz")
        if "origin" in content:
            reading["origin"] = finite(content.pop("origin"), "origin", "Settings", unit="s")
        if "names" in content:
            reading["names"] = Settings(channels=content.pop("names")).channels
        if (header := content.pop("header", None)) is not None:
            if not isinstance(header, bool):
                raise wrong_value("header", "Settings", "be true or false", header)
            reading["header"] = header
        if "point" in content:
            reading["point"] = as_point(content.pop("point"), "Settings")
        identifier = content.pop("identifier", None)
        Settings(identifier=identifier)  # refuses what is no such word
        return Choices(settings=Settings(**content), identifier=identifier, **reading)
    except InputError as error:
        words = str(error).replace("Argument ", "Setting ", 1).replace(" of `Settings`", f" in {file}", 1)
        raise InputError(words) from None
