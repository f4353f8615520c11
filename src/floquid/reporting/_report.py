"""From an analysis to a page on the disk."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from io import BytesIO
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import counted, input_error, kind_of, timed_matrices
from floquid.comparison import Comparison, Updated
from floquid.core import Branch
from floquid.errors import IdentificationError, InputError
from floquid.findings import Severity, texts
from floquid.io import as_path, atomic_path
from floquid.monitoring import Monitor
from floquid.order import OrderScan
from floquid.pipeline import Analysis, blas_threads
from floquid.plot import figure_of_fit, style
from floquid.reporting import _words as words
from floquid.reporting._case import Case, case_of
from floquid.reporting._comparison_page import comparison_page, monitor_page
from floquid.reporting._driven_figures import matrix_rows, measured_figures, paths_of
from floquid.reporting._modes_figures import Truth, mode_figures, mode_source
from floquid.reporting._page import filled, modes_of, page, rendered, title_of, verdict_of
from floquid.reporting._survey_page import survey_page
from floquid.surveys import Survey
from floquid.transfer import MeasuredTransfer, TransferFit
from floquid.views import (
    DAMPING_WORDS,
    DampingUnit,
    SpeedUnit,
    branch_words,
    check_damping_unit,
    mode_table,
    note_meanings,
    speed_texts,
)
from floquid.views import speed_unit as unit_of_speed

ENDINGS = (".html", ".htm")


def report(
    analysis: Analysis | TransferFit | MeasuredTransfer | Survey | Comparison | Updated | Monitor,
    path: str | PathLike[str],
    *,
    title: str | None = None,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    brief: bool = False,
    speed_unit: SpeedUnit = "hz",
    damping_unit: DampingUnit = "percent",
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the report of an analysis: one HTML page that opens in any browser, without a network.

    First come the verdict with its reasons and the table of modes, then linked figures. Then follow the preparation of
    the record, the settings, and how to cite. Curves of more than 3000 points keep their envelope, and the eight
    strongest channels are drawn: the page stays under 6 MB.

    Returns the file written. Raises InputError where `analysis` holds no modes, the file does not end in .html or
    cannot be written, or the truth does not fit.

    Parameters
    ----------
    analysis
        What `identify`, `fit_transfer`, `survey`, `compare` or `monitor` found, or `load` read.
    path
        The file, ending in .html; it is replaced, whole or not at all.
    title
        The heading; the names of the records when not given.
    truth
        Instants after phase zero (times,) [s] and the true A at each (times, n, n), drawn beside the estimate.
    brief
        True for one page to print (A4): the modes, the verdict with its reasons, one picture of the fit, the record and
        the settings.
    speed_unit
        The unit of the speed of the shaft, "hz" or "rpm"; frequencies of vibration are in Hz.
    damping_unit
        The damping: the ratio ζ in "percent", or the logarithmic "decrement" δ.
    progress
        Called with what is about to be done, in words.
    """
    of = "report"
    result: Any = analysis
    kind = kind_of(result)
    if kind not in PAGES:
        must, got = "be an Analysis", f"is a {type(analysis).__name__}"
        raise input_error("analysis", of, *NO_PAGE.get(kind, (must, got, "Pass what `identify` or `load` gives.")))
    options: dict[str, Any] = {"damping": damping_unit}
    if kind == "analysis":
        known = _truth(result, truth, of)
        options |= {"unit": speed_unit, "brief": brief, "truth": known, "progress": progress}
    else:
        _refuse_of_lines(truth, of, brief=brief)
    place = as_path(path, of=of)
    if place.suffix.lower() not in ENDINGS:
        raise input_error("path", of, "end in .html", f"is {place}", "The report is a web page.")
    unit_of_speed(speed_unit, of)
    check_damping_unit(damping_unit, of)
    if title is not None and not isinstance(title, str):
        raise input_error("title", of, "be a text", f"is a {type(title).__name__}")
    with atomic_path(place, of=of) as temporary:  # refused before the page is drawn
        temporary.write_text(PAGES[kind](result, title=title, **options), encoding="utf-8")
    return place


