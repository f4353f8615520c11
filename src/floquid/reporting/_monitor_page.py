"""The page of monitored records: charts over time, the instant of a change, and how periodic the records are."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.fit import WITHIN
from floquid.monitoring import CHARTED, LEAST, Monitor, record_heads, record_rows, sentences
from floquid.reporting._case import BLACK, CURVES, MARKERS, VERMILION, Figure, hover, legend_above, new_figure
from floquid.reporting._page import asset, bokeh_scripts, described, embedded, filled
from floquid.views import over_label

MOST = 8  # features of one figure
STEPS = (
    "Modes of each record were matched with those of the baseline by their shapes.",
    "Parts of the exponents were fitted over the covariates by generalised least squares, with their own deviations.",
    "T² is the squared distance of a record from that, and the moving average has a quarter of the newest record.",
    "The instant of a change is where a step or a ramp is most likely, all coefficients fitted again.",
    "Sidebands are the lines beside the main line of each mode, on one reference shape, less what noise makes of them.",
)
"""Sentences on how records are monitored."""


def monitor_page(found: Monitor, *, title: str | None) -> str:
    """The whole page as text."""
    figures = _figures(found)
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
        sources=[], steps=STEPS, settings=[("false alarms of each chart", f"{found.rate:g}")], hits=[],
        figures=[{"name": name, "words": described(made)} for name, made in figures.items()],
        bokeh=bokeh_scripts(),
        embedded=embedded(figures),
        behaviour=asset("page.js"),
    )  # fmt: skip


def _figures(found: Monitor) -> dict[str, Figure]:
    """The figures by the names of their places, over one axis."""
    charts, amounts, made = found.charts, found.amounts, {}
    label = over_label(found.over)
    if charts is not None:
        own = new_figure(label, "over the limit", name="charts", y_axis_type="log")
        for k, (name, values, limits) in enumerate(
            (
                ("T²", charts.t2, charts.t2_limit),
                ("moving average", charts.ewma, charts.ewma_limit),
                ("along the direction", charts.directed, charts.directed_limit),
            )
        ):
            _marks(own, found, np.maximum(values / limits, LEAST), None, k, name)
        own.line(found.x[[0, -1]], [1.0, 1.0], line_color=BLACK)
        made["charts"] = own
        for word, scale, words in (
            ("frequency", 2.0 * np.pi, "f - baseline [Hz]"),
            ("decay", 1.0, "Re λ - baseline [1/s]"),
        ):
            own = new_figure(label, words, name=word)
            kept = [k for k, name in enumerate(charts.features) if name.endswith(word)][:MOST]
            for number, k in enumerate(kept):
                bars = WITHIN * charts.residual_std[:, k] / scale
                name = charts.features[k].rpartition(" ")[0]
                _marks(own, found, charts.residual[:, k] / scale, (bars, bars), number, name)
            made[word] = own
        for k, name in enumerate(found.covariates):
            own = new_figure(label, over_label(name), name=f"covariate-{k}", height=200)
            _marks(own, found, found.conditions[:, k], None, k, "")
            made[f"covariate-{k}"] = own
    if amounts is not None:
        words = "of the change looked for [%]" if amounts.along else "sidebands [% of the response]"
        own = new_figure(label, words, name="amount")
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

    places = np.flatnonzero(found.baseline)
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []:
        span = BoxAnnotation(left=float(found.x[run[0]]), right=float(found.x[run[-1]]))
        span.fill_color, span.fill_alpha = BLACK, 0.07
        made.add_layout(span)
    if found.change is not None:
        low, high = (float(found.x[k]) for k in found.change.interval)
        margin = 0.2 * float(np.median(np.diff(found.x))) if len(found.x) > 1 else 0.0
        span = BoxAnnotation(left=low - margin, right=high + margin)
        span.fill_color, span.fill_alpha = VERMILION, 0.25
        made.add_layout(span)
