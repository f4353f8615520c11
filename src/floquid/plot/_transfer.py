"""Harmonic transfer functions: Bode and Nyquist plots of paths, a curve for each harmonic."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from floquid._checks import index, input_error, wrong_value
from floquid.fit import WITHIN
from floquid.inputs import TransferFunctions
from floquid.plot._style import Into, drawing, grid_of, plain
from floquid.views import Ink, in_unit, magnitude_bands, phase_degrees

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FrequencyAxis: TypeAlias = Literal["linear", "log"]

HARMONIC_COLORS = (Ink.BLACK, Ink.BLUE, Ink.VERMILION, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.SKY)
HARMONIC_DASHES = ("-", "--", ":", "-.")
LINES = 150  # frequencies up to which a deviation is a bar
MOST_PATHS = 8  # rows that a page holds
HEADROOM = 1.25  # the top of an axis of magnitudes over the largest


def transfer(
    found: TransferFunctions | Callable[[], TransferFunctions],
    *,
    output: int | None = None,
    driven_by: int | None = None,
    frequency_axis: FrequencyAxis = "linear",
    all_paths: bool = False,
    ax: Into = None,
) -> Figure:
    r"""Magnitude and phase of the harmonic transfer functions :math:`G_m(\Omega)`, a row for each path.

    A curve a harmonic m: the response at Ω + mω to an input at Ω. Bands are 95 % intervals, of lines that were measured
    bars. The phase is drawn where the magnitude stands above four deviations.

    Raises InputError where there is no such output or input, or the axes do not fit.

    Parameters
    ----------
    found
        Transfer functions, or what makes them (`analysis.transfer`).
    output, driven_by
        Which output and which input, from 0; every one when not given, of many paths the eight of the largest |G|.
    frequency_axis
        The axis of frequencies: "linear", or "log", which leaves out what is not above zero.
    all_paths
        True for a row for each path, however many there are.
    ax
        The axes to draw into, two for each path; a new figure when not given.
    """
    from matplotlib.ticker import MaxNLocator

    own, of = found() if callable(found) else found, "transfer"
    if frequency_axis not in ("linear", "log"):
        raise wrong_value("frequency_axis", of, 'be "linear" or "log"', frequency_axis)
    if frequency_axis == "log":
        own = _above_zero(own, of)
    paths = _paths(own, output, driven_by, of, all_paths=all_paths)
    height = 1.0 + 2.2 * len(paths)
    with drawing(height, ax, of, panels=grid_of(len(paths), 2), width_ratios=(3, 2), sharex=True) as (figure, panels):
        for number, (row, column) in enumerate(paths):
            _draw_path(panels[2 * number], panels[2 * number + 1], own, row, column)
        if frequency_axis == "log":
            panels[0].set_xscale("log")
        else:
            panels[0].xaxis.set_major_locator(MaxNLocator(4))  # shared: the numbers of the narrow panels would meet
        for axes in panels[-2:]:
            axes.set_xlabel(r"frequency of the input $\Omega/2\pi$ [Hz]")
    return figure


def nyquist(
    found: TransferFunctions | Callable[[], TransferFunctions],
    *,
    output: int | None = None,
    driven_by: int | None = None,
    all_paths: bool = False,
    ax: Into = None,
) -> Figure:
    r"""Harmonic transfer functions :math:`G_m(\Omega)` in the complex plane, a panel for each path.

    A curve a harmonic m, its lowest frequency marked. A panel is as large as the 95 % intervals at least, so that noise
    does not look like a curve. Where G has no unit a cross is at -1: what a closed loop goes around.

    Raises InputError where there is no such output or input, or the axes do not fit.

    Parameters
    ----------
    found
        Transfer functions, or what makes them (`analysis.transfer`).
    output, driven_by
        Which output and which input, from 0; every one when not given, of many paths the eight of the largest |G|.
    all_paths
        True for a panel for each path, however many there are.
    ax
        The axes to draw into, one for each path; a new figure when not given.
    """
    own, of = found() if callable(found) else found, "nyquist"
    paths = _paths(own, output, driven_by, of, all_paths=all_paths)
    across = min(len(paths), 2)
    down = -(-len(paths) // across)
    cells = [[min(number, len(paths) - 1) for number in row] for row in grid_of(down, across)]
    with drawing(1.0 + 6.4 / across * down, ax, of, panels=cells) as (figure, panels):
        for axes, (row, column) in zip(panels, paths, strict=True):
            for place, harmonic in _inner_first(own):
                curve = own.values[place, row, column]
                std = np.zeros_like(curve) if own.std is None else own.std[place, row, column]
                there = np.isfinite(curve) & np.isfinite(std)
                curve, std = curve[there], WITHIN * std[there]
                if curve.any():
                    axes.update_datalim(np.concatenate([curve - std, curve + std]).view(float).reshape(-1, 2))
                    look = _look(harmonic)
                    axes.plot(curve.real, curve.imag, **look, linewidth=0.9, label=f"m = {harmonic}")
                    axes.plot(*curve[:1].view(float), color=look["color"], marker="o", markersize=3.5, linestyle="none")
            if (unit := plain(own.unit(row, column))) == "-":
                axes.plot(-1.0, 0.0, color=Ink.BLACK, marker="+", markersize=9.0, linestyle="none")
            axes.set_title(f"{plain(own.inputs[column].name)} to {plain(own.outputs[row].name)}", loc="left")
            axes.set(xlabel=in_unit("Re $G_m$", unit), ylabel=in_unit("Im $G_m$", unit))
            axes.set_aspect("equal", adjustable="datalim")
            axes.locator_params(nbins=5)
    return figure


def _paths(
    found: TransferFunctions, output: int | None, driven_by: int | None, of: str, *, all_paths: bool
) -> list[tuple[int, int]]:
    """The outputs and inputs to draw, of many the strongest unless all are wanted."""
    rows = range(len(found.outputs)) if output is None else [index(output, "output", of, len(found.outputs))]
    columns = range(len(found.inputs)) if driven_by is None else [index(driven_by, "driven_by", of, len(found.inputs))]
    paths = [(row, column) for row in rows for column in columns]
    return paths if all_paths else _strongest(found, paths)


def _above_zero(found: TransferFunctions, of: str) -> TransferFunctions:
    """Transfer functions at the frequencies that a logarithmic axis has."""
    there = found.frequencies_hz > 0.0
    if not there.any():
        raise input_error("found", of, "have frequencies above zero for a logarithmic axis", "has none")
    std = None if found.std is None else found.std[..., there]
    return replace(found, frequencies_hz=found.frequencies_hz[there], values=found.values[..., there], std=std)


def _inner_first(found: TransferFunctions) -> list[tuple[int, int]]:
    """The places of harmonics and these, from zero outwards."""
    return sorted(enumerate(found.harmonics.tolist()), key=lambda one: (abs(one[1]), one[1]))


def _look(harmonic: int) -> dict[str, Any]:
    """The colour and the dashes of a harmonic."""
    number = 2 * abs(harmonic) - (harmonic > 0)
    return {
        "color": HARMONIC_COLORS[number % len(HARMONIC_COLORS)],
        "linestyle": HARMONIC_DASHES[number // len(HARMONIC_COLORS) % len(HARMONIC_DASHES)],
    }


def _strongest(found: TransferFunctions, paths: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The paths of the largest |G| among those of one unit, in their own order."""
    sizes = {path: float(np.nanmax(np.abs(found.values[:, *path]), initial=0.0)) for path in paths}
    largest: dict[str, float] = {}
    for path, size in sizes.items():
        largest[found.unit(*path)] = max(largest.get(found.unit(*path), 0.0), size)
    share = {path: size / (largest[found.unit(*path)] or 1.0) for path, size in sizes.items()}
    return sorted(sorted(paths, key=lambda path: -share[path])[:MOST_PATHS])


