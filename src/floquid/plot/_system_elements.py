"""Periodic matrices over a period: elements of A(t), and residues as identified and as the harmonics kept draw them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import index, input_error, positive, timed_matrices
from floquid.core import Channel, channels_named
from floquid.fit import WITHIN
from floquid.pipeline import Analysis
from floquid.plot._style import (
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
from floquid.reconstruction import StateModel
from floquid.views import Ink, closed_period, element_unit, expansion, identified_residue, in_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def system_elements(
    state: StateModel | Mapping[str, StateModel],
    elements: Sequence[tuple[int, int]] | None = None,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    period: float | None = None,
    channels: Sequence[Channel] = (),
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    """Chosen elements of A(t) over the period: circles, with the truth as lines where it is known.

    Bands are 1.96 standard deviations each way, where those are estimated: at each instant alone, 95 % of such
    intervals hold the true value.

    One panel an element. Raises InputError where an element is not in A, the truth does not fit, or the period is
    needed and not given.

    Parameters
    ----------
    state
        The state model, or several in the same states by name.
    elements
        Rows and columns, counted from 1 as in A(3,1); when not given, the first two stiffnesses and the first damping
        of the first equation of motion: A(3,1), A(3,2) and A(3,3) for four states.
    truth
        Instants after phase zero (times,) [s], and the true A at each (times, n, n).
    period
        The period [s]; when not given, the instants are taken to be equally spaced over one, as `reconstruct` has them.
    channels
        The channels of the record: with them, states in different units get the right unit on the axis.
    periods_per_revolution
        Draw against the angle of the shaft, which turns once in this many periods; not given, against the phase.
    ax
        The axes to draw into, one for each element; a new figure when not given.
    """
    of = "system_elements"
    named = several(state, StateModel, "state", of)
    first = next(iter(named.values()))
    n = len(first.states)
    for name, other in named.items():
        if other.states != first.states:
            raise input_error("state", of, "hold models in the same states", f"{name!r} has {other.states}")
    chosen = _default(n) if elements is None else [_element(entry, n, of) for entry in elements]
    if not chosen:
        raise input_error("elements", of, "name at least one element", "is empty")
    length = _period(first, of) if period is None else positive(period, "period", of, unit="s")
    known = None if truth is None else timed_matrices(truth, of, n)
    degrees = degrees_a_period(periods_per_revolution, of) / length
    with drawing(1.0 + 1.5 * len(chosen), ax, of, panels=grid_of(len(chosen)), sharex=True) as (figure, panels):
        for axes, (i, j) in zip(panels, chosen, strict=True):
            if known is not None:
                axes.plot(known[0] * degrees, known[1][:, i - 1, j - 1], color=Ink.BLACK, label="truth")
            _draw_estimates(axes, named, i - 1, j - 1, degrees, length)
            axes.margins(y=0.12)
            largest = float(np.abs(axes.dataLim.intervaly).max())
            label_values(axes, f"A({i},{j})", element_unit(first, i - 1, j - 1, channels), largest)
        label_angle(panels[-1], periods_per_revolution, of)
    return figure


def _draw_estimates(axes: Axes, named: dict[str, StateModel], i: int, j: int, degrees: float, period: float) -> None:
    """One element of A in each model, with bands of its deviations where they are known."""
    bands = [name for name, state in named.items() if state.system_std is not None]
    for look, (name, state) in zip(LOOKS, named.items(), strict=False):
        axes.plot(state.times * degrees, state.system[:, i, j], **look.points, label=entitled(name, "estimated"))
        if state.system_std is None:
            continue
        order, times = closed_period(state.times, period)
        middle, width = state.system[order, i, j], WITHIN * state.system_std[order, i, j]
        band = {"color": look.line["color"], "alpha": 0.25, "linewidth": 0.0}
        label = "95 % intervals" if name == bands[-1] else None
        axes.fill_between(times * degrees, middle - width, middle + width, **band, label=label)


def _default(n: int) -> list[tuple[int, int]]:
    """The first two stiffnesses and the first damping of the first equation of motion."""
    row = n // 2 + 1
    return list(dict.fromkeys([(row, 1), (row, min(2, n)), (row, row)])) if n > 1 else [(1, 1)]


def _element(entry: tuple[int, int], n: int, of: str) -> tuple[int, int]:
    valid = isinstance(entry, Sequence) and len(entry) == 2 and all(isinstance(k, (int, np.integer)) for k in entry)
    if not valid or not all(1 <= k <= n for k in entry):
        must = f"hold (row, column) pairs from 1 to {n}"
        raise input_error("elements", of, must, f"has {entry!r}", "Counting starts at 1: A(1,1).")
    return int(entry[0]), int(entry[1])


def _period(state: StateModel, of: str) -> float:
    """The period over which the instants are equally spaced."""
    steps = np.diff(state.times)
    if not len(steps) or np.ptp(steps) > 1e-6 * abs(steps[0]):
        must = "be given when the instants are not equally spaced over a period"
        raise input_error("period", of, must, "is None", "Pass period=model.period.")
    return float(steps.mean() * len(state.times))


SHORT, LINE = 10, 18
"""The longest name of a channel that stands beside its unit, and the longest line of another, in characters."""

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
            axes.plot(harmonics, std, color=Ink.SILVER, linestyle="--", label="one standard deviation")
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