def _truth(analysis: Analysis, truth: tuple[ArrayLike, ArrayLike] | None, of: str) -> Truth | None:
    """The true A(t) as the page has it, refused where it fits none that was estimated."""
    if truth is None:
        return None
    if analysis.state is None:
        must, got = "come with an A(t) to hold it against", "the analysis has none"
        raise input_error("truth", of, must, got, "Identify with `states`, or leave out the truth.")
    return timed_matrices(truth, of, len(analysis.state.states))


def _refuse_of_lines(truth: tuple[ArrayLike, ArrayLike] | None, of: str, *, brief: bool) -> None:
    """Refuse what a page of modes fitted to transfer functions does not have."""
    if truth is not None:
        must, got = "come with an A(t) to hold it against", "modes of transfer functions and surveys have none"
        raise input_error("truth", of, must, got, "Leave it out.")
    if brief:
        must, got = "be false of modes fitted to transfer functions and of surveys", "is true"
        raise input_error("brief", of, must, got, "Their page is short: leave it out.")


def _text(
    analysis: Analysis,
    *,
    title: str | None,
    brief: bool,
    truth: Truth | None,
    unit: SpeedUnit,
    damping: DampingUnit,
    progress: Callable[[str], None],
) -> str:
    """The page of an analysis as text."""
    scanned = (None, "") if brief else _scan(analysis, progress)
    progress("drawing the report")
    case = case_of(analysis, *scanned, damping=damping)
    return brief_page(case, title=title, unit=unit) if brief else page(case, title=title, truth=truth, unit=unit)


def _scan(analysis: Analysis, progress: Callable[[str], None]) -> tuple[OrderScan | None, str]:
    """The poles of several orders, or why there are none: a record may be too short for them."""
    if analysis.decay is None:
        return None, ""
    progress("scanning the order")
    try:
        with blas_threads([analysis.lifted.responses]):
            return analysis.scan(), ""
    except (InputError, IdentificationError) as error:
        return None, str(error)


MOST_MODES, MOST_SENTENCES = 14, 4  # rows and sentences that leave room for the picture on a sheet of A4
DPI = 200  # sharp on paper


def brief_page(case: Case, *, title: str | None, unit: SpeedUnit) -> str:
    """The page as text: nothing in it moves, and nothing is loaded."""
    analysis: Analysis = case.analysis
    found = modes_of(analysis, case.damping)
    table = found["table"]
    sentences = [*analysis.reasons, *speed_texts(analysis.findings, unit, Severity.WARNING)]
    reasons, shown = len(analysis.reasons), sentences[:MOST_SENTENCES]
    name, figure = figure_of_fit(analysis)
    stream = BytesIO()
    with style():
        figure.savefig(stream, format="png", dpi=DPI)
    content: dict[str, Any] = verdict_of(analysis) | found
    # The options that differ from those of a run without any
    usual = {field.name: field.default for field in fields(analysis.settings)}
    rows = words.settings_rows(analysis)
    content |= {
        "table": replace(table, rows=table.rows[:MOST_MODES]),
        "modes_left": max(0, len(table.rows) - MOST_MODES),
        "reasons": shown[:reasons],
        "warnings": shown[reasons:],
        "sentences_left": len(sentences) - len(shown),
        "picture": b64encode(stream.getvalue()).decode("ascii"),
        "described": name,
        "summary": words.summary_line(case, unit),
        "sources": words.sources(analysis),
        "settings": [(name, value) for name, value in rows if getattr(analysis.settings, name) != usual[name]],
    }
    return filled("brief.html.jinja", title=title or title_of(case), **content)


POINTS = 600  # frequencies of a curve, beside those measured


