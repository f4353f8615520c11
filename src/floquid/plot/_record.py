"""The record in time: with the samples that one lifted response takes from it, and beside what the model says of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import index, integer
from floquid.core import Cycles, channels_named
from floquid.fit import WITHIN
from floquid.pipeline import Analysis
from floquid.plot._style import POINTS, Into, degrees_a_period, drawing, grid_of, label_values, plain
from floquid.views import Ink, Synthesis, check_analysis, envelope, lifted_points
from floquid.views import synthesis as synthesis_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSET = (0.36, 0.58, 0.62, 0.33)  # where the inset is: left, bottom, width and height as shares of the axes
MOST_ANGLES = 3  # how many angles of the shaft the legend lists
INSET_WITH_LABELS = 0.46  # the height below which the record must stay beside the inset, as a share of the axes
STRETCHES = 40  # stretches of the record, each with its rms of the residual

_RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none"}
_MODEL: dict[str, Any] = {"color": Ink.VERMILION, "linestyle": "-"}


def time_record(
    analysis: Analysis,
    channel: str | None = None,
    phase: int = 0,
    *,
    hit: int = 0,
    inset_cycles: int = 5,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    """The free response of one channel, and circles at the samples of one phase: one lifted response.

    An inset shows the first cycles (Allen 2009, figure 2). A long record is drawn by its envelope.

    Raises InputError where there is no such channel, phase or hit.

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
    periods_per_revolution
        Name the phase by the angles of the shaft, which turns once in this many periods; not given, by its number.
    ax
        The axes to draw into; a new figure when not given.
    """
    of = "time_record"
    index(hit, "hit", of, len(analysis.cycles))
    record, cycles = analysis.responses[hit], analysis.cycles[hit]
    row = 0 if channel is None else channels_named(record.channels, [channel], argument="channel", of=of)[0]
    index(phase, "phase", of, cycles.n_phases)
    integer(inset_cycles, "inset_cycles", of, at_least=1)
    times, values = record.times, record.values[row]
    period = analysis.model.period
    instants = lifted_points(analysis, row, hit)[0] + phase / cycles.n_phases * period
    samples = cycles.values[row, phase]
    with drawing(4.0, ax, of) as (figure, (axes,)):
        shown = record.channels[row]
        label = plain(shown.name) + (f", hit {hit + 1}" if len(analysis.cycles) > 1 else "")
        axes.plot(*envelope(times, values, POINTS), color=Ink.BLUE, linewidth=0.7, label=label)
        marks = _marks(cycles, phase, periods_per_revolution)
        ring: dict[str, Any] = {**_RING, "color": Ink.VERMILION}
        axes.plot(*envelope(instants, samples, POINTS), **ring, markersize=2.5, markeredgewidth=0.6, label=marks)
        axes.set(xlabel="time [s]", xlim=(times[0], times[-1]))
        largest = float(np.nanmax(np.abs(values)))
        label_values(axes, shown.name, shown.unit, largest)
        _make_room(axes, times, values)
        end = int(np.searchsorted(times, instants[0] + inset_cycles * period + 0.5 / record.sample_rate))
        inset = axes.inset_axes(INSET)
        inset.plot(*envelope(times[:end], values[:end], POINTS), color=Ink.BLUE)
        near = instants <= times[end - 1]
        inset.plot(*envelope(instants[near], samples[near], POINTS), **ring, markersize=5.0, markeredgewidth=1.0)
        inset.margins(x=0.02, y=0.12)
        label_values(inset, "", shown.unit, largest)
        inset.set_title(f"the first {min(inset_cycles, cycles.n_cycles)} periods, same units", fontsize=8.0, pad=3.0)
        inset.tick_params(labelsize=8.0)
    return figure


def _marks(cycles: Cycles, phase: int, periods_per_revolution: int | None) -> str:
    """Meaning of the circles: the number of the phase, or the angles of the shaft."""
    if periods_per_revolution is None:
        return f"phase {phase} of {cycles.n_phases}, once a period"
    step = degrees_a_period(periods_per_revolution, "time_record")
    first = (cycles.first_phase + phase / cycles.n_phases) % 1.0 * step
    if periods_per_revolution > MOST_ANGLES:
        return f"shaft at {first:.4g}° and every {step:.4g}° from there"
    return "shaft at " + " or ".join(f"{first + step * number:.4g}°" for number in range(periods_per_revolution))


def _make_room(axes: Axes, times: Floats, values: Floats) -> None:
    """Set the limits of the axes so that the record passes below the inset."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    pad = 0.05 * (high - low)
    bottom, top = low - pad, high + pad
    beside = values[int((INSET[0] - 0.08) * len(times)) :]
    needed = bottom + (float(np.nanmax(beside)) + pad - bottom) / INSET_WITH_LABELS
    axes.set_ylim(bottom, max(top, needed))


