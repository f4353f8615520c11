"""The page of a comparison: the verdict, each pair, both sets of exponents in the strip, and the shapes' similarity."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.comparison import RARE, ComparedPoint, Comparison, headings, missing_words, mode_number, pair_row, verdict
from floquid.reporting._case import (
    BLACK,
    BLUE,
    HEIGHT,
    ORANGE,
    SIZE,
    VERMILION,
    Figure,
    hover,
    legend_above,
    new_figure,
)
from floquid.reporting._page import asset, bokeh_scripts, described, embedded, filled
from floquid.views import in_strip, over_label, over_unit, region_on_branch

NUMBERED = 64  # cells of the matrix of similarities up to which each has its number
STEPS = (
    "Modes were paired all at once, by their exponents modulo iω and by their shapes.",
    "χ² is of all differences together, by the joint covariance of both sides; weak modes are not in it.",
)
"""Sentences on how modes are compared."""


def comparison_page(found: Comparison, *, title: str | None) -> str:
    """The whole page as text."""
    figures = _figures(found)
    missing = missing_words(found)
    mark = ("failed" if found.p < RARE else "remainder" if missing else "passed") if found.p is not None else "open"
    figure, words = verdict(found).split(": ", maxsplit=1) if found.p is not None else ("", verdict(found))
    points = f" at {counted(len(found.points), 'point')}" if found.over else ""
    return filled(
        "comparison.html.jinja",
        title=title or "Two sets of modes",
        summary=f"a: {found.a}. b: {found.b}.",
        mark=mark,
        sentence=words[:1].upper() + words[1:],
        under=f"{counted(len(found.pairs), 'pair')} of modes{points}{f'; {figure}' * bool(figure)}."
        + " No mode is missing on either side." * (not missing),
        reasons=missing,
        warnings=found.warnings,
        heads=headings(found),
        pairs=[pair_row(found, pair) for pair in found.pairs],
        sources=[], steps=STEPS, settings=[("p of differences that are more", f"< {RARE:g}")], hits=[],
        figures=[{"name": name, "words": described(made)} for name, made in figures.items()],
        bokeh=bokeh_scripts(),
        embedded=embedded(figures),
        behaviour=asset("page.js"),
    )  # fmt: skip


def _figures(found: Comparison) -> dict[str, Figure]:
    """The figures by the names of their places: of one point, that with the largest difference, and over all."""
    worst = found.worst
    number = 0 if worst is None else worst.point
    here = found.points[number]
    words, unit = over_unit(found.over or "")
    where = f" at {words} {here.value:g} {unit}".rstrip() if found.over else ""
    made = {"strip": _strip(here, where)}
    if np.isfinite(here.macs).any():
        made["similarity"] = _similarity(here, where)
    if found.over and any(np.isfinite(pair.z) for pair in found.pairs):
        made["differences"] = _differences(found)
    return made


def _strip(here: ComparedPoint, where: str) -> Figure:
    """Exponents of both sides at one point."""
    from bokeh.models import ColumnDataSource

    own = new_figure("Re λ [1/s]", "|Im λ| modulo ω [rad/s]", name="strip")
    own.title.text = f"Exponents{where}"
    for model, objects, colour, dash, marker, side in (
        (here.model_a, here.modes_a, BLUE, "solid", "circle", "a"),
        (here.model_b, here.modes_b, VERMILION, "dashed", "x", "b"),
    ):
        modes = [mode for each in objects for mode in each]
        places = in_strip(model.exponents[modes], model.fundamental)
        regions = [region_on_branch(model, mode, place) for mode, place in zip(modes, places, strict=True)]
        edges = [place + edge for place, edge in zip(places, regions, strict=True) if edge is not None]
        look: dict[str, Any] = {"line_color": colour, "legend_label": side}
        own.multi_line([edge.real for edge in edges], [edge.imag for edge in edges], line_dash=dash, **look)
        data = {
            "x": places.real, "y": places.imag, "mode": [mode_number(model, mode) for mode in modes],
            "hertz": np.abs(model.exponents[modes].imag) / (2.0 * np.pi),
        }  # fmt: skip
        source: Any = ColumnDataSource(data)  # type: ignore[arg-type]
        dots = own.scatter("x", "y", source=source, marker=marker, size=9, fill_color=None, line_width=1.5, **look)
        hover(own, [("", f"mode @mode of {side}"), ("Re λ", "@x{%.6g} 1/s"), ("f", "@hertz{%.6g} Hz")], [dots])
    half = 0.5 * here.model_a.fundamental
    ends = np.concatenate([[0.0], here.model_a.exponents.real, here.model_b.exponents.real])
    own.line([ends.min(), ends.max()], [half, half], line_color=ORANGE, line_dash="dashed", legend_label="ω/2")
    own.line([0.0, 0.0], [0.0, half], line_color=BLACK)
    legend_above(own, columns=3)
    return own


def _similarity(here: ComparedPoint, where: str) -> Figure:
    """The similarity of each shape of a with each of b, in greys, with numbers where there is room."""
    from bokeh.models import ColumnDataSource, FixedTicker, Range1d

    labels = [
        ["/".join(str(mode_number(model, mode)) for mode in modes) for modes in each]
        for model, each in ((here.model_a, here.modes_a), (here.model_b, here.modes_b))
    ]
    count, across = map(len, labels)
    own = new_figure(
        "mode of b", "mode of a", name="similarity", height=min(HEIGHT, 110 + 30 * count),
        x_range=Range1d(start=-0.5, end=across - 0.5), y_range=Range1d(start=count - 0.5, end=-0.5),
    )  # fmt: skip
    for axis, names in ((own.yaxis[0], labels[0]), (own.xaxis[0], labels[1])):
        axis.ticker = FixedTicker(ticks=list(range(len(names))))
        axis.major_label_overrides = dict(enumerate(names))
    own.grid.visible = False
    own.title.text = f"Similarity of shapes (mac){where}"
    rows, columns = np.indices(here.macs.shape)
    macs = np.nan_to_num(here.macs.ravel())
    data = {
        "x": columns.ravel(), "y": rows.ravel(), "mac": macs, "text": [f"{mac:.2f}" for mac in macs],
        "a": [labels[0][k] for k in rows.ravel()], "b": [labels[1][k] for k in columns.ravel()],
        "shade": [f"#{3 * f'{round(255 - 230 * mac):02x}'}" for mac in macs],
        "ink": ["white" if mac > 0.5 else BLACK for mac in macs],
    }  # fmt: skip
    source: Any = ColumnDataSource(data)  # type: ignore[arg-type]
    cells = own.rect("x", "y", 1, 1, source=source, fill_color="shade", line_color="white")
    if macs.size <= NUMBERED:
        centred: Any = {"text_align": "center", "text_baseline": "middle", "text_font_size": SIZE}
        own.text("x", "y", "text", source=source, text_color="ink", **centred)
    hover(own, [("", "mode @a of a, mode @b of b"), ("mac", "@mac{%.4f}")], [cells])
    return own


def _differences(found: Comparison) -> Figure:
    """The difference of each pair over its deviation, over the operating point; open where it is not in χ²."""
    from bokeh.models import ColumnDataSource

    known = [pair for pair in found.pairs if np.isfinite(pair.z)]
    numbers = [mode_number(found.points[pair.point].model_a, pair.a) for pair in known]
    data = {
        "x": [found.points[pair.point].value for pair in known], "y": [pair.z for pair in known], "mode": numbers,
        "hertz": [pair.frequencies_hz[0] for pair in known],
        "fill": [BLUE if pair.counted else "white" for pair in known],
    }  # fmt: skip
    own = new_figure(over_label(found.over or ""), "z [deviations]", name="differences")
    own.title.text = "Difference of λ of each pair"
    source: Any = ColumnDataSource(data)  # type: ignore[arg-type]
    dots = own.scatter("x", "y", source=source, size=8, line_color=BLUE, fill_color="fill")
    hover(own, [("", "mode @mode of a"), ("f", "@hertz{%.6g} Hz"), ("z", "@y{%.3g}")], [dots])
    own.y_range.start = 0.0
    return own
