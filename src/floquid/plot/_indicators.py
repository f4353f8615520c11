"""Mode indicator functions and singular values: how many modes there seem to be before any is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import integer
from floquid.lti import WHITE
from floquid.order import Indicators
from floquid.plot._several import legend_of_all, several
from floquid.plot._style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    new_figure,
    plain,
    style,
)
from floquid.views import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

LOOKS = ((BLUE, "-", 1.8), (ORANGE, "-", 1.2), (GREEN, (0, (4, 1.5)), 1.2), (PURPLE, (0, (1, 1)), 1.2))
"""Colour, dashes and width of the first curves; those further down lie on one another."""

DEEP = 20
"""How many singular values are shown beyond those above the noise."""


def indicators(found: Indicators | Mapping[str, Indicators], *, points: int = 4000, angular: bool = False) -> Figure:
    """Mode indicator functions over the band 0 to ω/2, and the singular values of the responses, both over the noise.

    On the left, 1 is where white noise alone would lie: of the mode indicator functions (CMIF) its expected end, of the
    composite its mean. A second CMIF that rises where the first does means a second mode. On the right, each value
    above the line is the trace of a pole.

    Parameters
    ----------
    found
        What `order.indicators` found, or several of them by name: then a row each.
    points
        The most points a curve is drawn with.
    angular
        Frequencies in rad/s instead of Hz.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        `found` is neither, or there are more of them than fit a figure.
    """
    of = "indicators"
    named = several(found, Indicators, "found", of)
    integer(points, "points", of, at_least=2)
    turn, unit = (2.0 * np.pi, "rad/s") if angular else (1.0, "Hz")
    with style():
        figure = new_figure(7.0, 3.8 if len(named) == 1 else 0.8 + 2.8 * len(named))
        panels = figure.subplots(len(named), 2, squeeze=False, width_ratios=(3, 2))
        for (left, right), (name, one) in zip(panels, named.items(), strict=True):
            _draw_curves(left, one, points, turn)
            _draw_values(right, one)
            if name:
                left.set_title(plain(name), loc="left")
        panels[-1, 0].set_xlabel(rf"lifted band, 0 to $\omega$/2 [{unit}]")
        panels[-1, 1].set_xlabel("number")
        legend_of_all(figure)
    return figure


def _draw_curves(axes: Axes, found: Indicators, points: int, turn: float) -> None:
    """The mode indicator functions and the composites, over white noise."""
    x = found.angles * turn / (2.0 * np.pi * found.dt)
    for number, (curve, (color, dashes, width)) in enumerate(zip(found.cmif.T, LOOKS, strict=False), start=1):
        look = {"color": color, "linestyle": dashes, "linewidth": width}
        axes.plot(*envelope(x, curve, points), **look, label=f"CMIF {number}")
    axes.plot(*envelope(x, found.composite / WHITE, points), color=GREY, linewidth=1.0, label="composite", zorder=1.9)
    if found.residual is not None:
        curve = envelope(x, found.residual / WHITE, points)
        axes.plot(*curve, color=VERMILION, linewidth=0.8, label="composite, data − model")
    axes.axhline(1.0, color=BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    axes.set(yscale="log", xlim=(0.0, x[-1]), ylabel="magnitude / white noise [-]")
    plain_decades(axes)
    axes.set_ylim(bottom=min(0.3, 0.5 * float(found.composite.min() / WHITE)))


def _draw_values(axes: Axes, found: Indicators) -> None:
    """The leading singular values and the largest of noise."""
    shown = min(len(found.singular_values), found.n_above + DEEP)
    numbers, values = np.arange(1, shown + 1), found.singular_values[:shown]
    floor = np.finfo(float).eps * values[0]
    values = np.maximum(values, floor)
    look = {"linestyle": "none", "marker": "o", "color": BLUE, "markersize": 3.5}
    above = numbers <= found.n_above
    axes.plot(numbers[above], values[above], **look, label="above the noise")
    axes.plot(numbers[~above], values[~above], **look, markerfacecolor="none", label="not above it")
    axes.axhline(found.noise_edge, color=BLACK, linestyle="--", linewidth=0.9)
    axes.set(yscale="log", xlim=(0.0, shown + 1.0), ylabel="singular values / noise [-]")
    whole_numbers(axes.xaxis)
    plain_decades(axes)
    axes.text(0.97, 0.96, f"{found.n_above} above the noise", transform=axes.transAxes, ha="right", va="top")


def whole_numbers(axis: Axis) -> None:
    """Put ticks at whole numbers alone."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True))


def plain_decades(axes: Axes) -> None:
    """Write 1, 2, 5, 10 … on a logarithmic axis of a few decades; of many, the powers of ten."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    few = high < 1e3 * max(low, 1e-300)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=12))
    axes.yaxis.set_major_formatter((lambda value, _: f"{value:g}") if few else LogFormatterSciNotation())
    axes.yaxis.set_minor_formatter(NullFormatter())
