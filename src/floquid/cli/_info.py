"""`floquid info`: what is in a file."""

from __future__ import annotations

import shlex

from rich.table import Table

from floquid.cli._options import Debug, RecordFile, split
from floquid.cli._terminal import counted, terminal
from floquid.readers import ClockCandidate, FileSummary, describe_file

_OPTIONS = {"pulses": "--tach", "azimuth": "--azimuth"}


def info(file: RecordFile, /, *, channels: str | None = None, rate: float | None = None, debug: Debug = False) -> None:
    """Show what is in a record file: channels, units, rate, candidates for the clock, and what to type next.

    Parameters
    ----------
    file
        The record.
    channels
        The channels to show, comma-separated; all when not given.
    rate
        The sampling rate [Hz], overriding what the file says.
    debug
        Show the traceback of an error.
    """
    del debug
    found = describe_file(file, rate=rate, channels=None if channels is None else split(channels))
    print_summary(found)
    given = "" if channels is None else f" --channels {shlex.quote(channels)}"
    given += "" if rate is None else f" --rate {rate:.17g}"
    terminal().print(next_command(found, given), soft_wrap=True)


def print_summary(found: FileSummary) -> None:
    """Print what is in a file."""
    console = terminal()
    rate = "rate unknown" if found.sample_rate is None else f"{found.sample_rate:.10g} Hz"
    length = "" if found.duration is None else f", {found.duration:.6g} s"
    console.print(
        f"{found.path}: {found.format}, {counted(len(found.channels), 'channel')}, "
        f"{counted(found.n_samples, 'sample')}, {rate}{length}",
        soft_wrap=True,
    )
    table = Table(box=None)
    for name in ("channel", "quantity", "unit"):
        table.add_column(name)
    for name in ("min", "max", "std", "missing"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in found.channels:
        numbers = [("-" if value is None else f"{value:.4g}") for value in (c.minimum, c.maximum, c.std)]
        table.add_row(c.name, str(c.quantity), c.unit, *numbers, str(c.n_missing) if c.n_missing else "-")
    console.print(table)
    for note in found.notes:
        console.print(f"Note: {note}")
    for candidate in found.clock_candidates:
        option = option_of(candidate)
        console.print(f"Clock candidate: {candidate.name}: {candidate.why}{f' ({option})' if option else ''}")
    if found.period is not None:
        console.print(f"The file states a period of {found.period:.12g} s.")
    elif not found.clock_candidates:
        console.print("No candidate for a clock: give the period with --period or --frequency.", style="dim")


def option_of(candidate: ClockCandidate) -> str:
    """The option of `identify` that takes this clock, as it is typed; empty for a period, which needs none."""
    option = _OPTIONS.get(candidate.kind)
    return f"{option} {shlex.quote(candidate.name)}" if option else ""


def best_option(candidates: tuple[ClockCandidate, ...]) -> str | None:
    """The option for the likeliest clock, empty where the file states a period; None if there is no clock."""
    usable = [candidate for candidate in candidates if candidate.kind != "speed"]
    usable.sort(key=lambda c: (c.kind != "period", not c.is_sure, c.kind != "azimuth"))
    return option_of(usable[0]) if usable else None


def next_command(found: FileSummary, given: str) -> str:
    """The command to type after this one; `given` are the options that were typed."""
    path = shlex.quote(found.path)
    if found.sample_rate is None:
        return f"Next, with the true rate: floquid info {path}{given} --rate 1000"
    best = best_option(found.clock_candidates)
    if best is None:
        return f"Next, with the true period: floquid identify {path}{given} --period 0.02"
    return f"Next: floquid identify {path}{given}{f' {best}' if best else ''}"
