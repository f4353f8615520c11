"""A(t): the elements that vary most, with their bands."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.core import PeriodicModel
from floquid.reconstruction import StateModel
from floquid.reporting._chosen_figures import BAND
from floquid.reporting._look import BLUE, VERMILION, Figure, legend_above, new_figure
from floquid.views import closed_period, element_unit

MOST = 12  # elements shown; `summary.json` holds all

Truth = tuple[Floats, Floats]


def elements_shown(state: StateModel, *, second_order: bool) -> list[tuple[int, int]]:
    """The elements that are no identity: all of them where they are few, or else those that vary most."""
    n = len(state.states)
    rows = range(n // 2 if second_order else 0, n)
    places = [(i, j) for i in rows for j in range(n)]
    if len(places) <= MOST:
        return places
    swing = 0.5 * np.ptp(state.system, axis=0)
    if state.system_std is not None:
        swing = swing / np.maximum(state.system_std.max(axis=0), np.finfo(float).tiny)
    return sorted(sorted(places, key=lambda place: -swing[place])[:MOST])


def element_name(i: int, j: int) -> str:
    """The name of an element, counted from one: A₁₂ as A12, with a comma beyond nine."""
    return f"A{i + 1}{j + 1}" if max(i, j) < 9 else f"A{i + 1},{j + 1}"


def element_figures(
    state: StateModel, model: PeriodicModel, *, second_order: bool, truth: Truth | None
) -> list[Figure]:
    """A figure an element, against the phase."""
    return [_element_figure(state, model, place, truth) for place in elements_shown(state, second_order=second_order)]


def _element_figure(state: StateModel, model: PeriodicModel, place: tuple[int, int], truth: Truth | None) -> Figure:
    i, j = place
    label = f"{element_name(i, j)} [{element_unit(state, i, j, model.channels)}]"
    made = new_figure("phase [periods]", label, name=f"system-{i}-{j}", height=240)
    made.title.text = element_name(i, j)
    order, times = closed_period(state.times, model.period)
    turns = times / model.period
    values = state.system[order, i, j]
    if state.system_std is not None:
        width = BAND * state.system_std[order, i, j]
        made.varea(
            turns, values - width, values + width, fill_color=BLUE, fill_alpha=0.25, legend_label="interval of 95 %"
        )
    made.line(turns, values, line_color=BLUE, line_width=2, legend_label="identified")
    if truth is not None:
        inside = (truth[0] >= 0.0) & (truth[0] <= model.period * (1.0 + 1e-9))
        made.line(
            truth[0][inside] / model.period, truth[1][inside, i, j], line_color=VERMILION, line_dash="dashed",
            line_width=2, legend_label="truth",
        )  # fmt: skip
    legend_above(made)
    return made
