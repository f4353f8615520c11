"""Several results in one figure: two that are compared, and the records of a machine over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import an_instance, index, input_error
from floquid.comparison import ComparedPoint, Comparison, Pair, mode_labels, mode_number
from floquid.fit import WITHIN
from floquid.monitoring import Monitor, amount_label, beside_baseline, over_limits, spans_of
from floquid.plot._style import CLOSE_ACROSS, CLOSE_UPS, Into, drawing, grid_of, short_tick, with_close_ups
from floquid.views import Ink, in_strip, over_label, region_on_branch

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_A: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "color": Ink.BLUE,
    "markersize": 6.0,
    "markerfacecolor": "none",
}
_B: dict[str, Any] = {"linestyle": "none", "marker": "x", "color": Ink.VERMILION, "markersize": 5.5}


def comparison(found: Comparison, *, point: int | None = None, ax: Into = None) -> Figure:
    """Exponents of both sides in the strip, the similarity of shapes, and each pair close up with regions of 95 %.

    In the strip exponents stand at |Im λ| modulo ω, from zero to ω/2. Close up they stand on the branch of the first
    side, off its value; a region is drawn of a side that has deviations. `found` is what `compare` gave. `point` is the
    number of the point, by default that of the largest difference over its deviation. `ax` are two axes to draw into
    and one more for each pair, twelve at most. Raises InputError where one is something else.
    """
    of = "comparison"
    an_instance(found, Comparison, "found", of, "Pass floquid.compare(...).")
    number = 0 if found.worst is None else found.worst.point
    number = number if point is None else index(point, "point", of, len(found.points))
    here = found.points[number]
    pairs = [pair for pair in found.pairs if pair.point == number][:CLOSE_UPS]
    rows, layout = with_close_ups(len(pairs), (3.0, 1.7))
    with drawing(3.4 + 1.9 * rows, ax, of, **layout) as (figure, (strip, macs, *close)):
        for model, modes, look, label in (
            (here.model_a, here.modes_a, _A, "a"), (here.model_b, here.modes_b, _B, "b"),
        ):  # fmt: skip
            lam = model.exponents[[mode for object_ in modes for mode in object_]]
            strip.plot(lam.real, in_strip(lam, model.fundamental).imag, **look, label=label)
        strip.axvline(0.0, color=Ink.BLACK, linewidth=0.9)
        strip.axhline(0.5 * here.model_a.fundamental, color=Ink.ORANGE, linestyle="--", linewidth=0.9, label="ω/2")
        strip.set(xlabel="Re λ [1/s]", ylabel="|Im λ| modulo ω [rad/s]", ylim=(0.0, 0.55 * here.model_a.fundamental))
        if found.over is not None:
            strip.set_title(f"{found.over} = {here.value:g}")
        _draw_macs(macs, here)
        for place, (pair, axes) in enumerate(zip(pairs, close, strict=True)):
            _draw_close(axes, here, pair)
            if place % CLOSE_ACROSS == 0:
                axes.set_ylabel("Im λ − a [rad/s]", fontsize=8.0)
            if place + CLOSE_ACROSS >= len(pairs):
                axes.set_xlabel("Re λ − a [1/s]", fontsize=8.0)
    return figure


def _draw_macs(axes: Axes, here: ComparedPoint) -> None:
    """The similarity of each mode of a with each of b, in grey and as a number where there is room."""
    labels = mode_labels(here)
    axes.imshow(np.nan_to_num(here.macs), cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    axes.grid(False)
    axes.set(xlabel="mode of b", ylabel="mode of a", title="similarity of shapes (mac)")
    if np.isnan(here.macs).all():
        axes.set_title("no common channels: no similarity")
    axes.set_xticks(range(len(labels[1])), labels[1])
    axes.set_yticks(range(len(labels[0])), labels[0])
    for (row, column), value in np.ndenumerate(here.macs if here.macs.size <= 64 else np.empty((0, 0))):
        if np.isfinite(value):
            dark = "white" if value > 0.5 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=dark, fontsize=7.5)


def _draw_close(axes: Axes, here: ComparedPoint, pair: Pair) -> None:
    """One pair close up, off the exponent of a."""
    reach = 1e-12 * here.model_a.fundamental
    apart = pair.exponent_b - pair.exponent_a
    for model, mode, exponent, look in (
        (here.model_a, pair.a, pair.exponent_a, _A), (here.model_b, pair.b, pair.exponent_b, _B),
    ):  # fmt: skip
        off = exponent - pair.exponent_a
        axes.plot([off.real], [off.imag], **look)
        region = region_on_branch(model, mode, exponent)
        if region is not None:
            axes.plot((off + region).real, (off + region).imag, color=look["color"], linewidth=1.0)
            reach = max(reach, *np.abs([region.real, region.imag]).max(axis=1))
    reach = 1.25 * max(reach, abs(apart.real), abs(apart.imag))
    axes.axhline(0.0, color=Ink.SILVER, linewidth=0.5)
    axes.axvline(0.0, color=Ink.SILVER, linewidth=0.5)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.locator_params(nbins=3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(short_tick)
    axes.tick_params(labelsize=7.0)
    z = "" if np.isnan(pair.z) else f": z = {pair.z:.3g}"
    numbers = mode_number(here.model_a, pair.a), mode_number(here.model_b, pair.b)
    axes.set_title(f"a {numbers[0]}, b {numbers[1]}{z}", fontsize=8.0)


COLOURS = (Ink.BLUE, Ink.VERMILION, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.SKY)
MADE = "Pass what `monitor` made."
MARKS = ("o", "s", "^", "D", "v", "P")


def monitor(found: Monitor, *, ax: Into = None) -> Figure:
    """Charts of records over their limits, frequencies and decays less the baseline with 95 % bars, and covariates.

    Grey is the baseline; what is shaded red is the 95 % interval of the instant of a change. Open marks are records
    outside the covariates of the baseline. `found` is what `monitor` made, and `ax` four axes to draw into. Raises
    InputError where it has no charts, or one is something else.
    """
    of = "monitor"
    charts = an_instance(found, Monitor, "found", of, MADE).charts
    if charts is None:
        raise input_error("found", of, "have a baseline", "was made without", "Pass `baseline`.")
    with drawing(8.6, ax, of, panels=grid_of(4), sharex=ax is None) as (figure, axes):
        top, *parts, last = axes
        for k, (label, over) in enumerate(over_limits(charts).items()):
            known = np.isfinite(over)
            if known.any():
                look: dict[str, Any] = {"color": COLOURS[k], "marker": MARKS[k], "markersize": 3.0}
                top.plot(found.x[known], over[known], label=label, linewidth=0.8, **look)
        top.axhline(1.0, color=Ink.BLACK, linewidth=0.9)
        top.set(yscale="log", ylabel="over the limit")
        for axes_, (label, shown) in zip(parts, beside_baseline(charts).values(), strict=True):
            for number, (name, values, std) in enumerate(shown):
                _bars(axes_, found, values, std, number, name)
            axes_.axhline(0.0, color=Ink.BLACK, linewidth=0.6)
            axes_.set(ylabel=label)
        _conditions(last, found)
        for axes_ in axes:
            _spans(axes_, found)
        _label(last, found)
    return figure


def _label(axes: Axes, found: Monitor) -> None:
    """Label what records go over; records that are counted have whole ticks."""
    from matplotlib.ticker import MaxNLocator

    axes.set(xlabel=over_label(found.over))
    axes.xaxis.set_major_locator(MaxNLocator(integer=found.over == "record"))


def periodic_amount(found: Monitor, *, ax: Into = None) -> Figure:
    """Periodic amounts over the records, with 95 % intervals.

    Without a template it is the root of the share of energy in sidebands [%]; else the share of the change that was
    looked for [%]. `found` is what `monitor` made, and `ax` the axes to draw into. Raises InputError where no record
    has sidebands, or one is something else.
    """
    of = "periodic_amount"
    amounts = an_instance(found, Monitor, "found", of, MADE).amounts
    if amounts is None:
        raise input_error("found", of, "have records with sidebands", "has none", "Identify with `constrained=True`.")
    with drawing(3.2, ax, of) as (figure, (axes,)):
        value, low, high = 100.0 * amounts.value, 100.0 * amounts.low, 100.0 * amounts.high
        bars = np.maximum(np.stack([value - low, high - value]), 0.0)
        axes.errorbar(
            found.x, value, bars, color=Ink.BLUE, linestyle="none", marker="o", markersize=3.5, elinewidth=0.9
        )
        axes.set(ylabel=amount_label(amounts))
        _label(axes, found)
        axes.axhline(0.0, color=Ink.BLACK, linewidth=0.6)
        _spans(axes, found)
    return figure


def _bars(axes: Axes, found: Monitor, values: Floats, std: Floats, number: int, name: str) -> None:
    """One feature with its bars; extrapolated records are open."""
    charts = found.charts
    assert charts is not None
    colour = COLOURS[number % len(COLOURS)]
    look: dict[str, Any] = {"color": colour, "marker": MARKS[number % len(MARKS)], "linestyle": "none"}
    for outside, face in ((False, colour), (True, "white")):
        at = (charts.extrapolated == outside) & np.isfinite(values)
        if at.any():
            label = None if outside else name
            axes.errorbar(
                found.x[at], values[at], WITHIN * std[at], elinewidth=0.8, markersize=3.0, markerfacecolor=face,
                label=label, **look,
            )  # fmt: skip


def _conditions(axes: Axes, found: Monitor) -> None:
    """The covariates from their mean, over their range in the baseline."""
    for k, name in enumerate(found.covariates):
        own = found.conditions[:, k]
        spread = np.nanmax(own[found.baseline]) - np.nanmin(own[found.baseline])
        scaled = (own - np.nanmean(own[found.baseline])) / (spread or 1.0)
        look: dict[str, Any] = {"color": COLOURS[-1 - k % len(COLOURS)], "marker": MARKS[-1 - k % len(MARKS)]}
        axes.plot(found.x, scaled, linewidth=0.6, markersize=3.0, label=name, **look)
    axes.set(ylabel="covariates\n[range of the baseline]")


def _spans(axes: Axes, found: Monitor) -> None:
    """Shade the baseline, and the interval of the instant of a change."""
    for spans, color, alpha in zip(spans_of(found), (Ink.SILVER, Ink.VERMILION), (0.12, 0.25), strict=True):
        for span in spans:
            axes.axvspan(*span, facecolor=color, alpha=alpha, edgecolor="none", zorder=0)
