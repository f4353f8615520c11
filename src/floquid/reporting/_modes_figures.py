"""Where the modes lie: the stabilisation diagram, the complex plane, and the multipliers about the unit circle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid.order import Stability
from floquid.reporting._case import POINTS, Case
from floquid.reporting._look import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HEIGHT,
    SIZE,
    SKY,
    VERMILION,
    Figure,
    hover,
    legend_above,
    new_figure,
)
from floquid.views import envelope, exponent_ellipses, multiplier_ellipses

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource

LEVELS = {
    Stability.NEW: ("new", "circle", GREY, 3),
    Stability.FREQUENCY: ("stable in frequency", "cross", VERMILION, 8),
    Stability.DAMPING: ("and damping", "square", GREEN, 7),
    Stability.SHAPE: ("and shape", "circle", BLUE, 7),
}
"""Told apart by form as well as by colour."""

FILLED = (Stability.NEW, Stability.SHAPE)

NEAR = 0.01
"""A pole of another order is one of a mode when it is this near to it, as a share of the fundamental."""


def mode_source(case: Case) -> ColumnDataSource:
    """The modes, a row each; the row selected is the mode that all figures show."""
    from bokeh.models import ColumnDataSource, Selection

    model = case.analysis.model
    at = list(case.modes)
    value = np.asarray(model.exponents[at], np.complex128)
    data = {
        "number": np.arange(1, len(at) + 1),
        "decay": value.real,
        "frequency": np.abs(value.imag) * case.turn,
        "folded": np.abs(model.principal()[at].imag) * case.turn,
        "damping": 100.0 * model.damping_ratios[at],
        "real": model.multipliers[at].real,
        "imag": np.abs(model.multipliers[at].imag),
    }
    return ColumnDataSource(data, name="modes", selected=Selection(indices=[0] if at else []))


TOOLTIP = [
    ("mode", "@number"),
    ("Im λ/2π", "@frequency{%.7g} Hz"),
    ("Re λ", "@decay{%.4g} 1/s"),
    ("ζ", "@damping{%.4g} %"),
]


def _modes(made: Figure, source: ColumnDataSource, x: str, y: str) -> None:
    """The modes as numbered marks; the one chosen is filled."""
    from bokeh.models import LabelSet, TapTool

    marks = made.scatter(
        x, y, source=source, size=11, line_color=BLACK, fill_color=VERMILION, line_width=1.3, name="mode-marks",
        nonselection_fill_color="white", nonselection_fill_alpha=0.6, nonselection_line_alpha=1.0,
    )  # fmt: skip
    made.add_layout(LabelSet(x=x, y=y, text="number", source=source, x_offset=7, y_offset=4, text_font_size="12px"))
    made.add_tools(TapTool(renderers=[marks]))
    hover(made, TOOLTIP, [marks])


def _ellipses(made: Figure, curves: NDArray[np.complex128] | None, turn: float = 1.0) -> None:
    """The ellipses of 95 %, which show as one looks closer."""
    if curves is None:
        return
    made.multi_line(
        list(curves.real), list(curves.imag * turn), line_color=BLACK, line_width=1.0, legend_label="95 % ellipse"
    )


def _upper(curves: NDArray[np.complex128] | None, case: Case) -> NDArray[np.complex128] | None:
    """The curves of the modes shown, mirrored where they lie below the real axis: there the conjugate is drawn."""
    if curves is None:
        return None
    own = curves[list(case.modes)]
    below = np.mean(own.imag, axis=1, keepdims=True) < 0.0
    return np.asarray(np.where(below, own.conj(), own), np.complex128)


def exponents_figure(case: Case, source: ColumnDataSource) -> Figure:
    """The exponents in the complex plane, conjugates left out."""
    made = new_figure("Re λ [1/s]", "Im λ/2π [Hz]", name="exponents")
    made.x_range.range_padding = made.y_range.range_padding = 0.15
    _ellipses(made, _upper(exponent_ellipses(case.analysis.model), case), case.turn)
    _modes(made, source, "decay", "frequency")
    made.ray(x=0, y=0, angle=np.pi / 2, length=0, line_color=GREY, line_dash="dashed")
    made.ray(x=0, y=0, angle=-np.pi / 2, length=0, line_color=GREY, line_dash="dashed")
    legend_above(made)
    return made


def multipliers_figure(case: Case, source: ColumnDataSource) -> Figure:
    """The multipliers beside the unit circle, conjugates left out."""
    from bokeh.models import Range1d

    model = case.analysis.model
    largest = 1.1 * max(1.0, float(np.abs(model.multipliers).max(initial=0.0)))
    made = new_figure(
        "Re μ [-]", "|Im μ| [-]", name="multipliers", height=HEIGHT, match_aspect=True,
        x_range=Range1d(start=-largest, end=largest), y_range=Range1d(start=-0.1 * largest, end=largest),
    )  # fmt: skip
    angle = np.linspace(0.0, np.pi, 181)
    made.line(np.cos(angle), np.sin(angle), line_color=GREY, line_dash="dashed", legend_label="unit circle: no decay")
    _ellipses(made, _upper(multiplier_ellipses(model), case))
    _modes(made, source, "real", "imag")
    legend_above(made)
    return made


def stabilisation_figure(case: Case, source: ColumnDataSource) -> Figure:
    """The poles of each order; a pole that belongs to a mode chooses it."""
    from bokeh.models import ColumnDataSource, CustomJS, LogAxis, LogScale, Range1d, TapTool

    scan, model = case.scan, case.analysis.model
    assert scan is not None
    made = new_figure("frequency in the lifted band, 0 to ω/2 [Hz]", "order", name="stabilisation", height=420)
    angles, level = envelope(scan.indicators.angles, scan.indicators.cmif[:, 0], POINTS)
    made.y_range = Range1d(start=0.0, end=1.1 * max(scan.orders))
    made.extra_y_ranges = {"cmif": Range1d(start=0.5 * level[level > 0].min(initial=1.0), end=2.0 * level.max())}
    made.extra_y_scales = {"cmif": LogScale()}
    made.add_layout(
        LogAxis(
            y_range_name="cmif", axis_label="largest CMIF / white noise [-]", axis_label_text_font_style="normal",
            axis_label_text_font_size=SIZE, axis_label_text_color=BLACK, minor_tick_line_color=None,
        ),
        "right",
    )  # fmt: skip
    made.line(angles * case.turn / scan.indicators.dt, level, y_range_name="cmif", line_color=SKY, line_alpha=0.8)
    _mode_lines(made, source, 1.05 * max(scan.orders))
    principal = model.principal()[list(case.modes)]
    principal = principal.real + 1j * np.abs(principal.imag)
    marks = []
    for stability, (name, marker, colour, size) in LEVELS.items():
        poles = _poles(case, stability, principal)
        own = ColumnDataSource(poles)
        drawn = made.scatter(
            "frequency", "order", source=own, marker=marker, size=size, line_color=colour, legend_label=name,
            fill_color=colour if stability in FILLED else None, nonselection_alpha=1.0,
            name=f"poles-{stability.name.lower()}",
        )  # fmt: skip
        own.selected.js_on_change(
            "indices",
            CustomJS(
                args={"own": own, "modes": source},
                code="""
                if (own.selected.indices.length === 0) return;
                const row = own.get_column("row")[own.selected.indices[0]];
                own.selected.indices = [];
                if (row >= 0) modes.selected.indices = [row];
                """,
            ),
        )
        marks.append(drawn)
    made.add_tools(TapTool(renderers=marks))
    hover(made, [("order", "@order"), ("folded", "@frequency{%.7g} Hz"), ("Re λ", "@decay{%.4g} 1/s"),
                 ("mode", "@mode")], marks)  # fmt: skip
    legend_above(made)
    return made


def _mode_lines(made: Figure, source: ColumnDataSource, top: float) -> None:
    """Where the modes of the model lie, with their numbers; the one chosen stands out."""
    made.vspan(
        x="folded", source=source, line_color=VERMILION, line_width=2.5, nonselection_line_color=GREY,
        nonselection_line_width=1.0, nonselection_line_alpha=1.0, legend_label="modes of the table",
    )  # fmt: skip
    made.text(
        x="folded", y=top, text="number", source=source, text_font_size="12px", text_align="center",
        text_baseline="middle", nonselection_text_alpha=1.0,
    )  # fmt: skip


def _poles(case: Case, stability: Stability, principal: NDArray[np.complex128]) -> dict[str, Any]:
    """The poles of one level, each with the mode that it belongs to."""
    scan, fundamental = case.scan, case.analysis.model.fundamental
    assert scan is not None
    columns: dict[str, Any] = {"frequency": [], "order": [], "decay": [], "row": [], "mode": []}
    for order, model, stable in zip(scan.orders, scan.models, scan.stable, strict=True):
        for pole, own in zip(model.poles, stable, strict=True):
            if own != stability or pole.imag < -1e-9 * fundamental:
                continue
            off = np.abs(principal - (pole.real + 1j * abs(pole.imag)))
            near = len(off) > 0 and float(off.min()) < NEAR * fundamental
            row = int(np.argmin(off)) if near else -1
            columns["frequency"].append(abs(pole.imag) * case.turn)
            columns["order"].append(int(order))
            columns["decay"].append(float(pole.real))
            columns["row"].append(row)
            columns["mode"].append(str(row + 1) if near else "none of the model")
    return columns
