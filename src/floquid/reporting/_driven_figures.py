"""Figures of records whose excitation goes on: spectra, transfer functions, the way of inputs, samples left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.errors import IdentificationError, InputError
from floquid.findings import texts
from floquid.fit import WITHIN
from floquid.inputs import TransferFunctions
from floquid.pipeline import Analysis, measure_transfer, predicted_rest
from floquid.reporting._case import (
    CURVES,
    DASHES,
    LONGEST,
    MARKERS,
    POINTS,
    SIZE,
    Case,
    Figure,
    legend_above,
    new_figure,
)
from floquid.reporting._chosen_figures import Chosen, span_lines
from floquid.reporting._modes_figures import mark_labels
from floquid.transfer import MeasuredTransfer
from floquid.views import Ink, SpectraOfModes, envelope, in_unit, magnitude_bands, phase_degrees, shortened

MOST_PATHS = 16  # paths from an input to an output that are drawn; transfer.csv holds all
CLOSE = 5.0  # periods of the stretch left out
LINES = 120  # frequencies at which G is measured beside the model
FLAT = 8.0  # widths of a resonance over which a line is measured, from which on resonances are lost
STRONGEST = 3  # harmonics of a path that are drawn beside measured lines
SEEN = 4.0  # deviations from which on a phase is one
MOST_MODES = 8  # modes whose inputs are drawn

Path = tuple[int, int]  # output and input


def paths_of(found: TransferFunctions, noise: Floats, sizes: Floats) -> list[Path]:
    """The paths that do most beyond the noise, in the order of outputs and inputs."""
    size = np.abs(found.values).max(axis=(0, 3)) * sizes / noise
    order = np.argsort(-size, axis=None, kind="stable")[:MOST_PATHS]
    return sorted((int(place) // size.shape[1], int(place) % size.shape[1]) for place in order)


def _name(found: TransferFunctions, path: Path) -> str:
    return f"{shortened(found.inputs[path[1]].name, LONGEST)} to {shortened(found.outputs[path[0]].name, LONGEST)}"


def matrix_rows(found: TransferFunctions, paths: list[Path]) -> list[tuple[str, list[tuple[str, int]]]]:
    """Name of each path, and share of each harmonic of the largest, in words and as grey."""
    rows = []
    for row, column in paths:
        largest = np.abs(found.values[:, row, column]).max(axis=1)
        share = largest / max(largest.max(), np.finfo(float).tiny)
        rows.append((_name(found, (row, column)), [(f"{100.0 * one:.3g} %", round(255 - 125 * one)) for one in share]))
    return rows


def _curve(harmonic: int) -> int:
    """The number of the curve of a harmonic: 0, -1, 1, -2, ...."""
    return (2 * abs(harmonic) - (harmonic > 0)) % len(CURVES)


def transfer_figures(found: TransferFunctions, paths: list[Path]) -> list[Figure]:
    """Magnitude and phase of each harmonic of each path, a pair of figures a path."""
    figures = []
    for row, column in paths:
        unit = found.unit(row, column)
        size = new_figure(
            "frequency of the input f [Hz]", in_unit("|G|", unit), name=f"size-{row}-{column}", y_axis_type="log"
        )
        sizes, low, high, size.y_range.start = magnitude_bands(found, row, column)
        degrees = phase_degrees(found, row, column)
        phase = new_figure(
            "frequency of the input f [Hz]", "arg G [°]", name=f"phase-{row}-{column}", x_range=size.x_range
        )
        size.title.text = phase.title.text = _name(found, (row, column))
        for place, m in sorted(enumerate(found.harmonics.tolist()), key=lambda one: (abs(one[1]), one[1])):
            if not sizes[place].any():
                continue
            number = _curve(m)
            look = {"line_color": CURVES[number], "line_dash": DASHES[number], "legend_label": f"m = {m}"}
            if found.std is not None:
                size.varea(
                    found.frequencies_hz, low[place], high[place], fill_color=CURVES[number], fill_alpha=0.25,
                    legend_label=f"m = {m}",
                )  # fmt: skip
            size.line(found.frequencies_hz, sizes[place], line_width=2, **look)
            phase.line(found.frequencies_hz, degrees[place], line_width=2, **look)
        for made in (size, phase):
            legend_above(made, columns=3)
        figures += [size, phase]
    return figures


def measured_beside(analysis: Analysis, found: TransferFunctions) -> tuple[MeasuredTransfer | None, tuple[str, ...]]:
    """G measured line by line over the frequencies of that of the model, or none, and words on that."""
    hertz = np.linspace(found.frequencies_hz[0], found.frequencies_hz[-1], LINES)
    try:
        measured = measure_transfer(
            analysis.records,
            replace(analysis.settings, excitation="none", skip=None),
            harmonics=found.harmonics,
            frequencies_hz=hertz,
        )
    except (InputError, IdentificationError) as error:
        return None, (str(error),)
    narrowest = float(np.abs(analysis.model.exponents.real).min()) / np.pi
    for finding in measured.findings:
        if finding.code == "measured_polynomials" and finding.numbers["width"] > FLAT * narrowest:
            why = (
                f"The records are too short for that: a line is measured over {finding.numbers['width']:.3g} Hz, and "
                f"the narrowest resonance is {narrowest:.3g} Hz wide."
            )
            return None, (why,)
    return measured, texts(measured.findings)


def measured_figures(
    lines: TransferFunctions, at: TransferFunctions, drawn: TransferFunctions, paths: list[Path], *, each: bool = False
) -> list[Figure]:
    """Lines as measured with bars of 95 %, and the model's G with bands: a figure a path, or each harmonic of it."""
    from bokeh.models import ColumnDataSource, Whisker

    assert lines.std is not None
    figures, most = [], MOST_PATHS * STRONGEST // len(paths) if each else STRONGEST
    for row, column in paths:
        off = (at.values - lines.values)[:, row, column]
        std = lines.std[:, row, column]
        with np.errstate(divide="ignore", invalid="ignore"):
            pulls = np.array([off.real / std.real, off.imag / std.imag])
        pulls[:, ~np.isfinite(off)] = np.nan
        sizes, low, high, _ = magnitude_bands(lines, row, column)
        curves, under, over, _ = magnitude_bands(drawn, row, column)
        strongest = np.sort(np.argsort(-curves.max(axis=1), kind="stable")[:most])
        for places in strongest[:, None] if each else [strongest]:
            made = new_figure(
                "frequency of the input f [Hz]", in_unit("|G|", lines.unit(row, column)),
                name=f"measured-{row}-{column}-{places[0]}", y_axis_type="log",
            )  # fmt: skip
            which = f", m = {lines.harmonics[places[0]]}" if each else ""
            apart = np.sqrt(np.nanmean(pulls[:, places if each else slice(None)] ** 2))
            made.title.text = f"{_name(lines, (row, column))}{which}: {apart:.2g} deviations apart (rms)"
            there = np.isfinite(sizes[places])
            made.y_range.start = 0.5 * np.maximum(sizes, high - sizes)[places][there].min(initial=np.inf)
            for place in places.tolist():
                there = (high[place] - sizes[place]) * SEEN < WITHIN * sizes[place]  # false of one that is missing
                number, label = _curve(int(lines.harmonics[place])), f"m = {lines.harmonics[place]}"
                colour = CURVES[number]
                made.varea(drawn.frequencies_hz, under[place], over[place], fill_color=colour, fill_alpha=0.25)
                made.line(
                    drawn.frequencies_hz, curves[place], line_width=1.5, line_color=colour, line_dash=DASHES[number],
                    legend_label=label,
                )  # fmt: skip
                source = ColumnDataSource({
                    "f": lines.frequencies_hz[there], "size": sizes[place, there],
                    "low": low[place, there], "high": high[place, there],
                })  # fmt: skip
                bars = Whisker(base="f", upper="high", lower="low", source=source, line_color=colour, level="underlay")
                bars.upper_head = bars.lower_head = None
                made.add_layout(bars)
                made.scatter(
                    "f", "size", source=source, size=4, marker=MARKERS[number], line_color=colour, fill_color="white",
                    legend_label=label,
                )  # fmt: skip
            legend_above(made, columns=3)
            figures.append(made)
    return figures


