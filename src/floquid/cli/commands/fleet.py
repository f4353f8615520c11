"""`floquid fleet`: many records, each identified for itself, into one table with a row a mode."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from floquid._checks import counted, input_error
from floquid.cli._errors import in_a_line
from floquid.cli.arguments.options import ModelOptions, RecordOptions, choices_of, given
from floquid.cli.arguments.shared import OUTPUT, FleetFiles, Format, OptionalWhole, Place, SettingsFile
from floquid.cli.output.terminal import json_text, terminal
from floquid.errors import IdentificationError
from floquid.fleets import Fleet, scheduled
from floquid.fleets import fleet as identify_all

OF = "floquid fleet"
MOST = 6  # records without a result that are named


def fleet(
    *files: FleetFiles,
    record: RecordOptions | None = None,
    model: ModelOptions | None = None,
    workers: OptionalWhole = None,
    scheduler: str | None = None,
    out: Annotated[Place, Parameter(group=OUTPUT)] = Path("modes.parquet"),
    keep: Annotated[Place | None, Parameter(group=OUTPUT)] = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
) -> None:
    """Identify many records, each for itself, into one Parquet table with a row a mode.

    A record without a result is one row with its reason. A run that was killed, or is started again, goes on where it
    ended: a finished record is done again where its file or the options have changed.

    Parameters
    ----------
    record, model
        The fields of `Settings`.
    workers
        How many processes of this machine share the records; one for each processor when not given.
    scheduler
        The address of a scheduler of dask, whose workers on any machines share them: tcp://head:8786.
    out
        The table, ending in .parquet.
    keep
        A folder for the whole result of each record, which `floquid report` and `floquid survey` read.
    format
        text prints counts and reasons; json prints the same for a program.
    """
    if not files:
        must = "name records"
        raise input_error("FILES", OF, must, "none was given", "For example: floquid fleet 'lake/*/*.parquet'")
    if scheduler is not None and workers is not None:
        must = "not be given beside --workers"
        raise input_error("--scheduler", OF, must, "both are given", "It has its own workers.")
    choices = choices_of(settings).with_given(**given(record, OF), **given(model, OF))
    with ExitStack() as held:
        by = None if scheduler is None else held.enter_context(scheduled(scheduler, of=OF, argument="--scheduler"))
        found = identify_all(
            files,
            choices.resolved(),
            executor=by,
            workers=workers,
            out=out,
            keep=keep,
            reading=choices.reading(),
            words=in_a_line,
            progress=True,
        )
    if format == "json":
        sys.stdout.write(json_text(_content(found)))
        sys.stdout.flush()
    else:
        print_fleet(terminal(), found)
    if not found.n_identified:
        raise IdentificationError(f"No record has a result. The first: {found.lost[0][1]}")


def _content(found: Fleet) -> dict[str, object]:
    """The content of `--format json`."""
    return {
        "format": "floquid-fleet/1",
        "out": str(found.out),
        "records": found.n_records,
        "before": found.n_before,
        "identified": found.n_identified,
        "passed": found.n_passed,
        "modes": found.n_modes,
        "lost": [{"file": file, "reason": reason} for file, reason in found.lost],
    }


def print_fleet(console: Console, found: Fleet) -> None:
    """Print the counts, and the first records without a result."""
    console.print(str(found))
    for file, reason in found.lost[:MOST]:
        console.print(f"No result: {file}: {reason}", style="yellow", soft_wrap=True)
    if len(found.lost) > MOST:
        console.print(
            f"… and {counted(len(found.lost) - MOST, 'more record')}, each a row with its reason.", style="dim"
        )
    console.print(f"Written to {found.out}.", soft_wrap=True)
