"""Spectra of the record and of lifted responses, in families and once; harmonic power spectra of outputs alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Floats
from floquid._checks import index, input_error, integer, positive
from floquid.core import channels_named
from floquid.pipeline import Analysis
from floquid.plot._style import (
    POINTS,
    SIZE,
    Into,
    columns_that_fit,
    degrees_a_period,
    drawing,
    frequency_unit,
    grid_of,
    plain,
)
from floquid.views import (
    Family,
    Ink,
    check_analysis,
    envelope,
    families,
    lifted_spectrum,
    record_spectrum,
    spectra_of_modes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = (Ink.BLUE, Ink.ORANGE, Ink.GREEN, Ink.VERMILION, Ink.PURPLE, Ink.SKY)
DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), "-.")
LINE_DASHES = ((0, (4, 2)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)))
CURVES = 4  # singular values that are drawn: three of them are seldom modes at once

BESIDE = 88  # characters of a row of a legend that is as wide as the axes
DEPTH = 0.1  # where the axis of magnitudes ends, as a share of the lowest level of noise


def spectra(
    analysis: Analysis,
    channels: Sequence[str] | None = None,
    phases: Sequence[int] | None = None,
    *,
    hit: int = 0,
    angular: bool = False,
    limit: float | None = None,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    r"""Magnitudes of the transforms of a record and, below, of its lifted responses at some phases.

    .. math:: \Delta t \Big| \sum_n y[n]\, e^{-i\Omega n \Delta t} \Big|, \qquad
              T \Big| \sum_m y_k[m]\, e^{-i\Omega m T} \Big|

    (Allen 2009, figures 3 and 4.) A mode shows in the record as a family of peaks at |Im λ + mω|, those of the
    harmonics kept being marked, and once in each lifted response, folded into the band from 0 to ω/2. Between
    the two, each mode has a row: a filled mark is its strongest line, rings are the others, each with its harmonic m.
    Dotted lines are the mean magnitude of the noise found in each channel. The whole periods of the record are
    transformed.

    The record above, the families of its lines, and the lifted responses below. Raises InputError where there is no
    such channel, phase or hit, or there are more of them than can be told apart.

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
    ax
        Three axes to draw into; a new figure when not given.
    """
    of = "spectra"
    cycles = analysis.cycles
    index(hit, "hit", of, len(cycles))
    listed = cycles[hit].channels
    rows = list(range(min(2, len(listed))))
    if channels is not None:
        rows = channels_named(listed, channels, argument="channels", of=of)
    chosen = _phases((0,) if phases is None else phases, cycles[hit].n_phases, of)
    if not 1 <= len(rows) <= len(COLORS):
        raise input_error("channels", of, f"name one to {len(COLORS)} channels", f"names {len(rows)}", "Choose some.")
    turn, unit = frequency_unit(angular=angular)
    scale = turn / (2.0 * np.pi)
    shown = _shown(analysis, rows)
    marks = np.concatenate([family.omega for family in shown] or [np.zeros(0)]) * scale
    end = 0.5 * cycles[hit].n_phases / analysis.lifted.period * turn
    wanted = max(marks, default=end) + 0.5 * turn / analysis.lifted.period
    end = min(end, wanted if limit is None else positive(limit, "limit", of, unit=unit))
    degrees = degrees_a_period(periods_per_revolution, of)
    first, step = cycles[hit].first_phase, 1.0 / cycles[hit].n_phases
    angles = {phase: f"{(first + phase * step) % 1.0 * degrees:.4g}°" for phase in chosen}
    strip = 0.5 + 0.17 * max(len(shown), 1)  # that of the families has no more room than it needs
    heights = (2.5, strip, 2.5)
    with drawing(5.8 + strip, ax, of, panels=grid_of(3), legend=False, height_ratios=heights) as (figure, own):
        panels, below = [own[0], own[2]], own[1]
        _draw_record(panels[0], analysis, rows, hit, marks, turn=turn, end=end)
        _draw_lifted(panels[1], analysis, rows, angles, hit, turn=turn)
        upper = analysis.model.upper_modes
        numbers = [upper.index(family.mode) + 1 for family in shown]
        _draw_families(below, shown, numbers, scale=scale, end=end)
        below.set_xlim(panels[0].get_xlim())
        panels[0].tick_params(labelbottom=False)
        below.set_xlabel(f"frequency [{unit}]")
        panels[1].set_xlabel(rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]")
        what = "phase" if periods_per_revolution is None else "shaft angle"
        name = f"magnitude [{_unit({listed[row].unit for row in rows})}]"
        for axes, subject in zip(panels, ("the record", f"lifted responses, by {what}"), strict=True):
            axes.set_ylabel(f"{name}\n{subject}")
            columns = min(columns_that_fit(axes.get_legend_handles_labels()[1], BESIDE), 4)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2)
    return figure


def _draw_record(
    axes: Axes, analysis: Analysis, rows: Sequence[int], hit: int, marks: Floats, *, turn: float, end: float
) -> None:
    """The transforms of the record's whole periods, up to the frequency `end`, and the families' peaks."""
    levels = []
    for color, row in zip(COLORS, rows, strict=False):
        found = record_spectrum(analysis, row, hit)
        x = found.omega * turn / (2.0 * np.pi)
        levels.append((x, found.noise))
        inside = x <= end
        curve = envelope(x[inside], found.values[inside], POINTS)
        axes.plot(*curve, color=color, linewidth=0.8, label=plain(analysis.lifted.channels[row].name))
    _draw_levels(axes, levels)
    for number, mark in enumerate(np.unique(marks.round(12))):
        label = r"identified, $|\mathrm{Im}\,\lambda + m\omega|$" if number == 0 else None
        axes.axvline(mark, color=Ink.SILVER, linestyle=(0, (2, 2)), linewidth=0.8, zorder=1, label=label)
    axes.set_xlim(0.0, end)


def _draw_families(axes: Axes, shown: Sequence[Family], numbers: Sequence[int], *, scale: float, end: float) -> None:
    """A row for each mode: its strongest line filled, the others as rings; harmonics where there is room."""
    room = 0.025 * end
    for row, family in enumerate(shown):
        x, strongest = family.omega * scale, int(np.argmax(family.share))
        others = np.delete(x, strongest)
        look = {"linestyle": "none", "marker": "o", "color": Ink.BLUE, "markersize": 4.5}
        axes.plot(x[[strongest]], [row], **look)
        axes.plot(others, np.full(len(others), row), **look, markerfacecolor="none")
        for line in np.flatnonzero(x <= end - room):
            right = np.min(x[x > x[line]], initial=np.inf) - x[line]
            if right > 2.0 * room:
                axes.annotate(
                    f"{family.harmonics[line]:+d}".replace("-", "−") if family.harmonics[line] else "0",
                    (x[line], row),
                    xytext=(4.0, -3.0),
                    textcoords="offset points",
                    fontsize=7.5,
                )
    axes.set_yticks(range(len(shown)), [f"mode {number}" for number in numbers])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.tick_params(labelsize=SIZE)
    axes.grid(axis="y", visible=False)


def _draw_lifted(
    axes: Axes, analysis: Analysis, rows: Sequence[int], angles: dict[int, str], hit: int, *, turn: float
) -> None:
    """The transforms of the lifted responses of the channels at the phases, each named by its angle."""
    levels = []
    for color, row in zip(COLORS, rows, strict=False):
        name = plain(analysis.lifted.channels[row].name)
        for number, (phase, angle) in enumerate(angles.items()):
            found = lifted_spectrum(analysis, row, phase, hit)
            x = found.omega * turn / (2.0 * np.pi)
            curve = envelope(x, found.values, POINTS)
            axes.plot(*curve, color=color, linestyle=DASHES[number], linewidth=1.0, label=f"{name}, {angle}")
            if not number:
                levels.append((x, found.noise))
    _draw_levels(axes, levels, named=False)
    axes.set_xlim(0.0, 0.5 * turn / analysis.lifted.period)


def _draw_levels(axes: Axes, levels: Sequence[tuple[Floats, Floats]], *, named: bool = True) -> None:
    """The mean magnitude of each channel's noise, dotted. Single lines fall far below it, and the axis ends before."""
    for color, curve in zip(COLORS, levels, strict=False):
        axes.plot(*curve, color=color, linestyle=":", linewidth=1.4)
    if named:
        axes.plot([], [], color=Ink.BLACK, linestyle=":", linewidth=1.4, label="noise alone, mean")
    axes.set_yscale("log")
    axes.set_ylim(bottom=DEPTH * min(float(level.min()) for _, level in levels))


