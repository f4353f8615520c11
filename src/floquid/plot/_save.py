"""The standard figures of a result, as files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from numpy.typing import ArrayLike

from floquid._checks import input_error
from floquid._files import as_path, atomic_path
from floquid.pipeline import Analysis
from floquid.plot._composite import composite
from floquid.plot._speed import speed
from floquid.plot._style import style
from floquid.plot._system_elements import system_elements
from floquid.plot._time_record import time_record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Format = Literal["png", "svg", "pdf"]

# What would make two files of one figure differ.
_NO_DATE = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figures(
    analysis: Analysis,
    folder: str | PathLike[str],
    *,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    formats: Sequence[Format] = ("png",),
    dpi: float = 150.0,
) -> tuple[Path, ...]:
    """Write `time_record`, `composite`, with an A(t) `system_elements`, and with a tachometer `speed`.

    Each file appears whole or not at all.

    Parameters
    ----------
    analysis
        What `identify` found.
    folder
        An existing folder; files of the same names in it are replaced.
    truth
        Instants after phase zero (times,) [s] and the true A at each (times, n, n), to be drawn beside the estimate.
    formats
        "png", "svg" or "pdf", or several.
    dpi
        Dots an inch of PNG.

    Returns
    -------
    tuple of pathlib.Path
        The files written.

    Raises
    ------
    InputError
        The folder does not exist or cannot be written to, a format is unknown, or the truth does not fit.
    """
    of = "save_figures"
    place = as_path(folder, of=of, argument="folder")
    if isinstance(formats, str) or not all(form in get_args(Format) for form in formats):
        words = ", ".join(f'"{form}"' for form in get_args(Format))
        raise input_error("formats", of, f"be a list of {words}", f"is {formats!r}", 'Pass e.g. ["png", "pdf"].')
    figures: dict[str, Figure] = {"time_record": time_record(analysis), "composite": composite(analysis)}
    if analysis.state is not None:
        figures["system_elements"] = system_elements(
            analysis.state, truth=truth, period=analysis.model.period, channels=analysis.model.channels
        )
    if analysis.shafts:
        figures["speed"] = speed(analysis.shafts[0])
    written = []
    for name, figure in figures.items():
        for form in formats:
            path = place / f"{name}.{form}"
            _write(figure, path, form, dpi, of=of, argument="folder")
            written.append(path)
    return tuple(written)


def save_figure(figure: Figure, path: str | PathLike[str], *, dpi: float = 150.0) -> Path:
    """Write one figure, whole or not at all; the same figure always gives the same file.

    Parameters
    ----------
    figure
        A figure of this package.
    path
        The file, ending in .png, .svg or .pdf; it is replaced.
    dpi
        Dots an inch of PNG.

    Returns
    -------
    pathlib.Path
        The file written.

    Raises
    ------
    InputError
        The ending is another, or the file cannot be written.
    """
    of = "save_figure"
    place = as_path(path, of=of)
    form = place.suffix[1:].lower()
    if form not in get_args(Format):
        words = ", ".join(f".{one}" for one in get_args(Format))
        raise input_error("path", of, f"end in one of {words}", f"is {place}", "The ending says the format.")
    _write(figure, place, form, dpi, of=of, argument="path")
    return place


def _write(figure: Figure, path: Path, form: str, dpi: float, *, of: str, argument: str) -> None:
    with atomic_path(path, of=of, argument=argument) as temporary, style():
        figure.savefig(temporary, format=form, dpi=dpi, metadata=_NO_DATE[form])
