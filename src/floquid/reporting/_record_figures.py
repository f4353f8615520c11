"""The record: what was measured, the model, the residual, spectra, how it keeps step, and how many modes there are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats, Mask
from floquid.fit import WITHIN
from floquid.lti import WHITE, composites
from floquid.order import OrderScan, Stability
from floquid.reporting._case import CURVES, DASHES, MARKERS, POINTS, SIZE, Case, Figure, hover, legend_above, new_figure
from floquid.reporting._chosen_figures import Chosen, span_lines
from floquid.sync import ShaftAngle
from floquid.views import (
    Ink,
    SpeedUnit,
    Synchronisation,
    end_of_lines,
    envelope,
    in_unit,
    lifted_points,
    record_spectrum,
    speed_unit,
    synchronisation,
    synthesis,
    unfolded,
)

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource


CLOSE = 4  # periods of the close-up
MOST_RESPONSES = 16  # channels times hits at hand on the page
FAR = 4.0  # a stretch whose bar is longer than this times the median does not set the axis
MOST_HITS = len(MARKERS)  # hits that one figure can tell apart

PARTS = ("record", "points", "left", "near", "spectrum", "noise")


def responses(case: Case) -> list[tuple[int, int]]:
    """The channel and the hit of each response that can be looked at."""
    hits = len(case.analysis.records)
    return [(channel, hit) for hit in range(hits) for channel in case.channels][:MOST_RESPONSES]


def response_name(case: Case, channel: int, hit: int) -> str:
    """Name of a response."""
    name = case.analysis.model.channels[channel].name
    return name if len(case.analysis.records) == 1 else f"{name}, hit {hit + 1}"


def response_label(case: Case, number: int) -> str:
    """The axis of a response."""
    return in_unit("response", case.analysis.model.channels[responses(case)[number][0]].unit)


def spectrum_label(case: Case, number: int) -> str:
    """The axis of its spectrum."""
    unit = case.analysis.model.channels[responses(case)[number][0]].unit
    return f"magnitude [{'s' if unit == '-' else f'{unit} · s'}]"


def response_sources(case: Case) -> dict[str, Chosen]:
    """The curves of every response by the part of the figures that shows them; the first one is drawn."""
    from bokeh.models import ColumnDataSource

    rows = [_curves(case, channel, hit) for channel, hit in responses(case)]
    return {
        part: Chosen(ColumnDataSource(dict(rows[0][part]), name=part), tuple(row[part] for row in rows))
        for part in PARTS
    }


def _curves(case: Case, channel: int, hit: int) -> dict[str, dict[str, Any]]:
    """The curves of one response."""
    found = synthesis(case.analysis, channel, hit)
    near = found.times < found.times[0] + CLOSE * case.analysis.model.period
    near &= np.arange(len(near)) < POINTS  # of a record with thousands of samples a period, the beginning
    spectrum = record_spectrum(case.analysis, channel, hit)
    curves = {
        "record": envelope(found.times, found.measured, POINTS),
        "points": envelope(*lifted_points(case.analysis, channel, hit), POINTS // 4),
        "left": envelope(found.times, found.residual, POINTS),
        "spectrum": envelope(spectrum.omega * case.turn, spectrum.values, POINTS),
        "noise": envelope(spectrum.omega * case.turn, spectrum.noise, POINTS // 10),
    }
    made: dict[str, dict[str, Any]] = {part: {"x": x, "y": y.astype(np.float32)} for part, (x, y) in curves.items()}
    made["near"] = {
        "x": found.times[near],
        "y": found.measured[near].astype(np.float32),
        "model": found.predicted[near].astype(np.float32),
    }
    return made


def record_figures(case: Case, sources: dict[str, Chosen]) -> list[Figure]:
    """The whole record with the lifted points of phase zero, and a close-up with the model."""
    whole = new_figure("time [s]", response_label(case, 0), name="record")
    whole.line("x", "y", source=sources["record"].drawn, line_color=Ink.BLUE, legend_label="measured")
    whole.line("x", "y", source=sources["left"].drawn, line_color=Ink.VERMILION, legend_label="measured − model")
    marks = whole.scatter(
        "x", "y", source=sources["points"].drawn, marker="circle", size=5, fill_color=None, line_color=Ink.BLACK,
        legend_label="one sample a period",
    )  # fmt: skip
    hover(whole, [("time", "@x s"), ("value", "@y")], [marks])
    legend_above(whole)
    near = new_figure("time [s]", response_label(case, 0), name="near")
    near.scatter(
        "x", "y", source=sources["near"].drawn, marker="circle", size=5, fill_color=None, line_color=Ink.BLUE,
        legend_label="measured",
    )  # fmt: skip
    near.line("x", "model", source=sources["near"].drawn, line_color=Ink.ORANGE, line_width=2, legend_label="model")
    legend_above(near)
    return [whole, near]


def spectrum_figure(case: Case, sources: dict[str, Chosen], family: Chosen) -> Figure:
    """The spectrum of the record, with the lines λ + imω of all modes and those of the one chosen."""
    from bokeh.models import Range1d

    made = new_figure("frequency [Hz]", spectrum_label(case, 0), name="spectrum", y_axis_type="log", height=380)
    nyquist = 0.5 * case.analysis.lifted.n_phases / case.analysis.lifted.period
    end = min(nyquist, end_of_lines(case.analysis))
    span_lines(made, family)
    made.line("x", "y", source=sources["spectrum"].drawn, line_color=Ink.BLUE, legend_label="record")
    made.line("x", "y", source=sources["noise"].drawn, line_color=Ink.BLACK, line_dash="dotted", line_width=2,
              legend_label="noise alone")  # fmt: skip
    # The invisible curve gives the range: spans reach from edge to edge of whatever is shown.
    top = made.line("x", "y", source=sources["spectrum"].drawn, line_alpha=0.0)
    made.y_range.renderers = [top]
    made.x_range = Range1d(start=0.0, end=end)
    legend_above(made)
    return made


def composite_figure(case: Case) -> Figure:
    """The mean magnitude of all lifted responses over their noise, and of what the model leaves of them."""
    analysis = case.analysis
    found = analysis.modal.composites or composites(analysis.lifted.responses, analysis.modal)
    made = new_figure(
        "frequency in the lifted band, 0 to ω/2 [Hz]", "composite / noise", name="composite", y_axis_type="log"
    )
    scale = case.turn / analysis.lifted.period
    curves = (("data", found.data, Ink.BLUE, 2.5, "solid"), ("model", found.model, Ink.ORANGE, 1.2, "solid"),
              ("data − model", found.difference, Ink.VERMILION, 1.0, "solid"))  # fmt: skip
    for name, values, colour, width, dash in curves:
        x, y = envelope(found.angles * scale, values, POINTS)
        made.line(x, y, line_color=colour, line_width=width, line_dash=dash, legend_label=name)
    made.line(
        [0.0, np.pi * scale], [WHITE, WHITE], line_color=Ink.BLACK, line_dash="dashed", legend_label="white noise"
    )
    made.y_range.start = 0.5 * min(WHITE, float(found.difference[found.difference > 0].min(initial=WHITE)))
    made.y_range.end = 2.0 * max(WHITE, float(found.data.max()))
    legend_above(made)
    return made


def synchronisation_figure(found: list[Synchronisation]) -> Figure | None:
    """The slip of the response against its clock, stretch by stretch, of each hit; None where nothing tells it."""
    from bokeh.models import Range1d, Span

    told = [np.isfinite(one.slip) for one in found]
    if not any(own.any() for own in told):
        return None
    made = new_figure("time [s]", "ahead of the clock [°]", name="synchronisation", height=260)
    most = _shown(found, told)
    made.y_range = Range1d(start=-most, end=most)
    made.add_layout(Span(location=0.0, dimension="width", line_color=Ink.BLACK, line_dash="dashed"))
    for number, (one, own) in enumerate(zip(found, told, strict=True)):
        slip, width = np.degrees(one.slip[own]), np.degrees(WITHIN * one.slip_std[own])
        name = f"hit {number + 1}, bars of 95 %" if len(found) > 1 else "stretches of the record, bars of 95 %"
        made.segment(one.times[own], slip - width, one.times[own], slip + width, line_color=CURVES[number])
        made.scatter(one.times[own], slip, marker=MARKERS[number], size=7, color=CURVES[number], legend_label=name)
    legend_above(made)
    return made


def speed_figure(shaft: ShaftAngle, unit: SpeedUnit) -> Figure:
    """The speed of the shaft with its band, as the tachometer or the azimuth tells it, in a `unit`."""
    symbol, factor = speed_unit(unit, "report")
    factor /= 2.0 * np.pi
    times = np.linspace(shaft.first, shaft.last, POINTS // 3)
    speed, width = factor * shaft.speed(times), factor * WITHIN * shaft.speed_std(times)
    made = new_figure("time [s]", f"speed of the shaft [{symbol}]", name="speed", height=260)
    made.varea(
        times, speed - width, speed + width, fill_color=Ink.BLUE, fill_alpha=0.25, legend_label="interval of 95 %"
    )
    made.line(times, speed, line_color=Ink.BLUE, line_width=1.5, legend_label="speed")
    mean = factor * shaft.mean_speed
    made.line([times[0], times[-1]], [mean, mean], line_color=Ink.BLACK, line_dash="dashed", legend_label="mean")
    legend_above(made)
    return made


def _shown(found: list[Synchronisation], told: list[Mask]) -> float:
    """Limit of the axis: stretches where the response has nearly died would flatten the rest."""
    slip = np.abs(np.concatenate([one.slip[own] for one, own in zip(found, told, strict=True)]))
    width = WITHIN * np.concatenate([one.slip_std[own] for one, own in zip(found, told, strict=True)])
    sure = width <= FAR * np.median(width)
    return float(np.degrees(1.15 * (slip + width)[sure].max()))


def slips(case: Case) -> list[Synchronisation]:
    """Slip of each hit."""
    return [synchronisation(case.analysis, hit) for hit in range(min(len(case.analysis.records), MOST_HITS))]


def slip_words(found: list[Synchronisation]) -> list[str]:
    """Summary of the slips, a sentence a hit."""
    sentences = []
    for number, one in enumerate(found):
        if not np.isfinite(one.relative):
            continue
        who = f"Hit {number + 1}: the" if len(found) > 1 else "The"
        off = abs(one.relative) / one.relative_std if one.relative_std > 0 else 0.0
        deviations = f"{off:.1f}" if off < 100.0 else f"{off:.0f}"
        sentences.append(
            f"{who} response's own period is {one.parts_in_a_million()} parts in a "
            f"million from the one used, {deviations} standard deviations."
        )
    return sentences


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
