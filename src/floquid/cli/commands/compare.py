"""`floquid compare`: two sets of modes against one another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from rich.console import Console

from floquid._checks import counted
from floquid.cli.arguments.shared import Format, OutputFolder
from floquid.cli.commands.shapes import scales_of
from floquid.cli.output.folder import keep, maybe_folder, refuse_beside_identified, settle, tell
from floquid.cli.output.terminal import json_text, new_table, print_warnings, print_whole
from floquid.comparison import Comparison, Updated, headings, missing_words, pair_row, update_words, verdict
from floquid.comparison import compare as compare_sides
from floquid.errors import InputError
from floquid.exports import columns_text, comparison_columns, comparison_summary
from floquid.views import with_error

OF = "floquid compare"
FILES = ("comparison.h5", "comparison.json", "comparison.csv", "report.html", "figures/comparison.png")
MOST = 40  # rows and sentences that are printed of a survey


def compare(
    a: str,
    b: str,
    /,
    *,
    scale: Annotated[list[str] | None, Parameter(negative=())] = None,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
) -> None:
    """Compare two sets of modes, mode by mode: differences with deviations, what is missing, and χ² of all.

    Parameters of a model of your own are fitted to results in Python: floquid.update.

    Parameters
    ----------
    a
        A result of floquid identify or floquid survey, the file or its folder; a file with A(t), and C(t); a folder of
        .lin files, or of such folders; or an example system with numbers, systems:jeffcott,support_y=2.1
    b
        What it is held against, one of the same; differences are a less b.
    scale
        What takes a channel of b to the unit of a, name=1000; may be given several times.
    out
        A folder for comparison.h5, comparison.json, comparison.csv; then for figures/ and report.html, a page for the
        browser.
    format
        text prints a table; json prints comparison.json alone.
    """
    refuse_beside_identified(out, OF)
    for place in (Path(a), Path(b)):
        if place.exists():
            settle(place if place.is_dir() else place.parent)
    try:
        found = compare_sides(a, b, scale=scales_of(scale or (), OF))
    except InputError as error:
        raise InputError(_as_typed(str(error))) from None
    text = json_text(comparison_summary(found))
    with maybe_folder(out, FILES) as folder:
        keep(folder, found, FILES, [text, columns_text(comparison_columns(found))])
    json, why = text if format == "json" else None, "to keep the table, a figure and a page"
    tell(found, print_comparison, out=out, names=FILES, json=json, why=why)


def _as_typed(message: str) -> str:
    """A message on an argument of `compare` in the words of the command."""
    for argument, word in (("a", "A"), ("b", "B"), ("scale", "--scale")):
        message = message.replace(f"Argument `{argument}` of `compare`", f"`{word}`")
    return message


def print_comparison(console: Console, found: Comparison) -> None:
    """Print the pairs, what is missing, and how likely all differences are."""
    console.print(f"a: {found.a}   b: {found.b}   differences: a less b", soft_wrap=True)
    over = f"; {counted(len(found.points), 'point')}" if found.over else ""
    console.print(f"{counted(len(found.pairs), 'pair')} of modes{over}")
    names: Sequence[str] = headings(found)
    left = 3 if found.over else 2
    table = new_table([], names[:-1], names[-1:])
    for column in table.columns[:left]:
        column.justify = "left"
    for pair in found.pairs[:MOST]:
        table.add_row(*pair_row(found, pair))
    print_whole(console, table)
    if len(found.pairs) > MOST:
        console.print(f"… and {len(found.pairs) - MOST} more: `--out DIR` keeps all.", style="dim")
    deviations = "" if all(pair.std == 0 for pair in found.pairs) else "in brackets: one deviation of both together; "
    mac = "mac: similarity of the shapes in channels that both have, with phase zero of b moved to that of a."
    console.print(f"{deviations}z: the difference of λ over its deviation; {mac}", style="dim")
    missing = missing_words(found)
    for sentence in missing[:MOST]:
        console.print(sentence)
    if len(missing) > MOST:
        console.print(f"… and {len(missing) - MOST} more are missing: `--out DIR` lists all.", style="dim")
    console.print(verdict(found))
    print_warnings(console, found.warnings)


def print_updated(console: Console, found: Updated) -> None:
    """Print the parameters, what is not determined, and how well the model fits."""
    table = new_table(["parameter"], ["start", "value", "change [%]"])
    for name, value in found.values.items():
        start, std = found.start[name], found.std[name]
        if np.isnan(value):
            table.add_row(name, f"{start:g}", "not determined", "")
            continue
        change = f"{100.0 * (value / start - 1.0):+.3g}" if start else ""
        table.add_row(name, f"{start:g}", with_error(value, std), change)
    print_whole(console, table)
    console.print("in brackets: one standard deviation, in the last digits.", style="dim")
    for sentence in update_words(found):
        console.print(sentence)
    print_warnings(console, found.warnings)
