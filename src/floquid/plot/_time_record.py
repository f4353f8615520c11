"""The record in time, with the samples that one lifted response takes from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer
from floquid.core import Cycles, channels_named
from floquid.pipeline import Analysis
from floquid.plot._several import degrees_a_period
from floquid.plot._style import BLUE, VERMILION, finish, label_values, new_figure, plain, style
from floquid.views import envelope, lifted_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSET = (0.36, 0.58, 0.62, 0.33)
"""Where the inset is: left, bottom, width and height as shares of the axes."""

MOST_ANGLES = 3
"""How many angles of the shaft the legend lists."""

INSET_WITH_LABELS = 0.46
"""The height below which the record must stay beside the inset, as a share of the axes."""


def time_record(
    analysis: Analysis,
    channel: str | None = None,
    phase: int = 0,
    *,
    hit: int = 0,
    inset_cycles: int = 5,
    points: int = 4000,
    periods_per_revolution: int | None = None,
) -> Figure:
    """The free response of one channel, and circles at the samples of one phase: one lifted response.

    An inset shows the first cycles (Allen 2009, figure 2). A long record is drawn by its envelope.

    Parameters
    ----------
    analysis
        What `identify` found.
    channel
        The name of the channel; the first when not given.
    phase
        Which of the samples of a period gets the circles, from 0.
    hit
        Which of the records, from 0.
    inset_cycles
        The number of cycles in the inset.
    points
        The most points a curve is drawn with.
    periods_per_revolution
        Name the phase by the angles of the shaft, which turns once in this many periods; not given, by its number.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        There is no such channel, phase or hit.
    """
    of = "time_record"
    _below(hit, len(analysis.cycles), "hit", of)
    record, cycles = analysis.fit.free[hit], analysis.cycles[hit]
    row = 0
    if channel is not None:
        row = channels_named(record.channels, [channel], argument="channel", of=of)[0]
    _below(phase, cycles.n_phases, "phase", of)
    integer(inset_cycles, "inset_cycles", of, at_least=1)
    integer(points, "points", of, at_least=2)
    times, values = record.times, record.values[row]
    period = analysis.model.period
    instants = lifted_points(analysis, row, hit)[0] + phase / cycles.n_phases * period
    samples = cycles.values[row, phase]
    with style():
        figure = new_figure(7.0, 4.0)
        axes = figure.add_subplot()
        shown = record.channels[row]
        label = plain(shown.name) + (f", hit {hit + 1}" if len(analysis.cycles) > 1 else "")
        axes.plot(*envelope(times, values, points), color=BLUE, linewidth=0.7, label=label)
        marks = _marks(cycles, phase, periods_per_revolution)
        ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "color": VERMILION}
        axes.plot(*envelope(instants, samples, points), **ring, markersize=2.5, markeredgewidth=0.6, label=marks)
        axes.set(xlabel="time [s]", xlim=(times[0], times[-1]))
        largest = float(np.nanmax(np.abs(values)))
        label_values(axes, shown.name, shown.unit, largest)
        _make_room(axes, times, values)
        end = int(np.searchsorted(times, instants[0] + inset_cycles * period + 0.5 / record.sample_rate))
        inset = axes.inset_axes(INSET)
        inset.plot(*envelope(times[:end], values[:end], points), color=BLUE)
        near = instants <= times[end - 1]
        inset.plot(*envelope(instants[near], samples[near], points), **ring, markersize=5.0, markeredgewidth=1.0)
        inset.margins(x=0.02, y=0.12)
        label_values(inset, "", shown.unit, largest)
        inset.set_title(f"the first {min(inset_cycles, cycles.n_cycles)} periods, same units", fontsize=8.0, pad=3.0)
        inset.tick_params(labelsize=8.0)
        finish(figure)
    return figure


def _marks(cycles: Cycles, phase: int, periods_per_revolution: int | None) -> str:
    """What the circles stand for: the number of the phase, or the angles of the shaft."""
    if periods_per_revolution is None:
        return f"phase {phase} of {cycles.n_phases}, once a period"
    step = degrees_a_period(periods_per_revolution, "time_record")
    first = (cycles.first_phase + phase / cycles.n_phases) % 1.0 * step
    if periods_per_revolution > MOST_ANGLES:
        return f"shaft at {first:.4g}° and every {step:.4g}° from there"
    return "shaft at " + " or ".join(f"{first + step * number:.4g}°" for number in range(periods_per_revolution))


def _make_room(axes: Axes, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Set the limits of the axes so that the record passes below the inset."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    pad = 0.05 * (high - low)
    bottom, top = low - pad, high + pad
    beside = values[int((INSET[0] - 0.08) * len(times)) :]
    needed = bottom + (float(np.nanmax(beside)) + pad - bottom) / INSET_WITH_LABELS
    axes.set_ylim(bottom, max(top, needed))


def _below(value: int, end: int, argument: str, of: str) -> None:
    integer(value, argument, of, at_least=0)
    if value >= end:
        raise input_error(argument, of, f"be less than {end}", f"is {value}", "Counting starts at 0.")
