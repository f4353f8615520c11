"""Identified exponents with the regions of their errors, each close up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array
from floquid.core import PeriodicModel
from floquid.plot._several import legend_of_all
from floquid.plot._style import BLACK, BLUE, GREEN, GREY, ORANGE, SIZE, VERMILION, new_figure, style
from floquid.views import exponent_ellipses, grows, multiplier_ellipses, upper_modes, with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEVEL = 0.95
MOST, ACROSS = 12, 4
"""Modes that are drawn close up, at most, and how many of them in a row."""

WIDE = 6.0
"""Deviations that a close-up shows on either side, at least."""

_FOUND = {"linestyle": "none", "marker": "o", "color": BLUE, "markersize": 5.0}
_GROWS = {"linestyle": "none", "marker": "^", "color": VERMILION, "markersize": 6.0}
_TRUE = {"linestyle": "none", "marker": "x", "color": BLACK, "markersize": 6.5, "markeredgewidth": 1.2}
_COPIES = {"linestyle": "none", "marker": ".", "color": GREY, "markersize": 4.0}
_REGION = {"color": GREEN, "linewidth": 1.1}


def identified_exponents(model: PeriodicModel, truth: ArrayLike | None, of: str) -> Figure:
    """The exponents and the multipliers of a model, and each exponent close up with the region of its errors."""
    known = None if truth is None else frozen_array(truth, "truth", of, axes=("exponents",), dtype=np.complex128)
    upper = list(upper_modes(model))
    close = upper[:MOST] if model.covariance is not None else []
    rows = -(-len(close) // ACROSS)
    paired = None if known is None else truth_of(model, known)
    with style():
        figure = new_figure(7.0, 3.6 + 1.75 * rows)
        grid = figure.add_gridspec(1 + rows, 2 * ACROSS, height_ratios=(3.2, *[1.55] * rows))
        left, right = figure.add_subplot(grid[0, :ACROSS]), figure.add_subplot(grid[0, ACROSS:])
        _draw_plane(left, model, upper, paired)
        _draw_multipliers(right, model, paired)
        edges = exponent_ellipses(model, LEVEL)
        for number, mode in enumerate(close):
            row, column = divmod(number, ACROSS)
            axes = figure.add_subplot(grid[1 + row, 2 * column : 2 * column + 2])
            assert edges is not None
            _draw_close(axes, model, mode, upper.index(mode) + 1, edges[mode], paired)
        _label_close(figure, rows)
        legend_of_all(figure)
    return figure


def truth_of(model: PeriodicModel, truth: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """The true exponent of each mode, moved by whole multiples of iω to its branch (modes,); NaN where there is none.

    Paired so that the differences together are least; of a pair, one may be given.
    """
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


def _moved(values: NDArray[np.complex128], turn: float) -> NDArray[np.complex128]:
    """Differences of exponents, moved by whole multiples of iω next to zero."""
    return values - 1j * turn * np.round(values.imag / turn)


def _growing(model: PeriodicModel) -> NDArray[np.bool_]:
    """Which modes grow (modes,)."""
    return np.array([grows(model, mode) for mode in range(model.order)], bool)


def _draw_plane(axes: Axes, model: PeriodicModel, upper: list[int], truth: NDArray[np.complex128] | None) -> None:
    """The exponents, their copies, and the edges of the principal strip."""
    from matplotlib.ticker import MaxNLocator

    values, turn = model.exponents, model.fundamental
    reach = np.abs(values.imag).max(initial=0.0) + 1.2 * turn
    last = int(np.ceil(reach / turn)) + 1
    copies = (model.principal()[:, None] + 1j * turn * np.arange(-last, last + 1)).ravel()
    copies = copies[np.abs(copies.imag) <= reach]
    axes.axvline(0.0, color=BLACK, linewidth=0.9)
    for edge in (-0.5, 0.5):
        axes.axhline(edge * turn, color=ORANGE, linestyle="--", linewidth=0.9, label="edges of the strip, ±ω/2")
    axes.plot(copies.real, copies.imag, **_COPIES, label=r"copies, $\lambda + im\omega$")
    growing = _growing(model)
    axes.plot(values.real[~growing], values.imag[~growing], **_FOUND, label="identified")
    if growing.any():
        axes.plot(values.real[growing], values.imag[growing], **_GROWS, label="identified, grows")
    if truth is not None:
        axes.plot(truth.real, truth.imag, **_TRUE, label="truth")
    low, high = min(float(values.real.min()), 0.0), max(float(values.real.max()), 0.0)
    margin = 0.18 * (high - low) or 0.05 * turn
    axes.set(xlim=(low - margin, high + margin), xlabel=r"Re $\lambda$ [1/s]", ylabel=r"Im $\lambda$ [rad/s]")
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.xaxis.set_major_formatter(_tick)
    _number(axes, values[upper])


def _number(axes: Axes, values: NDArray[np.complex128]) -> None:
    """The numbers of the modes beside their marks; those of marks that all but coincide on one line."""
    shown = axes.transData.transform(np.column_stack([values.real, values.imag]))
    done: set[int] = set()
    middle = axes.transAxes.transform((0.5, 0.5))[0]
    for k, value in enumerate(values):
        near = [j for j in range(k, len(values)) if j not in done and np.abs(shown[j] - shown[k]).max() < 11.0]
        if k in done:
            continue
        done |= set(near)
        side = 1.0 if shown[k, 0] < middle else -1.0
        axes.annotate(
            ", ".join(str(j + 1) for j in near),
            (value.real, value.imag),
            xytext=(6.0 * side, 3.0),
            textcoords="offset points",
            ha="left" if side > 0.0 else "right",
            bbox={"boxstyle": "square,pad=0.05", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )


def _draw_multipliers(axes: Axes, model: PeriodicModel, truth: NDArray[np.complex128] | None) -> None:
    """The multipliers about the unit circle, with the regions of their errors."""
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    axes.plot(np.cos(turn), np.sin(turn), color=BLACK, linewidth=0.9, label="unit circle")
    values: NDArray[np.complex128] = model.multipliers
    growing = _growing(model)
    axes.plot(values.real[~growing], values.imag[~growing], **_FOUND)
    axes.plot(values.real[growing], values.imag[growing], **_GROWS)
    edges = multiplier_ellipses(model, LEVEL)
    if edges is not None:
        for x, y in zip(edges.real, edges.imag, strict=True):
            axes.plot(x, y, **_REGION, label="95 % region")
    if truth is not None:
        mu = np.asarray(np.exp(truth * model.period), dtype=np.complex128)
        axes.plot(mu.real, mu.imag, **_TRUE)
    reach = 1.15 * max(1.0, float(np.abs(values).max(initial=0.0)))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xlabel=r"Re $\mu$ [-]", ylabel=r"Im $\mu$ [-]")


def _draw_close(
    axes: Axes,
    model: PeriodicModel,
    mode: int,
    number: int,
    edge: NDArray[np.complex128],
    truth: NDArray[np.complex128] | None,
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
    axes.plot([0.0], [0.0], **(_GROWS if grows(model, mode) else _FOUND))
    if truth is not None and np.isfinite(truth[mode]):
        away = truth[mode] - value
        axes.plot([away.real], [away.imag], **_TRUE)
        reach = np.maximum(reach, 1.3 * np.abs([away.real, away.imag]))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(2, symmetric=True))
        axis.set_major_formatter(_tick)
    axes.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))
    real, imag = with_error(value.real, std[mode].real), with_error(abs(value.imag), std[mode].imag)
    sign = "+" if value.imag >= 0.0 else "-"
    axes.set_title(f"mode {number}:  {real}\n{sign} {imag} i".replace("-", "−"), fontsize=8.0)
    axes.tick_params(labelsize=7.0)


def _tick(value: float, _: float) -> str:
    """A number at a tick, such as 2e−5."""
    if abs(value) < 1e-300:
        return "0"
    return f"{value:.3g}".replace("e-0", "e-").replace("-", "−")


def _label_close(figure: Figure, rows: int) -> None:
    """What the close-ups show, once."""
    for axes in figure.axes[:2]:
        axes.tick_params(labelsize=SIZE)
    if not rows:
        return
    for axes in figure.axes[2 + ACROSS * (rows - 1) :]:
        axes.set_xlabel(r"Re $\lambda$ − est. [1/s]", fontsize=8.0)
    for axes in figure.axes[2::ACROSS]:
        axes.set_ylabel("Im $\\lambda$ − est.\n[rad/s]", fontsize=8.0)
