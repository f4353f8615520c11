"""Figures on the number of modes: poles that stay when the order changes, folded and unfolded, and indicators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid.order import OrderScan, Stability
from floquid.reporting._case import CURVES, DASHES, POINTS, SIZE, Case, Figure, hover, legend_above, new_figure
from floquid.views import Ink, end_of_lines, envelope, unfolded

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource

LEVELS = {  # told apart by form as well as by colour
    Stability.NEW: ("new", "circle", Ink.GREY, 3),
    Stability.FREQUENCY: ("stable in frequency", "cross", Ink.VERMILION, 8),
    Stability.DAMPING: ("and damping", "square", Ink.GREEN, 7),
    Stability.SHAPE: ("and shape", "circle", Ink.BLUE, 7),
}

FILLED = (Stability.NEW, Stability.SHAPE)

NEAR = 0.01  # a pole of another order is one of a mode when it is this near to it, as a share of the fundamental

CLICKED = """
if (own.selected.indices.length === 0) return;
const row = own.get_column("row")[own.selected.indices[0]];
own.selected.indices = [];
if (row >= 0) modes.selected.indices = [row];
"""

MOST_CURVES = 4  # CMIF curves shown
DEEP = 20  # singular values shown below the noise


def stabilisation_figures(case: Case, source: ColumnDataSource) -> list[Figure]:
    """The poles of each order in the lifted band, and on the branches where their shapes are."""
    assert case.scan is not None
    folded = new_figure("frequency in the lifted band, 0 to ω/2 [Hz]", "order", name="stabilisation", height=420)
    _draw_cmif(folded, case.scan, case.turn)
    frequencies = tuple(np.abs(model.poles.imag) for model in case.scan.models)
    _draw_poles(folded, case, source, frequencies, "folded")
    whole = new_figure("frequency, unfolded [Hz]", "order", name="unfolded", height=420)
    _draw_poles(whole, case, source, tuple(np.abs(z.imag) for z in unfolded(case.scan, case.analysis)), "frequency")
    return [folded, whole]


def _draw_cmif(made: Figure, scan: OrderScan, turn: float) -> None:
    """The largest mode indicator function behind the poles, on an axis of its own."""
    from bokeh.models import LogAxis, LogScale, Range1d

    angles, level = envelope(scan.indicators.angles, scan.indicators.cmif[:, 0], POINTS)
    made.extra_y_ranges = {"cmif": Range1d(start=0.5 * level[level > 0].min(initial=1.0), end=2.0 * level.max())}
    made.extra_y_scales = {"cmif": LogScale()}
    made.add_layout(
        LogAxis(
            y_range_name="cmif", axis_label="largest CMIF / white noise", axis_label_text_font_style="normal",
            axis_label_text_font_size=SIZE, axis_label_text_color=Ink.BLACK, minor_tick_line_color=None,
        ),
        "right",
    )  # fmt: skip
    made.line(angles * turn / scan.indicators.dt, level, y_range_name="cmif", line_color=Ink.SKY, line_alpha=0.8)


def _draw_poles(
    made: Figure, case: Case, source: ColumnDataSource, frequencies: tuple[Floats, ...], column: str
) -> None:
    """The poles by how far they agree with those of the order before; one that is clicked chooses its mode."""
    from bokeh.models import ColumnDataSource, CustomJS, Range1d, TapTool

    assert case.scan is not None
    made.y_range = Range1d(start=0.0, end=1.1 * max(case.scan.orders))
    _mode_lines(made, source, column, 1.05 * max(case.scan.orders))
    end = end_of_lines(case.analysis) if column == "frequency" else 0.5 / case.analysis.model.period
    made.x_range = Range1d(start=-0.02 * end, end=1.02 * end)
    marks = []
    for stability, (name, marker, colour, size) in LEVELS.items():
        own = ColumnDataSource(_poles(case, stability, frequencies))
        drawn = made.scatter(
            "frequency", "order", source=own, marker=marker, size=size, line_color=colour, legend_label=name,
            fill_color=colour if stability in FILLED else None, nonselection_alpha=1.0,
            name=f"poles-{stability.name.lower()}",
        )  # fmt: skip
        own.selected.js_on_change("indices", CustomJS(args={"own": own, "modes": source}, code=CLICKED))
        marks.append(drawn)
    made.add_tools(TapTool(renderers=marks))
    tips = [("order", "@order"), ("frequency", "@frequency{%.7g} Hz"), ("Re λ", "@decay{%.4g} 1/s"), ("mode", "@mode")]
    hover(made, tips, marks)
    legend_above(made)


def indicator_figures(case: Case) -> list[Figure]:
    """The mode indicator functions, and the singular values of the responses."""
    assert case.scan is not None
    found = case.scan.indicators
    curves = new_figure(
        "frequency in the lifted band, 0 to ω/2 [Hz]", "CMIF / white noise", name="cmif", y_axis_type="log"
    )
    for number in range(min(found.cmif.shape[1], MOST_CURVES)):
        angles, level = envelope(found.angles, found.cmif[:, number], POINTS)
        curves.line(
            angles * case.turn / found.dt, np.maximum(level, np.finfo(float).tiny), line_color=CURVES[number],
            line_dash=DASHES[number], line_width=1.5, legend_label=f"CMIF {number + 1}",
        )  # fmt: skip
    curves.line(
        [0.0, 0.5 / found.dt], [1.0, 1.0], line_color=Ink.BLACK, line_dash="dashed", legend_label="white noise alone"
    )
    legend_above(curves)
    shown = found.singular_values[: found.n_above + DEEP]
    numbers = np.arange(1, len(shown) + 1)
    values = new_figure("number", "singular value / noise", name="singular", y_axis_type="log")
    for above, words in ((True, "above the noise"), (False, "not above it")):
        own = (numbers <= found.n_above) == above
        values.scatter(
            numbers[own], np.maximum(shown[own], np.finfo(float).eps * shown[0]), size=6, line_color=Ink.BLUE,
            fill_color=Ink.BLUE if above else None, legend_label=f"{int(own.sum())} {words}" if above else words,
        )  # fmt: skip
    values.line(
        [0.0, len(shown) + 1.0], [found.noise_edge, found.noise_edge], line_color=Ink.BLACK, line_dash="dashed",
        legend_label="largest of noise alone",
    )  # fmt: skip
    legend_above(values)
    return [curves, values]


def _mode_lines(made: Figure, source: ColumnDataSource, column: str, top: float) -> None:
    """Marks of the modes of the model, with their numbers; the one chosen stands out."""
    made.vspan(
        x=column, source=source, line_color=Ink.VERMILION, line_width=2.5, nonselection_line_color=Ink.GREY,
        nonselection_line_width=1.0, nonselection_line_alpha=1.0, legend_label="modes of the table",
    )  # fmt: skip
    made.text(
        x=column, y=top, text=f"label_{column}", source=source, text_font_size=SIZE, text_align="center",
        text_baseline="middle", nonselection_text_alpha=1.0,
    )  # fmt: skip


def _poles(case: Case, stability: Stability, frequencies: tuple[Floats, ...]) -> dict[str, Any]:
    """The poles of one level at `frequencies` [rad/s], each with the mode that it belongs to."""
    scan, whole = case.scan, case.analysis.model
    assert scan is not None
    principal = whole.principal()[list(case.modes)]
    principal = principal.real + 1j * np.abs(principal.imag)
    columns: dict[str, Any] = {"frequency": [], "order": [], "decay": [], "row": [], "mode": []}
    for order, model, stable, places in zip(scan.orders, scan.models, scan.stable, frequencies, strict=True):
        for pole, own, place in zip(model.poles, stable, places, strict=True):
            if own != stability or pole.imag < -1e-9 * whole.fundamental or not np.isfinite(place):
                continue
            off = np.abs(principal - (pole.real + 1j * abs(pole.imag)))
            near = len(off) > 0 and float(off.min()) < NEAR * whole.fundamental
            row = int(np.argmin(off)) if near else -1
            columns["frequency"].append(float(place) * case.turn)
            columns["order"].append(int(order))
            columns["decay"].append(float(pole.real))
            columns["row"].append(row)
            columns["mode"].append(str(row + 1) if near else "none of the model")
    return columns
