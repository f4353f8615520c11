"""Figures of the modes: the stabilisation diagram, the complex plane, the multipliers about the unit circle."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import PeriodicModel
from floquid.fit import WITHIN
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel
from floquid.reporting._case import HEIGHT, SIZE, Case, Figure, hover, legend_above, new_figure
from floquid.reporting._chosen_figures import (
    Chosen,
    coefficient_source,
    coefficients_figure,
    link_modes,
    shape_figures,
    shape_source,
)
from floquid.views import (
    DampingUnit,
    Ink,
    closed_period,
    decrement,
    element_unit,
    exponent_ellipses,
    in_unit,
    input_unit,
    multiplier_ellipses,
)

LETTER, GAP, MARK, LINE = 0.026, 0.01, 0.045, 0.07
"""A letter, what is left between texts, or from a text to the next mark, and a line, as shares of axes on a phone."""

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource


def mode_source(case: Case) -> ColumnDataSource:
    """The modes, a row each; the row selected is the mode that all figures show."""
    from bokeh.models import ColumnDataSource, Selection

    model = case.analysis.model
    at = list(case.modes)
    value = np.asarray(model.exponents[at], np.complex128)
    data = {
        "number": np.arange(1, len(at) + 1),
        "decay": value.real,
        "frequency": np.abs(value.imag) * case.turn,
        "folded": np.abs(model.principal()[at].imag) * case.turn,
        "damping": [
            100.0 * ratio if case.damping == "percent" else decrement(ratio)[0]
            for ratio in model.damping_ratios[at].tolist()
        ],
        "real": model.multipliers[at].real,
        "imag": np.abs(model.multipliers[at].imag),
    }
    data["label_decay"] = mark_labels(data["decay"], data["frequency"], gap=MARK)
    for name in ("folded", "frequency"):  # of the stabilisation diagrams: all at one height
        data[f"label_{name}"] = mark_labels(data[name], np.zeros(len(at)), 0.5 / model.period * case.turn, 1.0)
    data["label_real"] = mark_labels(data["real"], data["imag"], 2.0, 1.0, gap=MARK)
    return ColumnDataSource(data, name="modes", selected=Selection(indices=[0] if at else []))


def mark_labels(x: Floats, y: Floats, wide: float = 0.0, high: float = 0.0, gap: float = GAP) -> list[str]:
    """The numbers of the modes for their marks; those whose texts would meet stand together at the first mark."""
    across, up = (max(max(v, default=0.0) - min(v, default=0.0), least) or 1.0 for v, least in ((x, wide), (y, high)))
    held = {k: [k + 1] for k in range(len(x))}

    def meet(one: int, other: int) -> bool:
        letters = max(len(_ranges(held[one])), len(_ranges(held[other])))
        return abs(x[one] - x[other]) <= (LETTER * letters + gap) * across and abs(y[one] - y[other]) <= LINE * up

    while pair := next((pair for pair in combinations(held, 2) if meet(*pair)), None):
        held[pair[0]] = sorted(held[pair[0]] + held.pop(pair[1]))
    return [_ranges(held.get(k, [])) for k in range(len(x))]


def _ranges(numbers: list[int]) -> str:
    """Numbers in ascending order as a short text: 1, 3-5."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{part[0]}–{part[-1]}" if len(part) > 2 else ", ".join(map(str, part)) for part in parts)


def _modes(made: Figure, source: ColumnDataSource, x: str, y: str, damping: DampingUnit) -> None:
    """The modes as numbered marks, damping in a unit; the one chosen is filled."""
    from bokeh.models import LabelSet, TapTool

    marks = made.scatter(
        x, y, source=source, size=11, line_color=Ink.BLACK, fill_color=Ink.VERMILION, line_width=1.3, name="mode-marks",
        nonselection_fill_color="white", nonselection_fill_alpha=0.6, nonselection_line_alpha=1.0,
    )  # fmt: skip
    made.add_layout(LabelSet(x=x, y=y, text=f"label_{x}", source=source, x_offset=7, y_offset=4, text_font_size=SIZE))
    made.add_tools(TapTool(renderers=[marks]))
    tips = [("mode", "@number"), ("Im λ/2π", "@frequency{%.7g} Hz"), ("Re λ", "@decay{%.4g} 1/s")]
    hover(made, [*tips, ("ζ", "@damping{%.4g} %") if damping == "percent" else ("δ", "@damping{%.4g}")], [marks])


