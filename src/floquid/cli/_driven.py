"""Records whose excitation goes on: `floquid identify --inputs` and `--excitation ambient`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from rich.console import Console

from floquid.cli._errors import CriteriaNotMetError
from floquid.cli._folder import RESULT, ResultFolder
from floquid.cli._settings import Choices
from floquid.cli._terminal import (
    DEVIATIONS,
    counted,
    json_text,
    print_lines,
    print_modes,
    print_title,
    print_warnings,
    terminal,
)
from floquid.core import Record
from floquid.exports import driven_summary, transfer_rows
from floquid.pipeline import ExcitedAnalysis, identify_ambient, identify_driven
from floquid.store import save
from floquid.views import excited_lines, mode_table, note_meanings

STAGES = 6


def excited(
    records: Sequence[Record],
    choices: Choices,
    folder: ResultFolder | None,
    report: Callable[[str], None],
    *,
    as_json: bool,
    enforce: bool,
) -> None:
    """Identify records whose excitation goes on, print the result, and write it into the folder, if there is one."""
    analysis = identified(records, choices, report)
    if folder is not None:
        from floquid.plot import save_figure
        from floquid.reporting import report as write_report

        save(analysis, folder.unfinished / RESULT)
        folder.write("summary.json", json_text(driven_summary(analysis)))
        folder.write("settings.toml", choices.text())
        if analysis.inputs:
            folder.write("transfer.csv", transfer_rows(analysis.transfer()))
        (folder.unfinished / "figures").mkdir()
        for name in dir(analysis.plot):
            save_figure(getattr(analysis.plot, name)(), folder.unfinished / "figures" / f"{name}.png")
        write_report(analysis, folder.unfinished / "report.html", progress=report)
        folder.publish()
    if as_json:
        sys.stdout.write(json_text(driven_summary(analysis)))
    else:
        print_excited(terminal(), analysis)
    if enforce and not analysis.passed:
        raise CriteriaNotMetError("\n  ".join(["The model does not pass its checks.", *analysis.warnings]))


def identified(records: Sequence[Record], choices: Choices, report: Callable[[str], None]) -> ExcitedAnalysis:
    """The result of the chain that the settings ask for."""
    settings = choices.resolved()
    if settings.excitation == "ambient":
        return identify_ambient(records, settings, report=report)
    return identify_driven(records, settings, report=report)


def print_excited(console: Console, analysis: ExcitedAnalysis) -> None:
    """Print the record, the modes, a line for each other finding, and the warnings."""
    first, model = analysis.records[0], analysis.model
    periods = sum(record.duration for record in analysis.records) / model.period
    inputs = f"{counted(len(analysis.inputs), 'input')} and " if analysis.inputs else ""
    console.print(
        f"{counted(len(analysis.records), 'record')}, {inputs}{counted(len(model.channels), 'output')} at "
        f"{first.sample_rate:.8g} Hz; ω = {model.fundamental:.6g} rad/s, {periods:.6g} periods in all."
    )
    print_title(console, f"Modes: order {model.order}, conjugates counted one by one")
    print_modes(console, analysis)
    meanings = note_meanings(mode_table(analysis))
    console.print("; ".join([f"±: a conjugate pair; {DEVIATIONS}", *meanings]) + ".", style="dim")
    console.print()
    print_lines(console, excited_lines(analysis))
    print_warnings(console, analysis.warnings)