@dataclass(frozen=True, slots=True)
class _Settings:
    """Settings of a fit of lines."""

    period: float
    hold: str
    harmonics: None = None  # of the shapes: found, not given
    branch: Branch = "strongest"


def lines_page(fit: TransferFit, *, title: str | None, damping: DampingUnit) -> str:
    """The whole page as text, damping in a unit."""
    lines, model = fit.measured, fit.model
    sampled = lines.step is not None
    at = fit.transfer(sampled=sampled)
    hertz = lines.frequencies_hz
    drawn = fit.transfer(np.union1d(hertz, np.linspace(hertz[0], hertz[-1], POINTS)), sampled=sampled)
    assert lines.std is not None
    noise = np.sqrt(np.nanmean(np.abs(lines.std) ** 2, axis=(0, 2, 3)))[:, None]
    shown: Any = SimpleNamespace(
        model=model, noise=noise, records=(), settings=_Settings(model.period, fit.hold), findings=fit.findings,
        decay=None, whitening=None, lengths=None,
    )  # fmt: skip
    case, paths = case_of(shown, damping=damping), paths_of(at, noise, np.ones(len(lines.inputs)))
    measured = measured_figures(lines, at, drawn, paths, each=True)
    table, ratio = mode_table(shown, damping_unit=damping), fit.chi_square / max(fit.degrees, 1)
    worst = max((finding.severity for finding in fit.findings), key=list(Severity).index, default=Severity.NOTE)
    mark, sentence = {
        Severity.NOTE: ("passed", "The modes explain the lines."),
        Severity.WARNING: ("remainder", "The modes do not explain all of the lines."),
        Severity.FAILURE: ("failed", "The fit fails."),
    }[worst]
    there = np.isfinite(lines.values).any(axis=(0, 1, 2))
    return rendered(
        case,
        mode_figures(case, mode_source(case)) | {"measured": measured},
        title or "Modes of measured transfer functions",
        mark=mark,
        sentence=sentence,
        under=f"They leave {ratio:.3g} times the variance of the lines, {fit.degrees} degrees of freedom.",
        reasons=texts(fit.findings, Severity.FAILURE),
        warnings=texts(fit.findings, Severity.WARNING),
        table=table,
        damping=DAMPING_WORDS[damping].replace("-", "−"),
        meanings=note_meanings(table),
        branch=branch_words(case.analysis),
        bands=True,
        summary=(
            f"{counted(len(case.modes), 'mode')} (order {model.order}) fitted to {np.count_nonzero(there)} lines from "
            f"{hertz[there][0]:.5g} to {hertz[there][-1]:.5g} Hz of {counted(len(lines.inputs), 'input')} and "
            f"{counted(len(lines.outputs), 'output')}, {counted(len(lines.harmonics), 'harmonic')}, at a period of "
            f"{model.period:.8g} s (ω/2π = {1.0 / model.period:.6g} Hz)."
        ),
        inputs=lines.inputs,
        matrix=matrix_rows(at, paths),
        harmonics=at.harmonics.tolist(),
        paths_shown=len(paths),
        paths_left=len(lines.inputs) * len(lines.outputs) - len(paths),
        steps=words.steps(shown),
    )


PAGES: dict[str, Callable[..., str]] = {
    "analysis": _text,
    "fitted": lines_page,
    "survey": survey_page,
    "comparison": lambda found, *, title, **_: comparison_page(found, title=title),
    "monitor": lambda found, *, title, **_: monitor_page(found, title=title),
}
"""The function of the page of each kind of result."""

NO_PAGE = {
    "measured": (
        "hold modes", "holds transfer functions as measured", "Fit modes to them: `floquid transfer --lines`."
    ),
    "update": (
        "have a page", "holds parameters that were fitted to results", "Its `summary()` says all there is."
    ),
}  # fmt: skip
"""Kinds of results without one: what a result must be, what it is, and what to do."""
