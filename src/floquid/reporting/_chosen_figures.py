"""The mode chosen on the whole page: its shape and its coefficients, the rows of all others at hand, and the change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.fit import WITHIN
from floquid.reporting._case import CURVES, DASHES, MARKERS, Case, Figure, hover, legend_above, new_figure
from floquid.views import Ink, SpectraOfModes, families, in_unit, shape_curves

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource

CHOOSE = """
if (modes.selected.indices.length !== 1) {
    // One mode is always chosen: a click beside all marks changes nothing, one on several takes the first.
    modes.selected.indices = [modes.selected.indices.length ? modes.selected.indices[0] : last.get_column("row")[0]];
    return;
}
const row = modes.selected.indices[0];
last.data = {row: [row]};
for (let k = 0; k < drawn.length; k++) drawn[k].data = columns[k][row];
document.dispatchEvent(new CustomEvent("floquid:mode", {detail: row}));
"""

RESPONSE = """
const row = response.get_column("row")[0];
for (let k = 0; k < drawn.length; k++) drawn[k].data = columns[k][row];
for (let k = 0; k < axes.length; k++) axes[k].axis_label = labels[k][row];
"""


@dataclass(frozen=True, slots=True)
class Chosen:
    """A source that figures draw, and the same columns of each mode."""

    drawn: ColumnDataSource
    modes: tuple[dict[str, Any], ...]


def shape_source(case: Case) -> Chosen:
    """The shapes over a period: the real and the imaginary part of each channel, each with its band of 95 %."""
    return _chosen("shape", [_shape(case, row) for row in range(len(case.modes))])


def coefficient_source(case: Case) -> Chosen:
    """The coefficients of each channel over their deviations."""
    return _chosen("coefficients", [_coefficients(case, row) for row in range(len(case.modes))])


def family_source(case: Case) -> Chosen:
    """The frequencies at which the mode shows in the record [Hz]."""
    by_mode = {family.mode: family for family in families(case.analysis)}
    return _chosen("family", [{"frequency": by_mode[mode].omega * case.turn} for mode in case.modes])


def harmonic_source(found: SpectraOfModes) -> Chosen:
    """The frequencies at which the mode shows in the harmonic power spectra [Hz]."""
    return _chosen("harmonic", [{"frequency": own} for own in found.modes])


def _chosen(name: str, rows: list[dict[str, Any]]) -> Chosen:
    from bokeh.models import ColumnDataSource

    return Chosen(ColumnDataSource(dict(rows[0]) if rows else {}, name=name), tuple(rows))


def _shape(case: Case, row: int) -> dict[str, Any]:
    curves = shape_curves(case.analysis.model, case.modes[row], hit=case.hits[row])
    columns: dict[str, Any] = {"turns": curves.turns}
    for number, channel in enumerate(case.channels):
        for part in ("real", "imag"):
            own = getattr(curves.values[channel], part)
            width = 0.0 if curves.std is None else WITHIN * getattr(curves.std[channel], part)
            columns[f"{part}{number}"] = own.astype(np.float32)
            columns[f"{part}{number}_low"] = (own - width).astype(np.float32)
            columns[f"{part}{number}_high"] = (own + width).astype(np.float32)
    return columns


def _coefficients(case: Case, row: int) -> dict[str, Any]:
    """Coefficients of the harmonics that the model keeps, and of several beside them."""
    model, mode, hit = case.analysis.model, case.modes[row], case.hits[row]
    whole = model.unselected
    if whole is None:
        kept = (model.coefficients[mode] != 0).any(axis=(0, 1))
        harmonics = model.harmonics[kept]
        values = np.abs(model.coefficients[mode][:, hit, kept])
        floors = np.full(values.shape, np.nan)
        kept = np.ones(len(harmonics), bool)
    else:
        own = model.modes_of(whole)[whole.modes] == mode
        harmonics, kept = whole.harmonics[own], model.kept_terms(whole)[own]
        values = np.abs(whole.coefficients[own, :, hit]).T
        floors = np.abs(whole.std()[own, :, hit]).T
    columns: dict[str, Any] = {"harmonic": harmonics, "alpha": kept.astype(float)}
    columns["kept"] = ["yes" if one else "no" for one in kept]
    width = 0.5 / max(len(case.channels), 1)
    for number, channel in enumerate(case.channels):
        columns[f"x{number}"] = harmonics + width * (number - 0.5 * (len(case.channels) - 1))
        columns[f"channel{number}"] = [case.names()[number]] * len(harmonics)
        columns[f"unit{number}"] = [case.units()[number]] * len(harmonics)
        columns[f"size{number}"], columns[f"floor{number}"] = values[channel], floors[channel]
        columns[f"ratio{number}"] = values[channel] / floors[channel] if whole is not None else values[channel]
    return columns


def shape_figures(case: Case, chosen: Chosen) -> list[Figure]:
    """The real and the imaginary part against the phase: a pair of figures for each unit."""
    figures, units = [], case.units()
    bands = case.analysis.model.estimates is not None
    for unit in dict.fromkeys(units):
        for part, words in (("real", "real part"), ("imag", "imaginary part")):
            made = new_figure("phase [periods]", in_unit(words, unit), name=f"shape-{part}")
            if part == "imag":
                made.y_range = figures[-1].y_range  # or a small part would look as large as the other
            for number, own in enumerate(units):
                if own != unit:
                    continue
                colour, dash = CURVES[number], DASHES[number]
                if bands:
                    made.varea(
                        x="turns", y1=f"{part}{number}_low", y2=f"{part}{number}_high", source=chosen.drawn,
                        fill_color=colour, fill_alpha=0.25, legend_label=case.labels()[number],
                    )  # fmt: skip
                made.line(
                    "turns", f"{part}{number}", source=chosen.drawn, line_color=colour, line_dash=dash, line_width=2,
                    legend_label=case.labels()[number],
                )  # fmt: skip
            legend_above(made)
            figures.append(made)
    return figures


def coefficients_figure(case: Case, chosen: Chosen) -> Figure:
    """The magnitudes of the coefficients over their deviations; those kept are filled."""
    from bokeh.models import BasicTicker, Span

    told = case.analysis.model.unselected is not None
    label = "|B| / standard deviation" if told else "|B| [units of the channels]"
    made = new_figure("harmonic m", label, name="coefficients", y_axis_type="log", height=360)
    for number, name in enumerate(case.labels()):
        colour = CURVES[number]
        mark = made.scatter(
            f"x{number}", f"ratio{number}", source=chosen.drawn, marker=MARKERS[number], size=9, line_color=colour,
            fill_color=colour, fill_alpha="alpha", legend_label=name,
        )  # fmt: skip
        # Through columns: a name written into the text would be read as a template.
        tips = [("channel", f"@channel{number}"), ("m", "@harmonic"), ("|B|", f"@size{number}{{%.4g}} @unit{number}")]
        tips += [("deviation", f"@floor{number}{{%.2g}} @unit{number}")] if told else []
        hover(made, [*tips, ("kept", "@kept")], [mark])
    if told:
        made.add_layout(Span(location=1.0, dimension="width", line_color=Ink.BLACK, line_dash="dashed"))
    made.xaxis.ticker = BasicTicker(min_interval=1, num_minor_ticks=0, desired_num_ticks=13)
    made.x_range.min_interval = 3
    legend_above(made)
    return made


def span_lines(made: Figure, lines: Chosen) -> None:
    """Draw the lines of all modes, and those of the mode chosen."""
    every = np.concatenate([row["frequency"] for row in lines.modes]) if lines.modes else np.zeros(0)
    made.vspan(x=every, line_color=Ink.GREY, line_alpha=0.35, line_width=1, legend_label="lines of all modes")
    made.vspan(
        x="frequency", source=lines.drawn, line_color=Ink.VERMILION, line_width=2, line_dash="dashed",
        legend_label="of the mode chosen",
    )  # fmt: skip


def link_modes(modes: ColumnDataSource, chosen: list[Chosen]) -> None:
    """Let the row selected in `modes` decide what the figures of the mode show."""
    from bokeh.models import ColumnDataSource, CustomJS

    last = ColumnDataSource({"row": [0]})
    modes.selected.js_on_change("indices", CustomJS(args=_args(chosen, modes=modes, last=last), code=CHOOSE))


def link_responses(chosen: list[Chosen], axes: list[Any], labels: list[list[str]]) -> ColumnDataSource:
    """A source whose one number says which response the figures of the record show, and how their axes are labelled."""
    from bokeh.models import ColumnDataSource, CustomJS

    response = ColumnDataSource({"row": [0]}, name="response")
    response.js_on_change(
        "data", CustomJS(args=_args(chosen, response=response, axes=axes, labels=labels), code=RESPONSE)
    )
    return response


def _args(chosen: list[Chosen], **others: Any) -> dict[str, Any]:
    return {"drawn": [one.drawn for one in chosen], "columns": [list(one.modes) for one in chosen], **others}
