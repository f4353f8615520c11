"""Whether the record keeps step with its period: a slope is a wrong period, a curve a speed that wanders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.reporting._case import POINTS, Case
from floquid.reporting._chosen_figures import BAND
from floquid.reporting._look import BLACK, BLUE, CURVES, MARKERS, Figure, legend_above, new_figure
from floquid.sync import ShaftAngle
from floquid.views import Synchronisation, synchronisation

FAR = 4.0
"""A stretch whose bar is longer than this times the median does not set the axis."""

MOST_HITS = len(MARKERS)
"""Hits that one figure can tell apart."""


def synchronisation_figure(found: list[Synchronisation]) -> Figure | None:
    """The slip of the response against its clock, stretch by stretch, of each hit; None where nothing tells it."""
    from bokeh.models import Range1d, Span

    told = [np.isfinite(one.slip) for one in found]
    if not any(own.any() for own in told):
        return None
    made = new_figure("time [s]", "response ahead of its clock [° of the period]", name="synchronisation", height=260)
    most = _shown(found, told)
    made.y_range = Range1d(start=-most, end=most)
    made.add_layout(Span(location=0.0, dimension="width", line_color=BLACK, line_dash="dashed"))
    for number, (one, own) in enumerate(zip(found, told, strict=True)):
        slip, width = np.degrees(one.slip[own]), np.degrees(BAND * one.slip_std[own])
        name = f"hit {number + 1}, bars of 95 %" if len(found) > 1 else "stretches of the record, bars of 95 %"
        made.segment(one.times[own], slip - width, one.times[own], slip + width, line_color=CURVES[number])
        made.scatter(one.times[own], slip, marker=MARKERS[number], size=7, color=CURVES[number], legend_label=name)
    legend_above(made)
    return made


def speed_figure(shaft: ShaftAngle) -> Figure:
    """The speed of the shaft with its band, as the tachometer or the azimuth tells it."""
    times = np.linspace(shaft.first, shaft.last, POINTS // 3)
    speed, width = shaft.speed(times) / (2.0 * np.pi), BAND * shaft.speed_std(times) / (2.0 * np.pi)
    made = new_figure("time [s]", "speed of the shaft [Hz]", name="speed", height=260)
    made.varea(times, speed - width, speed + width, fill_color=BLUE, fill_alpha=0.25, legend_label="interval of 95 %")
    made.line(times, speed, line_color=BLUE, line_width=1.5, legend_label="speed")
    mean = shaft.mean_speed / (2.0 * np.pi)
    made.line([times[0], times[-1]], [mean, mean], line_color=BLACK, line_dash="dashed", legend_label="mean")
    legend_above(made)
    return made


def _shown(found: list[Synchronisation], told: list[NDArray[np.bool_]]) -> float:
    """How far the axis reaches: stretches where the response has nearly died would flatten the rest."""
    slip = np.abs(np.concatenate([one.slip[own] for one, own in zip(found, told, strict=True)]))
    width = BAND * np.concatenate([one.slip_std[own] for one, own in zip(found, told, strict=True)])
    sure = width <= FAR * np.median(width)
    return float(np.degrees(1.15 * (slip + width)[sure].max()))


def slips(case: Case) -> list[Synchronisation]:
    """How well each hit keeps step."""
    return [synchronisation(case.analysis, hit) for hit in range(min(len(case.analysis.records), MOST_HITS))]


def _relative(found: Synchronisation) -> str:
    """The difference and its deviation in parts in a million, both to the digits that the deviation warrants."""
    value, std = 1e6 * found.relative, 1e6 * found.relative_std
    digits = max(0, 1 - int(np.floor(np.log10(std)))) if std > 0 else 3
    return f"{value:+.{digits}f} ± {std:.{digits}f}".replace("-", "−")


def _plain(value: float) -> str:
    return f"{value:.1f}" if value < 100.0 else f"{value:.0f}"


def slip_words(found: list[Synchronisation]) -> list[str]:
    """What the slips say of the period, a sentence a hit."""
    sentences = []
    for number, one in enumerate(found):
        if not np.isfinite(one.relative):
            continue
        who = f"Hit {number + 1}: the" if len(found) > 1 else "The"
        off = abs(one.relative) / one.relative_std if one.relative_std > 0 else 0.0
        sentences.append(
            f"{who} response's own period is {_relative(one)} parts in a "
            f"million from the one used, {_plain(off)} standard deviations."
        )
    return sentences
