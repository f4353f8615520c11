"""The poles of every order of a scan: those that stay line up in columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import an_instance, integer
from floquid.lti import WHITE, Outcome, composites
from floquid.order import Indicators, OrderScan, Stability
from floquid.pipeline import Analysis
from floquid.plot._style import (
    POINTS,
    Into,
    drawing,
    frequency_unit,
    grid_of,
    plain,
    plain_decades,
    several,
    whole_numbers,
)
from floquid.views import Ink, end_of_lines, envelope, record_spectrum, unfolded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MARKS: dict[Stability, tuple[str, dict[str, Any]]] = {  # told apart by form as well as by colour
    Stability.NEW: ("new", {"marker": ".", "color": Ink.SILVER, "markersize": 3.0}),
    Stability.FREQUENCY: ("stable in frequency", {"marker": "+", "color": Ink.VERMILION, "markersize": 5.0}),
    Stability.DAMPING: (
        "and damping",
        {"marker": "s", "color": Ink.GREEN, "markersize": 4.0, "markerfacecolor": "none"},
    ),
    Stability.SHAPE: ("and shape", {"marker": "o", "color": Ink.BLUE, "markersize": 4.0}),
}


def stabilisation(
    scan: OrderScan, *, analysis: Analysis | None = None, chosen: int | None = None, ax: Into = None
) -> Figure:
    """The frequencies of the poles of each order, marked by how far they agree with those of the order before.

    Lifted responses fold all frequencies into the band from 0 to ω/2. Real multipliers lie on its edges. Behind the
    poles is the largest mode indicator function, on the axis to the right.

    With an analysis the axis is unfolded: each pole is at |Im λ| on the branch whose zeroth harmonic carries most of
    its residues (`views.unfolded`), where it is to be looked for on the machine; dotted lines are multiples of ω/2,
    where the band folds. Behind is the spectrum of the record, a mean over the channels. Poles of noise have no branch
    of their own: they scatter up to half of the sampling rate, most of them beyond the end of the axis, half a
    fundamental above the highest line of the analysis.

    `scan` is what `order.scan` found, `analysis` what `identify` found in the same responses, `chosen` an order
    that is marked, and `ax` the axes to draw into. Raises InputError where one is something else, or the analysis is of
    other responses.
    """
    an_instance(scan, OrderScan, "scan", "stabilisation", "Pass what `scan` gives.")
    if chosen is not None:
        integer(chosen, "chosen", "stabilisation", at_least=1)
    poles = _poles(scan, analysis)
    with drawing(4.4, ax, "stabilisation") as (figure, (axes,)):
        if analysis is None:
            found = scan.indicators
            curve = envelope(found.angles / (2.0 * np.pi * found.dt), found.cmif[:, 0], POINTS)
            _draw_behind(axes, curve, {"linewidth": 1.2, "label": "CMIF"}, "largest CMIF / white noise")
            end = np.pi / scan.indicators.dt
        else:
            _draw_spectrum(axes, analysis)
            end = 2.0 * np.pi * end_of_lines(analysis)
        _draw_poles(axes, poles, scan, end)
        if analysis is not None:
            _draw_folds(axes, analysis, end)
        _finish(axes, scan, chosen, end / (2.0 * np.pi))
        band = r" in the lifted band, 0 to $\omega$/2" if analysis is None else ""
        axes.set_xlabel(f"frequency{band} [Hz]")
    return figure


def _poles(scan: OrderScan, analysis: Analysis | None) -> list[Floats]:
    """The frequency of each pole of each order above the real axis [rad/s], on its branch where that is known."""
    angles = [np.angle(model.multipliers) for model in scan.models]
    found = [own / scan.indicators.dt for own in angles]
    if analysis is not None:
        found = [np.abs(exponents.imag) for exponents in unfolded(scan, analysis)]
    return [np.where(angle >= 0, own, np.nan) for angle, own in zip(angles, found, strict=True)]


def _draw_poles(axes: Axes, poles: list[Floats], scan: OrderScan, end: float) -> None:
    """The poles up to `end` [rad/s], a form for each level of stability."""
    found: dict[Stability, list[tuple[float, int]]] = {level: [] for level in Stability}
    for order, model, levels, own in zip(scan.orders, scan.models, scan.stable, poles, strict=True):
        if model.outcome is Outcome.SUCCESS:
            for frequency, level in zip(own, levels, strict=True):
                if np.isfinite(frequency):
                    found[Stability(int(level))].append((float(frequency), order))
    # Of a line without points that is not clipped, matplotlib takes the figure's corner for its place.
    for level, (label, look) in MARKS.items():
        x, y = np.array([pole for pole in found[level] if pole[0] <= end * (1.0 + 1e-9)], float).reshape(-1, 2).T
        axes.plot(x / (2.0 * np.pi), y, linestyle="none", clip_on=not len(x), zorder=3, label=label, **look)


def _finish(axes: Axes, scan: OrderScan, chosen: int | None, end: float) -> None:
    """The order chosen, limits and labels."""
    if chosen is not None:
        axes.axhline(chosen, color=Ink.BLACK, linestyle="--", linewidth=0.9, zorder=2, label="order chosen")
    lowest, highest = scan.orders[0], scan.orders[-1]
    margin = 0.04 * max(highest - lowest, 1)
    axes.set(xlim=(0.0, end), ylim=(lowest - margin, highest + margin), ylabel="order [complex poles]")
    whole_numbers(axes.yaxis)


def _draw_spectrum(axes: Axes, analysis: Analysis) -> None:
    """The mean of the record's spectra over the noise, of the longest hit."""
    hit = int(np.argmax([cycles.n_cycles for cycles in analysis.cycles]))
    found = [record_spectrum(analysis, row, hit) for row in range(len(analysis.lifted.channels))]
    mean = np.mean([one.values / one.noise for one in found], axis=0)
    look = {"linewidth": 1.0, "label": "spectrum of the record"}
    curve = envelope(found[0].omega / (2.0 * np.pi), mean, POINTS)
    _draw_behind(axes, curve, look, "spectrum of the record / noise", bottom=0.5)


