"""`floquid identify`: from files to exponents, shapes and A(t); `floquid report`: the page of a saved result again."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from floquid._bar import bar
from floquid._checks import input_error
from floquid.cli._errors import CriteriaNotMetError
from floquid.cli.arguments.options import Damping, ModelOptions, RecordOptions, ShaftSpeed, choices_of, given
from floquid.cli.arguments.records import check_files, read_records
from floquid.cli.arguments.shared import (
    OUTPUT,
    RESULT,
    Flag,
    Format,
    OutputFolder,
    RecordFiles,
    Saved,
    SettingsFile,
    Verbose,
)
from floquid.cli.output.folder import NAMES, draw_result, in_memory, maybe_folder, result_file, write_result
from floquid.cli.output.printed import print_analysis
from floquid.cli.output.terminal import json_text, print_files, print_folder, progress, terminal
from floquid.errors import IdentificationError
from floquid.exports import summary
from floquid.findings import texts
from floquid.large import LargeResult, identify_large
from floquid.pipeline import identify as identify_records
from floquid.preparation import for_command
from floquid.readers import read
from floquid.reporting import report as write_report
from floquid.search import SECONDS
from floquid.store import load

OF = "floquid identify"
STAGES = 10


def identify(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    model: ModelOptions | None = None,
    enforce: Annotated[bool, Flag, Parameter(group="Checks")] = False,
    out: OutputFolder = None,
    figures: Annotated[bool, Flag, Parameter(group=OUTPUT)] = False,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
    verbose: Verbose = False,
    speed_unit: ShaftSpeed = "hz",
    damping_unit: Damping = "percent",
    memory: Annotated[str | None, Parameter(group="Large records")] = None,
) -> None:
    """Identify the Floquet exponents, the periodic mode shapes and A(t) from measured responses.

    Free responses, unless --inputs names what drove the system, or --excitation ambient says that nobody measured it.

    Parameters
    ----------
    record, model
        The fields of `Settings`.
    enforce
        End with exit code 3 and the reasons where the model does not pass its checks; the result is written all the
        same. A model that fails, since it leaves many times the noise, or since what was found makes it wrong, ends
        with exit code 1 in any case, and so does one without the A(t) that was asked for.
    out
        A folder for result.h5, summary.json and settings.toml, which are written before anything is printed; then for
        report.html, a page for the browser.
    figures
        Draw the figures of the page into OUT/figures, too, as files for a paper; they take longer than the page.
    format
        text prints tables; json prints summary.json alone.
    verbose
        Print the reasons too: the noise of each channel, why the order is what it is, what the columns are.
    memory
        Identify a free decay that is larger than memory within that much, such as 1GB. The .h5 or .npy file is read
        two or three times in blocks. Exponents and residues go to OUT/result.h5. Checks look at a part of it. There are
        no A(t), gaps and tachometers.
    """
    check_files(files, OF)
    if memory is not None:
        more = {"figures": figures or None, "settings": settings}
        more = {name: value for name, value in more.items() if value is not None}
        chosen = {**given(record, OF), **given(model, OF), **more}
        identify_in_blocks(files, chosen, memory, out, format, OF, enforce=enforce)
        return
    choices = choices_of(settings).with_given(**given(record, OF), **given(model, OF))
    if enforce and not choices.settings.validate:
        remedy = "Leave out --no-validate, and `validate = false` in the settings."
        raise input_error("--enforce", OF, "come with the checks of the model", "they are switched off", remedy)
    if figures and out is None:
        raise input_error("--figures", OF, "come with --out", "no folder was named", "Add `--out DIR`.")
    stages, mark = STAGES + (1 if out else 0) + (3 if choices.settings.structure else 0), ""
    with maybe_folder(out, NAMES) as folder, progress(stages) as report:
        records, choices = read_records(files, choices, OF, report)
        analysis = identify_records(records, choices.resolved(), report=report)
        if folder is not None:
            mark = write_result(folder, analysis, choices.text(), report)
    if format == "json":
        sys.stdout.write(json_text(summary(analysis)))
        sys.stdout.flush()
    else:
        print_analysis(analysis, verbose=verbose, speed_unit=speed_unit, damping_unit=damping_unit)
        if not verbose:
            hint = "`floquid identify --verbose` explains the columns and gives all reasons in full."
            terminal().print(hint, style="dim")
    if out is not None:
        with progress(2 + figures) as report:
            draw_result(out, analysis, mark, report, figures=figures, speed_unit=speed_unit, damping_unit=damping_unit)
    if format == "text":
        print_folder(out, figures=figures)
    if analysis.failed:
        raise IdentificationError(analysis.warnings[0])
    if analysis.settings.states and analysis.state is None:
        raise IdentificationError(*texts([own for own in analysis.findings if own.code == "states_unfit"]))
    if enforce and not analysis.passed:
        unmet = () if analysis.validation is None else analysis.validation.unmet
        raise CriteriaNotMetError("\n  ".join(["The model does not pass its checks.", *(analysis.reasons or unmet)]))


def report(
    result: Saved,
    *,
    out: OutputFolder = None,
    title: str | None = None,
    brief: Annotated[bool, Flag] = False,
    speed_unit: ShaftSpeed = "hz",
    damping_unit: Damping = "percent",
) -> None:
    """Write the report of a saved result: one HTML page that opens in any browser, without a network.

    It may be that of modes fitted to transfer functions, as `floquid transfer --method fit --out g.h5` writes it.

    Parameters
    ----------
    out
        The page, ending in .html; report.html beside the result when not given, and brief.html with --brief.
    title
        The heading of the page; the names of the records when not given.
    brief
        One page to print: the modes, the verdict with its reasons, one picture of the fit, the record, the settings.
    """
    file = result_file(result)
    page = file.parent / ("brief.html" if brief else "report.html") if out is None else out
    with progress(3) as stage:
        stage("reading the result")
        write_report(
            in_memory(load(file), "floquid report"),
            page,
            title=title,
            brief=brief,
            speed_unit=speed_unit,
            damping_unit=damping_unit,
            progress=stage,
        )
    terminal().print(f"Written: {page}", soft_wrap=True)


TAKEN = ("period", "rate", "origin", "channels", "order", "mode_false_alarm", "seconds")


def identify_in_blocks(
    files: Sequence[Path],
    options: Mapping[str, Any],
    memory: str,
    out: Path | None,
    format_: str,
    of: str,
    *,
    enforce: bool,
) -> None:
    """Identify one record within a memory, write the result into a folder, and print it.

    As `identify` ends in an error where a model fails, so does this, and with `enforce` where it does not pass.
    """
    if len(files) != 1:
        raise input_error("FILES", of, "be one file with --memory", f"are {len(files)}", "Give one.")
    if out is None:
        must = "come with --out"
        raise input_error("--memory", of, must, "no folder was named", "Residues stay there: add `--out DIR`.")
    others = [name for name in options if name not in TAKEN]
    if others:
        must, got = "stand alone with --memory", "is given with it"
        taken = ", ".join(f"--{name}".replace("_", "-") for name in TAKEN)
        remedy = f"It takes {taken}. Others need a record in memory."
        raise input_error(f"--{others[0].replace('_', '-')}", of, must, got, remedy)
    if (out / "summary.json").exists():
        got = f"{out} holds the result of a record in memory"
        raise input_error("--out", of, "be a folder of its own with --memory", got, "Name another folder.")
    said = [options.get(name) for name in ("period", "rate", "channels")]
    record = read(
        files[0], lazy=True, period=said[0], rate=said[1], channels=said[2], origin=options.get("origin", 0.0)
    )
    out.mkdir(parents=True, exist_ok=True)
    with bar(True) as report:
        found = identify_large(
            record,
            out / RESULT,
            memory=memory,
            order=options.get("order"),
            false_alarm=options.get("mode_false_alarm", 1e-9),
            seconds=options.get("seconds", SECONDS),
            report=report,
        )
    if format_ == "json":
        sys.stdout.write(json_text(_summary(found)))
        sys.stdout.flush()
    else:
        terminal().print(for_command(found.summary()), soft_wrap=True, highlight=False)
        print_files(out, (RESULT,), "to keep the result")
        text = "`fq.load` reads it in Python; `floquid compare`, `survey` and `shapes` take it, too."
        terminal().print(text, style="dim")
    if found.failed:
        raise IdentificationError(found.reasons[0])
    if enforce and not found.passed:
        raise CriteriaNotMetError("\n  ".join(["The model does not pass its checks.", *found.reasons]))


def _summary(found: LargeResult) -> dict[str, Any]:
    """The result as `summary.json` has that of a record in memory, as far as there is one."""
    modes = [
        {
            "exponent": [value.real, value.imag],
            "exponent_std": [std.real, std.imag],
            "multiplier": [multiplier.real, multiplier.imag],
            "kind": "pair" if not real else "real" if multiplier.real > 0 else "negative",
        }
        for value, std, multiplier, real in zip(
            found.exponents, found.exponent_std, found.multipliers, found.real, strict=True
        )
    ]
    channels, periods = found.part
    checked = {"passed": found.passed, "reasons": found.reasons, "channels": channels, "periods": periods}
    size = {"period": found.period, "n_cycles": found.n_cycles, "n_phases": found.n_phases, "sweeps": found.sweeps}
    return {"format": "floquid-large/1", **size, "modes": modes, "system": None, "validation": checked}
