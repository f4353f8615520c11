"""`floquid identify`: from files to exponents, shapes and A(t)."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from floquid._checks import input_error, positive
from floquid.cli._output import ResultFolder, print_json
from floquid.cli._progress import progress
from floquid.cli._terminal import print_analysis
from floquid.errors import InputError
from floquid.pipeline import Settings
from floquid.pipeline import identify as identify_records
from floquid.readers import read

STAGES = 8


def identify(
    *files: Path,
    period: float | None = None,
    frequency: Annotated[float | None, Parameter(name="--frequency")] = None,
    origin: float = 0.0,
    rate: float | None = None,
    channels: str | None = None,
    order: int | None = None,
    harmonics: int | None = None,
    states: str | None = None,
    out: Path | None = None,
    format: Literal["text", "json"] = "text",  # noqa: A002
    settings: Path | None = None,
    debug: bool = False,
) -> None:
    """Identify the Floquet exponents, the periodic mode shapes and A(t) from free responses.

    Parameters
    ----------
    files
        Records of free responses (.npz, .csv). Several files are several hits on one system.
    period
        The period of the system [s]: half a revolution for a two-fold symmetric shaft seen from the ground.
    frequency
        The fundamental frequency [Hz], one over the period; instead of --period.
    origin
        The time of phase zero [s].
    rate
        The sampling rate [Hz], overriding what the files say.
    channels
        The channels to use, comma-separated; all when not given.
    order
        The number of complex poles, conjugates counted one by one; found from the data when not given.
    harmonics
        Keep the harmonics from minus to plus this of each mode; those above the noise when not given.
    states
        The channels that are the displacement states of A(t), comma-separated; no A(t) when not given.
    out
        A folder for result.h5, summary.json, settings.toml and figures/.
    format
        text prints a table; json prints summary.json alone.
    settings
        A settings.toml written by an earlier run; options given here come first.
    debug
        Show the traceback of an error.
    """
    del debug
    if not files:
        raise input_error(
            "FILE",
            "floquid identify",
            "name at least one record",
            "none was given",
            "For example: floquid identify run.npz --period 0.02",
        )
    chosen = _settings(settings, period, frequency, channels, order, harmonics, states)
    folder = ResultFolder.prepare(out) if out is not None else None
    with progress(STAGES + (3 if folder else 0)) as report:
        records = []
        for file in files:
            report(f"reading {file.name}")
            records.append(read(file, period=chosen.period, rate=rate, channels=chosen.channels or None, origin=origin))
        analysis = identify_records(records, chosen, report=report)
        if folder is not None:
            folder.write(analysis, report)
    if format == "json":
        print_json(analysis)
    else:
        print_analysis(analysis, folder.path if folder else None)


def _settings(
    file: Path | None,
    period: float | None,
    frequency: float | None,
    channels: str | None,
    order: int | None,
    harmonics: int | None,
    states: str | None,
) -> Settings:
    """The settings of the file, with what was given on the command line put over them."""
    if period is not None and frequency is not None:
        raise input_error(
            "--frequency", "floquid identify", "not be given beside --period", "both are given", "Give one of them."
        )
    if frequency is not None:
        period = 1.0 / positive(frequency, "--frequency", "floquid identify", unit="Hz")
    given = {
        "period": period,
        "channels": None if channels is None else split(channels),
        "order": order,
        "harmonics": harmonics,
        "states": None if states is None else split(states),
    }
    base = load_settings(file) if file is not None else Settings()
    return replace(base, **{name: value for name, value in given.items() if value is not None})


def split(text: str) -> tuple[str, ...]:
    """A comma-separated list."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def load_settings(file: Path) -> Settings:
    """The settings of a TOML file.

    Raises
    ------
    InputError
        The file cannot be read, or holds what is not a setting.
    """
    import tomllib

    known = [f.name for f in fields(Settings)]
    try:
        content: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"Cannot read the settings {file}: {error}.") from None
    for name in content:
        if name not in known:
            raise input_error(
                name, str(file), "be a setting", "there is none of that name", f"The settings are: {', '.join(known)}."
            )
    return Settings(**content)
