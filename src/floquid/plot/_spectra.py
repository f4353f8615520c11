"""Spectra of the record and of lifted responses: the same resonances, in families above, and once below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer, positive
from floquid.core import channels_named
from floquid.lti import WHITE
from floquid.pipeline import Analysis
from floquid.plot._several import degrees_a_period
from floquid.plot._style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SIZE,
    SKY,
    VERMILION,
    envelope,
    new_figure,
    plain,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY)
DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), "-.")

DEPTH = 0.1
"""Where the axis of magnitudes ends, as a share of the lowest level of noise."""


def spectra(
    analysis: Analysis,
    channels: Sequence[str] | None = None,
    phases: Sequence[int] | None = None,
    *,
    hit: int = 0,
    angular: bool = False,
    limit: float | None = None,
    periods_per_revolution: int | None = None,
    points: int = 4000,
) -> Figure:
    r"""Magnitudes of the transforms of a record and, below, of its lifted responses at some phases.

    .. math:: \Delta t \Big| \sum_n y[n]\, e^{-i\Omega n \Delta t} \Big|, \qquad
              T \Big| \sum_m y_k[m]\, e^{-i\Omega m T} \Big|

    (Allen 2009, figures 3 and 4.) A mode shows in the record as a family of peaks at |Im λ + mω|, those of the
    harmonics kept being marked, and once in each lifted response, folded into the band from 0 to ω/2. Dotted lines are
    the mean magnitude of the noise found in each channel. The whole periods of the record are transformed.

    Parameters
    ----------
    analysis
        What `identify` found.
    channels
        The names of the channels, up to six; the first two when not given.
    phases
        Which samples of a period give the lifted responses, from 0, up to four; the first when not given.
    hit
        Which of the hits, from 0.
    angular
        Frequencies in rad/s instead of Hz.
    limit
        The highest frequency of the upper pane [Hz, or rad/s when `angular`]; when not given, half of the fundamental
        above the highest peak marked, at most the Nyquist frequency.
    periods_per_revolution
        Name the phases by the angle of the shaft, which turns once in this many periods; not given, by their own.
    points
        The most points a curve is drawn with.

    Returns
    -------
    matplotlib.figure.Figure
        The record above, the lifted responses below.

    Raises
    ------
    InputError
        There is no such channel, phase or hit, or there are more of them than can be told apart.
    """
    of = "spectra"
    cycles = analysis.cycles
    if integer(hit, "hit", of, at_least=0) >= len(cycles):
        raise input_error("hit", of, f"be less than {len(cycles)}", f"is {hit}", "Counting starts at 0.")
    listed = cycles[hit].channels
    rows = list(range(min(2, len(listed))))
    if channels is not None:
        rows = channels_named(listed, channels, argument="channels", of=of)
    chosen = _phases((0,) if phases is None else phases, cycles[hit].n_phases, of)
    if not 1 <= len(rows) <= len(COLORS):
        raise input_error("channels", of, f"name one to {len(COLORS)} channels", f"names {len(rows)}", "Choose some.")
    integer(points, "points", of, at_least=2)
    turn, unit = (2.0 * np.pi, "rad/s") if angular else (1.0, "Hz")
    marks = _families(analysis, rows) * turn / (2.0 * np.pi)
    end = 0.5 * cycles[hit].n_phases / analysis.lifted.period * turn
    wanted = max(marks, default=end) + 0.5 * turn / analysis.lifted.period
    end = min(end, wanted if limit is None else positive(limit, "limit", of, unit=unit))
    degrees = degrees_a_period(periods_per_revolution, of)
    first, step = cycles[hit].first_phase, 1.0 / cycles[hit].n_phases
    angles = {phase: f"{(first + phase * step) % 1.0 * degrees:.4g}°" for phase in chosen}
    with style():
        figure = new_figure(7.0, 6.0)
        panels = figure.subplots(2, 1)
        _draw_record(panels[0], analysis, rows, hit, marks, turn=turn, end=end, points=points)
        _draw_lifted(panels[1], analysis, rows, angles, hit, turn=turn, points=points)
        panels[0].set_xlabel(f"frequency [{unit}]")
        panels[1].set_xlabel(rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]")
        what = "phase" if periods_per_revolution is None else "shaft angle"
        name = f"magnitude [{_unit({listed[row].unit for row in rows})}]"
        for axes, subject in zip(panels, ("the record", f"lifted responses, by {what}"), strict=True):
            axes.set_ylabel(f"{name}\n{subject}")
            axes.tick_params(labelsize=SIZE)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
        figure.align_ylabels(panels)
    return figure


def _draw_record(
    axes: Axes,
    analysis: Analysis,
    rows: Sequence[int],
    hit: int,
    marks: NDArray[np.float64],
    *,
    turn: float,
    end: float,
    points: int,
) -> None:
    """The transforms of the record's whole periods, up to the frequency `end`, and the families' peaks."""
    levels = []
    for color, row in zip(COLORS, rows, strict=False):
        frequencies, values, level = record_spectrum(analysis, row, hit)
        levels.append((frequencies * turn, level))
        inside = frequencies * turn <= end
        curve = envelope(frequencies[inside] * turn, values[inside], points)
        axes.plot(*curve, color=color, linewidth=0.8, label=plain(analysis.lifted.channels[row].name))
    _draw_levels(axes, levels)
    for number, mark in enumerate(marks):
        label = r"identified, $|\mathrm{Im}\,\lambda + m\omega|$" if number == 0 else None
        axes.axvline(mark, color=GREY, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1, label=label)
    axes.set_xlim(0.0, end)


def _draw_lifted(
    axes: Axes, analysis: Analysis, rows: Sequence[int], angles: dict[int, str], hit: int, *, turn: float, points: int
) -> None:
    """The transforms of the lifted responses of the channels at the phases, each named by its angle."""
    levels = []
    for color, row in zip(COLORS, rows, strict=False):
        name = plain(analysis.lifted.channels[row].name)
        for number, (phase, angle) in enumerate(angles.items()):
            frequencies, values, level = lifted_spectrum(analysis, row, phase, hit)
            curve = envelope(frequencies * turn, values, points)
            axes.plot(*curve, color=color, linestyle=DASHES[number], linewidth=1.0, label=f"{name}, {angle}")
            if not number:
                levels.append((frequencies * turn, level))
    _draw_levels(axes, levels, named=False)
    axes.set_xlim(0.0, 0.5 * turn / analysis.lifted.period)


def _draw_levels(
    axes: Axes, levels: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], *, named: bool = True
) -> None:
    """The mean magnitude of each channel's noise, dotted. Single lines fall far below it, and the axis ends before."""
    for color, curve in zip(COLORS, levels, strict=False):
        axes.plot(*curve, color=color, linestyle=":", linewidth=1.4)
    if named:
        axes.plot([], [], color=BLACK, linestyle=":", linewidth=1.4, label="noise alone, mean")
    axes.set_yscale("log")
    axes.set_ylim(bottom=DEPTH * min(float(level.min()) for _, level in levels))


