"""`floquid transfer`: harmonic transfer functions; `floquid multisine`: the inputs to measure them with."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from floquid._checks import input_error
from floquid._json import for_json
from floquid.cli._folder import identified_in, is_saved, refuse_beside_result
from floquid.cli._options import (
    Choices,
    Format,
    Frequency,
    NewRecordFile,
    OptionalWhole,
    RecordFiles,
    RecordOptions,
    SettingsFile,
    Whole,
    choices_of,
    given,
    period_of,
    split,
)
from floquid.cli._records import check_files, read_records
from floquid.cli._terminal import json_text, print_title, print_warnings, progress, terminal
from floquid.core import Channel, Record, channels_named
from floquid.errors import IdentificationError, InputError
from floquid.exports import export_transfer, fit_entries, import_transfer, measured_entries, transfer_entries
from floquid.findings import Finding, Severity, as_mapping, texts
from floquid.inputs import TransferFunctions
from floquid.pipeline import Analysis, measure_transfer
from floquid.pipeline import identify as identify_records
from floquid.readers import write
from floquid.reporting import ENDINGS
from floquid.reporting import report as write_report
from floquid.store import load, save
from floquid.transfer import CURVATURE, MeasuredTransfer, Multisine, TransferFit, fit_transfer
from floquid.transfer import multisine as designed
from floquid.views import with_error

OF = "floquid transfer"
DESIGN = "floquid multisine"
STAGES = 6
SHOWN = 12  # frequencies that are printed

Method: TypeAlias = Literal["model", "repeats", "polynomials", "chirps", "fit"]

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
_CURVATURE = "The weight of the curvature, with --method chirps: more of it averages more noise, and flattens more."
_DROP = "First repeats of each record that are left out, until the transient has died."
_REFERENCE = (
    "Reference signals without the noise, one for each input, with commas: for a closed loop or noisy inputs, with "
    "polynomials or fit."
)
_BAND = "The lowest and the highest line [Hz], with a comma; by default up to a fifth of the rate."


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
    settings
        A settings.toml written by an earlier run; options given here come first.
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
        must, remedy = "not be given with --method repeats", "Leave it out: the lines are those of the inputs."
        raise input_error("--at", OF, must, f"is {at!r}", remedy)
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
        if out is not None:
            _write(found, result, out)
    if format == "json":
        sys.stdout.write(json_text(transfer_entries(found) | {"method": method} | more | _told(findings)))
    else:
        _print(found, findings, more, out)
    failed = texts(findings, Severity.FAILURE)
    if failed:
        raise IdentificationError(failed[0])


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
            raise input_error(option, OF, "not be given with --method model", f"is {value!r}", remedy)


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


def _spread(there: NDArray[np.bool_]) -> NDArray[np.int64]:
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


def _write(found: TransferFunctions, result: Analysis | MeasuredTransfer | TransferFit, out: Path) -> None:
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


def multisine(
    *,
    period: float | None = None,
    frequency: Frequency = None,
    rate: Annotated[float | None, Parameter(help="The sampling rate [Hz].")] = None,
    turns: Whole = 128,
    band: Annotated[str, Parameter(help=_BAND)] = "",
    inputs: str = "u",
    unit: str = "-",
    rms: float = 1.0,
    repeats: OptionalWhole = 5,
    seed: Whole = 0,
    out: NewRecordFile = Path("multisine.csv"),
) -> None:
    """Write inputs for measuring harmonic transfer functions: random lines whose sidebands do not meet.

    Parameters
    ----------
    period
        The period of the system [s].
    turns
        Periods of the system in a repeat: half as many lines at most.
    inputs
        The names of the channels, with commas.
    unit
        Their unit, as N or V, by which a file of the answer tells them from responses.
    rms
        That of each input, in its unit.
    repeats
        How often it is repeated: the first for the transient, four and more for a variance.
    seed
        The seed of lines and phases.
    out
        The file; its suffix chooses the format.
    """
    own = period_of(period, frequency, DESIGN)
    if own is None or rate is None:
        name = "--period" if own is None else "--rate"
        raise input_error(name, DESIGN, "be given", "is not", "As --period 0.5 --rate 40.")
    names = split(inputs)
    if not names:
        raise input_error("--inputs", DESIGN, "name a channel", "names none", "As --inputs F1,F2.")
    asked = _band(band)
    design = designed(own, rate, turns=turns, band=asked, inputs=len(names), rms=rms, seed=seed)
    channels = names if unit == "-" else [Channel(name=name, unit=unit) for name in names]
    write(design.record(5 if repeats is None else repeats, channels), out)
    _print_design(terminal(), design, names)
    if asked is not None and asked[1] > 0.5 * rate:
        terminal().print(f"There are no lines beyond half the rate, {0.5 * rate:.5g} Hz: the band ends there.")
    terminal().print(f"Written to {out}.", soft_wrap=True)


def _print_design(console: Console, design: Multisine, names: tuple[str, ...]) -> None:
    """Print the lines of each input and what a repeat is."""
    for name, hertz in zip(names, design.frequencies_hz, strict=True):
        console.print(f"{name}: {len(hertz)} lines from {hertz[0]:.5g} to {hertz[-1]:.5g} Hz.")
    samples = design.values.shape[1]
    console.print(
        f"A repeat is {design.turns} periods, {samples} samples, {samples / design.sample_rate:.6g} s; "
        f"peak over rms {design.peak:.3g}. Play it without a gap, its begin at phase zero or at any other, and measure "
        f"at {design.sample_rate:.8g} Hz what is played and what answers."
    )


def _band(text: str) -> tuple[float, float] | None:
    """Two frequencies with a comma; None where none are named."""
    if not text.strip():
        return None
    try:
        low, high = (float(word) for word in split(text))
    except ValueError:
        must = "be two frequencies with a comma"
        raise input_error("--band", DESIGN, must, f"is {text!r}", "As --band 0.1,2.") from None
    return low, high
