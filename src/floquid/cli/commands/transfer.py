"""`floquid transfer`: harmonic transfer functions, in other coordinates too."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from floquid._arrays import Integers, Mask
from floquid._checks import counted, input_error, wrong_value
from floquid._json import for_json
from floquid.cli.arguments.options import Choices, RecordOptions, choices_of, given
from floquid.cli.arguments.records import check_files, read_records
from floquid.cli.arguments.shared import Flag, Format, OptionalWhole, RecordFiles, SettingsFile, Whole, is_saved, split
from floquid.cli.output.folder import identified_in, refuse_beside_result
from floquid.cli.output.terminal import json_text, print_title, print_warnings, progress, terminal
from floquid.core import Record, channels_named
from floquid.errors import IdentificationError, InputError
from floquid.exports import export_transfer, fit_entries, import_transfer, measured_entries, transfer_entries
from floquid.findings import Finding, Severity, as_mapping, texts
from floquid.inputs import TransferFunctions
from floquid.pipeline import Analysis, measure_transfer
from floquid.pipeline import identify as identify_records
from floquid.reporting import ENDINGS
from floquid.reporting import report as write_report
from floquid.store import load, save
from floquid.transfer import CURVATURE, MeasuredTransfer, TransferFit, fit_transfer
from floquid.views import impedance as inverse_of
from floquid.views import to_alpha_beta, to_dq, to_sequence, with_error

OF = "floquid transfer"
STAGES = 6
SHOWN = 12  # frequencies that are printed

Method: TypeAlias = Literal["model", "repeats", "polynomials", "chirps", "fit"]
Frame: TypeAlias = Literal["dq", "alpha-beta", "sequence"]
Picture: TypeAlias = Literal["bode", "nyquist"]
FrequencyAxis: TypeAlias = Literal["linear", "log"]

_AT = "Frequencies [Hz]: one, several with commas, or first:last:number. By default all that the method has."
_HARMONICS = "Harmonics m, with commas: the response at the input's frequency plus m times the fundamental."
_METHOD = (
    "model: from the modes identified. repeats: line by line, from inputs that repeat (floquid multisine), or a scan "
    "of sines, a file for each. polynomials: line by line, from any broad-band inputs. chirps: from chirps at "
    "different phases of the period, from rest to rest, a file for each; smoothed, without deviations. fit: from modes "
    "fitted to such lines."
)
_ENDINGS = r"\.(csv|mat|s\d+p|png|pdf|svg|h5|html?)"
_LINES = (
    "Instead of records, for --method fit: measured transfer functions with their deviations, .csv, .mat or .h5 as "
    "--out writes them."
)
_REPEAT = "Periods of the system in a repeat of the inputs, by default found from them."
_FRAME = "Coordinates of three-phase quantities: turning once a period, at rest, or symmetrical components."
_PHASES = (
    "The channels of a three-phase quantity with commas, a, b, c or alpha, beta: once for the outputs and once for the "
    "inputs, as --phases i_a,i_b,i_c --phases u_a,u_b,u_c."
)
_IMPEDANCE = "The inverse: from the outputs to the inputs, as impedances of admittances. In dq that of m = 0."
_CURVATURE = "The weight of the curvature, with --method chirps: more of it averages more noise, and flattens more."
_DROP = "First repeats of each record that are left out, until the transient has died."
_REFERENCE = (
    "Reference signals without the noise, one for each input, with commas: for a closed loop or noisy inputs, with "
    "polynomials or fit."
)


def transfer(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    method: Annotated[Method, Parameter(help=_METHOD)] = "model",
    at: Annotated[str, Parameter(help=_AT)] = "",
    harmonics: Annotated[str, Parameter(help=_HARMONICS, allow_leading_hyphen=True)] = "-1,0,1",
    lines: Annotated[Path | None, Parameter(help=_LINES)] = None,
    repeat: Annotated[OptionalWhole, Parameter(help=_REPEAT)] = None,
    drop: Annotated[Whole, Parameter(help=_DROP)] = 1,
    reference: Annotated[str, Parameter(help=_REFERENCE)] = "",
    curvature: Annotated[float, Parameter(help=_CURVATURE)] = CURVATURE,
    frame: Annotated[Frame | None, Parameter(help=_FRAME)] = None,
    phases: Annotated[tuple[str, ...], Parameter(help=_PHASES)] = (),
    impedance: Annotated[bool, Flag, Parameter(help=_IMPEDANCE)] = False,
    plot: Annotated[Picture, Parameter(help="The picture: magnitude and phase, or the complex plane.")] = "bode",
    frequency_axis: Annotated[FrequencyAxis, Parameter(help="The axis of frequencies in the picture.")] = "linear",
    out: Annotated[
        Path | None,
        Parameter(
            help="A table (.csv, .mat, .sNp for one harmonic of N paths), a picture (.png, .pdf, .svg), the whole "
            "result (.h5), or a page of modes (.html)."
        ),
    ] = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
) -> None:
    """Harmonic transfer functions from measured inputs to the other channels, with their deviations.

    Parameters
    ----------
    files
        Records of the responses and of what drives them, of any format that is read; or the result.h5 or the folder
        of an identification with --inputs, whose model is taken.
    record
        The fields of `Settings`.
    format
        text prints a table; json prints all frequencies.
    """
    said, saved = given(record, OF), is_saved(files)
    choices = choices_of(settings).with_given(**said)
    if saved:
        refuse_beside_result(said, OF)
    _check_given(files, choices.settings.inputs, lines, method, out, saved=saved)
    turns, hertz, references = _whole(harmonics), _frequencies(at), split(reference)
    if method == "model":
        _refuse_with_a_model(reference, repeat, curvature)
    if method == "repeats" and hertz is not None:
        must = "not be given with --method repeats"
        raise wrong_value("--at", OF, must, at, "Leave it out: the lines are those of the inputs.")
    with progress(STAGES) as report:
        records = []
        if lines is None and not saved:
            records, choices = _read(files, choices, references, report)
        chosen = choices.resolved()
        if lines is not None:
            result = fit_transfer(_measured_in(lines), period=chosen.period, hold=chosen.hold, report=report)
            found, findings, more = result.transfer(hertz, turns), result.findings, fit_entries(result)
        elif method == "model":
            result: Any = identified_in(files[0], OF) if saved else identify_records(records, chosen, report=report)
            found, findings, more = result.transfer(hertz, turns), result.findings, {}
        else:
            # Of a fit all lines are measured, and G is asked of the modes at the frequencies named.
            way, wanted = (None, None) if method == "fit" else (method, hertz)
            result = measured = measure_transfer(
                records,
                chosen,
                method=way,
                harmonics=turns,
                frequencies_hz=wanted,
                repeat=repeat,
                drop=drop,
                reference=references,
                curvature=curvature,
                report=report,
            )
            found, findings, more = measured.transfer, measured.findings, measured_entries(measured)
            if method == "fit":
                result = fit = fit_transfer(measured, hold=chosen.hold, report=report)
                found, findings, more = fit.transfer(hertz, turns), (*findings, *fit.findings), more | fit_entries(fit)
        asked = (frame, [list(split(own)) for own in phases], impedance)
        found = _changed(result, found, (hertz, turns), asked)
        if out is not None:
            _write(found, result, out, plot, frequency_axis)
    if format == "json":
        sys.stdout.write(json_text(transfer_entries(found) | {"method": method} | more | _told(findings)))
    else:
        _print(found, findings, more, out)
    failed = texts(findings, Severity.FAILURE)
    if failed:
        raise IdentificationError(failed[0])


def _changed(
    result: Any,
    found: TransferFunctions,
    at: tuple[list[float] | None, list[int]],
    asked: tuple[Frame | None, list[list[str]], bool],
) -> TransferFunctions:
    """Transfer functions in a frame, or inverted, of an analysis at any sideband and else of lines."""
    frame, groups, inverted = asked
    if frame is not None and not groups:
        remedy = "As --phases i_a,i_b,i_c --phases u_a,u_b,u_c."
        raise input_error("--phases", OF, f"name the channels for --frame {frame}", "is not given", remedy)
    if inverted and groups and len(groups) != 2:
        must, got = "come twice with --impedance: outputs, inputs", f"comes {counted(len(groups), 'time')}"
        raise input_error("--phases", OF, must, got, "As --phases i_a,i_b --phases u_a,u_b.")
    of_model = result.kind == "analysis"
    subject: Any = result if of_model else found
    how: dict[str, Any] = {"frequencies_hz": at[0]} if of_model else {"period": result.period}
    if frame == "dq":
        turned: Any = to_dq(subject, *groups, **how, harmonics=0 if inverted else at[1])
        return _inverse(turned, (found, turned), groups, {}) if inverted else turned
    if inverted:
        found = _inverse(subject, (found, found), groups, how | {"harmonics": at[1]})
    return found if frame is None else {"alpha-beta": to_alpha_beta, "sequence": to_sequence}[frame](found, *groups)


def _inverse(
    subject: Any, both: tuple[TransferFunctions, TransferFunctions], groups: list[list[str]], how: dict[str, Any]
) -> TransferFunctions:
    """The inverse between two groups of channels, or all; their names are those of `both`, before and now."""
    named, now = ((own.outputs, own.inputs) for own in both)
    chosen = [[channel.name for channel in side] for side in now]
    if groups:
        rows = [
            channels_named(side, group, argument="--phases", of=OF) for side, group in zip(named, groups, strict=True)
        ]
        chosen = [[names[row] for row in own] for names, own in zip(chosen, rows, strict=True)]
    return inverse_of(subject, chosen[0], chosen[1], **how)


def _told(findings: Sequence[Finding]) -> dict[str, Any]:
    """Findings for JSON: those that matter in words, and all with their numbers."""
    warnings = texts(findings, Severity.FAILURE, Severity.WARNING)
    return for_json({"warnings": list(warnings), "findings": [as_mapping(own) for own in findings]})


def _refuse_with_a_model(reference: str, repeat: int | None, curvature: float) -> None:
    """Refuse what the other methods take and a model of the record does not."""
    for option, value, usual, remedy in (
        ("--reference", reference, "", "Leave it out: `--excitation ambient` with --inputs takes account of a loop."),
        ("--repeat", repeat, None, "It counts for --method repeats or fit."),
        ("--curvature", curvature, CURVATURE, "It counts for --method chirps."),
    ):
        if value != usual:
            raise wrong_value(option, OF, "not be given with --method model", value, remedy)


def _print(found: TransferFunctions, findings: Sequence[Finding], more: dict[str, Any], out: Path | None) -> None:
    """Print G, the exponents where modes were fitted, and what was found."""
    print_transfer(terminal(), found)
    for value, std in zip(more.get("exponents", ()), more.get("exponents_std") or (), strict=True):
        real, imag = (with_error(*part) for part in zip(value, std, strict=True))
        terminal().print(f"λ = {real} + {imag} i")
    for words in texts(findings, Severity.NOTE) if more else ():
        terminal().print(words)
    print_warnings(terminal(), texts(findings, Severity.FAILURE, Severity.WARNING))
    if out is not None:
        terminal().print(f"Written: {out}", soft_wrap=True)


def print_transfer(console: Console, found: TransferFunctions) -> None:
    """Print magnitude and phase of each harmonic at a few frequencies, for every input and output."""
    for row, output in enumerate(found.outputs):
        for column, source in enumerate(found.inputs):
            print_title(console, f"{source.name} to {output.name} [{found.unit(row, column)}]: |G_m|, arg [°]")
            table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
            for name in ("f [Hz]", *(f"m = {harmonic}" for harmonic in found.harmonics.tolist())):
                table.add_column(name, justify="right", no_wrap=True)
            for place in _spread(np.isfinite(found.values[:, row, column].sum(axis=0))):
                values = found.values[:, row, column, place]
                std = np.zeros(len(values)) if found.std is None else np.abs(found.std[:, row, column, place]) / 2**0.5
                cells = [
                    f"{with_error(abs(value), error)}, {np.degrees(np.angle(value)):.0f}"
                    for value, error in zip(values, std, strict=True)
                ]
                table.add_row(f"{found.frequencies_hz[place]:.5g}", *cells)
            console.print(table)
    if found.step is not None:
        console.print(f"G of samples every {found.step:.6g} s: the input between them is in it.", style="dim")
    console.print("Response at f + m/T to an input at f; digits in brackets are one standard deviation.", style="dim")


def _spread(there: Mask) -> Integers:
    """Some places of those that are there, spread over them."""
    places = np.flatnonzero(there)
    return places[np.unique(np.linspace(0, len(places) - 1, min(SHOWN, len(places))).astype(int))]


def _check_given(
    files: tuple[Path, ...],
    inputs: tuple[str, ...] | None,
    lines: Path | None,
    method: str,
    out: Path | None,
    *,
    saved: bool,
) -> None:
    """Refuse records without inputs, lines beside records or for another method than a fit, and pages without modes."""
    if out is not None and not re.fullmatch(_ENDINGS, out.suffix.lower()):
        must = "end in .csv, .mat, .s1p to .s99p, .png, .pdf, .svg, .h5 or .html"
        raise input_error("--out", OF, must, f"is {out}", "The ending says what is written.")
    if method in ("repeats", "polynomials", "chirps") and out is not None and out.suffix.lower() in ENDINGS:
        remedy = "Fit modes to the lines: --method fit."
        raise input_error("--out", OF, f"be no page with --method {method}", f"is {out}", remedy)
    if saved and method != "model":
        remedy = "Give the records: lines are measured in them."
        raise input_error("--method", OF, "be model of a saved result", f"is {method}", remedy)
    if lines is None and not saved:
        check_files(files, OF)
        if not inputs:
            must = "name the channels that drive the system"
            raise input_error("--inputs", OF, must, "is not given", "As --inputs F.")
    elif lines is not None and (files or method != "fit"):
        got = "comes with records" if files else f"comes with --method {method}"
        raise input_error("--lines", OF, "stand in the place of records, with --method fit", got, "Give one of them.")


def _read(
    files: Sequence[Path], choices: Choices, references: tuple[str, ...], report: Callable[[str], None]
) -> tuple[list[Record], Choices]:
    """The records, references among their channels."""
    own = choices.settings.channels
    beside = [name for name in references if own and name not in own]
    try:
        records, choices = read_records(files, choices.with_given(channels=(*own, *beside)), OF, report)
    except InputError as error:
        if not any(f"has {name!r}" in str(error) for name in beside):
            raise
        raise InputError(str(error).replace("`channels` of `read`", f"`--reference` of `{OF}`")) from None
    for record in records:
        channels_named(record.channels, references, argument="--reference", of=OF)
    return records, choices


def _measured_in(file: Path) -> MeasuredTransfer | TransferFunctions:
    """Transfer functions in a table, or in a result that was measured."""
    if file.suffix.lower() != ".h5":
        return import_transfer(file)
    found = load(file)
    if not isinstance(found, MeasuredTransfer):
        remedy = "Write it by --method repeats or polynomials, --out g.h5."
        raise input_error("--lines", OF, "hold transfer functions that were measured", f"is {file}", remedy)
    return found


def _write(
    found: TransferFunctions,
    result: Analysis | MeasuredTransfer | TransferFit,
    out: Path,
    picture: Picture,
    axis: FrequencyAxis,
) -> None:
    """Write transfer functions as a table, as a picture, or with all that they come of."""
    if out.suffix.lower() == ".h5":
        save(result, out)
        return
    if out.suffix.lower() in ENDINGS:
        write_report(result, out)
        return
    if out.suffix.lower() in (".csv", ".mat") or re.fullmatch(r"\.s\d+p", out.suffix.lower()):
        export_transfer(found, out)
        return
    from floquid.plot import nyquist, save_figure
    from floquid.plot import transfer as bode

    if picture == "nyquist":
        save_figure(nyquist(found, all_paths=True), out)
    else:
        save_figure(bode(found, frequency_axis=axis, all_paths=True), out)


def _whole(text: str) -> list[int]:
    """Whole numbers of a comma-separated list."""
    try:
        return [int(word) for word in split(text)]
    except ValueError:
        raise wrong_value("--harmonics", OF, "be whole numbers with commas", text, "As -1,0,1.") from None


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
        raise wrong_value("--at", OF, must, text, "As 0.1:2:200.") from None
