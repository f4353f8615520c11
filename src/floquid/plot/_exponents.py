"""Floquet exponents with their families, and multipliers about the unit circle: those of a known A(t)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.floquet import FloquetModes, stability, upper_modes
from floquid.plot._identified_exponents import identified_exponents
from floquid.plot._several import legend_of_all
from floquid.plot._style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VAST = 300.0
"""Ratio of decay rates, of frequencies or of multipliers from which the scale is logarithmic."""

_DEEPEST = 12
"""Decades of multipliers that are shown."""

_FAMILY = 3
"""Copies of an exponent that are drawn on either side of it."""

_NUMBERED = 12
_RESTS = {"linestyle": "none", "marker": "D", "color": GREEN, "markersize": 5.0}
_DECAYS = {"linestyle": "none", "marker": "o", "color": BLUE, "markersize": 5.5}
_GROWS = {"linestyle": "none", "marker": "^", "color": VERMILION, "markersize": 6.5}
_COPIES = {"linestyle": "none", "marker": ".", "color": GREY, "markersize": 4.0, "alpha": 0.8}


def exponents(modes: FloquetModes | PeriodicModel, *, truth: ArrayLike | None = None) -> Figure:
    """The exponents with their families λ + imω, and the multipliers about the unit circle.

    Exponents are the representatives, whose zeroth harmonic is the strongest of the shape, numbered as pairs in the
    order of `modes`; the dashed lines are the edges of the principal strip, ±ω/2.

    Those of an identified model have the regions that hold the true value with 95 %. Such a region is seldom seen at
    full scale, so that each mode is drawn a second time close up, off its estimate, which is written above with its
    deviation in units of the last digits. The truth, where it is given, is moved by whole multiples of iω next to the
    estimate it belongs to. Of a known A(t) whose exponents differ vastly, scales are logarithmic: multipliers then keep
    their angle, and rings tell their size.

    Parameters
    ----------
    modes
        What `floquet.modes` found, or the model that `identify` found.
    truth
        The true exponents (exponents,) [1/s], of a model alone; on any branch, and of a conjugate pair one will do.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        `modes` is neither, or the truth is no list of numbers or given for modes that are known.
    """
    of = "exponents"
    if isinstance(modes, PeriodicModel):
        return identified_exponents(modes, truth, of)
    if truth is not None:
        must, got = "be given for an identified model alone", f"is {truth!r:.60}"
        raise input_error("truth", of, must, got, "Leave it out: the exponents of a known A(t) are the truth.")
    if not isinstance(modes, FloquetModes):
        must, remedy = "be a FloquetModes or a PeriodicModel", "Pass floquet.modes(A, period) or analysis.model."
        raise input_error("modes", of, must, f"is {modes!r:.60}", remedy)
    with style():
        figure = new_figure(7.0, 3.9)
        left, right = figure.subplots(1, 2, width_ratios=(1, 1))
        _draw_exponents(left, modes)
        _draw_multipliers(right, modes)
        legend_of_all(figure)
    return figure


def _draw_exponents(axes: Axes, modes: FloquetModes) -> None:
    """The representatives, their copies, the strip and the line of stability."""
    values, turn = modes.exponents, modes.fundamental
    copies = (values[:, None] + 1j * turn * np.delete(np.arange(-_FAMILY, _FAMILY + 1), _FAMILY)).ravel()
    vast = np.abs(values.imag).max() > _VAST * turn
    if not vast:  # whole columns, as far as the representatives reach
        reach = np.abs(values.imag).max() + 1.5 * turn
        last = int(np.ceil(reach / turn)) + 1
        copies = (modes.principal()[:, None] + 1j * turn * np.arange(-last, last + 1)).ravel()
        copies = copies[np.abs(copies.imag) <= reach]
    axes.axvline(0.0, color=BLACK, linewidth=0.9)
    for edge in (-0.5, 0.5):
        axes.axhline(edge * turn, color=ORANGE, linestyle="--", linewidth=0.9, label="edges of the strip, ±ω/2")
    axes.plot(copies.real, copies.imag, **_COPIES, label=r"copies, $\lambda + im\omega$")
    for chosen, look, label in _kinds(modes):
        if chosen.any():
            axes.plot(values.real[chosen], values.imag[chosen], **look, label=label)
    _scale_exponents(axes, values, turn, vast=bool(vast))
    upper = upper_modes(modes)
    if len(upper) <= _NUMBERED:
        _number(axes, [(float(values[r].real), float(values[r].imag)) for r in upper])
    axes.set(xlabel=r"Re $\lambda$ [1/s]", ylabel=r"Im $\lambda$ [rad/s]")


def _kinds(modes: FloquetModes) -> tuple[tuple[NDArray[np.bool_], dict[str, Any], str], ...]:
    """Which modes decay, which grow, which do neither as far as can be told, and how each is drawn."""
    real, margins = modes.exponents.real, stability(modes).margins
    return (
        (real < -margins, _DECAYS, "decays"),
        (np.abs(real) <= margins, _RESTS, "neither, as far as can be told"),
        (real > margins, _GROWS, "grows"),
    )


def _scale_exponents(axes: Axes, values: NDArray[np.complex128], turn: float, *, vast: bool) -> None:
    """Limits that hold the line of stability, and logarithmic scales of vastly different sizes."""
    from matplotlib.ticker import MaxNLocator

    sizes = np.abs(values.real)
    largest = float(sizes.max())
    small = sizes[sizes > 1e-9 * max(largest, turn)]
    if small.size and largest > _VAST * float(small.min()):
        threshold = 10.0 ** np.floor(np.log10(float(small.min())))
        axes.set_xscale("symlog", linthresh=threshold)
        _few_decades(axes.xaxis, threshold, largest)
        axes.set_xlim(-3.0 * largest if values.real.min() < 0.0 else -threshold, None)
        axes.set_xlim(None, max(3.0 * float(values.real.max()), threshold))
    else:
        low, high = min(float(values.real.min()), 0.0), max(float(values.real.max()), 0.0)
        margin = 0.15 * (high - low) or 0.05 * turn
        axes.set_xlim(low - margin, high + margin)
        axes.xaxis.set_major_locator(MaxNLocator(5))
    if vast:
        axes.set_yscale("symlog", linthresh=turn)
        _few_decades(axes.yaxis, 10.0 ** np.ceil(np.log10(turn)), float(np.abs(values.imag).max()))


def _few_decades(axis, threshold: float, largest: float) -> None:  # an Axis of matplotlib
    """Ticks at zero and at six powers of ten at most on either side."""
    low, high = int(np.round(np.log10(threshold))), int(np.floor(np.log10(largest)))
    powers = 10.0 ** np.arange(low, high + 1, max(1, -(-(high - low + 1) // 3)))
    axis.set_ticks([*(-powers[::-1]), 0.0, *powers])
    axis.set_ticks([], minor=True)


def _draw_multipliers(axes: Axes, modes: FloquetModes) -> None:
    """The multipliers in the plane; of vastly different ones the logarithm of their size is the radius."""
    sizes = modes.exponents.real * modes.period / np.log(10.0)  # decades
    angles = np.exp(1j * modes.principal().imag * modes.period)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    circle = np.cos(turn), np.sin(turn)
    vast = float(sizes.min()) < -np.log10(_VAST) or float(sizes.max()) > 1.5
    decades = min(float(np.ceil(max(-float(sizes.min()), 1.0))), _DEEPEST)
    radii = np.maximum(1.0 + sizes / decades, 0.0) if vast else 10.0**sizes
    inside = sizes >= -decades - 1e-9
    if vast:
        step = max(1, int(np.ceil(decades / 4.0)))
        highest = int(np.ceil(max(float(sizes.max()), 0.0)))
        for power in [*range(-step, -int(decades), -step), *range(step, highest + 1, max(step, highest // 3 or 1))]:
            radius = 1.0 + power / decades
            axes.plot(radius * circle[0], radius * circle[1], color=GREY, linewidth=0.5)
            axes.text(0.0, radius, f"$10^{{{power}}}$", ha="center", va="bottom", color="#555555")
    axes.plot(*circle, color=BLACK, linewidth=0.9, label="unit circle")
    points = radii * angles
    for chosen, look, _ in _kinds(modes):
        axes.plot(points[chosen & inside].real, points[chosen & inside].imag, **look)
    if not inside.all():
        axes.plot([0.0], [0.0], **{**_DECAYS, "markerfacecolor": "none"}, label=f"below $10^{{-{int(decades)}}}$")
    reach = 1.15 * max(1.0, float(radii.max()))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    if vast:
        axes.set(xticks=[], yticks=[], xlabel=r"$\mu$: angle, and log$_{10}|\mu|$ as radius [-]")
        axes.grid(visible=False)
    else:
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.axvline(0.0, color=GREY, linewidth=0.5)
        axes.set(xlabel=r"Re $\mu$ [-]", ylabel=r"Im $\mu$ [-]")


def _number(axes: Axes, places: list[tuple[float, float]]) -> None:
    """Numbers from 1 beside the points; those of points that coincide on one line."""
    shown = np.array([axes.transData.transform(place) for place in places])
    done: set[int] = set()
    for k, place in enumerate(places):
        if k in done:
            continue
        near = [j for j in range(k, len(places)) if j not in done and np.abs(shown[j] - shown[k]).max() < 12.0]
        done |= set(near)
        # Towards the middle, so that it stays inside.
        side = 1.0 if shown[k, 0] < axes.transAxes.transform((0.5, 0.5))[0] else -1.0
        axes.annotate(
            ", ".join(str(j + 1) for j in near),
            place,
            xytext=(6.0 * side, 4.0),
            textcoords="offset points",
            ha="left" if side > 0.0 else "right",
        )
