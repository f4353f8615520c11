"""The standard figures of a result, as files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import input_error, wrong_value
from floquid.io import as_path, atomic_path
from floquid.pipeline import Analysis
from floquid.plot._style import style
from floquid.views import SpeedUnit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Format = Literal["png", "svg", "pdf"]

FIGURES = (
    "time_record",
    "spectra",
    "composite",
    "indicators",
    "exponents",
    "periodic_shapes",
    "synthesis",
    "synchronisation",
    "harmonic_spectra",
    "transfer",
    "system_elements",
    "speed",
)
"""The names of the figures that there may be, in the order in which `save_figures` writes them."""

# What would make two files of one figure differ.
_NO_DATE = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figures(
    analysis: Analysis,
    folder: str | PathLike[str],
    *,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    formats: Sequence[Format] = ("png",),
    dpi: float = 150.0,
    speed_unit: SpeedUnit = "hz",
) -> tuple[Path, ...]:
    """Write every figure that the analysis allows, each under the name of its function (`FIGURES`).

    `synthesis` is of the channel and the hit in which a mode rises highest above the noise. `system_elements` needs an
    A(t), `speed` a tachometer, `transfer` measured inputs, and `harmonic_spectra` outputs alone. A scan over orders is
    not in an analysis: for its figure there is `stabilisation`. Each file appears whole or not at all.

    Returns the files written. Raises InputError where the folder does not exist or cannot be written to, a format is
    unknown, or the truth does not fit.

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
    speed_unit
        The unit of the speed of the shaft, "hz" or "rpm".
    """
    of = "save_figures"
    place = as_path(folder, of=of, argument="folder")
    if isinstance(formats, str) or not all(form in get_args(Format) for form in formats):
        words = ", ".join(f'"{form}"' for form in get_args(Format))
        raise wrong_value("formats", of, f"be a list of {words}", formats, 'Pass e.g. ["png", "pdf"].')
    from threadpoolctl import threadpool_limits

    written, plots = [], analysis.plot
    options: dict[str, dict[str, Any]] = {"system_elements": {"truth": truth}, "speed": {"speed_unit": speed_unit}}
    options |= _options(analysis)
    for name in sorted(dir(plots), key=FIGURES.index):
        # The matrices are many and small: threads inside BLAS would wait for each other, as in `identify`.
        with threadpool_limits(limits=1, user_api="blas"):
            figure = getattr(plots, name)(**options.get(name, {}))
        for form in formats:
            path = place / f"{name}.{form}"
            _write(figure, path, form, dpi, of=of, argument="folder")
            written.append(path)
    return tuple(written)


def figure_of_fit(analysis: Analysis) -> tuple[str, Figure]:
    """The figure that says most of the fit, and its name in words."""
    # Of free responses the record with the model over it and the residual, of measured inputs the transfer functions,
    # of outputs alone the spectra with the lines of the modes.
    if analysis.decay is not None:
        return "the record, the model over it, and the residual", analysis.plot.synthesis(
            **_options(analysis)["synthesis"]
        )
    if analysis.inputs:
        found = analysis.transfer()
        size = np.abs(found.values).max(axis=(0, 3)) / analysis.noise
        row, column = np.unravel_index(int(np.argmax(size)), size.shape)
        return "transfer functions", analysis.plot.transfer(output=int(row), driven_by=int(column))
    return "harmonic power spectra", analysis.plot.harmonic_spectra()


def _options(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """Options of figures by name: the channel and the hit that they are of."""
    row, hit = _strongest(analysis)
    return {
        "periodic_shapes": {"hit": hit},
        "synthesis": {"channel": analysis.model.channels[row].name, "hit": hit},
        "synchronisation": {"hit": hit},
    }


def _strongest(analysis: Analysis) -> tuple[int, int]:
    """The channel and hit of the largest response of a mode over the noise."""
    model, upper = analysis.model, analysis.model.upper_modes
    energy = np.sum(np.abs(model.coefficients[list(upper)]) ** 2, axis=3) / analysis.noise**2
    _, row, hit = np.unravel_index(int(np.argmax(energy)), energy.shape)
    return int(row), int(hit)


def save_figure(figure: Figure, path: str | PathLike[str], *, dpi: float = 150.0) -> Path:
    """Write one figure, whole or not at all; the same figure always gives the same file.

    `figure` is one of this package, and `dpi` the dots an inch of PNG. `path` is the file, ending in .png, .svg or
    .pdf, which is replaced. Returns the file written. Raises InputError where the ending is another, or the file cannot
    be written.
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