def _phases(phases: Sequence[int], n_phases: int, of: str) -> list[int]:
    chosen = list(dict.fromkeys(integer(phase, "phases", of, at_least=0) for phase in phases))
    for phase in chosen:
        if phase >= n_phases:
            raise input_error("phases", of, f"be less than {n_phases}", f"has {phase}", "Counting starts at 0.")
    if not 1 <= len(chosen) <= len(DASHES):
        raise input_error("phases", of, f"name one to {len(DASHES)} phases", f"names {len(chosen)}", "Choose some.")
    return chosen


def _shown(analysis: Analysis, rows: Sequence[int]) -> list[Family]:
    """The families, of the harmonics that are kept in one of the channels."""
    kept = (analysis.model.coefficients[:, rows] != 0).any(axis=(1, 2))
    shown = []
    for family in families(analysis):
        own = np.isin(family.harmonics, analysis.model.harmonics[kept[family.mode]])
        lines = {name: getattr(family, name)[own] for name in ("harmonics", "omega", "share")}
        part = Family(mode=family.mode, **lines)
        shown += [part] if own.any() else []
    return shown


def _unit(units: set[str]) -> str:
    if len(units) > 1:
        return "unit · s"
    (unit,) = units
    return "s" if unit == "-" else f"{plain(unit)} · s"