def _draw_behind(axes: Axes, curve: Any, look: dict[str, Any], name: str, bottom: float | None = None) -> None:
    """A curve on an axis of its own to the right, drawn below the poles."""
    other = axes.twinx()
    other.plot(*curve, color=Ink.SKY, **look)
    other.set(yscale="log", ylabel=name)
    other.set_ylim(bottom=bottom)
    plain_decades(other)
    other.grid(visible=False)
    axes.set_zorder(other.get_zorder() + 1)
    axes.patch.set_visible(False)


def _draw_folds(axes: Axes, analysis: Analysis, end: float) -> None:
    """Lines at which the lifted band folds."""
    half = np.pi / analysis.lifted.period
    for number in range(1, int(end / half * (1.0 - 1e-9)) + 1):
        label = r"multiples of $\omega$/2" if number == 1 else None
        axes.axvline(
            number * half / (2.0 * np.pi), color=Ink.SILVER, linestyle=":", linewidth=0.9, zorder=1, label=label
        )


LOOKS = ((Ink.BLUE, "-", 1.8), (Ink.ORANGE, "-", 1.2), (Ink.GREEN, (0, (4, 1.5)), 1.2), (Ink.PURPLE, (0, (1, 1)), 1.2))
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
    an_instance(found, Indicators, "found", "indicators", "Pass what `order.indicators` gives.")
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
    axes.plot(
        *envelope(x, found.composite / WHITE, POINTS), color=Ink.SILVER, linewidth=1.0, label="composite", zorder=1.9
    )
    if found.residual is not None:
        curve = envelope(x, found.residual / WHITE, POINTS)
        axes.plot(*curve, color=Ink.VERMILION, linewidth=0.8, label="composite, data − model")
    axes.axhline(1.0, color=Ink.BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    axes.set(yscale="log", xlim=(0.0, x[-1]), ylabel="magnitude / white noise")
    plain_decades(axes)
    axes.set_ylim(bottom=min(0.3, 0.5 * float(found.composite.min() / WHITE)))


def _draw_values(axes: Axes, found: Indicators) -> None:
    """The leading singular values and the largest of noise."""
    shown = min(len(found.singular_values), found.n_above + DEEP)
    numbers, values = np.arange(1, shown + 1), found.singular_values[:shown]
    floor = np.finfo(float).eps * values[0]
    values = np.maximum(values, floor)
    look = {"linestyle": "none", "marker": "o", "color": Ink.BLUE, "markersize": 3.5}
    above = numbers <= found.n_above
    axes.plot(numbers[above], values[above], **look, label="above the noise")
    axes.plot(numbers[~above], values[~above], **look, markerfacecolor="none", label="not above it")
    axes.axhline(found.noise_edge, color=Ink.BLACK, linestyle="--", linewidth=0.9)
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
        "data": (found.data, {"color": Ink.BLUE, "linewidth": 2.2}),
        "model": (found.model, {"color": Ink.ORANGE, "linewidth": 1.0}),
        "data − model": (found.difference, {"color": Ink.VERMILION, "linewidth": 0.8}),
    }
    for name, (values, look) in curves.items():
        axes.plot(*envelope(found.angles * scale, values, POINTS), **look, label=name)
    axes.axhline(WHITE, color=Ink.BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    for number, angle in enumerate(np.unique(np.abs(np.angle(analysis.modal.multipliers)))):
        label = "modes, folded" if number == 0 else None
        axes.axvline(angle * scale, color=Ink.SILVER, linestyle=(0, (2, 2)), linewidth=0.8, label=label, zorder=1)
    axes.set(yscale="log", xlim=(0.0, np.pi * scale))
    # The model may fall to nothing far from its modes, and would flatten all the rest.
    axes.set_ylim(bottom=0.5 * min(WHITE, float(found.difference[found.difference > 0].min(initial=WHITE))))
