"""`settings.toml`: all that `floquid identify` was told, to be told again."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from floquid._checks import finite, input_error, positive
from floquid.errors import InputError
from floquid.io import readable_file
from floquid.pipeline import IdentifierName, Settings

READING = ("rate", "origin", "identifier")  # the choices that are not settings as they stand


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """The settings of the identification, and how the files are read."""

    settings: Settings = field(default_factory=Settings)
    rate: float | None = None  # the sampling rate [Hz], overriding what the files say; None for theirs
    origin: float = 0.0  # the time of phase zero [s]
    identifier: IdentifierName | None = None  # the algorithm that finds the poles; None for the usual one

    def resolved(self) -> Settings:
        """The settings with the algorithm that was named."""
        return self.settings if self.identifier is None else replace(self.settings, identifier=self.identifier)

    def with_given(self, **given: Any) -> Choices:
        """These choices with those put over them that are given, which is to say, not None."""
        given = {name: value for name, value in given.items() if value is not None}
        reading = {name: given.pop(name) for name in READING if name in given}
        return replace(self, settings=replace(self.settings, **given), **reading)

    def text(self) -> str:
        """The choices as TOML; those that are None are left out, and mean the same when read back."""
        import tomli_w

        content = {name.name: getattr(self.settings, name.name) for name in fields(Settings)}
        content |= {"rate": self.rate, "origin": self.origin or None, "identifier": self.identifier}
        lists = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
        return tomli_w.dumps({name: value for name, value in lists.items() if value is not None})


def choices_of(file: Path | None) -> Choices:
    """The choices of a TOML file, or the usual ones where there is no file."""
    return Choices() if file is None else load_choices(file)


def load_choices(file: Path) -> Choices:
    """The choices of a TOML file; an InputError where it cannot be read, or holds what is not a setting."""
    import tomllib

    of = "floquid identify"
    readable_file(file, of=of, argument="--settings")
    try:
        content: dict[str, Any] = tomllib.loads(file.read_bytes().decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        remedy = "Mend it, or write it again with --out."
        raise input_error("--settings", of, "name a file in TOML", f"{file} is not: {error}", remedy) from None
    known = list(dict.fromkeys([*(f.name for f in fields(Settings)), *READING]))
    for name in content:
        if name not in known:
            raise InputError(f"{file} has `{name}`, which is not a setting.\n  The settings are: {', '.join(known)}.")
    try:
        reading: dict[str, float] = {}
        if "rate" in content:
            reading["rate"] = positive(content.pop("rate"), "rate", "Settings", unit="Hz")
        if "origin" in content:
            reading["origin"] = finite(content.pop("origin"), "origin", "Settings", unit="s")
        identifier = content.pop("identifier", None)
        Settings(identifier=identifier)  # refuses what is no such word
        return Choices(settings=Settings(**content), identifier=identifier, **reading)
    except InputError as error:
        words = str(error).replace("Argument ", "Setting ", 1).replace(" of `Settings`", f" in {file}", 1)
        raise InputError(words) from None
