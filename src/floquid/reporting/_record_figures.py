"""The record: what was measured, what the model says of it, what is left, and the spectra; one response at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid.lti import WHITE, composites
from floquid.reporting._case import POINTS, Case
from floquid.reporting._chosen_figures import Chosen
from floquid.reporting._look import BLACK, BLUE, GREY, ORANGE, VERMILION, Figure, hover, legend_above, new_figure
from floquid.views import envelope, lifted_points, record_spectrum, synthesis

CLOSE = 4
"""Periods of the close-up."""

MOST_RESPONSES = 16
"""Channels times hits at hand on the page."""

PARTS = ("record", "points", "left", "near", "spectrum", "noise")


def responses(case: Case) -> list[tuple[int, int]]:
    """The channel and the hit of each response that can be looked at."""
    hits = len(case.analysis.records)
    return [(channel, hit) for hit in range(hits) for channel in case.channels][:MOST_RESPONSES]


def response_name(case: Case, channel: int, hit: int) -> str:
    """What a response is called."""
    name = case.analysis.model.channels[channel].name
    return name if len(case.analysis.records) == 1 else f"{name}, hit {hit + 1}"


def response_label(case: Case, number: int) -> str:
    """The axis of a response."""
    return f"response [{case.analysis.model.channels[responses(case)[number][0]].unit}]"


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
    whole.line("x", "y", source=sources["record"].drawn, line_color=BLUE, legend_label="measured")
    whole.line("x", "y", source=sources["left"].drawn, line_color=VERMILION, legend_label="measured − model")
    marks = whole.scatter(
        "x", "y", source=sources["points"].drawn, marker="circle", size=5, fill_color=None, line_color=BLACK,
        legend_label="one sample a period",
    )  # fmt: skip
    hover(whole, [("time", "@x s"), ("value", "@y")], [marks])
    legend_above(whole)
    near = new_figure("time [s]", response_label(case, 0), name="near")
    near.scatter(
        "x", "y", source=sources["near"].drawn, marker="circle", size=5, fill_color=None, line_color=BLUE,
        legend_label="measured",
    )  # fmt: skip
    near.line("x", "model", source=sources["near"].drawn, line_color=ORANGE, line_width=2, legend_label="model")
    legend_above(near)
    return [whole, near]


def spectrum_figure(case: Case, sources: dict[str, Chosen], family: Chosen) -> Figure:
    """The spectrum of the record, with the lines λ + imω of all modes and those of the one chosen."""
    from bokeh.models import Range1d

    made = new_figure("frequency [Hz]", spectrum_label(case, 0), name="spectrum", y_axis_type="log", height=380)
    every = np.concatenate([row["frequency"] for row in family.modes]) if family.modes else np.zeros(0)
    nyquist = 0.5 * case.analysis.lifted.n_phases / case.analysis.lifted.period
    end = min(nyquist, max(every, default=nyquist) + 0.5 / case.analysis.lifted.period)
    made.vspan(x=every, line_color=GREY, line_alpha=0.35, line_width=1, legend_label="lines of all modes")
    made.vspan(
        x="frequency", source=family.drawn, line_color=VERMILION, line_width=2, line_dash="dashed",
        legend_label="of the mode chosen",
    )  # fmt: skip
    made.line("x", "y", source=sources["spectrum"].drawn, line_color=BLUE, legend_label="record")
    made.line("x", "y", source=sources["noise"].drawn, line_color=BLACK, line_dash="dotted", line_width=2,
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
        "frequency in the lifted band, 0 to ω/2 [Hz]", "composite / noise [-]", name="composite", y_axis_type="log"
    )
    scale = case.turn / analysis.lifted.period
    curves = (("data", found.data, BLUE, 2.5, "solid"), ("model", found.model, ORANGE, 1.2, "solid"),
              ("data − model", found.difference, VERMILION, 1.0, "solid"))  # fmt: skip
    for name, values, colour, width, dash in curves:
        x, y = envelope(found.angles * scale, values, POINTS)
        made.line(x, y, line_color=colour, line_width=width, line_dash=dash, legend_label=name)
    made.line([0.0, np.pi * scale], [WHITE, WHITE], line_color=BLACK, line_dash="dashed", legend_label="white noise")
    positive = found.difference[found.difference > 0]
    made.y_range.start = 0.5 * min(WHITE, float(positive.min()) if len(positive) else WHITE)
    made.y_range.end = 2.0 * max(WHITE, float(found.data.max()))
    legend_above(made)
    return made
