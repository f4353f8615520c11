"""From an analysis to a page on the disk."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from floquid._checks import input_error, timed_matrices
from floquid.comparison import Comparison, Updated
from floquid.errors import IdentificationError, InputError
from floquid.io import as_path, atomic_path
from floquid.monitoring import Monitor
from floquid.order import OrderScan
from floquid.pipeline import Analysis, blas_threads
from floquid.reporting._brief import brief_page
from floquid.reporting._case import case_of
from floquid.reporting._comparison_page import comparison_page
from floquid.reporting._lines_page import lines_page
from floquid.reporting._monitor_page import monitor_page
from floquid.reporting._page import page
from floquid.reporting._survey_page import survey_page
from floquid.reporting._system_figures import Truth
from floquid.surveys import Survey
from floquid.transfer import MeasuredTransfer, TransferFit
from floquid.views import DampingUnit, SpeedUnit, check_damping_unit
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
    match analysis:
        case Analysis():
            known = _truth(analysis, truth, of)
            units: dict[str, Any] = {"unit": speed_unit, "damping": damping_unit}
            write = partial(_text, analysis, brief=brief, truth=known, **units, progress=progress)
        case TransferFit():
            _refuse_of_lines(truth, of, brief=brief)
            write = partial(lines_page, analysis, damping=damping_unit)
        case Survey():
            _refuse_of_lines(truth, of, brief=brief)
            write = partial(survey_page, analysis, damping=damping_unit)
        case Comparison() | Monitor():
            _refuse_of_lines(truth, of, brief=brief)
            write = partial(comparison_page if isinstance(analysis, Comparison) else monitor_page, analysis)
        case MeasuredTransfer():
            remedy = "Fit modes to them: `floquid transfer --lines`."
            raise input_error("analysis", of, "hold modes", "holds transfer functions as measured", remedy)
        case Updated():
            must, got = "have a page", "holds parameters that were fitted to results"
            raise input_error("analysis", of, must, got, "Its `summary()` says all there is.")
        case _:
            must, got = "be an Analysis", f"is a {type(analysis).__name__}"
            raise input_error("analysis", of, must, got, "Pass what `identify` or `load` gives.")
    place = as_path(path, of=of)
    if place.suffix.lower() not in ENDINGS:
        raise input_error("path", of, "end in .html", f"is {place}", "The report is a web page.")
    unit_of_speed(speed_unit, of)
    check_damping_unit(damping_unit, of)
    if title is not None and not isinstance(title, str):
        raise input_error("title", of, "be a text", f"is a {type(title).__name__}")
    with atomic_path(place, of=of) as temporary:  # refused before the page is drawn
        temporary.write_text(write(title=title), encoding="utf-8")
    return place


def _truth(analysis: Analysis, truth: tuple[ArrayLike, ArrayLike] | None, of: str) -> Truth | None:
    """The true A(t) as the page has it, refused where it fits none that was estimated."""
    if truth is None:
        return None
    if analysis.state is None:
        must, got = "come with an A(t) to hold it against", "the analysis has none"
        raise input_error("truth", of, must, got, "Identify with `states`, or leave out the truth.")
    return timed_matrices(truth, "truth", of, len(analysis.state.states))


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
