"""Slip of a record against its period or its tachometer, and the speed that the tachometer tells."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._checks import wrong_value
from floquid.core import Record
from floquid.findings import Severity
from floquid.fit import WITHIN
from floquid.pipeline import Analysis
from floquid.plot._style import Into, drawing, grid_of, label_values, whole_numbers
from floquid.sync import ShaftAngle
from floquid.views import Ink, SpeedUnit, Synchronisation, speed_texts
from floquid.views import speed_unit as unit_of_speed
from floquid.views import synchronisation as synchronisation_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE = 6.0  # times the narrowest interval beyond which a stretch does not set the scale
SIGNIFICANT = 4.0  # standard deviations from which on a difference of periods is one

LOOKS = ((Ink.BLUE, "o"), (Ink.VERMILION, "s"), (Ink.GREEN, "^"), (Ink.ORANGE, "D"), (Ink.PURPLE, "v"), (Ink.SKY, "P"))
"""Told apart by form as well as by colour."""

POINTS = 1000  # instants at which the speed is drawn
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
    times = np.linspace(begin, end, POINTS)
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
