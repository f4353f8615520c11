"""The poles of every order of a scan: those that stay line up in columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from floquid._checks import input_error, integer
from floquid.lti import Outcome
from floquid.order import OrderScan, Stability
from floquid.plot._indicators import plain_decades, whole_numbers
from floquid.plot._several import legend_of_all, several
from floquid.plot._style import BLACK, BLUE, GREEN, GREY, SKY, VERMILION, envelope, new_figure, plain, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Behind = Literal["cmif", "composite"]

MARKS: dict[Stability, tuple[str, dict[str, Any]]] = {
    Stability.NEW: ("new", {"marker": ".", "color": GREY, "markersize": 3.0}),
    Stability.FREQUENCY: ("stable in frequency", {"marker": "+", "color": VERMILION, "markersize": 5.0}),
    Stability.DAMPING: ("and damping", {"marker": "s", "color": GREEN, "markersize": 4.0, "markerfacecolor": "none"}),
    Stability.SHAPE: ("and shape", {"marker": "o", "color": BLUE, "markersize": 4.0}),
}
"""Told apart by form as well as by colour."""

CURVES = {"cmif": "largest CMIF / white noise [-]", "composite": "composite / noise [-]"}


def stabilisation(
    scan: OrderScan | Mapping[str, OrderScan],
    *,
    chosen: int | Mapping[str, int] | None = None,
    behind: Behind = "cmif",
    points: int = 4000,
    angular: bool = False,
) -> Figure:
    """The frequencies of the poles of each order, marked by how far they agree with those of the order before.

    Lifted responses fold all frequencies into the band from 0 to ω/2. Real multipliers lie on its edges. Behind the
    poles is the largest mode indicator function or the composite, on the axis to the right.

    Parameters
    ----------
    scan
        What `order.scan` found, or several scans by name: then one panel each.
    chosen
        The order chosen, which is marked; of several scans, by name.
    behind
        "cmif" or "composite".
    points
        The most points a curve is drawn with.
    angular
        Frequencies in rad/s instead of Hz.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        `scan` is neither, there are more of them than fit a figure, or an option is not possible.
    """
    of = "stabilisation"
    named = several(scan, OrderScan, "scan", of)
    if behind not in get_args(Behind):
        raise input_error("behind", of, 'be "cmif" or "composite"', f"is {behind!r}")
    integer(points, "points", of, at_least=2)
    orders = _chosen(chosen, named)
    turn, unit = (2.0 * np.pi, "rad/s") if angular else (1.0, "Hz")
    with style():
        figure = new_figure(7.0, 4.4 if len(named) == 1 else 1.0 + 3.0 * len(named))
        panels = figure.subplots(len(named), squeeze=False)[:, 0]
        for axes, (name, one) in zip(panels, named.items(), strict=True):
            _draw_curve(axes, one, behind, points, turn)
            _draw_poles(axes, one, orders.get(name), turn)
            if name:
                axes.set_title(plain(name), loc="left")
        panels[-1].set_xlabel(rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]")
        legend_of_all(figure)
    return figure


def _chosen(chosen: int | Mapping[str, int] | None, named: Mapping[str, OrderScan]) -> dict[str, int]:
    """The order to mark in each panel that has one."""
    if chosen is None:
        return {}
    if not isinstance(chosen, Mapping):
        return dict.fromkeys(named, integer(chosen, "chosen", "stabilisation", at_least=1))
    for name in chosen:
        if name not in named:
            must = f"name the scans: {', '.join(named)}"
            raise input_error("chosen", "stabilisation", must, f"has {name!r}", "Pass one number for a single scan.")
    return {name: integer(order, "chosen", "stabilisation", at_least=1) for name, order in chosen.items()}


def _draw_poles(axes: Axes, scan: OrderScan, chosen: int | None, turn: float) -> None:
    """The poles above the real axis, a form for each level of stability, at `turn` times frequencies in Hz."""
    found: dict[Stability, list[tuple[float, int]]] = {level: [] for level in Stability}
    for order, model, levels in zip(scan.orders, scan.models, scan.stable, strict=True):
        if model.outcome is not Outcome.SUCCESS:
            continue
        angles = np.angle(model.multipliers)
        for angle, level in zip(angles[angles >= 0], levels[angles >= 0], strict=True):
            found[Stability(int(level))].append((float(angle), order))
    scale = turn / (2.0 * np.pi * scan.indicators.dt)
    for level, (label, look) in MARKS.items():
        x, y = np.array(found[level], dtype=float).reshape(-1, 2).T
        axes.plot(x * scale, y, linestyle="none", clip_on=False, zorder=3, label=label, **look)
    if chosen is not None:
        axes.axhline(chosen, color=BLACK, linestyle="--", linewidth=0.9, zorder=2, label="order chosen")
    lowest, highest = scan.orders[0], scan.orders[-1]
    margin = 0.04 * max(highest - lowest, 1)
    axes.set(xlim=(0.0, np.pi * scale), ylim=(lowest - margin, highest + margin), ylabel="order [complex poles]")
    whole_numbers(axes.yaxis)


def _draw_curve(axes: Axes, scan: OrderScan, behind: Behind, points: int, turn: float) -> None:
    """The indicator on an axis of its own to the right, drawn below the poles."""
    found = scan.indicators
    values = found.cmif[:, 0] if behind == "cmif" else found.composite
    other = axes.twinx()
    x = found.angles * turn / (2.0 * np.pi * found.dt)
    other.plot(
        *envelope(x, values, points), color=SKY, linewidth=1.2, label="CMIF" if behind == "cmif" else "composite"
    )
    other.set(yscale="log", ylabel=CURVES[behind])
    plain_decades(other)
    other.grid(visible=False)
    axes.set_zorder(other.get_zorder() + 1)
    axes.patch.set_visible(False)
