"""Floquet exponents with their families, and multipliers about the unit circle: of a known A(t), and identified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Mask
from floquid._checks import frozen_array, wrong_value
from floquid.core import PeriodicModel
from floquid.floquet import FloquetModes, stability, upper_modes
from floquid.plot._style import CLOSE_ACROSS, CLOSE_UPS, SIZE, Into, drawing, grid_of, short_tick, with_close_ups
from floquid.views import Ink, exponent_ellipses, grows, multiplier_ellipses, with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_VAST = 300.0  # ratio of decay rates, of frequencies or of multipliers from which the scale is logarithmic
_DEEPEST = 12  # decades of multipliers that are shown
_FAMILY = 3  # copies of an exponent that are drawn on either side of it

_NUMBERED = 12
LEVEL = 0.95
WIDE = 6.0  # deviations that a close-up shows on either side, at least

_SPOTS = [(x, y) for y in (1.0, -10.0, 8.0, -17.0) for x in (6.0, -6.0)]
"""Places of a number beside its mark [pt], the best ones first."""

_RESTS: dict[str, Any] = {"linestyle": "none", "marker": "D", "color": Ink.GREEN, "markersize": 5.0}
_DECAYS: dict[str, Any] = {"linestyle": "none", "marker": "o", "color": Ink.BLUE, "markersize": 5.5}
_GROWS: dict[str, Any] = {"linestyle": "none", "marker": "^", "color": Ink.VERMILION, "markersize": 6.5}
_COPIES: dict[str, Any] = {"linestyle": "none", "marker": ".", "color": Ink.SILVER, "markersize": 4.0}
_TRUE: dict[str, Any] = {
    "linestyle": "none",
    "marker": "x",
    "color": Ink.BLACK,
    "markersize": 6.5,
    "markeredgewidth": 1.2,
}
_REGION: dict[str, Any] = {"color": Ink.GREEN, "linewidth": 1.1}


def exponents(modes: FloquetModes | PeriodicModel, *, truth: ArrayLike | None = None, ax: Into = None) -> Figure:
    """The exponents with their families λ + imω, and the multipliers about the unit circle.

    Exponents are the representatives, whose zeroth harmonic is the strongest of the shape, numbered as pairs in the
    order of `modes`; the dashed lines are the edges of the principal strip, ±ω/2.

    Those of an identified model have the regions that hold the true value with 95 %. Such a region is seldom seen at
    full scale. So each mode is drawn again close up, off its estimate, which is written above with its deviation in the
    last digits. The truth, where it is given, is moved by whole multiples of iω next to the estimate it belongs to. Of
    a known A(t) whose exponents differ vastly, scales are logarithmic: multipliers then keep their angle, and rings
    tell their size.

    `modes` is what `floquet.modes` found, or the model that `identify` found; of a model alone `truth` are the true
    exponents (exponents,) [1/s], on any branch, and of a conjugate pair one will do. `ax` are two axes to draw into, of
    a model with deviations one more for each mode drawn close up. Raises InputError where `modes` is something else,
    the truth is no list of numbers or given for modes that are known, or the axes do not fit.
    """
    of = "exponents"
    if isinstance(modes, PeriodicModel):
        return _identified(modes, truth, ax, of)
    if truth is not None:
        must = "be given for an identified model alone"
        raise wrong_value("truth", of, must, truth, "Leave it out: the exponents of a known A(t) are the truth.")
    if not isinstance(modes, FloquetModes):
        must = "be a FloquetModes or a PeriodicModel"
        raise wrong_value("modes", of, must, modes, "Pass floquet.modes(A, period) or analysis.model.")
    with drawing(3.9, ax, of, panels=grid_of(1, 2)) as (figure, (left, right)):
        _draw_exponents(left, modes)
        _draw_multipliers(right, modes)
    return figure


def _columns(modes: FloquetModes | PeriodicModel, beyond: float) -> Complexes:
    """The copies of all exponents up to some fundamentals beyond the highest of them."""
    turn = modes.fundamental
    reach = np.abs(modes.exponents.imag).max(initial=0.0) + beyond * turn
    last = int(np.ceil(reach / turn)) + 1
    copies = (modes.principal()[:, None] + 1j * turn * np.arange(-last, last + 1)).ravel()
    return copies[np.abs(copies.imag) <= reach]


def _draw_strip(axes: Axes, modes: FloquetModes | PeriodicModel, copies: Complexes) -> None:
    """The line of stability, the edges of the principal strip, and the copies of the exponents."""
    axes.axvline(0.0, color=Ink.BLACK, linewidth=0.9)
    for edge in (-0.5, 0.5):
        label = "edges of the strip, ±ω/2"
        axes.axhline(edge * modes.fundamental, color=Ink.ORANGE, linestyle="--", linewidth=0.9, label=label)
    axes.plot(copies.real, copies.imag, **_COPIES, label=r"copies, $\lambda + im\omega$")
    axes.set(xlabel=r"Re $\lambda$ [1/s]", ylabel=r"Im $\lambda$ [rad/s]")


def _draw_circle(axes: Axes, largest: float, *, cross: bool = True) -> None:
    """The unit circle, in limits that hold multipliers of size `largest`."""
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(turn), np.sin(turn), color=Ink.BLACK, linewidth=0.9, label="unit circle")
    reach = 1.15 * max(1.0, largest)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    if cross:
        axes.axhline(0.0, color=Ink.SILVER, linewidth=0.5)
        axes.axvline(0.0, color=Ink.SILVER, linewidth=0.5)
        axes.set(xlabel=r"Re $\mu$", ylabel=r"Im $\mu$")


def _draw_exponents(axes: Axes, modes: FloquetModes) -> None:
    """The representatives, their copies, the strip and the line of stability."""
    values, turn = modes.exponents, modes.fundamental
    vast = np.abs(values.imag).max() > _VAST * turn
    turns = np.delete(np.arange(-_FAMILY, _FAMILY + 1), _FAMILY)
    _draw_strip(axes, modes, (values[:, None] + 1j * turn * turns).ravel() if vast else _columns(modes, 1.5))
    for chosen, look, label in _kinds(modes):
        if chosen.any():
            axes.plot(values.real[chosen], values.imag[chosen], **look, label=label)
    _scale_exponents(axes, values, turn, vast=bool(vast))
    upper = upper_modes(modes)
    if len(upper) <= _NUMBERED:
        _number(axes, values[upper])


def _kinds(modes: FloquetModes) -> tuple[tuple[Mask, dict[str, Any], str], ...]:
    """Groups of modes that decay, grow, or do neither within their errors, with their marks."""
    real, margins = modes.exponents.real, stability(modes).margins
    return (
        (real < -margins, _DECAYS, "decays"),
        (np.abs(real) <= margins, _RESTS, "neither, within its error"),
        (real > margins, _GROWS, "grows"),
    )


def _scale_exponents(axes: Axes, values: Complexes, turn: float, *, vast: bool) -> None:
    """Limits that hold the line of stability, and logarithmic scales of vastly different sizes."""
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
        _limit_decay(axes, values, turn, share=0.15, ticks=5)
    if vast:
        axes.set_yscale("symlog", linthresh=turn)
        _few_decades(axes.yaxis, 10.0 ** np.ceil(np.log10(turn)), float(np.abs(values.imag).max()))


def _limit_decay(axes: Axes, values: Complexes, turn: float, *, share: float, ticks: int) -> None:
    """Limits that hold the exponents and the line of stability, with that share of their distance to each side."""
    from matplotlib.ticker import MaxNLocator

    low, high = min(float(values.real.min()), 0.0), max(float(values.real.max()), 0.0)
    margin = share * (high - low) or 0.05 * turn
    axes.set_xlim(low - margin, high + margin)
    axes.xaxis.set_major_locator(MaxNLocator(ticks))


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
    vast = float(sizes.min()) < -np.log10(_VAST) or float(sizes.max()) > 1.5
    decades = min(float(np.ceil(max(-float(sizes.min()), 1.0))), _DEEPEST)
    radii = np.maximum(1.0 + sizes / decades, 0.0) if vast else 10.0**sizes
    inside = sizes >= -decades - 1e-9
    if vast:
        step = max(1, int(np.ceil(decades / 4.0)))
        highest = int(np.ceil(max(float(sizes.max()), 0.0)))
        for power in [*range(-step, -int(decades), -step), *range(step, highest + 1, max(step, highest // 3 or 1))]:
            radius = 1.0 + power / decades
            axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=Ink.SILVER, linewidth=0.5)
            axes.text(0.0, radius, f"$10^{{{power}}}$", ha="center", va="bottom", color="#555555")
    _draw_circle(axes, float(radii.max()), cross=not vast)
    points = radii * angles
    for chosen, look, _ in _kinds(modes):
        axes.plot(points[chosen & inside].real, points[chosen & inside].imag, **look)
    if not inside.all():
        axes.plot([0.0], [0.0], **(_DECAYS | {"markerfacecolor": "none"}), label=f"below $10^{{-{int(decades)}}}$")
    if vast:
        axes.set(xticks=[], yticks=[], xlabel=r"$\mu$: angle, and log$_{10}|\mu|$ as radius")
        axes.grid(visible=False)


def _number(axes: Axes, values: Complexes) -> None:
    """The numbers of the modes beside their marks, where least is in their way; those of one place stand together."""
    assert axes.figure is not None
    shown = axes.transData.transform(np.column_stack([values.real, values.imag])) * 72.0 / axes.figure.dpi  # [pt]
    taken = [(x - 4.0, y - 4.0, x + 4.0, y + 4.0) for x, y in shown]
    done: set[int] = set()
    for k, value in enumerate(values):
        near = [j for j in range(k, len(values)) if j not in done and np.abs(shown[j] - shown[k]).max() < 5.0]
        if k in done:
            continue
        done |= set(near)
        text = ", ".join(str(j + 1) for j in near)
        width = 0.65 * SIZE * len(text)
        boxes = []
        for x, y in _SPOTS:
            left, low = shown[k] + (x - width * (x < 0.0), y)
            boxes.append((left, low, left + width, low + SIZE))
        best = min(range(len(boxes)), key=lambda spot: sum(_overlap(boxes[spot], other) for other in taken))
        taken.append(boxes[best])
        axes.annotate(
            text,
            (value.real, value.imag),
            xytext=_SPOTS[best],
            textcoords="offset points",
            ha="left" if _SPOTS[best][0] > 0.0 else "right",
            va="bottom",
            bbox={"boxstyle": "square,pad=0.05", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )


def _overlap(one: Sequence[float], other: Sequence[float]) -> float:
    """The area that two boxes share, each (left, low, right, high)."""
    across = min(one[2], other[2]) - max(one[0], other[0])
    up = min(one[3], other[3]) - max(one[1], other[1])
    return max(across, 0.0) * max(up, 0.0)


def _identified(model: PeriodicModel, truth: ArrayLike | None, ax: Into, of: str) -> Figure:
    """The exponents and the multipliers of a model, and each exponent close up with the region of its errors."""
    known = None if truth is None else frozen_array(truth, "truth", of, axes=("exponents",), dtype=np.complex128)
    upper, edges = list(model.upper_modes), exponent_ellipses(model, LEVEL)
    close = upper[:CLOSE_UPS] if edges is not None else []
    rows, layout = with_close_ups(len(close), (3.2, 1.55))
    paired = None if known is None else _truth_of(model, known)
    with drawing(3.6 + 1.75 * rows, ax, of, **layout) as (figure, (left, right, *below)):
        _draw_plane(left, model, upper, paired)
        _draw_circle(right, float(np.abs(model.multipliers).max(initial=0.0)))
        _draw_identified(right, model, model.multipliers)
        regions = multiplier_ellipses(model, LEVEL)
        for region in [] if regions is None else regions:
            right.plot(region.real, region.imag, **_REGION, label="95 % region")
        if paired is not None:
            mu = np.asarray(np.exp(paired * model.period), dtype=np.complex128)
            right.plot(mu.real, mu.imag, **_TRUE)
        for number, (mode, axes) in enumerate(zip(close, below, strict=True)):
            row, column = divmod(number, CLOSE_ACROSS)
            assert edges is not None
            _draw_close(axes, model, mode, number + 1, edges[mode], paired)
            if row == rows - 1:
                axes.set_xlabel(r"Re $\lambda$ − est. [1/s]", fontsize=8.0)
            if column == 0:
                axes.set_ylabel("Im $\\lambda$ − est.\n[rad/s]", fontsize=8.0)
    return figure


def _truth_of(model: PeriodicModel, truth: Complexes) -> Complexes:
    """The true exponent of each mode, moved by multiples of iω to its branch (modes,); NaN where there is none."""
    from scipy.optimize import linear_sum_assignment

    turn = model.fundamental
    mirrored = truth.conj()
    alone = np.abs(_moved(np.subtract.outer(mirrored, truth), turn)).min(axis=1, initial=np.inf) > 1e-9 * turn
    every = np.concatenate([truth, mirrored[alone]])
    off = _moved(np.subtract.outer(every, model.exponents).T, turn)
    own, other = linear_sum_assignment(np.abs(off))
    found = np.full(model.order, np.nan + 0j)
    found[own] = model.exponents[own] + off[own, other]
    return found


def _moved(values: Complexes, turn: float) -> Complexes:
    """Differences of exponents, moved by whole multiples of iω next to zero."""
    return values - 1j * turn * np.round(values.imag / turn)


def _draw_identified(axes: Axes, model: PeriodicModel, values: Complexes) -> None:
    """Points of each mode (modes,), those that grow apart."""
    growing = np.array([grows(model, mode) for mode in range(model.order)], bool)
    axes.plot(values.real[~growing], values.imag[~growing], **_DECAYS, label="identified")
    if growing.any():
        axes.plot(values.real[growing], values.imag[growing], **_GROWS, label="identified, grows")


def _draw_plane(axes: Axes, model: PeriodicModel, upper: list[int], truth: Complexes | None) -> None:
    """The exponents, their copies, and the edges of the principal strip."""
    values = model.exponents
    _draw_strip(axes, model, _columns(model, 1.2))
    _draw_identified(axes, model, values)
    if truth is not None:
        axes.plot(truth.real, truth.imag, **_TRUE, label="truth")
    _limit_decay(axes, values, model.fundamental, share=0.18, ticks=4)
    axes.xaxis.set_major_formatter(short_tick)
    _number(axes, values[upper])


def _draw_close(
    axes: Axes, model: PeriodicModel, mode: int, number: int, edge: Complexes, truth: Complexes | None
) -> None:
    """One exponent close up: its region, and the truth where it is known, off the estimate."""
    from matplotlib.ticker import MaxNLocator

    std, value = model.exponent_std, model.exponents[mode]
    assert std is not None
    off = edge - value
    wide = complex(float(std[mode].real), float(std[mode].imag))
    wide = complex(wide.real or wide.imag or 1e-12, wide.imag or wide.real or 1e-12)
    reach = np.array([0.75 * WIDE * wide.real, 0.75 * WIDE * wide.imag])
    axes.plot(off.real, off.imag, **_REGION, label="95 % region")
    axes.plot([0.0], [0.0], **(_GROWS if grows(model, mode) else _DECAYS))
    if truth is not None and np.isfinite(truth[mode]):
        away = truth[mode] - value
        axes.plot([away.real], [away.imag], **_TRUE)
        reach = np.maximum(reach, 1.3 * np.abs([away.real, away.imag]))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(2, symmetric=True))
        axis.set_major_formatter(short_tick)
    axes.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))
    real, imag = with_error(value.real, std[mode].real), with_error(abs(value.imag), std[mode].imag)
    sign = "+" if value.imag >= 0.0 else "-"
    axes.set_title(f"mode {number}:  {real}\n{sign} {imag} i".replace("-", "−"), fontsize=8.0)
    axes.tick_params(labelsize=7.5)
