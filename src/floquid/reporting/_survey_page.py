"""The page of a survey: modes over an operating point, edges of instability, and the shape at a point chosen."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.reporting._look import BLACK, CURVES, DASHES, MARKERS, VERMILION, Figure, hover, legend_above, new_figure
from floquid.reporting._page import asset, bokeh_scripts, described, embedded, filled
from floquid.surveys import Point, Survey, edge_words, track_rows
from floquid.views import over_label, over_unit

MOST = 8  # channels of a shape, the strongest, and tracks of one look
STEPS = (
    "Modes were followed from point to point by their shapes, whatever branch of λ modulo iω each result reports.",
    "Each link was made again for 200 draws from the deviations; its confidence is the share that keep it.",
    "Edges come from the mean and the squared half difference of the exponents that meet, smooth over the points.",
)
"""Sentences on what a survey is."""

CHOSEN = """
const row = marks.selected.indices[0];
if (row === undefined) return;
for (const [k, bars] of shapes.entries()) {
  bars.data = { harmonic: marks.data.harmonic[row], size: marks.data["size" + k][row] };
}
shape.title.text = "Shape of " + marks.data.name[row] + " at " + Number(marks.data.x[row].toPrecision(6));
"""
"""A mark that is clicked shows its shape."""


def survey_page(found: Survey, *, title: str | None) -> str:
    """The whole page as text."""
    words, unit = over_unit(found.over)
    figures = _figures(found)
    failed = [point for point in found.points if point.reason is not None]
    unstable = any((track.growth > 0.0).any() for track in found.tracks)
    count = f"{counted(len(found.tracks), 'mode')} followed over {counted(len(found.points), 'point')}"
    return filled(
        "survey.html.jinja",
        title=title or f"Modes over {words}",
        summary=f"{count} from {found.values[0]:g} to {found.values[-1]:g} {unit}".rstrip() + ".",
        mark="failed" if unstable else "remainder" if found.warnings else "passed",
        sentence="Unstable in part of the range." if unstable else "Stable at every point.",
        under=f"{counted(len(found.edges), 'edge')} of instability. "
        f"{len(failed)} of {len(found.points)} points have no result, or one that fails.",
        reasons=(),
        notes=found.notes,
        warnings=found.warnings,
        heading=over_label(found.over),
        tracks=track_rows(found),
        edges=[edge_words(found, edge) for edge in found.edges],
        points=[_point_row(found, point) for point in found.points],
        sources=[], steps=STEPS, settings=[], hits=[],
        figures=[{"name": name, "words": described(made)} for name, made in figures.items()],
        bokeh=bokeh_scripts(),
        embedded=embedded(figures),
        behaviour=asset("page.js"),
    )  # fmt: skip


def _point_row(found: Survey, point: Point) -> tuple[str, ...]:
    order = "" if point.model is None else str(point.model.order)
    state = "passed" if point.passed else "no result" if point.model is None else "not passed"
    return f"{point.values[found.over]:g}", "; ".join(point.files), order, state, point.reason or ""


def _figures(found: Survey) -> dict[str, Figure]:
    """The figures by the names of their places, with what links them."""
    from bokeh.models import ColumnDataSource, CustomJS, SingleIntervalTicker, TapTool

    marks, channels = _marks(found), _channels(found)
    source: Any = ColumnDataSource(marks)  # type: ignore[arg-type]
    shape = new_figure("harmonic m", "size", name="shape")
    shape.xaxis.ticker = SingleIntervalTicker(interval=1)
    bars = []
    for k, name in enumerate(channels):
        first = {"harmonic": marks["harmonic"][:1], "size": marks[f"size{k}"][:1]}
        bars.append(ColumnDataSource({axis: own[0] if own else [] for axis, own in first.items()}))
        style: dict[str, Any] = {"source": bars[-1], "line_color": CURVES[k], "legend_label": name}
        shape.line("harmonic", "size", line_dash=DASHES[k], **style)
        shape.scatter("harmonic", "size", marker=MARKERS[k], fill_color="white", size=6, **style)
    legend_above(shape)
    shape.title.text = f"Shape of {marks['name'][0]} at {marks['x'][0]:g}" if marks["name"] else "Shape"
    made = {}
    for name, label in (("frequency", "frequency [Hz]"), ("decay", "Re λ [1/s]")):
        drawn = new_figure(over_label(found.over), label, name=name)
        for number, track in enumerate(found.tracks):
            y = track.decay if name == "decay" else np.abs(track.frequency) / (2.0 * np.pi)
            dash = DASHES[number // MOST % len(DASHES)]
            look: dict[str, Any] = {"line_color": CURVES[number % MOST], "legend_label": track.name}
            drawn.line(found.values[track.points], y, line_dash=dash, **look)
            if name == "decay":
                at, ends = found.values[track.points[track.locked]], track.exponents[track.locked].real
                drawn.segment(at, ends[:, 0], at, ends[:, 1], **look)
        drawn.segment("x", f"{name}_low", "x", f"{name}_high", source=source, line_color="colour")
        dots = drawn.scatter("x", name, source=source, size=8, line_color="colour", fill_color="fill")
        if name == "decay":
            drawn.line(found.values[[0, -1]], [0.0, 0.0], line_color=BLACK)
        for edge in found.edges:
            if edge.value is not None:
                low, high = _range(marks, name)
                drawn.line([edge.value] * 2, [low, high], line_color=VERMILION, line_dash="dotted")
        drawn.add_tools(TapTool(renderers=[dots]))
        told = [
            ("", "@name"),
            ("f", "@frequency{%.6g} Hz"),
            ("Re λ", "@decay{%.4g} 1/s"),
            ("link", "@confidence{%.2f}"),
        ]
        hover(drawn, told, [dots])
        legend_above(drawn, columns=4)
        made[name] = drawn
    source.selected.js_on_change(
        "indices", CustomJS(args={"marks": source, "shapes": bars, "shape": shape}, code=CHOSEN)
    )
    return made | {"shape": shape}


def _range(marks: dict[str, list[Any]], name: str) -> tuple[float, float]:
    """The range of the values of a figure."""
    return min(marks[name], default=0.0), max(marks[name], default=1.0)


def _channels(found: Survey) -> list[str]:
    """The strongest channels of the first model, as many as a figure shows."""
    model = next((point.model for point in found.points if point.model is not None), None)
    if model is None:
        return []
    energy = np.sum(np.abs(model.coefficients) ** 2, axis=(0, 2, 3))
    return [model.channels[k].name for k in sorted(np.argsort(-energy, kind="stable")[:MOST].tolist())]


def _marks(found: Survey) -> dict[str, list[Any]]:
    """A mark a mode of a track, with its shape."""
    channels = _channels(found)
    rows: list[dict[str, Any]] = []
    for number, track in enumerate(found.tracks):
        for place, point in enumerate(track.points.tolist()):
            model = found.points[point].model
            assert model is not None
            names = [channel.name for channel in model.channels]
            for half, mode in enumerate(track.modes[place].tolist()):
                if mode < 0:
                    continue
                lam, std = track.exponents[place, half], 1.96 * track.exponent_std[place, half]
                hertz, bar = abs(lam.imag) / (2.0 * np.pi), std.imag / (2.0 * np.pi)
                colour = CURVES[number % MOST]
                sizes = np.abs(model.coefficients[mode, :, 0])
                used = (sizes > 0.0).any(axis=0)
                row = {
                    "track": number, "name": track.name, "x": float(found.values[point]), "colour": colour,
                    "fill": "white" if track.weak[place] else colour, "confidence": float(track.confidence[place]),
                    "frequency": hertz, "frequency_low": hertz - bar, "frequency_high": hertz + bar,
                    "decay": lam.real, "decay_low": lam.real - std.real, "decay_high": lam.real + std.real,
                    "harmonic": model.harmonics[used].tolist(),
                }  # fmt: skip
                for k, name in enumerate(channels):
                    row[f"size{k}"] = sizes[names.index(name), used].tolist() if name in names else []
                rows.append(row)
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else _marks_of_none(channels)


def _marks_of_none(channels: list[str]) -> dict[str, list[Any]]:
    names = ["track", "name", "x", "colour", "fill", "confidence", "harmonic"]
    names += [f"{name}{end}" for name in ("frequency", "decay") for end in ("", "_low", "_high")]
    return {name: [] for name in [*names, *(f"size{k}" for k in range(len(channels)))]}
