"""The mode chosen on the whole page: its shape, its coefficients, the rows of all others; and that of a survey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid.core import PeriodicModel
from floquid.fit import WITHIN
from floquid.reporting._case import CURVES, DASHES, HEIGHT, MARKERS, SIZE, Case, Figure, hover, legend_above, new_figure
from floquid.shapes import CLEAR, ModeReading, pairs_of
from floquid.surveys import Survey
from floquid.views import Ink, SpectraOfModes, families, in_unit, over_unit, shape_curves

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


MOST = 8  # channels of a shape, the strongest
LINES, LEAST = 3, 0.1  # lines that have an orbit, at most, and the share of the largest that each has
SEEN = 1e-4  # of the largest: lines of a shape that are shown
AROUND = 6  # harmonics on either side that are shown of waves over blades
KINDS = (("forward", Ink.BLUE, "solid"), ("backward", Ink.VERMILION, "dashed"), ("planar", Ink.GREY, "dotted"))

CHOSEN = """
const row = marks.selected.indices[0];
if (row === undefined) return;
const at = name => marks.data[name][row];
const where = at("name") + " at " + Number(at("x").toPrecision(6)) + unit;
for (const [k, bars] of shapes.entries()) bars.data = { harmonic: at("harmonic"), size: at("size" + k) };
shape.title.text = "Shape of " + where;
for (const [kind, curves] of orbits.entries()) {
  const own = at("orbits").filter(one => one[0] === kind), turn = Array.from({ length: 46 }, (_, k) => 0.13 * k);
  const way = (one, k) => turn.map(t => one[k] * Math.cos(t) - one[k + 1] * Math.sin(one[5] * t));
  const xs = own.map(one => way(one, 1)), ys = own.map(one => way(one, 3));
  curves.data = { xs, ys, x: xs.map(x => x[0]), y: ys.map(y => y[0]) };
}
if (orbit) orbit.title.text = "Orbits of " + where;
for (const [family, waves] of Object.entries(tables)) {
  const share = at("waves " + family), text = share.map(s => s < 0.005 ? "" : s.toFixed(2));
  waves.data = { ...waves.data, share, text };
  patterns[family].title.text = family + ": " + where;
}
"""
"""A mark that is clicked shows its shape."""


def channels_of(found: Survey) -> list[str]:
    """The strongest channels of the first model of a survey, as many as a figure shows."""
    model = next((point.model for point in found.points if point.model is not None), None)
    if model is None:
        return []
    energy = np.sum(np.abs(model.coefficients) ** 2, axis=(0, 2, 3))
    return [model.channels[k].name for k in sorted(np.argsort(-energy, kind="stable")[:MOST].tolist())]


def shape_columns(found: Survey, point: int) -> Any:
    """A function that gives the columns of a mark: of a mode of a `point` of a survey on a track's branch."""
    model = found.points[point].model
    assert model is not None
    names, shown = [channel.name for channel in model.channels], channels_of(found)
    pairs = pairs_of(found.shapes.pairs, model.channels) if found.shapes.pairs else ()
    readings = (
        {own.mode: own for own in found.shapes.read(model).modes} if found.shapes.families(model.channels) else {}
    )

    def columns(mode: int, shift: int, *, mirrored: bool) -> dict[str, Any]:
        sizes = np.abs(model.coefficients[mode, :, 0])
        sizes /= max(float(sizes.max()), 1e-300)
        used = (sizes > SEEN * sizes.max()).any(axis=0)
        row: dict[str, Any] = {"harmonic": model.harmonics[used].tolist()}
        row |= {
            f"size{k}": sizes[names.index(name), used].tolist() if name in names else [] for k, name in enumerate(shown)
        }
        if pairs:
            row["orbits"] = _orbits(model, mode, [pair.x for pair in pairs], [pair.y for pair in pairs])
        for name in _families(found):
            row[f"waves {name}"] = _waves(found, model, readings.get(mode), name, shift, -1 if mirrored else 1)
        return row

    return columns


def _families(found: Survey) -> dict[str, Any]:
    """The groups of blades of a survey, by name."""
    model = next((point.model for point in found.points if point.model is not None), None)
    groups = () if model is None else found.shapes.families(model.channels)
    return {own.name: own.waves for own in groups if not own.is_fixed}


def _orbits(model: PeriodicModel, mode: int, first: Sequence[int], second: Sequence[int]) -> list[list[float]]:
    """The strongest lines of a mode in pairs: the kind, both parts of x and of y over the largest, the sign of time."""
    x, y = (model.coefficients[mode][rows, 0] for rows in (first, second))
    signs = np.where(model.exponents[mode].imag + model.fundamental * model.harmonics < 0.0, -1.0, 1.0)
    energy = 0.5 * (np.abs(x) ** 2 + np.abs(y) ** 2)
    whole = energy.sum(axis=0)
    largest = max(float(np.abs([x, y]).max()), 1e-300)
    found = []
    for line in np.argsort(-whole, kind="stable")[:LINES].tolist():
        if whole[line] <= LEAST * whole.max():
            continue
        for a, b, size in zip(x[:, line] / largest, y[:, line] / largest, energy[:, line] / largest**2, strict=True):
            index = -signs[line] * float((a.conj() * b).imag) / max(float(size), 1e-300)
            kind = 2.0 if abs(index) < CLEAR else float(index < 0.0)
            found.append([kind, a.real, a.imag, b.real, b.imag, float(signs[line])])
    return found


