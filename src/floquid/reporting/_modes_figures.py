"""Figures of the modes: the stabilisation diagram, the complex plane, the multipliers about the unit circle."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.reporting._case import Case
from floquid.reporting._chosen_figures import (
    Chosen,
    coefficient_source,
    coefficients_figure,
    link_modes,
    shape_figures,
    shape_source,
)
from floquid.reporting._look import BLACK, GREY, HEIGHT, SIZE, VERMILION, Figure, hover, legend_above, new_figure
from floquid.views import DampingUnit, decrement, exponent_ellipses, multiplier_ellipses

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
    """The numbers of the modes for their marks; those whose texts would meet stand together at the first mark.

    Positions `x` and `y` are in the units of axes that show `wide` by `high` at least. Texts are measured on a phone,
    and a `gap` is left after each.
    """
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
        x, y, source=source, size=11, line_color=BLACK, fill_color=VERMILION, line_width=1.3, name="mode-marks",
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
        list(curves.real), list(curves.imag * turn), line_color=BLACK, line_width=1.0, legend_label="95 % ellipse"
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
    made.ray(x=0, y=0, angle=np.pi / 2, length=0, line_color=GREY, line_dash="dashed")
    made.ray(x=0, y=0, angle=-np.pi / 2, length=0, line_color=GREY, line_dash="dashed")
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
    made.line(np.cos(angle), np.sin(angle), line_color=GREY, line_dash="dashed", legend_label="unit circle: no decay")
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