Spectrum = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Frequencies [Hz], magnitudes, and the mean of the noise alone, each (lines,)."""


def record_spectrum(analysis: Analysis, row: int, hit: int) -> Spectrum:
    """That of the whole periods of a channel."""
    cycles = analysis.cycles[hit]
    return _spectrum(analysis, row, hit, cycles.values[row].T.ravel(), analysis.lifted.period / cycles.n_phases, 1)


def lifted_spectrum(analysis: Analysis, row: int, phase: int, hit: int) -> Spectrum:
    """That of one lifted response."""
    cycles = analysis.cycles[hit]
    return _spectrum(analysis, row, hit, cycles.values[row, phase], analysis.lifted.period, cycles.n_phases)


def _spectrum(analysis: Analysis, row: int, hit: int, values: NDArray[np.float64], step: float, folds: int) -> Spectrum:
    """Noise that was whitened has the colour that the filter took off, folded as often as the response is."""
    frequencies = np.arange(len(values) // 2 + 1) / (len(values) * step)
    magnitudes = np.asarray(np.abs(np.fft.rfft(values)) * step, dtype=np.float64)
    white = WHITE * float(analysis.lifted.noise[row, hit]) * step * np.sqrt(len(values))
    turns = 2j * np.pi * (frequencies + np.arange(folds)[:, None] / step)
    colour = np.sqrt(np.mean(np.abs(analysis.lifted.gain(turns)[row]) ** -2.0, axis=0))
    return frequencies, magnitudes, white * colour


def _phases(phases: Sequence[int], n_phases: int, of: str) -> list[int]:
    chosen = list(dict.fromkeys(integer(phase, "phases", of, at_least=0) for phase in phases))
    for phase in chosen:
        if phase >= n_phases:
            raise input_error("phases", of, f"be less than {n_phases}", f"has {phase}", "Counting starts at 0.")
    if not 1 <= len(chosen) <= len(DASHES):
        raise input_error("phases", of, f"name one to {len(DASHES)} phases", f"names {len(chosen)}", "Choose some.")
    return chosen


def _families(analysis: Analysis, rows: Sequence[int]) -> NDArray[np.float64]:
    """The frequencies |Im λ + mω| of the harmonics kept in one of the channels, ascending [rad/s]."""
    model = analysis.model
    kept = (model.coefficients[:, rows] != 0).any(axis=(1, 2))
    found = np.abs(model.exponents.imag[:, None] + model.harmonics * model.fundamental)
    return np.unique(np.round(np.asarray(found[kept], dtype=np.float64), 12))


def _unit(units: set[str]) -> str:
    if len(units) > 1:
        return "unit · s"
    (unit,) = units
    return "s" if unit == "-" else f"{plain(unit)} · s"