def _curves(orbits: Sequence[Sequence[float]], kind: int) -> dict[str, list[Any]]:
    """The orbits of one kind, drawn as the page itself does when a mark is clicked."""
    turn = 0.13 * np.arange(46)
    own = [one for one in orbits if one[0] == kind]
    xs, ys = ([(one[k] * np.cos(turn) - one[k + 1] * np.sin(one[5] * turn)).tolist() for one in own] for k in (1, 3))
    return {"xs": xs, "ys": ys, "x": [curve[0] for curve in xs], "y": [curve[0] for curve in ys]}


def _waves(
    found: Survey, model: PeriodicModel, reading: ModeReading | None, name: str, shift: int, side: int
) -> list[float]:
    """Shares of the space harmonics n of a group at the harmonics m of the track, row by row."""
    waves = _families(found)[name]
    grid: Floats = np.zeros((len(waves), 2 * AROUND + 1))
    if reading is None or reading.blades is None:
        return grid.ravel().tolist()
    energy = {
        own.name: len(own.rows) * own.scale**2 * np.abs(reading.blades.tables[own.name]) ** 2
        for own in found.shapes.families(model.channels)
    }
    whole = sum(float(own.sum()) for own in (energy.values() if reading.blades.is_compared else [energy[name]]))
    rows = {int(wave): row for row, wave in enumerate(waves)}
    for (row, column), share in np.ndenumerate(energy[name] / max(whole, 1e-300)):
        m = side * int(model.harmonics[column]) - shift
        if abs(m) <= AROUND:
            grid[rows.get(side * int(waves[row]), row), m + AROUND] += share
    return np.round(grid, 4).ravel().tolist()


def chosen_figures(found: Survey, marks: Any) -> dict[str, Figure]:
    """Figures of the shape of the mark that is chosen in the source `marks`, by the names of their places."""
    from bokeh.models import AdaptiveTicker, ColumnDataSource, CustomJS

    first = {name: own[0] if len(own) else [] for name, own in marks.data.items()}
    unit = f" {over_unit(found.over)[1]}".rstrip()
    where = f"{first['name']} at {first['x']:g}{unit}" if marks.data["name"] else ""
    shape = new_figure("harmonic m", "size, over the largest", name="shape")
    shape.xaxis.ticker = AdaptiveTicker(mantissas=[1, 2, 5], min_interval=1, num_minor_ticks=0)
    bars = []
    for k, name in enumerate(channels_of(found)):
        bars.append(ColumnDataSource({"harmonic": first["harmonic"], "size": first[f"size{k}"]}))
        style: dict[str, Any] = {"source": bars[-1], "line_color": CURVES[k], "legend_label": name}
        shape.line("harmonic", "size", line_dash=DASHES[k], **style)
        shape.scatter("harmonic", "size", marker=MARKERS[k], fill_color="white", size=6, **style)
    legend_above(shape)
    shape.title.text = f"Shape of {where}" if where else "Shape"
    made, orbits = {"shape": shape}, []
    if "orbits" in first:
        made["orbits"] = new_figure("x, over the largest", "y, over the largest", name="orbits", match_aspect=True)
        made["orbits"].title.text = f"Orbits of {where}"
        for kind, (word, colour, dash) in enumerate(KINDS):
            curves: Any = _curves(first["orbits"], kind)
            orbits.append(ColumnDataSource(curves))
            look: dict[str, Any] = {"line_color": colour, "line_dash": dash, "legend_label": word}
            made["orbits"].line([np.nan], [np.nan], **look)  # the legend has the line of a kind that this mode lacks
            made["orbits"].multi_line("xs", "ys", source=orbits[-1], **look)
            made["orbits"].scatter("x", "y", source=orbits[-1], color=colour, size=7, legend_label=word)
        legend_above(made["orbits"], columns=3)
    patterns = {
        name: _pattern(name, waves, first.get(f"waves {name}", []), where) for name, waves in _families(found).items()
    }
    sources = {name: own.renderers[0].data_source for name, own in patterns.items()}
    arguments = {"marks": marks, "shapes": bars, "shape": shape, "orbits": orbits, "orbit": made.get("orbits")}
    arguments["unit"] = unit
    marks.selected.js_on_change(
        "indices", CustomJS(args=arguments | {"tables": sources, "patterns": patterns}, code=CHOSEN)
    )
    return made | {f"waves-{number}": own for number, own in enumerate(patterns.values())}


def _pattern(name: str, waves: Any, shares: Sequence[float], where: str) -> Figure:
    """The shares of space harmonics over the harmonics of a mode, as blues with numbers."""
    from bokeh.models import ColumnDataSource, LinearColorMapper, SingleIntervalTicker

    m, n = np.meshgrid(np.arange(-AROUND, AROUND + 1), waves)
    text = ["" if share < 0.005 else f"{share:.2f}" for share in shares]
    source: Any = ColumnDataSource({"m": m.ravel(), "n": n.ravel(), "share": shares, "text": text})
    height = min(HEIGHT, 120 + 40 * len(waves))
    own = new_figure("harmonic m of the mode", "wave n over the blades", name="waves", height=height)
    for axis in own.axis:
        axis.ticker = SingleIntervalTicker(interval=1)
    own.grid.visible = False
    own.title.text = f"{name}: {where}"
    blues = [f"#{255 - 169 * k // 100:02x}{255 - 75 * k // 100:02x}{255 - 22 * k // 100:02x}" for k in range(101)]
    shade: Any = {"field": "share", "transform": LinearColorMapper(palette=blues, low=0.0, high=1.0)}
    cells = own.rect("m", "n", 1, 1, source=source, fill_color=shade, line_color="#dddddd")
    centred: Any = {"text_align": "center", "text_baseline": "middle", "text_font_size": SIZE, "text_color": Ink.BLACK}
    own.text("m", "n", "text", source=source, **centred)
    hover(own, [("", "n = @n, m = @m"), ("share", "@share{%.4f}")], [cells])
    return own
