"""Arguments that commands share: their types, how their words are understood, and their help."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Group, Parameter, Token

from floquid._checks import input_error, positive, wrong_value
from floquid.core import as_point
from floquid.errors import InputError
from floquid.io import is_result
from floquid.preparation import SHORT
from floquid.readers import SUFFIXES, WRITTEN

RESULT = "result.h5"
"""The file of an identification in its folder: figures beside it are of it."""

TELLS = (
    "A forced response does not tell the period. Use a tachometer (--tach), the shaft angle (--azimuth), or 60 over "
    "the speed in rpm."
)
"""Sources of the period where the response is forced."""


def whole_number(_type: Any, tokens: Sequence[Token]) -> int:
    """The parser's own would round 2.5 down to 2 without a word."""
    text = tokens[0].value
    try:
        number = float(text)
        if number.is_integer():
            return int(text) if text.strip("+-").isdigit() else int(number)
    except (ValueError, OverflowError):
        pass
    raise ValueError(f'"{text}" is not a whole number.')


def _path(_type: Any, tokens: Sequence[Token]) -> Path:
    """An empty word would otherwise mean the folder that one happens to be in."""
    text = tokens[0].value
    if not text:
        raise ValueError("an empty word names no file or folder; was a shell variable not set?")
    return Path(text)


Whole = Annotated[int, Parameter(converter=whole_number)]
OptionalWhole = Annotated[int | None, Parameter(converter=whole_number)]
Place = Annotated[Path, Parameter(converter=_path)]
RecordFile = Annotated[Path, Parameter(converter=_path, help=f"The record: {SUFFIXES}.")]
_FILES = f"Records of one system, {SUFFIXES}: several files are several hits, or runs."
RecordFiles = Annotated[Path, Parameter(converter=_path, help=_FILES)]
_OF_SURVEYS = (
    f"Records ({SUFFIXES}), results of `floquid identify`, the table of `floquid fleet --keep`, folders of .lin files "
    "of one operating point, or folders of such, at several operating points."
)
_OF_MONITORS = f"Results of `floquid identify`, records ({SUFFIXES}), or folders of such, one a record, in order."
MonitorFiles = Annotated[Path, Parameter(converter=_path, help=_OF_MONITORS)]
SurveyFiles = Annotated[Path, Parameter(converter=_path, help=_OF_SURVEYS)]
_OF_FLEETS = (
    f"Records ({SUFFIXES}), folders of such, or patterns in quotes: 'lake/*/*.parquet'. Each is a record alone."
)
FleetFiles = Annotated[Path, Parameter(converter=_path, help=_OF_FLEETS)]
NewRecordFile = Annotated[
    Path, Parameter(converter=_path, help=f"The file to write; its suffix chooses the format: {WRITTEN}.")
]
OUTPUT = Group("Output", sort_key=9)
Flag = Parameter(negative="", show_default=False)
Verbose = Annotated[bool, Flag, Parameter(group=OUTPUT)]
Format = Annotated[Literal["text", "json"], Parameter(group=OUTPUT)]
OutputFolder = Annotated[Path | None, Parameter(converter=_path, group=OUTPUT)]
_SETTINGS = "A settings.toml written by `floquid identify`; options given here come first."
SettingsFile = Annotated[Path | None, Parameter(converter=_path, group=OUTPUT, help=_SETTINGS)]
_TABLE = "A text table: a column named file, then a column a quantity; one named period is that of each record [s]."
PointTable = Annotated[Path | None, Parameter(converter=_path, help=_TABLE)]
_WORKERS = "How many processes identify records; one for each processor when not given."
Workers = Annotated[int | None, Parameter(converter=whole_number, help=_WORKERS)]
_SAVED = "A result.h5 that `floquid identify --out DIR` wrote, or the folder that it is in."
Saved = Annotated[Path, Parameter(converter=_path, help=_SAVED)]
Periods = Annotated[int, Parameter(converter=whole_number, help="The length of the record, in periods of the system.")]
Seed = Annotated[int, Parameter(converter=whole_number, help="The seed of the noise.")]
_NOISE = "Standard deviation of white noise, as a share of the largest free response of each channel: 0.02 is 2 %."
Noise = Annotated[float, Parameter(help=_NOISE)]
Rate = Annotated[float | None, Parameter(help="The sampling rate [Hz], overriding what the file says.")]
HEADER_HELP = "A text table has a line of names, or without one columns called 1, 2, 3."
Header = Annotated[bool, Parameter(help=HEADER_HELP, show_default=False)]
FREQUENCY_HELP = "The fundamental frequency [Hz], one over the period; instead of --period."
Frequency = Annotated[float | None, Parameter(help=FREQUENCY_HELP)]
NAMES_HELP = "Names for the channels, comma-separated, or the path of a variable that holds them."
Names = Annotated[str | None, Parameter(help=NAMES_HELP)]
POINT_HELP = "A quantity of the operating point as NAME=NUMBER, e.g. speed_rpm=742; may be given several times."
Point = Annotated[list[str] | None, Parameter(help=POINT_HELP, negative=())]


def is_saved(files: Sequence[Path]) -> bool:
    """True where a single file is a result, or the folder of one, and no record."""
    return len(files) == 1 and is_result(files[0] / RESULT if files[0].is_dir() else files[0])


def point_given(words: Sequence[str], of: str) -> dict[str, float]:
    """The operating point by words such as `speed_rpm=742` that the command `of` was given."""
    found: dict[str, float] = {}
    for word in words:
        name, equals, number = (part.strip() for part in word.partition("="))
        try:
            found[name] = float(number) if equals else np.nan
            as_point({name: found[name]}, of)
        except (ValueError, InputError):
            example = "For example: --point speed_rpm=742"
            raise wrong_value("--point", of, "be NAME=NUMBER", word, example) from None
    return found


def split(text: str) -> tuple[str, ...]:
    """A comma-separated list."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def period_of(period: float | None, frequency: float | None, of: str) -> float | None:
    """The period [s], whichever of the two was given."""
    if period is not None and frequency is not None:
        raise input_error("--frequency", of, "not be given beside --period", "both are given", "Give one of them.")
    if frequency is None:
        return period
    return positive(1.0 / positive(frequency, "--frequency", of, unit="Hz"), "period", "Settings", unit="s")


def options(settings: Mapping[str, Any]) -> str:
    """Fields of `Settings` as the words of a command."""
    words = []
    for name, value in settings.items():
        flag = "--" + SHORT.get(name, name).replace("_", "-")
        listed = ",".join(value) if isinstance(value, tuple) else value
        words.append(flag if value is True else f"{flag} {shlex.quote(str(listed))}")
    return " ".join(words)
