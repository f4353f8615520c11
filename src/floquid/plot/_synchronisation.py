"""How well a record keeps step with its period or its tachometer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import input_error, integer
from floquid.pipeline import Analysis
from floquid.plot._several import legend_of_all
from floquid.plot._style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SIZE, SKY, VERMILION, new_figure, style
from floquid.views import Synchronisation, upper_modes
from floquid.views import synchronisation as synchronisation_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INTERVAL = 1.96
"""The standard deviations to each side within which 95 % of estimates lie."""

WIDE = 6.0
"""Times the narrowest interval beyond which a stretch does not set the scale."""

SIGNIFICANT = 4.0
"""Standard deviations from which on a difference of periods is one."""

LOOKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (ORANGE, "D"), (PURPLE, "v"), (SKY, "P"))
"""Told apart by form as well as by colour."""


def synchronisation(analysis: Analysis, *, hit: int = 0) -> Figure:
    """By how much the response is ahead of the phase that the period or the tachometer gives it, along the record.

    Above is the slip of the response, in degrees of the period, in each stretch of the record, with the straight line
    through it. On a record that keeps step it lies about zero, within its bars. A slope is another period, a curve a
    speed that wanders, a jump a pulse too many or too few. Below are the phases of the strongest lines against the
    model: harmonic m of a mode turns m times as far as the slip; where all lines of a mode turn together it is the
    exponent that is off, and not the period.

    Parameters
    ----------
    analysis
        What `identify` found.
    hit
        Which of the hits, from 0.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        There is no such hit.
    """
    of = "synchronisation"
    if not isinstance(analysis, Analysis):
        raise input_error("analysis", of, "be an Analysis", f"is {analysis!r:.60}", "Pass what `identify` gives.")
    if integer(hit, "hit", of, at_least=0) >= analysis.model.n_hits:
        raise input_error("hit", of, f"be less than {analysis.model.n_hits}", f"is {hit}", "Counting starts at 0.")
    found = synchronisation_of(analysis, hit)
    with style():
        figure = new_figure(7.0, 5.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        _draw_slip(upper, found)
        _draw_phases(lower, found, upper_modes(analysis.model))
        upper.set_title(_verdict(found), loc="left")
        lower.set_title("phase of the strongest lines", loc="left")
        lower.set_xlabel("time [s]")
        upper.set_ylabel("response ahead\n[deg of the period]")
        lower.set_ylabel("ahead of the model\n[deg of the line]")
        for axes in (upper, lower):
            axes.tick_params(labelsize=SIZE)
        figure.align_ylabels([upper, lower])
        legend_of_all(figure)
    return figure


def _draw_slip(axes: Axes, found: Synchronisation) -> None:
    """The slip with its intervals, and the straight line through it."""
    axes.axhline(0.0, color=BLACK, linewidth=0.9)
    told = found.told
    slip, width = np.degrees(found.slip[told]), INTERVAL * np.degrees(found.slip_std[told])
    look = {"linestyle": "none", "marker": "o", "markersize": 4.0, "color": BLACK, "capsize": 2.0}
    axes.errorbar(found.times[told], slip, width, **look, label="slip, 95 % intervals")
    if np.isfinite(found.relative):
        line = np.degrees(found.offset - 2.0 * np.pi * found.cycles * found.relative)
        axes.plot(found.times, line, color=VERMILION, linestyle="--", label="straight line through it")
    _limit(axes, slip, width)


def _draw_phases(axes: Axes, found: Synchronisation, upper: tuple[int, ...]) -> None:
    """The phases of the lines, side by side within each stretch, so that their bars can be told apart."""
    axes.axhline(0.0, color=BLACK, linewidth=0.9)
    apart = np.diff(found.times).min(initial=np.inf) if len(found.times) > 1 else 0.0
    every, bars = [], []
    for number, (mode, m) in enumerate(zip(found.modes, found.harmonics, strict=True)):
        told = np.isfinite(found.phases[number])
        phase, width = np.degrees(found.phases[number, told]), INTERVAL * np.degrees(found.phases_std[number, told])
        x = found.times[told] + apart * 0.09 * (number - 0.5 * (len(found.modes) - 1))
        color, marker = LOOKS[number]
        look = {"linestyle": "none", "marker": marker, "markersize": 3.5, "color": color, "linewidth": 0.8}
        words = (
            f"mode {upper.index(int(mode)) + 1}, $m$ = {int(m):+d}"
            if m
            else f"mode {upper.index(int(mode)) + 1}, $m$ = 0"
        )
        axes.errorbar(x, phase, width, **look, label=words.replace("-", "−"))
        every.append(phase)
        bars.append(width)
    _limit(axes, np.concatenate(every or [np.zeros(0)]), np.concatenate(bars or [np.zeros(0)]))


def _limit(axes: Axes, values: np.ndarray, widths: np.ndarray) -> None:
    """A scale on which the stretches that tell most are seen; the bars of those that tell little reach beyond it."""
    if not len(values):
        return
    sure = widths <= WIDE * np.quantile(widths, 0.25)
    reach = 1.2 * max(float((np.abs(values) + widths)[sure].max()), 1e-12)
    axes.set_ylim(-reach, reach)


def _verdict(found: Synchronisation) -> str:
    """What the slips say, in words."""
    if not np.isfinite(found.relative):
        return "The response does not tell its period: no mode with two harmonics that holds is seen in two stretches."
    value, std = 1e6 * found.relative, 1e6 * found.relative_std
    digits = max(0, 1 - int(np.floor(np.log10(std)))) if std > 0 else 3
    off = abs(value) / std if std > 0 else 0.0
    verdict = "another period" if off > SIGNIFICANT else "no other period"
    words = f"own period − period used: ({value:+.{digits}f} ± {std:.{digits}f}) · 10⁻⁶ of it, {verdict}"
    if np.isfinite(found.misfit):
        words += f"\nscatter about the straight line, over that of the noise: {np.sqrt(found.misfit):.2g}"
    return words.replace("-", "−")
