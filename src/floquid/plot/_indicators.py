"""Indications before any model, and the part that a model explains: mode indicators, singular values and composites."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import input_error
from floquid.lti import WHITE, composites
from floquid.order import Indicators
from floquid.pipeline import Analysis
from floquid.plot._style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    POINTS,
    PURPLE,
    VERMILION,
    Into,
    drawing,
    frequency_unit,
    grid_of,
    plain,
    plain_decades,
    several,
    whole_numbers,
)
from floquid.views import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = ((BLUE, "-", 1.8), (ORANGE, "-", 1.2), (GREEN, (0, (4, 1.5)), 1.2), (PURPLE, (0, (1, 1)), 1.2))
"""Colour, dashes and width of the first curves; those further down lie on one another."""

DEEP = 20  # how many singular values are shown beyond those above the noise


def indicators(found: Indicators, *, ax: Into = None) -> Figure:
    """Mode indicator functions over the band 0 to ω/2, and the singular values of the responses, both over the noise.

    On the left, 1 is where white noise alone would lie: of the mode indicator functions (CMIF) its expected end, of the
    composite its mean. A second CMIF that rises where the first does means a second mode. On the right, each value
    above the line is the trace of a pole.

    `found` is what `order.indicators` found, and `ax` are two axes to draw into. Raises InputError where one is
    something else.
    """
    if not isinstance(found, Indicators):
        remedy = "Pass what `order.indicators` gives."
        raise input_error("found", "indicators", "be an Indicators", f"is {found!r:.60}", remedy)
    with drawing(3.8, ax, "indicators", panels=grid_of(1, 2), width_ratios=(3, 2)) as (figure, (left, right)):
        _draw_curves(left, found)
        _draw_values(right, found)
        left.set_xlabel(r"lifted band, 0 to $\omega$/2 [Hz]")
        right.set_xlabel("number")
    return figure


def _draw_curves(axes: Axes, found: Indicators) -> None:
    """The mode indicator functions and the composites, over white noise."""
    x = found.angles / (2.0 * np.pi * found.dt)
    for number, (curve, (color, dashes, width)) in enumerate(zip(found.cmif.T, LOOKS, strict=False), start=1):
        look = {"color": color, "linestyle": dashes, "linewidth": width}
        axes.plot(*envelope(x, curve, POINTS), **look, label=f"CMIF {number}")
    axes.plot(*envelope(x, found.composite / WHITE, POINTS), color=GREY, linewidth=1.0, label="composite", zorder=1.9)
    if found.residual is not None:
        curve = envelope(x, found.residual / WHITE, POINTS)
        axes.plot(*curve, color=VERMILION, linewidth=0.8, label="composite, data − model")
    axes.axhline(1.0, color=BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    axes.set(yscale="log", xlim=(0.0, x[-1]), ylabel="magnitude / white noise")
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
    axes.set(yscale="log", xlim=(0.0, shown + 1.0), ylabel="singular values / noise")
    whole_numbers(axes.xaxis)
    plain_decades(axes)
    axes.text(0.97, 0.96, f"{found.n_above} above the noise", transform=axes.transAxes, ha="right", va="top")


def composite(analysis: Analysis | Mapping[str, Analysis], *, angular: bool = False, ax: Into = None) -> Figure:
    """Composites of the data, of the model and of their difference, over the band 0 to ω/2 of the lifted responses.

    A composite is the mean magnitude of the spectra of all lifted responses, each over the standard deviation of its
    noise. Where the difference lies on the level of white noise, the model has explained all there is. Marks show the
    frequencies of the modes, folded into the band.

    `analysis` is what `identify` found, or several by name: then one panel each. With `angular` frequencies are in
    rad/s instead of Hz. `ax` are the axes to draw into, one for each analysis. Raises InputError where `analysis` is
    something else, there are more of them than fit a figure, or the axes do not fit.
    """
    named = several(analysis, Analysis, "analysis", "composite")
    turn, unit = frequency_unit(angular=angular)
    height = 4.0 if len(named) == 1 else 1.0 + 2.6 * len(named)
    with drawing(height, ax, "composite", panels=grid_of(len(named)), sharex=True) as (figure, panels):
        for axes, (name, one) in zip(panels, named.items(), strict=True):
            _draw_composites(axes, one, turn)
            filtered = "" if one.lifted.whitening is None else ",\nafter the whitening filter"
            axes.set_ylabel(f"mean magnitude / noise{filtered}")
            if name:
                axes.set_title(plain(name), loc="left")
        panels[-1].set_xlabel(rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]")
    return figure


def _draw_composites(axes: Axes, analysis: Analysis, turn: float) -> None:
    """The composites of one analysis, the level of white noise, and its modes, at `turn` times frequencies in Hz."""
    found = analysis.modal.composites or composites(analysis.lifted.responses, analysis.modal)
    scale = turn / (2.0 * np.pi * analysis.lifted.period)
    curves = {
        "data": (found.data, {"color": BLUE, "linewidth": 2.2}),
        "model": (found.model, {"color": ORANGE, "linewidth": 1.0}),
        "data − model": (found.difference, {"color": VERMILION, "linewidth": 0.8}),
    }
    for name, (values, look) in curves.items():
        axes.plot(*envelope(found.angles * scale, values, POINTS), **look, label=name)
    axes.axhline(WHITE, color=BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    for number, angle in enumerate(np.unique(np.abs(np.angle(analysis.modal.multipliers)))):
        label = "modes, folded" if number == 0 else None
        axes.axvline(angle * scale, color=GREY, linestyle=(0, (2, 2)), linewidth=0.8, label=label, zorder=1)
    axes.set(yscale="log", xlim=(0.0, np.pi * scale))
    # The model may fall to nothing far from its modes, and would flatten all the rest.
    axes.set_ylim(bottom=0.5 * min(WHITE, float(found.difference[found.difference > 0].min(initial=WHITE))))
