"""Records of a machine over time: charts over their limits, frequencies and decays, covariates, periodic amounts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.fit import WITHIN
from floquid.monitoring import LEAST, Monitor
from floquid.plot._style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, Into, drawing, grid_of
from floquid.views import over_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
MARKS = ("o", "s", "^", "D", "v", "P")


def monitor(found: Monitor, *, ax: Into = None) -> Figure:
    """Charts of records over their limits, frequencies and decays less the baseline with 95 % bars, and covariates.

    Grey is the baseline; what is shaded red is the 95 % interval of the instant of a change. Open marks are records
    outside the covariates of the baseline. `found` is what `monitor` made, and `ax` four axes to draw into. Raises
    InputError where it has no charts, or one is something else.
    """
    of = "monitor"
    charts = _checked(found, of).charts
    if charts is None:
        raise input_error("found", of, "have a baseline", "was made without", "Pass `baseline`.")
    with drawing(8.6, ax, of, panels=grid_of(4), sharex=ax is None) as (figure, axes):
        top, *parts, last = axes
        for k, (values, limits, label) in enumerate(
            (
                (charts.t2, charts.t2_limit, "T²"),
                (charts.ewma, charts.ewma_limit, "moving average"),
                (charts.directed, charts.directed_limit, "along the direction"),
            )
        ):
            known = np.isfinite(values)
            if known.any():
                over = np.maximum(values[known] / limits[known], LEAST)
                look: dict[str, Any] = {"color": COLOURS[k], "marker": MARKS[k], "markersize": 3.0}
                top.plot(found.x[known], over, label=label, linewidth=0.8, **look)
        top.axhline(1.0, color=BLACK, linewidth=0.9)
        top.set(yscale="log", ylabel="over the limit")
        for axes_, word, scale, label in (
            (parts[0], "frequency", 2.0 * np.pi, "f - baseline [Hz]"),
            (parts[1], "decay", 1.0, "Re λ - baseline [1/s]"),
        ):
            kept = [k for k, name in enumerate(charts.features) if name.endswith(word)]
            for number, k in enumerate(kept):
                name = charts.features[k].rpartition(" ")[0]
                _bars(axes_, found, charts.residual[:, k] / scale, charts.residual_std[:, k] / scale, number, name)
            axes_.axhline(0.0, color=BLACK, linewidth=0.6)
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
    amounts = _checked(found, of).amounts
    if amounts is None:
        got = "has none"
        raise input_error("found", of, "have records with sidebands", got, "Identify with `constrained=True`.")
    with drawing(3.2, ax, of) as (figure, (axes,)):
        value, low, high = 100.0 * amounts.value, 100.0 * amounts.low, 100.0 * amounts.high
        bars = np.maximum(np.stack([value - low, high - value]), 0.0)
        axes.errorbar(found.x, value, bars, color=BLUE, linestyle="none", marker="o", markersize=3.5, elinewidth=0.9)
        words = "of the change looked for [%]" if amounts.along else "sidebands [% of the response]"
        axes.set(ylabel=words)
        _label(axes, found)
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
        _spans(axes, found)
    return figure


def _checked(found: Any, of: str) -> Monitor:
    if not isinstance(found, Monitor):
        raise input_error("found", of, "be a Monitor", f"is a {type(found).__name__}", "Pass what `monitor` made.")
    return found


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
    places = np.flatnonzero(found.baseline)
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []:
        axes.axvspan(found.x[run[0]], found.x[run[-1]], facecolor=GREY, alpha=0.12, edgecolor="none", zorder=0)
    if found.change is not None:
        low, high = (float(found.x[k]) for k in found.change.interval)
        margin = 0.2 * float(np.median(np.diff(found.x))) if len(found.x) > 1 else 0.0
        axes.axvspan(low - margin, high + margin, facecolor=VERMILION, alpha=0.25, edgecolor="none", zorder=0)