def harmonic_spectra(
    analysis: Analysis, *, harmonics: int = 1, periods: int | None = None, limit: float | None = None, ax: Into = None
) -> Figure:
    r"""Singular values of the harmonic power spectra of a record of outputs alone, and the lines of its modes.

    .. math:: \sigma_k\{S(\Omega)\}, \qquad
              S_{mn}(\Omega) = \frac{1}{J} \sum_j Y_j(\Omega + m\omega)\, Y_j(\Omega + n\omega)^H

    with Y the transforms of segments (Allen, Sracic, Chauhan and Hansen 2011). A mode is a peak of the first at each of
    \|Im λ + mω\| that it has in the outputs, and up to M fundamentals beside; a second singular value that rises there
    is another mode. Lines are those of the model, the strongest of each mode thick. Channels of different units are
    divided by their rms.

    Raises InputError where the responses are free, or an option is not possible.

    Parameters
    ----------
    analysis
        What `identify` found of records whose excitation goes on.
    harmonics
        M: outputs are modulated by -M to M.
    periods
        Periods a segment; a twelfth of the record where not given.
    limit
        The highest frequency [Hz]; half of the fundamental above the highest line where not given.
    ax
        The axes to draw into; a new figure when not given.
    """
    of = "harmonic_spectra"
    check_analysis(analysis, of)
    found = spectra_of_modes(analysis, harmonics, periods)
    end = found.end if limit is None else min(float(found.frequencies_hz[-1]), positive(limit, "limit", of, unit="Hz"))
    inside = found.frequencies_hz <= end
    with drawing(4.2, ax, of) as (figure, (axes,)):
        for number in range(min(CURVES, found.values.shape[1])):
            x, y = envelope(found.frequencies_hz[inside], found.values[inside, number], POINTS)
            width, alpha = (0.8, 0.75 - 0.15 * number) if number else (1.3, 1.0)
            label = None if number else "singular values, descending"
            axes.plot(x, y, color=Ink.BLACK, linewidth=width, alpha=alpha, label=label)
        for number, own in enumerate(found.modes):
            look = {
                "color": COLORS[number % len(COLORS)],
                "linestyle": LINE_DASHES[number // len(COLORS) % len(LINE_DASHES)],
            }
            for place, line in enumerate(own):
                label = f"lines of mode {number + 1}" if place == 0 else None
                axes.axvline(line, **look, linewidth=1.6 if place == 0 else 0.9, zorder=1, label=label)
        axes.set_yscale("log")
        axes.set_xlim(0.0, end)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(f"harmonic power spectra, M = {harmonics} [{plain(found.unit)}]")
    return figure
