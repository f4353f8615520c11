"""Pages of two results that are compared, and of the records of a machine over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.comparison import (
    RARE,
    ComparedPoint,
    Comparison,
    headings,
    missing_words,
    mode_labels,
    mode_number,
    pair_row,
    verdict,
)
from floquid.fit import WITHIN
from floquid.monitoring import (
    CHARTED,
    Monitor,
    amount_label,
    beside_baseline,
    over_limits,
    record_heads,
    record_rows,
    sentences,
    spans_of,
)
from floquid.reporting._case import CURVES, HEIGHT, MARKERS, SIZE, Figure, hover, legend_above, new_figure
from floquid.reporting._page import drawn_by, filled
from floquid.views import Ink, in_strip, over_label, over_unit, region_on_branch

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
        **drawn_by(figures),
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
        (here.model_a, here.modes_a, Ink.BLUE, "solid", "circle", "a"),
        (here.model_b, here.modes_b, Ink.VERMILION, "dashed", "x", "b"),
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
    own.line([ends.min(), ends.max()], [half, half], line_color=Ink.ORANGE, line_dash="dashed", legend_label="ω/2")
    own.line([0.0, 0.0], [0.0, half], line_color=Ink.BLACK)
    legend_above(own, columns=3)
    return own


def _similarity(here: ComparedPoint, where: str) -> Figure:
    """The similarity of each shape of a with each of b, in greys, with numbers where there is room."""
    from bokeh.models import ColumnDataSource, FixedTicker, Range1d

    labels = mode_labels(here)
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
        "ink": ["white" if mac > 0.5 else Ink.BLACK for mac in macs],
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
        "fill": [Ink.BLUE if pair.counted else "white" for pair in known],
    }  # fmt: skip
    own = new_figure(over_label(found.over or ""), "z [deviations]", name="differences")
    own.title.text = "Difference of λ of each pair"
    source: Any = ColumnDataSource(data)  # type: ignore[arg-type]
    dots = own.scatter("x", "y", source=source, size=8, line_color=Ink.BLUE, fill_color="fill")
    hover(own, [("", "mode @mode of a"), ("f", "@hertz{%.6g} Hz"), ("z", "@y{%.3g}")], [dots])
    own.y_range.start = 0.0
    return own


MOST = 8  # features of one figure
STEPS_OF_RECORDS = (
    "Modes of each record were matched with those of the baseline by their shapes.",
    "Parts of the exponents were fitted over the covariates by generalised least squares, with their own deviations.",
    "T² is the squared distance of a record from that, and the moving average has a quarter of the newest record.",
    "The instant of a change is where a step or a ramp is most likely, all coefficients fitted again.",
    "Sidebands are the lines beside the main line of each mode, on one reference shape, less what noise makes of them.",
)
"""Sentences on how records are monitored."""


def monitor_page(found: Monitor, *, title: str | None) -> str:
    """The whole page as text."""
    figures = _charts(found)
    alarms = int(found.alarm.sum())
    told = sentences(found)
    sentence = f"{counted(alarms, 'record')} with an alarm." if alarms else "No alarm."
    if found.charts is None:
        sentence = "Compared with no baseline."
    return filled(
        "monitor.html.jinja",
        title=title or "A machine over its records",
        summary=f"{counted(len(found.files), 'record')}, {int(found.baseline.sum())} of them the baseline.",
        mark="failed" if alarms else "remainder" if found.warnings else "passed",
        sentence=sentence,
        under=" ".join(told),
        reasons=(),
        warnings=found.warnings,
        heads=record_heads(found),
        charted=CHARTED if found.charts is not None else "",
        records=record_rows(found),
        sources=[], steps=STEPS_OF_RECORDS, settings=[("false alarms of each chart", f"{found.rate:g}")], hits=[],
        **drawn_by(figures),
    )  # fmt: skip


def _charts(found: Monitor) -> dict[str, Figure]:
    """The figures by the names of their places, over one axis."""
    charts, amounts, made = found.charts, found.amounts, {}
    label = over_label(found.over)
    if charts is not None:
        own = new_figure(label, "over the limit", name="charts", y_axis_type="log")
        for k, (name, over) in enumerate(over_limits(charts).items()):
            _marks(own, found, over, None, k, name)
        own.line(found.x[[0, -1]], [1.0, 1.0], line_color=Ink.BLACK)
        made["charts"] = own
        for word, (words, shown) in beside_baseline(charts).items():
            own = new_figure(label, words, name=word)
            for number, (name, values, std) in enumerate(shown[:MOST]):
                _marks(own, found, values, (WITHIN * std, WITHIN * std), number, name)
            made[word] = own
        for k, name in enumerate(found.covariates):
            own = new_figure(label, over_label(name), name=f"covariate-{k}", height=200)
            _marks(own, found, found.conditions[:, k], None, k, "")
            made[f"covariate-{k}"] = own
    if amounts is not None:
        own = new_figure(label, amount_label(amounts), name="amount")
        value = 100.0 * amounts.value
        _marks(own, found, value, (value - 100.0 * amounts.low, 100.0 * amounts.high - value), 0, "")
        made["amount"] = own
    for own in made.values():
        _spans(own, found)
        legend_above(own, columns=4)
    first = next(iter(made.values()), None)
    for own in made.values():
        own.x_range = first.x_range if first is not None else own.x_range
    return made


def _marks(made: Figure, found: Monitor, values: Any, bars: Any, number: int, name: str) -> None:
    """Marks of one quantity with its bars, open outside the covariates of the baseline."""
    from bokeh.models import ColumnDataSource

    known = np.isfinite(values)
    if not known.any():
        return
    colour = CURVES[number % len(CURVES)]
    outside = np.zeros(len(found.x), bool) if found.charts is None else found.charts.extrapolated
    down, up = (np.zeros(len(values)),) * 2 if bars is None else bars
    data = {
        "x": found.x[known], "y": values[known], "low": (values - down)[known], "high": (values + up)[known],
        "file": [found.files[k] for k in np.flatnonzero(known)], "record": np.flatnonzero(known),
        "fill": ["white" if outside[k] else colour for k in np.flatnonzero(known)],
    }  # fmt: skip
    source: Any = ColumnDataSource(data)  # type: ignore[arg-type]
    label = {"legend_label": name} if name else {}
    if bars is not None:
        made.segment("x", "low", "x", "high", source=source, line_color=colour, **label)
    else:
        made.line("x", "y", source=source, line_color=colour, **label)
    dots = made.scatter(
        "x", "y", source=source, size=6, marker=MARKERS[number % len(MARKERS)], line_color=colour, fill_color="fill",
        **label,
    )  # fmt: skip
    hover(made, [("", f"{name} record @record"), ("file", "@file"), ("", "@y{%.5g}")], [dots])


def _spans(made: Figure, found: Monitor) -> None:
    """Shade the baseline, and the interval of the instant of a change."""
    from bokeh.models import BoxAnnotation

    for spans, colour, alpha in zip(spans_of(found), (Ink.BLACK, Ink.VERMILION), (0.07, 0.25), strict=True):
        for left, right in spans:
            made.add_layout(BoxAnnotation(left=left, right=right, fill_color=colour, fill_alpha=alpha))
