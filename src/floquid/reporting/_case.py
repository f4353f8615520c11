"""Parts of an analysis that the page shows, and one look for its figures.

They are readable in print, in grey and by the colour-blind.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid.order import OrderScan
from floquid.pipeline import Analysis
from floquid.views import DampingUnit, Ink, shortened

Figure = Any  # a bokeh figure: its own types do not know what its properties become

CURVES = (Ink.BLUE, Ink.VERMILION, Ink.GREEN, Ink.PURPLE, Ink.ORANGE, Ink.SKY, Ink.BLACK, Ink.GREY)
DASHES = ("solid", "dashed", "dotted", "dotdash", "dashdot", "solid", "dashed", "dotted")
MARKERS = ("circle", "square", "triangle", "diamond", "inverted_triangle", "hex", "star", "square_pin")
"""Curves and marks are told apart by form as well as by colour; as many as one figure shows. All marks can be open
or filled."""

TICK = """
const size = Math.abs(tick), value = Number(tick.toPrecision(6));
const text = size > 0 && (size < 1e-3 || size >= 1e6) ? value.toExponential() : value.toString();
return text.replace("e+", "e").replace(/-/g, "\u2212");
"""
"""A number at an axis: bokeh's own would be 3.000e-7."""

SIZE = "13px"
ACROSS, HANDLE, ROW = 48, 5, 24  # characters of a legend on a phone and of one of its handles, and a row [px]
HEIGHT = 320


def new_figure(x: str, y: str, *, name: str, height: int = HEIGHT, **options: Any) -> Figure:
    """An empty figure as wide as the page lets it be, with its axes labelled."""
    from bokeh.models import CustomJSTickFormatter
    from bokeh.plotting import figure

    made: Figure = figure(
        height=height,
        sizing_mode="stretch_width",
        tools="box_zoom,pan,xwheel_zoom,reset,save",
        active_drag="box_zoom",
        active_scroll=None,
        toolbar_location="above",
        x_axis_label=x,
        y_axis_label=y,
        min_border_right=12,
        name=f"{name}-figure",
        **options,
    )
    made.toolbar.logo = None
    made.toolbar.stylesheets = ["@media print { :host { display: none; } }"]
    made.toolbar.autohide = False
    for axis in made.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = SIZE
        axis.axis_label_text_color = axis.major_label_text_color = Ink.BLACK
        axis.minor_tick_line_color = None
    for axis, kind in ((made.xaxis[0], options.get("x_axis_type")), (made.yaxis[0], options.get("y_axis_type"))):
        if kind != "log":
            axis.formatter = CustomJSTickFormatter(code=TICK)
    made.grid.grid_line_color = "#dddddd"
    made.title.text_font_size = "14px"
    return made


def legend_above(made: Figure, *, columns: int = 2) -> None:
    """Put the legend in a row of its own above the axes, where it covers nothing; a click hides a curve."""
    if not made.legend:
        return
    legend = made.legend[0]
    made.add_layout(legend, "above")
    labels = [item.label.value for item in legend.items]
    columns = min(columns, len(labels))
    rows = -(-len(labels) // columns)
    while columns > 1 and sum(max(map(len, labels[k::columns])) + HANDLE for k in range(columns)) > ACROSS:
        columns -= 1
    made.height += ROW * (-(-len(labels) // columns) - rows)
    legend.orientation = "horizontal"
    legend.location = "top_left"  # one moved to the right makes a browser print the whole page smaller
    legend.ncols = columns
    legend.click_policy = "hide"
    legend.border_line_color = None
    legend.label_text_font_size = SIZE
    legend.label_text_color = Ink.BLACK
    legend.padding, legend.margin, legend.spacing = 2, 5, 8
    legend.glyph_height = 16


def hover(made: Figure, tooltips: list[tuple[str, str]], renderers: list[Any], **options: Any) -> None:
    """Tell the numbers under the pointer; `@name{%.3g}` is a number as C prints it."""
    from bokeh.models import HoverTool

    printed: Any = {f"@{name}": "printf" for _, text in tooltips for name in re.findall(r"@(\w+)\{%", text)}
    made.add_tools(HoverTool(tooltips=tooltips, renderers=renderers, formatters=printed, **options))


MOST_CHANNELS = 8  # channels that one figure can tell apart; the result file holds all
LONGEST = 28  # characters of a name in a legend
POINTS = 3000  # the most points of a curve: a long record keeps its envelope


@dataclass(frozen=True, slots=True)
class Case:
    """An analysis and what of it is shown."""

    analysis: Any  # an Analysis, or what shows modes of lines as one
    scan: OrderScan | None  # the poles of several orders; None where there are none
    why: str  # why there are none
    modes: tuple[int, ...]  # one mode of each pair
    channels: tuple[int, ...]  # the strongest channels, in their own order
    hits: tuple[int, ...]  # the hit in which each of `modes` is strongest
    damping: DampingUnit = "percent"  # the unit of damping

    @property
    def turn(self) -> float:
        """Frequencies are in hertz: cycles in a radian."""
        return 0.5 / np.pi

    def names(self) -> list[str]:
        """The names of the channels shown."""
        return [self.analysis.model.channels[row].name for row in self.channels]

    def labels(self) -> list[str]:
        """The names as short as a legend wants them, no two alike."""
        short = [shortened(name, LONGEST) for name in self.names()]
        return [f"{name} ({n})" if short.count(name) > 1 else name for n, name in enumerate(short, start=1)]

    def units(self) -> list[str]:
        """The units of the channels shown."""
        return [self.analysis.model.channels[row].unit for row in self.channels]


def case_of(
    analysis: Analysis, scan: OrderScan | None = None, why: str = "", *, damping: DampingUnit = "percent"
) -> Case:
    """Choose what is shown, damping in a unit."""
    model = analysis.model
    modes = tuple(model.upper_modes)
    energy = np.abs(model.coefficients) ** 2 / analysis.noise[:, :, None] ** 2
    energy = energy.sum(axis=-1)  # (modes, channels, hits)
    # Every mode counts the same, or the channels of the strongest mode alone would be seen.
    share = energy.sum(axis=2) / np.maximum(energy.sum(axis=(1, 2)), np.finfo(float).tiny)[:, None]
    strongest = np.argsort(share.sum(axis=0))[::-1][:MOST_CHANNELS]
    return Case(
        analysis=analysis,
        scan=scan,
        why=why,
        modes=modes,
        channels=tuple(sorted(int(row) for row in strongest)),
        hits=tuple(int(np.argmax(energy[mode].sum(axis=0))) for mode in modes),
        damping=damping,
    )
