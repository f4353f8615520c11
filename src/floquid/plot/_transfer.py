"""Harmonic transfer functions: Bode plots of paths, a curve for each harmonic with its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import index
from floquid.inputs import TransferFunctions
from floquid.plot._style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Into,
    drawing,
    grid_of,
    plain,
)
from floquid.views import in_unit, magnitude_bands, phase_degrees

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


HARMONIC_COLORS = (BLACK, BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
HARMONIC_DASHES = ("-", "--", ":", "-.")
LINES = 150  # frequencies up to which a deviation is a bar
MOST_PATHS = 8  # rows that a page holds


def transfer(
    found: TransferFunctions | Callable[[], TransferFunctions],
    *,
    output: int | None = None,
    driven_by: int | None = None,
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
    ax
        The axes to draw into, two for each path; a new figure when not given.
    """
    from matplotlib.ticker import MaxNLocator

    own = found() if callable(found) else found
    of = "transfer"
    rows = range(len(own.outputs)) if output is None else [index(output, "output", of, len(own.outputs))]
    columns = range(len(own.inputs)) if driven_by is None else [index(driven_by, "driven_by", of, len(own.inputs))]
    paths = _strongest(own, [(row, column) for row in rows for column in columns])
    height = 1.0 + 2.2 * len(paths)
    with drawing(height, ax, of, panels=grid_of(len(paths), 2), width_ratios=(3, 2), sharex=True) as (figure, panels):
        for number, (row, column) in enumerate(paths):
            _draw_path(panels[2 * number], panels[2 * number + 1], own, row, column)
        panels[0].xaxis.set_major_locator(MaxNLocator(4))  # shared: the numbers of the narrow panels would meet
        for axes in panels[-2:]:
            axes.set_xlabel(r"frequency of the input $\Omega/2\pi$ [Hz]")
    return figure


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
    for place, harmonic in sorted(enumerate(found.harmonics.tolist()), key=lambda one: (abs(one[1]), one[1])):
        there = np.isfinite(sizes[place])
        if not sizes[place, there].any():
            continue
        hertz, number = found.frequencies_hz[there], 2 * abs(harmonic) - (harmonic > 0)
        color = HARMONIC_COLORS[number % len(HARMONIC_COLORS)]
        look = {
            "color": color,
            "linestyle": HARMONIC_DASHES[number // len(HARMONIC_COLORS) % len(HARMONIC_DASHES)],
            "linewidth": 0.6 if measured else None,
        }
        upper.plot(hertz, sizes[place, there], **look, label=f"m = {harmonic}")
        # A point alone, between phases that say nothing, would not be seen without a mark.
        beside.plot(hertz, degrees[place, there], **look, marker="." if measured else None, markersize=2.5)
        if found.std is not None and measured:
            upper.vlines(hertz, low[place, there], high[place, there], color=color, linewidth=1.2)
        elif found.std is not None:
            upper.fill_between(hertz, low[place, there], high[place, there], color=color, alpha=0.2, linewidth=0.0)
    upper.set_yscale("log")
    upper.set_ylim(bottom=floor)
    upper.set_title(f"{plain(found.inputs[column].name)} to {plain(found.outputs[row].name)}", loc="left")
    upper.set_ylabel(in_unit("$|G_m|$", plain(found.unit(row, column))))
    beside.set(ylabel=r"arg $G_m$ [deg]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
