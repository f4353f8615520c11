"""Options of the command line that are the fields of `Settings`: their names, words and kinds are written there."""

from __future__ import annotations

import re
from dataclasses import fields, make_dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from cyclopts import Group, Parameter

from floquid.cli._options import split, whole_number
from floquid.cli._records import period_of
from floquid.cli._settings import IdentifierName
from floquid.pipeline import Settings
from floquid.reconstruction import Form

NAMES = {"pulses_per_revolution": "pulses_per_rev", "periods_per_revolution": "periods_per_rev"}
"""Settings that have shorter names here."""

RECORDS = (
    *("period", "tach", "azimuth", "estimate_period", "pulses_per_revolution", "periods_per_revolution"),
    *("channels", "orbit", "find_hits", "skip", "forced", "trust_period", "noise_floor"),
)
"""The settings that say what records are taken for: those of every command that starts from records."""

SYSTEM = ("states", "form", "delay", "structure", "output_error", "system_times")
CHECKS = ("validate",)
MODEL = tuple(f.name for f in fields(Settings) if f.name not in (*RECORDS, *SYSTEM, *CHECKS))

READING = {
    "frequency": (float, "The fundamental frequency [Hz], one over the period; instead of --period."),
    "origin": (float, "The time of phase zero [s]; 0 if not given."),
    "rate": (float, "The sampling rate [Hz], overriding what the files say."),
}
"""What is said of records beside the settings."""

RECORD = "Record"
ORDER = (RECORD, "Model", "State matrix A(t)", "Checks")
"""The groups of options, in the order of the help."""

KINDS: dict[str, Any] = {"form": Form, "identifier": IdentifierName}


def _words() -> dict[str, str]:
    """The first sentence on each setting."""
    found = re.findall(r"^    (\w+)\n((?: {8}.+\n)+)", str(Settings.__doc__), re.MULTILINE)
    texts = {name: re.sub(r"\s+", " ", text.replace("`", "")).strip() for name, text in found}
    return {name: re.split(r"(?<=\.)\s(?=[A-Z\"\d])", text)[0] for name, text in texts.items()}


def _option(name: str, kind: Any, words: str, default: Any, group: Group) -> tuple[str, Any, None]:
    """One option, None where it is not given."""
    words += " Comma-separated." if default == () else ""
    more: dict[str, Any] = {"help": words, "group": group}
    if kind is int:
        more["converter"] = whole_number
    if kind is bool and default is False:
        more["negative"] = ()
    elif kind is not bool and default not in (None, (), "", 0.0):
        more["help"] = f"{words} [default: {default:g}]" if kind in (int, float) else f"{words} [default: {default}]"
    return NAMES.get(name, name), Annotated[kind | None, Parameter(**more)], None


def _options(title: str, *groups: tuple[str, tuple[str, ...]]) -> type:
    """A class of options, those of each group together."""
    words, own = _words(), {f.name: f for f in fields(Settings)}
    found = []
    for label, names in groups:
        group = Group(label, sort_key=ORDER.index(label))
        for name in names:
            kind = KINDS.get(
                name, {"int": int, "float": float, "bool": bool}.get(str(own[name].type).split(" |")[0], str)
            )
            found.append(_option(name, kind, words.get(name, ""), own[name].default, group))
        if label == RECORD:
            found += [_option(name, kind, text, None, group) for name, (kind, text) in READING.items()]
    made = make_dataclass(title, [(name, kind, default) for name, kind, default in found], frozen=True, kw_only=True)
    made.__module__ = __name__
    return Parameter(name="*")(made)


def given(options: object, of: str) -> dict[str, Any]:
    """The fields of `Choices` that were said, by name.

    Parameters
    ----------
    options
        Options of one of the classes here; None for none.
    of
        The command, for messages.

    Returns
    -------
    dict
        What was said.

    Raises
    ------
    InputError
        Period and frequency are both given, or the frequency is not possible.
    """
    if options is None:
        return {}
    long = {short: name for name, short in NAMES.items()}
    said = {long.get(f.name, f.name): getattr(options, f.name) for f in fields(options)}  # type: ignore[arg-type]
    if "frequency" in said:
        said["period"] = period_of(said["period"], said.pop("frequency"), of)
    for name in ("channels", "states"):
        if said.get(name) is not None:
            said[name] = split(said[name])
    return {name: value for name, value in said.items() if value is not None}


if TYPE_CHECKING:
    RecordOptions: TypeAlias = Any
    ModelOptions: TypeAlias = Any
else:
    RecordOptions = _options("RecordOptions", (RECORD, RECORDS))
    ModelOptions = _options("ModelOptions", ("Model", MODEL), ("State matrix A(t)", SYSTEM), ("Checks", CHECKS))