def harmonic_figure(found: SpectraOfModes, lines: Chosen) -> Figure:
    """Singular values of the harmonic power spectra, with the lines of all modes, numbered at the strongest of each."""
    from bokeh.models import Range1d

    made = new_figure(
        "frequency [Hz]", f"harmonic power spectra [{found.unit}]", name="harmonic", y_axis_type="log", height=380,
        x_range=Range1d(start=0.0, end=found.end),
    )  # fmt: skip
    span_lines(made, lines)
    inside, drawn = found.frequencies_hz <= found.end, []
    looks = (("first", Ink.BLACK, 2.0), ("second", Ink.BLUE, 1.5), ("third", Ink.GREEN, 1.0))
    for (label, colour, width), values in zip(looks, found.values.T, strict=False):
        x, y = envelope(found.frequencies_hz[inside], values[inside], POINTS)
        drawn.append(made.line(x, y, line_color=colour, line_width=width, legend_label=f"{label} singular value"))
    strongest = np.array([own[0] for own in found.modes])
    height = np.interp(strongest, found.frequencies_hz, found.values[:, 0])
    names = mark_labels(strongest, np.log10(height), found.end)
    made.text(strongest, height, names, x_offset=6, y_offset=-4, text_font_size=SIZE, text_font_style="bold")
    made.y_range.renderers = drawn  # spans reach from edge to edge of whatever is shown
    legend_above(made)
    return made