def _ellipses(made: Figure, curves: Complexes | None, turn: float = 1.0) -> None:
    """The ellipses of 95 %, which show as one looks closer."""
    if curves is None:
        return
    made.multi_line(
        list(curves.real), list(curves.imag * turn), line_color=Ink.BLACK, line_width=1.0, legend_label="95 % ellipse"
    )


def _upper(curves: Complexes | None, case: Case) -> Complexes | None:
    """The curves of the modes shown, mirrored where they lie below the real axis: there the conjugate is drawn."""
    if curves is None:
        return None
    own = curves[list(case.modes)]
    below = np.mean(own.imag, axis=1, keepdims=True) < 0.0
    return np.asarray(np.where(below, own.conj(), own), np.complex128)


def exponents_figure(case: Case, source: ColumnDataSource) -> Figure:
    """The exponents in the complex plane, conjugates left out."""
    made = new_figure("Re λ [1/s]", "Im λ/2π [Hz]", name="exponents")
    made.x_range.range_padding = made.y_range.range_padding = 0.15
    _ellipses(made, _upper(exponent_ellipses(case.analysis.model), case), case.turn)
    _modes(made, source, "decay", "frequency", case.damping)
    made.ray(x=0, y=0, angle=np.pi / 2, length=0, line_color=Ink.GREY, line_dash="dashed")
    made.ray(x=0, y=0, angle=-np.pi / 2, length=0, line_color=Ink.GREY, line_dash="dashed")
    legend_above(made)
    return made


def multipliers_figure(case: Case, source: ColumnDataSource) -> Figure:
    """The multipliers beside the unit circle, conjugates left out."""
    from bokeh.models import Range1d

    model = case.analysis.model
    largest = 1.1 * max(1.0, float(np.abs(model.multipliers).max(initial=0.0)))
    made = new_figure(
        "Re μ", "|Im μ|", name="multipliers", height=HEIGHT, match_aspect=True,
        x_range=Range1d(start=-largest, end=largest), y_range=Range1d(start=-0.1 * largest, end=largest),
    )  # fmt: skip
    angle = np.linspace(0.0, np.pi, 181)
    made.line(
        np.cos(angle), np.sin(angle), line_color=Ink.GREY, line_dash="dashed", legend_label="unit circle: no decay"
    )
    _ellipses(made, _upper(multiplier_ellipses(model), case))
    _modes(made, source, "real", "imag", case.damping)
    legend_above(made)
    return made


def mode_figures(case: Case, modes: ColumnDataSource, *chosen: Chosen) -> dict[str, list[Figure]]:
    """Shape and coefficients of the mode chosen, and the planes of all, by their places on the page, linked."""
    # What else is drawn of the mode chosen is linked with them.
    shape, coefficients = shape_source(case), coefficient_source(case)
    link_modes(modes, [shape, coefficients, *chosen])
    return {
        "shape": shape_figures(case, shape),
        "coefficients": [coefficients_figure(case, coefficients)],
        "plane": [exponents_figure(case, modes), multipliers_figure(case, modes)],
    }


MOST = 12  # elements shown of each; `summary.json` holds all

Truth = tuple[Floats, Floats]


def elements_shown(values: Floats, std: Floats | None, *, second_order: bool) -> list[tuple[int, int]]:
    """The elements that are no identity: all of them where they are few, or else those that vary most."""
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
        width = WITHIN * std[order]
        made.varea(
            turns, values - width, values + width, fill_color=Ink.BLUE, fill_alpha=0.25, legend_label="interval of 95 %"
        )
    made.line(turns, values, line_color=Ink.BLUE, line_width=2, legend_label="identified")
    if truth is not None:
        inside = (truth[0] >= 0.0) & (truth[0] <= period * (1.0 + 1e-9))
        made.line(
            truth[0][inside] / period, truth[1][inside], line_color=Ink.VERMILION, line_dash="dashed", line_width=2,
            legend_label="truth",
        )  # fmt: skip
    legend_above(made)
    return made
