"""Residues over the period, as identified at each phase and as the harmonics kept draw them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import index, input_error
from floquid.core import channels_named
from floquid.pipeline import Analysis
from floquid.plot._style import (
    GREY,
    LOOKS,
    Into,
    degrees_a_period,
    drawing,
    entitled,
    grid_of,
    label_angle,
    label_values,
    plain,
    several,
)
from floquid.views import expansion, identified_residue, in_unit

SHORT, LINE = 10, 18
"""The longest name of a channel that stands beside its unit, and the longest line of another, in characters."""

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PARTS = ("real", "imag")


def residues(
    analysis: Analysis | Mapping[str, Analysis],
    mode: int = 0,
    channels: Sequence[str] | None = None,
    *,
    hit: int = 0,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    r"""The residue of a mode at each phase, and the smooth shape of the harmonics kept, both over the period.

    .. math:: R_k = R^d_k\, e^{-\lambda t_k}, \qquad R(t) = \sum_m B_m\, e^{im\omega t}

    (Allen 2009, eqs. 9 and 11, figure 6.) λ is on the branch of the model's exponent: on another the same residues
    would turn once or more a period.

    One row a channel, the real part on the left and the imaginary part on the right. Raises InputError where there is
    no such mode, channel or hit.

    Parameters
    ----------
    analysis
        What `identify` found, or several analyses of the same channels by name.
    mode
        Which mode of the model, from 0; of several analyses, that of the first, and the modes of the others that are
        nearest to it.
    channels
        The names of the channels; all when not given.
    hit
        Which of the hits, from 0.
    periods_per_revolution
        Draw against the angle of the shaft, which turns once in this many periods; not given, against the phase.
    ax
        The axes to draw into, two for each channel; a new figure when not given.
    """
    of = "residues"
    named = several(analysis, Analysis, "analysis", of)
    shown = next(iter(named.values())).model.channels
    rows = list(range(len(shown)))
    if channels is not None:
        rows = channels_named(shown, channels, argument="channels", of=of)
    if not rows:
        raise input_error("channels", of, "name at least one channel", "is empty")
    modes = _chosen_modes(named, mode, hit, of)
    height = 1.1 + 1.45 * len(rows)
    with drawing(height, ax, of, panels=grid_of(len(rows), 2), sharex=True) as (figure, panels):
        for pair, row in zip(zip(panels[::2], panels[1::2], strict=True), rows, strict=True):
            _draw_residue(pair, named, modes, row, hit, degrees_a_period(periods_per_revolution, of))
        for axes, part in zip(panels[:2], ("real part", "imaginary part"), strict=True):
            axes.set_title(part)
        for axes in panels[-2:]:
            label_angle(axes, periods_per_revolution, of, steps=4)
    return figure


def coefficients(
    analysis: Analysis | Mapping[str, Analysis],
    mode: int = 0,
    channel: str | None = None,
    *,
    hit: int = 0,
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    r"""The magnitude of every Fourier coefficient of a residue, the kept ones marked, and the residue itself.

    .. math:: B_m = \frac1P \sum_k R_k\, e^{-im\omega t_k}

    (Allen 2009, eq. 11, figure 7.) Those of the P harmonics below the Nyquist frequency are drawn: circles, and stems
    for those that the model keeps. The broken line is one standard deviation of a coefficient, where it is known; what
    lies at it is noise. Below, the real and the imaginary part of the residue, as `residues` draws them.

    The coefficients above, the parts of the residue below. `channel` is the name of the channel, the first when not
    given; `analysis`, `mode`, `hit` and `periods_per_revolution` are as of `residues`; `ax` are three axes.
    Raises InputError where there is no such mode, channel or hit, or the axes do not fit.
    """
    of = "coefficients"
    named = several(analysis, Analysis, "analysis", of)
    shown = next(iter(named.values())).model.channels
    row = 0 if channel is None else channels_named(shown, [channel], argument="channel", of=of)[0]
    modes = _chosen_modes(named, mode, hit, of)
    with drawing(5.4, ax, of, panels=((0, 0), (1, 2)), height_ratios=(1.25, 1.0)) as (figure, (axes, *panels)):
        deviations = []
        for look, (name, one) in zip(LOOKS, named.items(), strict=False):
            found = expansion(one, modes[name], row, hit)
            kept = found.kept
            axes.plot(found.harmonics, found.magnitudes, **look.points, label=entitled(name, "identified"))
            if kept.any():
                stems = {"color": look.line["color"], "linewidth": 2.0 * look.line["linewidth"]}
                words = entitled(name, "harmonics kept")
                axes.vlines(found.harmonics[kept], 0.0, found.magnitudes[kept], **stems, label=words)
            deviations += [] if found.std is None else [(found.harmonics, found.std)]
        for harmonics, std in deviations:
            axes.plot(harmonics, std, color=GREY, linestyle="--", label="one standard deviation")
        _log_axis(axes, in_unit(f"|B| of {plain(shown[row].name)}", plain(shown[row].unit)))
        _draw_residue(panels, named, modes, row, hit, degrees_a_period(periods_per_revolution, of))
        for one, part in zip(panels, ("real part", "imaginary part"), strict=True):
            one.set_title(part)
            label_angle(one, periods_per_revolution, of, steps=4)
    return figure


def _chosen_modes(named: dict[str, Analysis], mode: int, hit: int, of: str) -> dict[str, int]:
    """The index of the mode in each analysis: that of the first, and those nearest to it."""
    first = next(iter(named.values())).model
    index(mode, "mode", of, first.order)
    index(hit, "hit", of, min(one.model.n_hits for one in named.values()))
    names = [channel.name for channel in first.channels]
    modes = {}
    for name, analysis in named.items():
        if [channel.name for channel in analysis.model.channels] != names:
            raise input_error("analysis", of, "hold analyses of the same channels", f"{name!r} has others")
        modes[name] = int(np.argmin(np.abs(analysis.model.exponents - first.exponents[mode])))
    return modes


def _draw_residue(
    panels: Sequence[Axes], named: dict[str, Analysis], modes: dict[str, int], row: int, hit: int, degrees: float
) -> None:
    """The real and the imaginary part of one channel's residue on the two `panels`."""
    channel = next(iter(named.values())).model.channels[row]
    for axes, part in zip(panels, PARTS, strict=True):
        for look, (name, one) in zip(LOOKS, named.items(), strict=False):
            period, mode = one.model.period, modes[name]
            times = np.linspace(0.0, period, 361)
            points = getattr(identified_residue(one, mode, row, hit), part)
            smooth = getattr(one.model.shapes(times)[mode, row, hit], part)
            phase = (one.lifted.phase_times / period % 1.0) * degrees
            axes.plot(phase, points, **look.points, label=entitled(name, "identified"))
            axes.plot(times / period * degrees, smooth, **look.line, label=entitled(name, "harmonics kept"))
        axes.margins(y=0.1)
        largest = float(np.abs(axes.dataLim.intervaly).max())
        # A row is low: a long name takes several lines, or it would meet that of the row below.
        name = channel.name if part == "real" else ""
        if len(name) > SHORT:
            name = "\n".join([*wrap(name, LINE), ""])
        label_values(axes, name, channel.unit, largest)


def _log_axis(axes: Axes, name: str) -> None:
    """A logarithmic axis of magnitudes over the harmonics, its bottom below the smallest of them."""
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    smallest = np.nanmin(values[values > 0])
    axes.set(yscale="log", xlabel=r"harmonic $m$ of the residue", ylabel=name)
    axes.set_ylim(bottom=0.6 * smallest)
    axes.margins(x=0.02)
