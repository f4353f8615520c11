"""Figures of a record: its samples and the model over them, and how it was tied to the phase."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import index, integer, wrong_value
from floquid.core import Cycles, Record, channels_named
from floquid.findings import Severity
from floquid.fit import WITHIN
from floquid.pipeline import Analysis
from floquid.plot._style import POINTS, Into, degrees_a_period, drawing, grid_of, label_values, plain, whole_numbers
from floquid.sync import ShaftAngle
from floquid.views import (
    Ink,
    SpeedUnit,
    Synchronisation,
    Synthesis,
    check_analysis,
    envelope,
    lifted_points,
    speed_texts,
)
from floquid.views import speed_unit as unit_of_speed
from floquid.views import synchronisation as synchronisation_of
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


WIDE = 6.0  # times the narrowest interval beyond which a stretch does not set the scale
SIGNIFICANT = 4.0  # standard deviations from which on a difference of periods is one

LOOKS = ((Ink.BLUE, "o"), (Ink.VERMILION, "s"), (Ink.GREEN, "^"), (Ink.ORANGE, "D"), (Ink.PURPLE, "v"), (Ink.SKY, "P"))
"""Told apart by form as well as by colour."""

SPEED_POINTS = 1000  # instants at which the speed is drawn
ACROSS = 95  # characters of a row of the title


def synchronisation(analysis: Analysis, *, hit: int = 0, ax: Into = None) -> Figure:
    """By how much the response is ahead of the phase that the period or the tachometer gives it, along the record.

    Above is the slip of the response, in degrees of the period, in each stretch of the record, with the straight line
    through it. On a record that keeps step it lies about zero, within its bars. A slope is another period, a curve a
    speed that wanders, a jump a pulse too many or too few. Below are the phases of the strongest lines against the
    model: harmonic m of a mode turns m times as far as the slip; where all lines of a mode turn together it is the
    exponent that is off, and not the period.

    `analysis` is what `identify` found, `hit` counts from 0, and `ax` are two axes to draw into. Raises InputError
    where there is no such hit, or the axes do not fit.
    """
    found = synchronisation_of(analysis, hit)
    with drawing(5.2, ax, "synchronisation", panels=grid_of(2), sharex=True) as (figure, (upper, lower)):
        _draw_slip(upper, found)
        _draw_phases(lower, found, analysis.model.upper_modes)
        upper.set_title(_verdict(found), loc="left")
        lower.set_title("phase of the strongest lines", loc="left")
        lower.set_xlabel("time [s]")
        upper.set_ylabel("ahead of the clock\n[deg of the period]")
        lower.set_ylabel("ahead of the model\n[deg of the line]")
    return figure


def _draw_slip(axes: Axes, found: Synchronisation) -> None:
    """The slip with its intervals, and the straight line through it."""
    axes.axhline(0.0, color=Ink.BLACK, linewidth=0.9)
    told = found.told
    slip, width = np.degrees(found.slip[told]), WITHIN * np.degrees(found.slip_std[told])
    look = {"linestyle": "none", "marker": "o", "markersize": 4.0, "color": Ink.BLACK, "capsize": 2.0}
    axes.errorbar(found.times[told], slip, width, **look, label="slip, 95 % intervals")
    if np.isfinite(found.relative):
        line = np.degrees(found.offset - 2.0 * np.pi * found.cycles * found.relative)
        axes.plot(found.times, line, color=Ink.VERMILION, linestyle="--", label="straight line through it")
    _limit(axes, slip, width)


def _draw_phases(axes: Axes, found: Synchronisation, upper: tuple[int, ...]) -> None:
    """The phases of the lines, side by side within each stretch, so that their bars can be told apart."""
    axes.axhline(0.0, color=Ink.BLACK, linewidth=0.9)
    apart = np.diff(found.times).min(initial=np.inf) if len(found.times) > 1 else 0.0
    every, bars = [], []
    for number, (mode, m) in enumerate(zip(found.modes, found.harmonics, strict=True)):
        told = np.isfinite(found.phases[number])
        phase, width = np.degrees(found.phases[number, told]), WITHIN * np.degrees(found.phases_std[number, told])
        x = found.times[told] + apart * 0.09 * (number - 0.5 * (len(found.modes) - 1))
        color, marker = LOOKS[number]
        look = {"linestyle": "none", "marker": marker, "markersize": 3.5, "color": color, "linewidth": 0.8}
        words = f"mode {upper.index(int(mode)) + 1}, $m$ = {int(m):+d}".replace("+0", "0")
        axes.errorbar(x, phase, width, **look, label=words.replace("-", "−"))
        every.append(phase)
        bars.append(width)
    _limit(axes, np.concatenate(every or [np.zeros(0)]), np.concatenate(bars or [np.zeros(0)]))


def _limit(axes: Axes, values: np.ndarray, widths: np.ndarray) -> None:
    """A scale on which the stretches that tell most are seen; the bars of those that tell little reach beyond it."""
    if not len(values):
        return
    sure = widths <= WIDE * np.quantile(widths, 0.25)
    reach = 1.2 * max(float((np.abs(values) + widths)[sure].max()), 1e-12)
    axes.set_ylim(-reach, reach)


def _verdict(found: Synchronisation) -> str:
    """Summary of the slips, in words."""
    if not np.isfinite(found.relative):
        return "The response does not tell its period: no mode with two harmonics that holds is seen in two stretches."
    off = abs(found.relative) / found.relative_std if found.relative_std > 0 else 0.0
    verdict = "another period" if off > SIGNIFICANT else "no other period"
    words = f"own period − period used: ({found.parts_in_a_million()}) · 10⁻⁶ of it, {verdict}"
    if np.isfinite(found.misfit):
        words += f"\nscatter about the straight line, over that of the noise: {np.sqrt(found.misfit):.2g}"
    return words.replace("-", "−")


def speed(shaft: ShaftAngle, record: Record | None = None, *, speed_unit: SpeedUnit = "hz", ax: Into = None) -> Figure:
    """The speed against time with its band, the residuals of the pulses, and the geometry of an encoder; the verdict.

    `shaft` is what `sync.shaft_angle` found. What lies outside the evidence of a `record` is drawn too, shaded. The
    speed is in `speed_unit`, "hz" or "rpm", and `ax` are two axes to draw into, of an encoder three. Raises InputError
    where one of these is something else.
    """
    if not isinstance(shaft, ShaftAngle):
        raise wrong_value("shaft", "speed", "be a ShaftAngle", shaft, "Pass sync.shaft_angle(record).")
    if record is not None and not isinstance(record, Record):
        raise wrong_value("record", "speed", "be a Record or None", record)
    begin, end = shaft.first, shaft.last
    if record is not None:
        begin, end = min(begin, record.start), max(end, float(record.times[-1]))
    (symbol, factor), rows = unit_of_speed(speed_unit, "speed"), 2 if shaft.geometry is None else 3
    with drawing(0.8 + 1.7 * rows, ax, "speed", panels=grid_of(rows)) as (figure, panels):
        _draw_speed(panels[0], shaft, begin, end, symbol, factor / (2.0 * np.pi))
        _draw_residuals(panels[1], shaft)
        panels[0].sharex(panels[1])
        margin = 0.02 * (end - begin)
        panels[1].set(xlim=(begin - margin, end + margin), xlabel="time [s]")
        if shaft.geometry is not None:
            _draw_geometry(panels[2], shaft)
        for axes in panels[:2]:
            for low, high in ((begin - margin, shaft.first), (shaft.last, end + margin)):
                axes.axvspan(low, high, color=Ink.SILVER, alpha=0.15, linewidth=0.0)
        (verdict,) = speed_texts(shaft.findings[:1], speed_unit, *Severity)
        panels[0].set_title("\n".join(textwrap.wrap(verdict, ACROSS)), loc="left")
    return figure


def _draw_speed(axes: Axes, shaft: ShaftAngle, begin: float, end: float, unit: str, factor: float) -> None:
    """The speed with its band; the mean, in a `unit`; 1 rad/s has `factor` of them."""
    times = np.linspace(begin, end, SPEED_POINTS)
    curve, width = factor * shaft.speed(times), WITHIN * factor * shaft.speed_std(times)
    band = {"color": Ink.BLUE, "alpha": 0.25, "linewidth": 0.0}
    axes.fill_between(times, curve - width, curve + width, **band, label="95 % interval")
    axes.plot(times, curve, color=Ink.BLUE, label="speed")
    axes.axhline(factor * shaft.mean_speed, color=Ink.BLACK, linestyle="--", linewidth=0.9, label="mean")
    label_values(axes, "speed", unit, float(curve.max()))
    axes.tick_params(labelbottom=False)


def _draw_residuals(axes: Axes, shaft: ShaftAngle) -> None:
    """Residual of each pulse, as a time or as an angle; those left out, apart."""
    if shaft.jitter_unit == "s":
        values, unit, name = -1e6 * shaft.residuals / shaft.mean_speed, "µs", "pulse − fit"  # ahead in angle is early
        std = 1e6 * shaft.jitter
    else:
        values, unit, name = np.degrees(shaft.residuals), "deg", "azimuth − fit"
        std = float(np.degrees(shaft.jitter))
    kept = shaft.kept
    limit = 1.15 * max(float(np.abs(values[kept]).max()), 3.0 * std)
    axes.axhspan(-WITHIN * std, WITHIN * std, color=Ink.BLUE, alpha=0.12, linewidth=0.0)
    axes.plot(shaft.times[kept], values[kept], linestyle="none", marker="o", markersize=2.0, color=Ink.BLUE)
    out = np.clip(values[~kept], -limit, limit)
    if len(out):
        cross: dict[str, Any] = {"linestyle": "none", "marker": "x", "color": Ink.VERMILION}
        axes.plot(shaft.times[~kept], out, **cross, label="left out (at the rim: off scale)")
    axes.set_ylim(-1.05 * limit, 1.05 * limit)
    label_values(axes, name, unit, limit)


def _draw_geometry(axes: Axes, shaft: ShaftAngle) -> None:
    """Distance of each line from even spacing."""
    assert shaft.geometry is not None
    assert shaft.geometry_std is not None
    values, deviations = np.degrees(shaft.geometry), np.degrees(shaft.geometry_std)
    numbers = np.arange(len(values))
    axes.errorbar(numbers, values, WITHIN * deviations, linestyle="none", marker="o", markersize=3.0, color=Ink.ORANGE)
    axes.axhline(0.0, color=Ink.BLACK, linewidth=0.7)
    axes.set_xlabel("line of the encoder")
    whole_numbers(axes.xaxis)
    label_values(axes, "ahead of even", "deg", float(np.nanmax(np.abs(values))))
