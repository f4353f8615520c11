"""`floquid monitor`: records of one machine against a baseline of it, and how periodic each is."""

from __future__ import annotations

from dataclasses import replace

from rich.console import Console

from floquid._bar import bar
from floquid._checks import counted, input_error, wrong_value
from floquid.cli.arguments.options import ModelOptions, RecordOptions, choices_of, given
from floquid.cli.arguments.points import jobs_of, points_of
from floquid.cli.arguments.shared import (
    Format,
    MonitorFiles,
    OutputFolder,
    Place,
    PointTable,
    SettingsFile,
    Whole,
    Workers,
)
from floquid.cli.output.folder import keep, maybe_folder, refuse_beside_identified, tell
from floquid.cli.output.terminal import json_text, new_table, print_title, print_warnings, print_whole
from floquid.errors import IdentificationError
from floquid.exports import columns_text, monitor_columns, monitor_summary
from floquid.monitoring import CHARTED, Monitor, record_heads, record_rows, sentences
from floquid.monitoring import monitor as monitored

OF = "floquid monitor"
FILES = (
    "monitor.h5", "monitor.json", "monitor.csv", "report.html", "figures/monitor.png", "figures/periodic_amount.png",
)  # fmt: skip
MOST = 12  # records that are printed beside those of an alarm, the last


def monitor(
    *files: MonitorFiles,
    baseline: str | None = None,
    covariates: str | None = None,
    degree: Whole = 2,
    false_alarms: float = 1e-3,
    like: Place | None = None,
    over: str | None = None,
    table: PointTable = None,
    record: RecordOptions | None = None,
    model: ModelOptions | None = None,
    workers: Workers = None,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
) -> None:
    """Compare records of one machine with a baseline of it: alarms, when it changed, how periodic it is.

    Records are identified first. Each file is a record, in the order of their names; --over orders them otherwise.

    Parameters
    ----------
    baseline
        The records of the healthy machine, counted from 0: 0:30 are the first thirty. Without it no record is compared,
        and how periodic each is, is all that is told.
    covariates
        Quantities of the operating point on which frequencies and decays may depend, joined by commas; by default
        speed_rpm and temperature, of those that the baseline has. They come from --table, single numbers in the files,
        or --point.
    degree
        The largest degree of the functions of covariates.
    false_alarms
        The rate of false alarms of each chart at each record.
    like
        A result or record of the machine with a damage: a one-sided chart looks for the same change, and sidebands are
        measured along it.
    over
        A quantity by which records are ordered and drawn, such as days.
    out
        A folder for monitor.h5, monitor.json, monitor.csv; then for figures/ and report.html, a page for the browser.
    format
        text prints what was found; json prints monitor.json alone.
    """
    if not files and table is None:
        example = "For example: floquid monitor results --baseline 0:30 --out monitor"
        raise input_error("FILES", OF, "name results or records", "none was given", example)
    refuse_beside_identified(out, OF)
    healthy = None if baseline is None else _slice(baseline)
    choices = choices_of(settings).with_given(**given(record, OF), **given(model, OF))
    with maybe_folder(out, FILES) as folder:
        with bar(True) as report:
            jobs = [replace(job, sidebands=True) for job in jobs_of(files, choices, None, table)]
            looked_for = [replace(job, sidebands=True) for job in jobs_of([like], choices, None, table)] if like else []
            if len(looked_for) > 1:
                raise input_error("--like", OF, "be one record or result", f"{like} holds {len(looked_for)}")
            points = points_of([*jobs, *looked_for], workers, report)
        if all(point.model is None for point in points):
            raise IdentificationError(f"No record has a result. The first: {points[0].reason}")
        if like and points[-1].model is None:
            raise input_error("--like", OF, "hold a record or a result", f"{like} does not: {points[-1].reason}")
        found = monitored(
            points[: len(jobs)],
            baseline=healthy,
            covariates=None if covariates is None else [name.strip() for name in covariates.split(",") if name.strip()],
            degree=degree,
            rate=false_alarms,
            direction=points[-1] if like else None,
            over=over,
        )
        text = json_text(monitor_summary(found))
        keep(folder, found, FILES, [text, columns_text(monitor_columns(found))])
    json, why = text if format == "json" else None, "to keep numbers, figures and a page over time"
    tell(found, print_monitor, out=out, names=FILES, json=json, why=why)


def _slice(text: str) -> slice:
    """A range of records, 0:30."""
    first, colon, end = text.partition(":")
    try:
        return (
            slice(int(first) if first.strip() else None, int(end) if end.strip() else None)
            if colon
            else slice(0, int(first))
        )
    except ValueError:
        must = "be a range of records, counted from 0"
        raise wrong_value("--baseline", OF, must, text, "Such as 0:30 for the first thirty.") from None


def print_monitor(console: Console, found: Monitor) -> None:
    """Print what was found, the records with alarms or something to say of them, and the last ones."""
    rows = record_rows(found)
    shown = [k for k in range(len(rows)) if found.alarm[k] or found.reasons[k] or k >= len(rows) - MOST]
    if len(shown) > 2 * MOST:
        shown = [*shown[:MOST], *shown[-MOST:]]
    console.print(f"{counted(len(rows), 'record')}.")
    print_title(console, "Records")
    names = record_heads(found)
    table = new_table([], names[:1], []) if not rows else new_table(names[:2], names[2:-1], names[-1:])
    for k in shown:
        table.add_row(*rows[k])
    print_whole(console, table)
    if found.charts is not None:
        console.print(CHARTED, style="dim")
    if len(shown) < len(rows):
        console.print(f"{len(rows) - len(shown)} more in monitor.csv (--out).", style="dim")
    console.print()
    for sentence in sentences(found):
        console.print(sentence)
    print_warnings(console, found.warnings)
