"""The record, the model's response, and what is left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer
from floquid.core import channels_named
from floquid.pipeline import Analysis
from floquid.plot._several import legend_of_all
from floquid.plot._style import BLACK, BLUE, GREY, ORANGE, SIZE, VERMILION, label_values, new_figure, plain, style
from floquid.views import Synthesis, envelope
from floquid.views import synthesis as synthesis_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INTERVAL = 1.96
"""The standard deviations to each side within which 95 % of the noise lies."""

STRETCHES = 40
"""Stretches of the record in each of which the rms of what is left is drawn."""

_DATA: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "color": BLUE}
_MODEL: dict[str, Any] = {"color": VERMILION, "linestyle": "-"}


def synthesis(
    analysis: Analysis,
    channel: str | None = None,
    *,
    hit: int = 0,
    close_cycles: int = 4,
    points: int = 4000,
) -> Figure:
    """A channel of the record with the model's response over it: the first cycles, the whole record, what is left.

    Below, what is left lies between the broken lines, 1.96 deviations of the noise, where the model has explained all
    there is; the steps are its root mean square in stretches of the record. The record is the one identified from, as
    `views.synthesis` has it.

    Parameters
    ----------
    analysis
        What `identify` found.
    channel
        The name of the channel; the first when not given.
    hit
        Which of the hits, from 0.
    close_cycles
        The number of cycles close up.
    points
        The most points a curve is drawn with.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        There is no such channel or hit.
    """
    of = "synthesis"
    if not isinstance(analysis, Analysis):
        raise input_error("analysis", of, "be an Analysis", f"is {analysis!r:.60}", "Pass what `identify` gives.")
    if integer(hit, "hit", of, at_least=0) >= analysis.model.n_hits:
        raise input_error("hit", of, f"be less than {analysis.model.n_hits}", f"is {hit}", "Counting starts at 0.")
    integer(close_cycles, "close_cycles", of, at_least=1)
    integer(points, "points", of, at_least=2)
    shown = analysis.model.channels
    row = 0 if channel is None else channels_named(shown, [channel], argument="channel", of=of)[0]
    found = synthesis_of(analysis, row, hit)
    name, unit = shown[row].name, shown[row].unit
    with style():
        figure = new_figure(7.0, 6.2)
        close, whole, left = figure.subplots(3, 1, height_ratios=(1.2, 1.2, 1.0))
        _draw_close(close, found, close_cycles * analysis.model.period)
        _draw_whole(whole, found, points)
        _draw_left(left, found, points)
        largest = float(np.nanmax(np.abs(found.measured)))
        label_values(close, "response", unit, largest)
        label_values(whole, "response", unit, largest)
        label_values(left, "left", unit, float(np.nanmax(np.abs(left.get_ylim()))))
        cycles = "cycle" if close_cycles == 1 else f"{close_cycles} cycles"
        hits = f", hit {hit + 1}" if analysis.model.n_hits > 1 else ""
        close.set_title(f"the first {cycles} of {plain(name)}{hits}", loc="left")
        whole.set_title("the whole record", loc="left")
        rms = float(np.sqrt(np.nanmean(found.residual**2)))
        left.set_title(f"what is left: {rms / found.noise:.3f} times the noise (rms)", loc="left")
        left.set_xlabel("time [s]")
        whole.tick_params(labelbottom=False)
        for axes in (close, whole, left):
            axes.tick_params(labelsize=SIZE)
        figure.align_ylabels([close, whole, left])
        legend_of_all(figure)
    return figure


def _draw_close(axes: Axes, found: Synthesis, length: float) -> None:
    """The samples of the first cycles as rings, and the response through them."""
    inside = found.times <= found.times[0] + length * (1.0 + 1e-9)
    times = found.times[inside]
    axes.plot(times, found.measured[inside], **_DATA, markersize=3.6, markeredgewidth=0.8, label="measured")
    axes.plot(times, found.predicted[inside], **_MODEL, linewidth=1.2, label="model")
    axes.set_xlim(times[0], times[-1])


def _draw_whole(axes: Axes, found: Synthesis, points: int) -> None:
    axes.plot(*envelope(found.times, found.measured, points), color=BLUE, linewidth=0.8, label="measured")
    axes.plot(*envelope(found.times, found.predicted, points), **_MODEL, linewidth=0.5, label="model")
    axes.set_xlim(found.times[0], found.times[-1])


def _draw_left(axes: Axes, found: Synthesis, points: int) -> None:
    """What is left, between the lines of the noise, and its rms stretch by stretch."""
    axes.plot(*envelope(found.times, found.residual, points), color=GREY, linewidth=0.5, label="measured − model")
    for side in (-INTERVAL, INTERVAL):
        axes.axhline(side * found.noise, color=BLACK, linestyle="--", linewidth=0.9, label="95 % of the noise")
    edges, rms = _steps(found)
    axes.stairs(rms, edges, baseline=None, color=ORANGE, linewidth=1.6, zorder=3, label="rms of what is left")
    axes.set_xlim(found.times[0], found.times[-1])
    # What the model leaves out early on would hide all the rest if it set the scale alone.
    reach = max(3.0 * INTERVAL * found.noise, 1.1 * float(np.nanquantile(np.abs(found.residual), 0.999)))
    axes.set_ylim(-reach, reach)


def _steps(found: Synthesis) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The ends of equal stretches [s] and the rms of what is left in each; NaN where nothing was sampled."""
    count = max(1, min(STRETCHES, len(found.times) // 50))
    place = np.arange(len(found.times)) * count // len(found.times)
    there = np.isfinite(found.residual)
    held = np.bincount(place[there], found.residual[there] ** 2, count)
    number = np.bincount(place[there], minlength=count)
    rms = np.sqrt(np.divide(held, number, out=np.full(count, np.nan), where=number > 0))
    firsts = np.searchsorted(place, np.arange(count))
    return np.append(found.times[firsts], found.times[-1]), rms