def reach_figures(case: Case) -> list[Figure]:
    """Strength at which each input drives each mode at each harmonic."""
    from bokeh.models import BasicTicker

    analysis: Analysis = case.analysis
    own, driven = analysis.model.inputs, analysis.driven
    assert own is not None
    assert driven is not None
    rms = driven.samples.input_size
    figures, count = [], len(own.channels)
    width = 0.8 / count
    for number, mode in enumerate(case.modes[:MOST_MODES], start=1):
        made = new_figure("harmonic l", "|b| times rms [1/s]", name=f"reach-{number}", height=260)
        made.title.text = f"mode {number}"
        used = (own.coefficients[mode] != 0).any(axis=0)
        for source, channel in enumerate(own.channels):
            size = np.abs(own.coefficients[mode, source, used]) * rms[source]
            places = own.harmonics[used] + width * (source - 0.5 * (count - 1))
            label, colour = shortened(channel.name, LONGEST), CURVES[source % len(CURVES)]
            made.vbar(x=places, top=size, width=0.9 * width, fill_color=colour, line_color=None, legend_label=label)
            if own.coefficient_std is not None:
                std = WITHIN * np.abs(own.coefficient_std[mode, source, used]) / np.sqrt(2.0) * rms[source]
                made.segment(
                    places, np.maximum(size - std, 0.0), places, size + std, line_color=Ink.BLACK, line_width=1.5
                )
        made.xaxis.ticker = BasicTicker(min_interval=1, num_minor_ticks=0)
        made.x_range.min_interval = 2
        made.y_range.start = 0
        legend_above(made)
        figures.append(made)
    return figures


def left_out_figures(case: Case) -> tuple[list[Figure], bool]:
    """Measured and predicted outputs at the start of the samples left out, and whether any were."""
    analysis: Analysis = case.analysis
    assert analysis.driven is not None
    samples = analysis.driven.samples
    found, fitted = predicted_rest(analysis)
    values = np.where(samples.there, samples.values, np.nan)
    stop = samples.begins[1]
    begin = int(0.75 * stop) if fitted.all() else int(np.flatnonzero(~fitted)[0])
    place = slice(begin, min(stop, begin + int(CLOSE * analysis.model.period / samples.step) + 1))
    seconds = analysis.records[0].start + samples.step * np.arange(place.start, place.stop)
    figures = []
    for row, label in zip(case.channels, case.labels(), strict=True):
        made = new_figure("time [s]", in_unit("response", analysis.model.channels[row].unit), name=f"left-{row}")
        made.title.text = label
        made.scatter(
            seconds, values[row, place], size=5, fill_color="white", line_color=Ink.BLACK, legend_label="measured"
        )
        made.line(seconds, found[row, place], line_color=Ink.BLUE, line_width=2, legend_label="predicted")
        made.line(
            seconds, values[row, place] - found[row, place], line_color=Ink.VERMILION, line_dash="dashed",
            legend_label="difference",
        )  # fmt: skip
        legend_above(made, columns=3)
        figures.append(made)
    return figures, not fitted.all()
