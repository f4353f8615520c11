"""`floquid survey`: modes over a speed, from records or from results at several of them."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from floquid._bar import bar
from floquid._checks import counted, input_error
from floquid.cli.arguments.options import ModelOptions, RecordOptions, choices_of, given
from floquid.cli.arguments.points import OF, jobs_of, points_of
from floquid.cli.arguments.shared import (
    OUTPUT,
    Format,
    OutputFolder,
    PointTable,
    SettingsFile,
    SurveyFiles,
    Whole,
    Workers,
)
from floquid.cli.commands.shapes import ShapeChoices
from floquid.cli.output.folder import keep, maybe_folder, refuse_beside_identified, tell
from floquid.cli.output.terminal import json_text, new_table, print_title, print_warnings, print_whole
from floquid.errors import IdentificationError
from floquid.exports import columns_text, edge_columns, survey_columns, survey_summary
from floquid.surveys import Survey, edge_words, point_rows, track_rows
from floquid.surveys import survey as survey_points
from floquid.views import over_label, over_unit

FILES = (
    "survey.h5", "survey.json", "survey.csv", "edges.csv", "survey.parquet", "report.html", "figures/campbell.png",
    "figures/damping.png", "figures/multipliers.png",
)  # fmt: skip
MOST = 6  # notes that are printed


def survey(
    *files: SurveyFiles,
    over: str = "speed_rpm",
    table: PointTable = None,
    read: ShapeChoices | None = None,
    record: RecordOptions | None = None,
    model: ModelOptions | None = None,
    gap: Whole = 2,
    confidence: float = 0.95,
    workers: Workers = None,
    damping: Annotated[Literal["decay", "ratio", "decrement"], Parameter(group=OUTPUT)] = "decay",
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
) -> None:
    """Follow modes over a speed, or another operating point, and find where they turn unstable.

    Records are identified first. Those of one operating point are hits. One that fails is a point without a result.

    Parameters
    ----------
    over
        The quantity of the operating point: speed_rpm, temperature, wind_m_s, ... It comes from --table, from single
        numbers in the files, from --point, or, of speed_rpm, from the period.
    read
        How shapes are read: modes have a whirl with pairs, names and frequencies in the fixed frame with blades.
    gap
        How many points a mode may be missing at.
    confidence
        The probability that the interval of an edge holds it.
    damping
        What the figure of damping shows: Re λ, the ratio ζ, or the logarithmic decrement δ.
    out
        A folder for survey.h5, survey.json, survey.csv and edges.csv, and survey.parquet where pyarrow is installed;
        then for figures/ and report.html, a page for the browser.
    format
        text prints tables; json prints survey.json alone.
    """
    if not files and table is None:
        example = "For example: floquid survey *.npz --over speed_rpm --out survey"
        raise input_error("FILES", OF, "name records or results", "none was given", example)
    refuse_beside_identified(out, OF)
    choices = choices_of(settings).with_given(**given(record, OF), **given(model, OF))
    with maybe_folder(out, FILES) as folder:
        with bar(True) as report:
            shapes = (read or ShapeChoices()).options(OF)
            points = points_of(jobs_of(files, choices, over, table, shapes), workers, report)
            found = replace(_surveyed(points, over, gap, confidence), shapes=shapes)
        text, columns = json_text(survey_summary(found)), survey_columns(found)
        if folder is not None and find_spec("pyarrow"):
            import pyarrow as pa
            from pyarrow.parquet import write_table

            write_table(pa.table(columns), folder.unfinished / FILES[4])
        keep(folder, found, FILES, [text, columns_text(columns), columns_text(edge_columns(found))])
    json, why = text if format == "json" else None, "to keep the survey, the figures and a page"
    page = {"damping_unit": "decrement" if damping == "decrement" else "percent"}
    tell(
        found, print_survey, out=out, names=FILES, json=json, why=why, options={"damping": {"unit": damping}}, page=page
    )
    if all(point.model is None for point in found.points):
        raise IdentificationError(f"No point has a result. The first: {found.points[0].reason}")


def _surveyed(points: list, over: str, gap: int, confidence: float) -> Survey:
    """The survey; a file without a result that says no operating point is told, and has no place in it."""
    lost = [point for point in points if point.model is None and over not in point.values]
    if len(lost) == len(points):
        got = f"{', '.join(lost[0].files)} does not: {(lost[0].reason or '').rstrip('.')}"
        raise input_error("FILES", OF, "hold a record or a result", got)
    found = survey_points([point for point in points if point not in lost], over=over, gap=gap, confidence=confidence)
    words = [f"{', '.join(point.files)} is left out: {point.reason}" for point in lost]
    return replace(found, warnings=(*words, *found.warnings))


def print_survey(console: Console, found: Survey) -> None:
    """Print the modes, the edges, and what a reader must know."""
    words, unit = over_unit(found.over)
    values, lost = found.values, sum(point.model is None for point in found.points)
    missing = f"; {lost} without a result" if lost else ""
    ends = " to ".join(dict.fromkeys(f"{value:g}" for value in values[[0, -1]]))
    console.print(f"{counted(len(values), 'point')}, {words} {ends} {unit}".rstrip() + f"{missing}.")
    if not found.tracks and lost < len(values):
        print_title(console, "Modes at each point")
        table = new_table([over_label(found.over)], ["f [Hz]", "Re λ [1/s]"])
        for row in point_rows(found):
            table.add_row(*row)
        print_whole(console, table)
    elif found.tracks:
        print_title(console, f"Modes over {words}")
        whirl = ["whirl, first … last"] if found.shapes.pairs else []
        numbers = ["points", "f [Hz], first … last", "Re λ [1/s], least … most", *whirl]
        table = new_table([""], numbers, ["locked", "unstable"])
        for row in track_rows(found):
            table.add_row(*row)
        print_whole(console, table)
        brackets = "In brackets: one standard deviation, in the last digits."
        marks = "Locked, unstable: points at which two real multipliers stand for a pair, and at which Re λ is above 0."
        console.print(f"{brackets} {marks}", style="dim")
        if whirl:
            console.print("Whirl: 1 is a forward circle, 0 a straight line, -1 a backward circle.", style="dim")
        _print_edges(console, found)
    for note in found.notes[:MOST]:
        console.print(f"{note[0].upper()}{note[1:]}")
    if len(found.notes) > MOST:
        console.print(f"… and {len(found.notes) - MOST} more.", style="dim")
    print_warnings(console, found.warnings)


def _print_edges(console: Console, found: Survey) -> None:
    if not found.edges:
        console.print("No mode turns unstable or stable between two points.")
        return
    print_title(console, "Edges of instability")
    table = new_table([], [over_label(found.over), f"{100.0 * found.confidence:g} % interval"], ["", "of"])
    for edge in found.edges:
        table.add_row(*edge_words(found, edge))
    print_whole(console, table)
