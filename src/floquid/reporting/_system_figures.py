"""A(t) and B(t): the elements that vary most, with their bands."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.core import PeriodicModel
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel
from floquid.reporting._look import BLUE, VERMILION, Figure, legend_above, new_figure
from floquid.views import INTERVAL, closed_period, element_unit, in_unit, input_unit

MOST = 12  # elements shown of each; `summary.json` holds all

Truth = tuple[Floats, Floats]


def elements_shown(values: Floats, std: Floats | None, *, second_order: bool) -> list[tuple[int, int]]:
    """The elements that are no identity: all of them where they are few, or else those that vary most.

    `values` are those of A(t) or B(t) (times, states, columns), `std` their deviations.
    """
    _, n, columns = values.shape
    places = [(i, j) for i in range(n // 2 if second_order else 0, n) for j in range(columns)]
    if len(places) <= MOST:
        return places
    swing = 0.5 * np.ptp(values, axis=0)
    if std is not None:
        swing = swing / np.maximum(std.max(axis=0), np.finfo(float).tiny)
    return sorted(sorted(places, key=lambda place: -swing[place])[:MOST])


def element_name(letter: str, i: int, j: int) -> str:
    """The name of an element, counted from one: A₁₂ as A12, with a comma beyond nine."""
    return f"{letter}{i + 1}{j + 1}" if max(i, j) < 9 else f"{letter}{i + 1},{j + 1}"


def system_figures(analysis: Analysis, truth: Truth | None) -> dict[str, list[Figure]]:
    """A figure an element of A(t), and of B(t), against the phase, by their places on the page."""
    state, model = analysis.state, analysis.model
    if state is None:
        return {"system": [], "driving": []}
    second = analysis.settings.form == "second-order"
    return {
        "system": [
            _element_figure(state, model, at, truth)
            for at in elements_shown(state.system, state.system_std, second_order=second)
        ],
        "driving": _input_figures(state, model, second_order=second),
    }


def _input_figures(state: StateModel, model: PeriodicModel, *, second_order: bool) -> list[Figure]:
    """A figure an element of B(t)."""
    if state.inputs is None or model.inputs is None:
        return []
    stds, channels = state.inputs_std, model.inputs.channels
    return [
        _over_period(
            state, model.period, element_name("B", i, j), input_unit(state, i, channels[j], model.channels),
            state.inputs[:, i, j], None if stds is None else stds[:, i, j], None,
        )
        for i, j in elements_shown(state.inputs, stds, second_order=second_order)
    ]  # fmt: skip


def _element_figure(state: StateModel, model: PeriodicModel, place: tuple[int, int], truth: Truth | None) -> Figure:
    i, j = place
    std = None if state.system_std is None else state.system_std[:, i, j]
    known = None if truth is None else (truth[0], truth[1][:, i, j])
    unit = element_unit(state, i, j, model.channels)
    return _over_period(state, model.period, element_name("A", i, j), unit, state.system[:, i, j], std, known)


def _over_period(
    state: StateModel, period: float, name: str, unit: str, values: Floats, std: Floats | None, truth: Truth | None
) -> Figure:
    """One element over the period, its band, and its truth where that is known."""
    made = new_figure("phase [periods]", in_unit(name, unit), name=f"system-{name}", height=240)
    made.title.text = name
    order, times = closed_period(state.times, period)
    turns = times / period
    values = values[order]
    if std is not None:
        width = INTERVAL * std[order]
        made.varea(
            turns, values - width, values + width, fill_color=BLUE, fill_alpha=0.25, legend_label="interval of 95 %"
        )
    made.line(turns, values, line_color=BLUE, line_width=2, legend_label="identified")
    if truth is not None:
        inside = (truth[0] >= 0.0) & (truth[0] <= period * (1.0 + 1e-9))
        made.line(
            truth[0][inside] / period, truth[1][inside], line_color=VERMILION, line_dash="dashed", line_width=2,
            legend_label="truth",
        )  # fmt: skip
    legend_above(made)
    return made