def synthesis(
    analysis: Analysis, channel: str | None = None, *, hit: int = 0, close_cycles: int = 4, ax: Into = None
) -> Figure:
    """A channel of the record with the model's response over it: the first cycles, the whole record, the residual.

    Below, the residual lies between the broken lines, 1.96 deviations of the noise, where the model has explained all
    there is; the steps are its root mean square in stretches of the record. The record is the one identified from, as
    `views.synthesis` has it.

    Raises InputError where there is no such channel or hit.

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
    ax
        Three axes to draw into; a new figure when not given.
    """
    of = "synthesis"
    check_analysis(analysis, of, hit=hit)
    integer(close_cycles, "close_cycles", of, at_least=1)
    shown = analysis.model.channels
    row = 0 if channel is None else channels_named(shown, [channel], argument="channel", of=of)[0]
    found = synthesis_of(analysis, row, hit)
    name, unit = shown[row].name, shown[row].unit
    with drawing(6.2, ax, of, panels=grid_of(3), height_ratios=(1.2, 1.2, 1.0)) as (figure, (close, whole, left)):
        _draw_close(close, found, close_cycles * analysis.model.period)
        whole.plot(*envelope(found.times, found.measured, POINTS), color=Ink.BLUE, linewidth=0.8, label="measured")
        whole.plot(*envelope(found.times, found.predicted, POINTS), **_MODEL, linewidth=0.5, label="model")
        whole.set_xlim(found.times[0], found.times[-1])
        _draw_left(left, found)
        largest = float(np.nanmax(np.abs(found.measured)))
        label_values(close, "response", unit, largest)
        label_values(whole, "response", unit, largest)
        label_values(left, "residual", unit, float(np.nanmax(np.abs(left.get_ylim()))))
        cycles = "cycle" if close_cycles == 1 else f"{close_cycles} cycles"
        hits = f", hit {hit + 1}" if analysis.model.n_hits > 1 else ""
        close.set_title(f"the first {cycles} of {plain(name)}{hits}", loc="left")
        whole.set_title("the whole record", loc="left")
        rms = float(np.sqrt(np.nanmean(found.residual**2)))
        left.set_title(f"residual: {rms / found.noise:.3f} times the noise (rms)", loc="left")
        left.set_xlabel("time [s]")
        whole.tick_params(labelbottom=False)
    return figure


def _draw_close(axes: Axes, found: Synthesis, length: float) -> None:
    """The samples of the first cycles as rings, and the response through them."""
    inside = found.times <= found.times[0] + length * (1.0 + 1e-9)
    times = found.times[inside]
    axes.plot(
        times, found.measured[inside], **_RING, color=Ink.BLUE, markersize=3.6, markeredgewidth=0.8, label="measured"
    )
    axes.plot(times, found.predicted[inside], **_MODEL, linewidth=1.2, label="model")
    axes.set_xlim(times[0], times[-1])


def _draw_left(axes: Axes, found: Synthesis) -> None:
    """Residual between the lines of the noise, and its rms stretch by stretch."""
    axes.plot(*envelope(found.times, found.residual, POINTS), color=Ink.SILVER, linewidth=0.5, label="measured − model")
    for side in (-WITHIN, WITHIN):
        axes.axhline(side * found.noise, color=Ink.BLACK, linestyle="--", linewidth=0.9, label="95 % of the noise")
    edges, rms = _steps(found)
    axes.stairs(rms, edges, baseline=None, color=Ink.ORANGE, linewidth=1.6, zorder=3, label="rms of the residual")
    axes.set_xlim(found.times[0], found.times[-1])
    # What the model leaves out early on would hide all the rest if it set the scale alone.
    reach = max(3.0 * WITHIN * found.noise, 1.1 * float(np.nanquantile(np.abs(found.residual), 0.999)))
    axes.set_ylim(-reach, reach)


def _steps(found: Synthesis) -> tuple[Floats, Floats]:
    """The ends of equal stretches [s] and the rms of the residual in each; NaN where nothing was sampled."""
    count = max(1, min(STRETCHES, len(found.times) // 50))
    place = np.arange(len(found.times)) * count // len(found.times)
    there = np.isfinite(found.residual)
    held = np.bincount(place[there], found.residual[there] ** 2, count)
    number = np.bincount(place[there], minlength=count)
    rms = np.sqrt(np.divide(held, number, out=np.full(count, np.nan), where=number > 0))
    firsts = np.searchsorted(place, np.arange(count))
    return np.append(found.times[firsts], found.times[-1]), rms
