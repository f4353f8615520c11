"""Records whose excitation goes on: `floquid identify --inputs`, `--excitation ambient` and `floquid transfer`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from floquid._checks import input_error
from floquid.cli._errors import CriteriaNotMetError
from floquid.cli._folder import RESULT, ResultFolder
from floquid.cli._options import Debug, Format, RecordFiles, RecordOptions, SettingsFile, given, split
from floquid.cli._records import check_files, read_records
from floquid.cli._settings import Choices, choices_of
from floquid.cli._terminal import (
    DEVIATIONS,
    counted,
    json_text,
    print_lines,
    print_modes,
    print_title,
    print_warnings,
    progress,
    terminal,
)
from floquid.core import Record
from floquid.exports import driven_summary, transfer_entries, transfer_rows
from floquid.inputs import TransferFunctions
from floquid.pipeline import ExcitedAnalysis, identify_ambient, identify_driven
from floquid.store import save
from floquid.views import excited_lines, mode_table, note_meanings

OF = "floquid transfer"
STAGES = 6
SHOWN = 12  # frequencies that are printed
POINTS = 200

_AT = "Frequencies [Hz]: one, several with commas, or first:last:number. By default up to beyond the highest mode."
_HARMONICS = "Harmonics m, with commas: the response at the input's frequency plus m times the fundamental."


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
    analysis = _identified(records, choices, report)
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


def _identified(records: Sequence[Record], choices: Choices, report: Callable[[str], None]) -> ExcitedAnalysis:
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


def transfer(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    at: Annotated[str, Parameter(help=_AT)] = "",
    harmonics: Annotated[str, Parameter(help=_HARMONICS)] = "-1,0,1",
    out: Annotated[Path | None, Parameter(help="A table (.csv), or a picture (.png, .pdf, .svg).")] = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
    debug: Debug = False,
) -> None:
    """Harmonic transfer functions from measured inputs to the other channels, with their deviations.

    Parameters
    ----------
    files
        Records of the responses and of what drives them, of any format that is read.
    record
        The fields of `Settings`.
    format
        text prints a table; json prints all frequencies.
    settings
        A settings.toml written by an earlier run; options given here come first.
    """
    del debug
    check_files(files, OF)
    choices = choices_of(settings).with_given(**given(record, OF))
    if not choices.settings.inputs:
        raise input_error("--inputs", OF, "name the channels that drive the system", "is not given", "As --inputs F.")
    turns = _whole(harmonics)
    with progress(STAGES) as report:
        records, choices = read_records(files, choices, OF, report)
        analysis = _identified(records, choices, report)
        found = analysis.transfer(_frequencies(at), turns)
        if out is not None:
            _write(found, out)
    if format == "json":
        sys.stdout.write(json_text(transfer_entries(found)))
        return
    print_transfer(terminal(), found)
    print_warnings(terminal(), analysis.warnings)
    if out is not None:
        terminal().print(f"Written: {out}", soft_wrap=True)


def print_transfer(console: Console, found: TransferFunctions) -> None:
    """Print magnitude and phase of each harmonic at a few frequencies, for every input and output."""
    from floquid.views import with_error

    places = np.unique(np.linspace(0, len(found.frequencies_hz) - 1, min(SHOWN, len(found.frequencies_hz))).astype(int))
    for row, output in enumerate(found.outputs):
        for column, source in enumerate(found.inputs):
            print_title(console, f"{source.name} to {output.name} [{output.unit}/{source.unit}]: |G_m|, arg [°]")
            table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
            for name in ("f [Hz]", *(f"m = {harmonic}" for harmonic in found.harmonics.tolist())):
                table.add_column(name, justify="right", no_wrap=True)
            for place in places:
                values = found.values[:, row, column, place]
                std = np.zeros(len(values)) if found.std is None else np.abs(found.std[:, row, column, place]) / 2**0.5
                cells = [
                    f"{with_error(abs(value), error)}, {np.degrees(np.angle(value)):.0f}"
                    for value, error in zip(values, std, strict=True)
                ]
                table.add_row(f"{found.frequencies_hz[place]:.5g}", *cells)
            console.print(table)
    console.print("Response at f + m/T to an input at f; digits in brackets are one standard deviation.", style="dim")


def _write(found: TransferFunctions, out: Path) -> None:
    """Write transfer functions as a table, or as a picture."""
    if out.suffix.lower() == ".csv":
        out.write_text(transfer_rows(found), encoding="utf-8")
        return
    from floquid.plot import save_figure
    from floquid.plot import transfer as drawn

    save_figure(drawn(found), out)


def _whole(text: str) -> list[int]:
    """Whole numbers of a comma-separated list."""
    try:
        return [int(word) for word in split(text)]
    except ValueError:
        raise input_error("--harmonics", OF, "be whole numbers with commas", f"is {text!r}", "As -1,0,1.") from None


def _frequencies(text: str) -> list[float] | None:
    """Frequencies [Hz] of a list or a range; None where none are named."""
    if not text.strip():
        return None
    try:
        if ":" in text:
            first, last, number = text.split(":")
            return np.linspace(float(first), float(last), int(number)).tolist()
        return [float(word) for word in split(text)]
    except ValueError:
        must = "be frequencies with commas, or first:last:number"
        raise input_error("--at", OF, must, f"is {text!r}", "As 0.1:2:200.") from None
