"""The speed of the shaft, what is left over of its pulses, and the lines of its encoder."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import input_error
from floquid.core import Record
from floquid.plot._indicators import whole_numbers
from floquid.plot._several import legend_of_all
from floquid.plot._style import BLACK, BLUE, GREY, ORANGE, VERMILION, label_values, new_figure, style
from floquid.sync import ShaftAngle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND = 2.0
"""Standard deviations on either side."""

POINTS = 1000
"""Instants at which the speed is drawn."""

ACROSS = 95
"""Characters of a row of the title."""


def speed(shaft: ShaftAngle, record: Record | None = None, *, rpm: bool = False) -> Figure:
    """The speed against time with its band, the residuals of the pulses, and the geometry of an encoder; the verdict.

    Parameters
    ----------
    shaft
        What `sync.shaft_angle` found.
    record
        The record: what of it lies outside the evidence is drawn too, shaded.
    rpm
        The speed in revolutions a minute instead of Hz.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        `shaft` is not a ShaftAngle, or `record` not a Record.
    """
    if not isinstance(shaft, ShaftAngle):
        raise input_error("shaft", "speed", "be a ShaftAngle", f"is {shaft!r:.60}", "Pass sync.shaft_angle(record).")
    if record is not None and not isinstance(record, Record):
        raise input_error("record", "speed", "be a Record or None", f"is {record!r:.60}")
    begin, end = shaft.first, shaft.last
    if record is not None:
        begin, end = min(begin, record.start), max(end, float(record.times[-1]))
    rows = 2 if shaft.geometry is None else 3
    with style():
        figure = new_figure(7.0, 0.8 + 1.7 * rows)
        panels = figure.subplots(rows, 1)
        _draw_speed(panels[0], shaft, begin, end, rpm=rpm)
        _draw_residuals(panels[1], shaft)
        panels[0].sharex(panels[1])
        margin = 0.02 * (end - begin)
        panels[1].set(xlim=(begin - margin, end + margin), xlabel="time [s]")
        if shaft.geometry is not None:
            _draw_geometry(panels[2], shaft)
        for axes in panels[:2]:
            for low, high in ((begin - margin, shaft.first), (shaft.last, end + margin)):
                axes.axvspan(low, high, color=GREY, alpha=0.15, linewidth=0.0)
        panels[0].set_title("\n".join(textwrap.wrap(shaft.reasons[0], ACROSS)), loc="left")
        legend_of_all(figure)
    return figure


def _draw_speed(axes: Axes, shaft: ShaftAngle, begin: float, end: float, *, rpm: bool) -> None:
    """The speed with its band; the mean."""
    factor, unit = (60.0, "rpm") if rpm else (1.0, "Hz")
    factor /= 2.0 * np.pi
    times = np.linspace(begin, end, POINTS)
    curve, width = factor * shaft.speed(times), BAND * factor * shaft.speed_std(times)
    axes.fill_between(
        times, curve - width, curve + width, color=BLUE, alpha=0.25, linewidth=0.0, label=f"± {BAND:g} std"
    )
    axes.plot(times, curve, color=BLUE, label="speed")
    axes.axhline(factor * shaft.mean_speed, color=BLACK, linestyle="--", linewidth=0.9, label="mean")
    label_values(axes, "speed", unit, float(curve.max()))
    axes.tick_params(labelbottom=False)


def _draw_residuals(axes: Axes, shaft: ShaftAngle) -> None:
    """What each pulse lies off the fit, as a time or as an angle; those left out, apart."""
    if shaft.jitter_unit == "s":
        values, unit, name = -1e6 * shaft.residuals / shaft.mean_speed, "µs", "pulse − fit"  # ahead in angle is early
        std = 1e6 * shaft.jitter
    else:
        values, unit, name = np.degrees(shaft.residuals), "deg", "azimuth − fit"
        std = float(np.degrees(shaft.jitter))
    kept = shaft.kept
    limit = 1.15 * max(float(np.abs(values[kept]).max()), 3.0 * std)
    axes.axhspan(-BAND * std, BAND * std, color=BLUE, alpha=0.12, linewidth=0.0)
    axes.plot(shaft.times[kept], values[kept], linestyle="none", marker="o", markersize=2.0, color=BLUE)
    out = np.clip(values[~kept], -limit, limit)
    if len(out):
        axes.plot(
            shaft.times[~kept],
            out,
            linestyle="none",
            marker="x",
            color=VERMILION,
            label="left out (at the rim: off scale)",
        )
    axes.set_ylim(-1.05 * limit, 1.05 * limit)
    label_values(axes, name, unit, limit)


def _draw_geometry(axes: Axes, shaft: ShaftAngle) -> None:
    """How far each line is ahead of even spacing."""
    assert shaft.geometry is not None
    assert shaft.geometry_std is not None
    values, deviations = np.degrees(shaft.geometry), np.degrees(shaft.geometry_std)
    numbers = np.arange(len(values))
    axes.errorbar(numbers, values, BAND * deviations, linestyle="none", marker="o", markersize=3.0, color=ORANGE)
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    axes.set_xlabel("line of the encoder")
    whole_numbers(axes.xaxis)
    label_values(axes, "ahead of even", "deg", float(np.nanmax(np.abs(values))))
