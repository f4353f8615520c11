"""The kinds of words that options take, stricter than the parser's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter, Token

from floquid.readers import SUFFIXES, WRITTEN


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
RecordFiles = Annotated[
    Path,
    Parameter(
        converter=_path,
        help=f"Records of free responses: {SUFFIXES}. Several files are several hits on one system.",
    ),
]
NewRecordFile = Annotated[
    Path, Parameter(converter=_path, help=f"The file to write; its suffix chooses the format: {WRITTEN}.")
]
OptionalPlace = Annotated[Path | None, Parameter(converter=_path)]
OUTPUT = Group("Output", sort_key=9)
Verbose = Annotated[bool, Parameter(negative="", show_default=False, group=OUTPUT)]
Debug = Annotated[bool, Parameter(negative="", show_default=False, group=OUTPUT)]
Format = Annotated[Literal["text", "json"], Parameter(group=OUTPUT)]
OutputFolder = Annotated[Path | None, Parameter(converter=_path, group=OUTPUT)]
SettingsFile = Annotated[Path | None, Parameter(converter=_path, group=OUTPUT)]


def split(text: str) -> tuple[str, ...]:
    """A comma-separated list."""
    return tuple(word.strip() for word in text.split(",") if word.strip())
