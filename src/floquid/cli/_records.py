"""The records that a command was given, as `identify` and `scan` read them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from floquid._checks import input_error, positive
from floquid.cli._info import best_option
from floquid.cli._settings import Choices
from floquid.core import Record
from floquid.readers import describe_file, read


def check_files(files: Sequence[Path], of: str) -> None:
    """Refuse no record at all, and one record as two: its noise would count as two independent ones."""
    if not files:
        example = f"For example: {of} run.npz --period 0.02"
        raise input_error("FILES", of, "name at least one record", "none was given", example)
    seen: dict[Path, Path] = {}
    for file in files:
        place = file.resolve()
        if place in seen:
            raise input_error(
                "FILES",
                of,
                "name each record once",
                f"{seen[place]} is given twice" if file == seen[place] else f"{seen[place]} and {file} are one file",
                "A record counted twice would halve its variance, and nothing more would be known.",
            )
        seen[place] = file


def period_of(period: float | None, frequency: float | None, of: str) -> float | None:
    """The period [s], whichever of the two was given."""
    if period is not None and frequency is not None:
        raise input_error("--frequency", of, "not be given beside --period", "both are given", "Give one of them.")
    if frequency is None:
        return period
    return positive(1.0 / positive(frequency, "--frequency", of, unit="Hz"), "period", "Settings", unit="s")


def read_records(
    files: Sequence[Path], choices: Choices, of: str, report: Callable[[str], None]
) -> tuple[list[Record], Choices]:
    """The records, and the choices with the names that the channels have from here on."""
    chosen, records = choices.settings, []
    signals = [name for name in (chosen.tach, chosen.azimuth) if name is not None]
    named = (*chosen.channels, *(name for name in signals if name not in chosen.channels)) if chosen.channels else None
    for file in files:
        report(f"reading {file.name}")
        record = read(
            file,
            period=chosen.period,
            rate=choices.rate,
            channels=named,
            origin=choices.origin,
        )
        if record.clock is None and not signals and not chosen.estimate_period:
            raise input_error(
                "--period",
                of,
                "be given",
                f"neither it nor --frequency is, and {file} does not state one",
                "Give the period of the system [s], as in --period 0.02, its frequency [Hz], as in --frequency 50, or "
                "the channel of a tachometer, as in --tach tach; --estimate-period finds it from the response."
                f"{_likely(file, choices.rate)}",
            )
        records.append(record)
    if chosen.channels:  # a path may stand for all rows of a matrix: from here on each has its name
        choices = choices.with_given(channels=tuple(c.name for c in records[0].channels if c.name not in signals))
    return records, choices


def _likely(file: Path, rate: float | None) -> str:
    """The option for the clock that the file seems to hold, in a sentence; empty if there is none."""
    option = best_option(describe_file(file, rate=rate).clock_candidates)
    return f"\n  This file seems to have one: {option}" if option else ""
