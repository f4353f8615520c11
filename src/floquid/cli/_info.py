"""`floquid info`: what is in a file."""

from __future__ import annotations

from rich.table import Table

from floquid.cli._options import Debug, Place
from floquid.cli._terminal import counted, terminal
from floquid.readers import FileSummary, describe_file


def info(file: Place, /, *, debug: Debug = False) -> None:
    """Show what is in a record file: channels, units, rate, candidates for the clock.

    Parameters
    ----------
    file
        The record: .npz, .csv, .mat, .h5, .hdf5, .uff or .unv.
    debug
        Show the traceback of an error.
    """
    del debug
    print_summary(describe_file(file))


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
        console.print(f"Clock candidate: {candidate.name}: {candidate.why}")
    if found.period is not None:
        console.print(f"The file states a period of {found.period:.12g} s.")
    elif not found.clock_candidates:
        console.print("No candidate for a clock: give the period with --period or --frequency.", style="dim")