def _draw_path(upper: Axes, beside: Axes, found: TransferFunctions, row: int, column: int) -> None:
    """Magnitude and phase of one path, a curve for each harmonic."""
    sizes, low, high, floor = magnitude_bands(found, row, column)
    degrees = phase_degrees(found, row, column)
    measured = not np.isfinite(found.values).all() or len(found.frequencies_hz) <= LINES
    for place, harmonic in _inner_first(found):
        there = np.isfinite(sizes[place])
        if not sizes[place, there].any():
            continue
        hertz, look = found.frequencies_hz[there], _look(harmonic) | {"linewidth": 0.6 if measured else None}
        color = look["color"]
        upper.plot(hertz, sizes[place, there], **look, label=f"m = {harmonic}")
        # A point alone, between phases that say nothing, would not be seen without a mark.
        beside.plot(hertz, degrees[place, there], **look, marker="." if measured else None, markersize=2.5)
        if found.std is not None and measured:
            upper.vlines(hertz, low[place, there], high[place, there], color=color, linewidth=1.2)
        elif found.std is not None:
            upper.fill_between(hertz, low[place, there], high[place, there], color=color, alpha=0.2, linewidth=0.0)
    upper.set_yscale("log")
    # A curve that hardly changes has no room above it otherwise: limits in logarithms are shares of the range.
    upper.set_ylim(floor, max(upper.get_ylim()[1], HEADROOM * float(np.nanmax(sizes, initial=floor))))
    upper.set_title(f"{plain(found.inputs[column].name)} to {plain(found.outputs[row].name)}", loc="left")
    upper.set_ylabel(in_unit("$|G_m|$", plain(found.unit(row, column))))
    beside.set(ylabel=r"arg $G_m$ [deg]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
