"""The page of a survey: modes over an operating point, edges of instability, and the shape at a point chosen."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.fit import WITHIN
from floquid.reporting._case import HEIGHT, ROW, Figure, hover, legend_above, new_figure
from floquid.reporting._chosen_figures import channels_of, chosen_figures, shape_columns
from floquid.reporting._page import drawn_by, filled, listed
from floquid.surveys import (
    DAMPING,
    Damping,
    Point,
    Survey,
    damping_of,
    edge_words,
    link_runs,
    looks,
    order_end,
    order_lines,
    track_rows,
    unstable_spans,
)
from floquid.views import DampingUnit, Ink, over_label, over_unit

COLUMNS = 4  # of a legend
BEFORE, BEHIND = 0.03, 0.1  # room beside the points over their range; behind them stand the orders of the speed
ABOVE = 1.15  # top of the figure of frequencies over the largest
SENSES = {0: "circle", 1: "triangle", -1: "inverted_triangle"}
"""Marks of modes that whirl forward and backward, and of others."""

NAMES = ["track", "name", "x", "colour", "fill", "confidence", "marker", "harmonic"]
NAMES += [f"{name}{end}" for name in ("frequency", "decay", "damping") for end in ("", "_low", "_high")]
"""Columns of marks, where there are none."""

STEPS = (
    "Modes were followed from point to point by their shapes, whatever branch of λ modulo iω each result reports.",
    "Each link was made again for 200 draws from the deviations; its confidence is the share that keep it.",
    "Edges come from the mean and the squared half difference of the exponents that meet, smooth over the points.",
)
"""Sentences on what a survey is."""


def survey_page(found: Survey, *, title: str | None, damping: DampingUnit = "percent") -> str:
    """The whole page as text, with the `damping` beside Re λ in a unit."""
    words, unit = over_unit(found.over)
    measure: Damping = "decrement" if damping == "decrement" else "ratio"
    marks = _marks(found, measure)
    over, chosen = _figures(found, marks, measure), chosen_figures(found, marks)
    unstable = any((track.growth > 0.0).any() for track in found.tracks)
    count = f"{counted(len(found.tracks), 'mode')} followed over {counted(len(found.points), 'point')}"
    return filled(
        "survey.html.jinja",
        title=title or f"Modes over {words}",
        summary=f"{count} from {found.values[0]:g} to {found.values[-1]:g} {unit}".rstrip() + ".",
        mark="failed" if unstable else "remainder" if found.warnings else "passed",
        sentence="Unstable in part of the range." if unstable else "Stable at every point.",
        under=_counts(found),
        reasons=(),
        notes=found.notes,
        warnings=found.warnings,
        heading=over_label(found.over), within=f"{100.0 * found.confidence:g} % interval",
        tracks=track_rows(found), whirls=bool(found.shapes.pairs),
        edges=[edge_words(found, edge) for edge in found.edges],
        points=[_point_row(found, point) for point in found.points],
        sources=[], steps=STEPS, settings=[], hits=[],
        orbits="orbits" in chosen, blades="waves-0" in chosen,
        **drawn_by(over | chosen) | {"figures": listed(over), "chosen": listed(chosen)},
    )  # fmt: skip


def _counts(found: Survey) -> str:
    """Sentences on how much of a survey can be believed."""
    total, passed = len(found.points), sum(point.passed for point in found.points)
    lost = sum(point.model is None for point in found.points)
    failed = sum(point.reason is not None for point in found.points) - lost
    others = {
        "fail": failed, "not checked": total - passed - failed - lost, "without a result": lost,
    }  # fmt: skip
    listing = ", ".join(
        [f"{passed} of {total} points pass their checks", *(f"{n} {w}" for w, n in others.items() if n)]
    )
    return f"{listing}. {counted(len(found.edges), 'edge')} of instability."


def _point_row(found: Survey, point: Point) -> tuple[str, ...]:
    order = "" if point.model is None else str(point.model.order)
    unsure = "no result" if point.model is None else "fails" if point.reason else "not checked"
    state = "passed" if point.passed else unsure
    return f"{point.values[found.over]:g}", "; ".join(point.files), order, state, point.reason or ""


def _figures(found: Survey, marks: Any, unit: Damping) -> dict[str, Figure]:
    """The figures over the operating point by the names of their places."""
    from bokeh.models import BoxAnnotation, Range1d, TapTool

    made, (begin, end) = {}, found.values[[0, -1]]
    spans = [(*span, 0.12) for span in unstable_spans(found)] + [(*edge.interval, 0.3) for edge in found.edges]
    room = (end - begin) or 1.0
    across = Range1d(start=begin - BEFORE * room, end=end + BEHIND * room)
    for name, label in (("frequency", "frequency [Hz]"), ("decay", DAMPING["decay"]), ("damping", marks.name)):
        first = name == "frequency"
        height = HEIGHT + ROW * (len(found.tracks) // COLUMNS if first else 0)
        drawn = new_figure(over_label(found.over), label, name=name, height=height, x_range=across)
        high = max((value for value in marks.data[name] if np.isfinite(value)), default=1.0)
        for number, track in enumerate(found.tracks):
            colour, dash, doubt = looks(found)[number]
            look: dict[str, Any] = {"line_color": colour, "legend_label": track.name}
            y = {
                "frequency": np.abs(track.frequency) / (2.0 * np.pi),
                "decay": track.decay,
                "damping": damping_of(track, unit)[0],
            }
            x = found.values[track.points]
            drawn.line([], [], line_dash=dash, **look)  # the legend has the dash of the track
            for run, doubtful in link_runs(track):
                drawn.line(x[run], y[name][run], line_dash=doubt if doubtful else dash, **look)
            if name == "decay":
                at, ends = found.values[track.points[track.locked]], track.exponents[track.locked].real
                drawn.segment(at, ends[:, 0], at, ends[:, 1], **look)
        drawn.segment("x", f"{name}_low", "x", f"{name}_high", source=marks, line_color="colour")
        dots = drawn.scatter("x", name, source=marks, size=8, line_color="colour", fill_color="fill", marker="marker")
        if first:
            top = ABOVE * (high or 1.0)
            drawn.y_range = Range1d(start=0.0, end=top)
            for order, hertz in order_lines(found):
                drawn.line(found.values, hertz, line_color=Ink.GREY, line_dash="dotted")
                end = order_end(found, hertz, top)
                if end is not None:
                    beside: Any = {"x_offset": 7, "text_baseline": "top" if end[1] == top else "middle"}
                    beside |= {"text_color": Ink.GREY, "text_font_size": "12px"}
                    drawn.text([end[0]], [end[1]], [order], **beside)
        else:
            drawn.line(found.values[[0, -1]], [0.0, 0.0], line_color=Ink.BLACK)
        for low, high, shade in spans:
            drawn.add_layout(
                BoxAnnotation(left=low, right=high, fill_color=Ink.VERMILION, fill_alpha=shade, line_color=None)
            )
        drawn.add_tools(TapTool(renderers=[dots]))
        told = [
            ("", "@name"),
            ("f", "@frequency{%.6g} Hz"),
            ("Re λ", "@decay{%.4g} 1/s"),
            (marks.name, "@damping{%.4g}"),
            ("link", "@confidence{%.2f}"),
        ]
        hover(drawn, told, [dots])
        if first or len(found.tracks) <= COLUMNS:
            legend_above(drawn, columns=COLUMNS)
        else:
            drawn.legend[0].visible = False  # that of the first figure is of all
        made[name] = drawn
    return made


def _marks(found: Survey, unit: Damping) -> Any:
    """A mark a mode of a track, with its shape: a source with the label of the damping for its name."""
    from bokeh.models import ColumnDataSource

    rows: list[dict[str, Any]] = []
    shapes = cache(partial(shape_columns, found))
    for number, track in enumerate(found.tracks):
        values, spread = damping_of(track, unit)
        for place, point in enumerate(track.points.tolist()):
            columns = shapes(point)
            for half, mode in enumerate(track.modes[place].tolist()):
                if mode < 0:
                    continue
                lam, std = track.exponents[place, half], track.exponent_std[place, half]
                sizes = {
                    "frequency": (abs(lam.imag) / (2.0 * np.pi), std.imag / (2.0 * np.pi)),
                    "decay": (lam.real, std.real),
                    "damping": (values[place], spread[place]),
                }
                colour = looks(found)[number][0]
                rows.append({
                    "track": number, "name": track.name, "x": float(found.values[point]), "colour": colour,
                    "fill": "white" if track.weak[place] else colour, "confidence": float(track.confidence[place]),
                    "marker": "square" if track.locked[place] else SENSES[int(track.sense[place])],
                    **{name: float(value) for name, (value, _) in sizes.items()},
                    **{f"{name}_low": float(value - WITHIN * bar) for name, (value, bar) in sizes.items()},
                    **{f"{name}_high": float(value + WITHIN * bar) for name, (value, bar) in sizes.items()},
                    **columns(mode, int(track.shifts[place]), mirrored=bool(track.mirrored[place])),
                })  # fmt: skip
    names = rows[0] if rows else [*NAMES, *(f"size{k}" for k in range(len(channels_of(found))))]
    data: Any = {name: [row[name] for row in rows] for name in names}
    return ColumnDataSource(data, name=DAMPING[unit])
