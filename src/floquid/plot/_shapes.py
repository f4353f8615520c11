"""Periodic mode shapes over the period, and their harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.floquet import FloquetModes, multiplier_is_real, stability, state_participation, upper_modes
from floquid.plot._identified_shapes import identified_shapes
from floquid.plot._indicators import plain_decades
from floquid.plot._several import label_angle, legend_of_all
from floquid.plot._style import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, new_figure, plain, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Parts = Literal["polar", "cartesian"]

_LOOKS = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (ORANGE, ":"), (PURPLE, (0, (5, 1, 1, 1, 1, 1))))
"""Told apart by dashes as well as by colour."""

_MODES, _MOST = 3, 6
_FAINT = 0.02
"""Of a shape's largest value: below, its phase says nothing."""

_SLIGHT = 1e-9
"""Of a mode: a state with less of it has no part in it."""

_LEAST = 1e-4
"""Of the mean square: the smallest bar."""

_POINTS = 361
_SHORT = 30


def periodic_shapes(
    modes: FloquetModes | PeriodicModel,
    states: Sequence[str] | None = None,
    of: Sequence[int] | None = None,
    *,
    parts: Parts | None = None,
    hit: int = 0,
    weights: ArrayLike | None = None,
) -> Figure:
    """The periodic shapes of modes over the period, and the parts of their harmonics.

    Those of an identified model are drawn as they are, in the units of the channels, with bands that hold the true
    value at each phase with 95 %: a row for each mode and unit. In polar form a band is that of a circle with the
    larger of the deviations of real and imaginary part.

    Those of a known A(t) have a row a mode, by rising damping; each shape is scaled so that the strongest coefficient
    of its zeroth harmonic is one, in the units of the states. The states drawn are those that take most part in the
    modes.

    Parameters
    ----------
    modes
        What `floquet.modes` found, or the model that `identify` found.
    states
        The names of the states (n,); x1, x2, ... where not given. Of an identified model, the names of the channels to
        draw; all where not given, or of each unit the strongest five.
    of
        The indices of the modes, up to six; by default three, one of each pair: those that decay most slowly, of an
        identified model the strongest.
    parts
        "polar", magnitude and phase, or "cartesian", real and imaginary part; by default polar, of an identified model
        cartesian.
    hit
        Which of the hits, from 0, of an identified model.
    weights
        Of an identified model, what each channel counts for in the parts of the harmonics (channels, hits) [1/unit of
        the channel]: for the shares that tables give, `1/analysis.noise`. None: one over the largest coefficient of all
        channels of its unit, so that a channel counts by its size and not by how well it is known. All hits count.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        `modes` is neither, there are not as many names as states, or a mode, channel or hit is not there.
    """
    name = "periodic_shapes"
    if parts is not None and parts not in get_args(Parts):
        raise input_error("parts", name, 'be "polar" or "cartesian"', f"is {parts!r}")
    if isinstance(modes, PeriodicModel):
        return identified_shapes(modes, states, of, hit, weights=weights, polar=parts == "polar", name=name)
    if not isinstance(modes, FloquetModes):
        must, remedy = "be a FloquetModes or a PeriodicModel", "Pass floquet.modes(A, period) or analysis.model."
        raise input_error("modes", name, must, f"is {modes!r:.60}", remedy)
    parts = parts or "polar"
    names = _names(modes, states, name)
    rows = _rows(modes, of, name)
    shares = state_participation(modes)
    strongest = _strongest(shares[rows])
    with style():
        figure = new_figure(7.0, 1.3 + 1.75 * len(rows))
        panels = figure.subplots(len(rows), 3, squeeze=False, width_ratios=(3, 3, 2.2))
        for row, (r, three) in enumerate(zip(rows, panels, strict=True)):
            taking_part = {names[k]: k for k in strongest if shares[r, k] > _SLIGHT}
            looks = {names[k]: look for k, look in zip(strongest, _LOOKS, strict=False)}
            _draw_shape(three, modes, r, taking_part, looks, parts)
            _draw_harmonics(three[2], modes, r)
            three[0].set_title(_title(modes, r), loc="left")
            for axes in three[:2]:
                label_angle(axes, None, name, steps=4)
                if row < len(rows) - 1:
                    axes.set_xlabel("")
        panels[-1, 2].set_xlabel("harmonic $m$")
        figure.align_ylabels(panels[:, 0])
        legend_of_all(figure)
    return figure


def _names(modes: FloquetModes, states: Sequence[str] | None, of: str) -> list[str]:
    count = modes.coefficients.shape[1]
    if states is None:
        return [f"x{k}" for k in range(1, count + 1)]
    if isinstance(states, str) or len(states) != count:
        got = f"is {states!r}" if isinstance(states, str) else f"has {len(states)}"
        raise input_error("states", of, f"hold {count} names", got)
    shown = [str(name).partition(" (internal DOF index")[0] for name in states]
    short = [name if len(name) <= _SHORT else f"{name[: _SHORT - 1]}…" for name in shown]
    return [f"{k + 1}: {name}" if short.count(name) > 1 else name for k, name in enumerate(short)]


def _rows(modes: FloquetModes, of: Sequence[int] | None, name: str) -> list[int]:
    """The modes that are drawn, by falling growth."""
    if of is None:
        chosen = upper_modes(modes)
    else:
        chosen = [int(r) for r in of if isinstance(r, (int, np.integer)) and 0 <= r < modes.order]
        if len(chosen) != len(of) or not 1 <= len(chosen) <= _MOST:
            must = f"list one to {_MOST} indices from 0 to {modes.order - 1}"
            raise input_error("of", name, must, f"is {list(of)!r:.60}")
    ordered = sorted(chosen, key=lambda r: -modes.exponents[r].real)
    return ordered if of is not None else ordered[:_MODES]


def _strongest(shares: NDArray[np.float64]) -> list[int]:
    """The states of the largest shares in any of the modes, in their own order."""
    order = np.argsort(-shares.max(axis=0), kind="stable")
    return sorted(order[: len(_LOOKS)].tolist())


def _title(modes: FloquetModes, mode: int) -> str:
    value = complex(modes.exponents[mode])
    if abs(value.real) <= stability(modes).margins[mode]:
        value = complex(0.0, value.imag)
    if multiplier_is_real(modes, mode):
        words = f"{value.real:.4g}" + (f" + {abs(value.imag):.4g}i" if value.imag else "")
    else:
        words = f"{value.real:.4g} ± {abs(value.imag):.4g}i"
    return rf"$\lambda$ = {words} 1/s".replace("-", "−")


def _draw_shape(
    panels: Sequence[Axes],
    modes: FloquetModes,
    mode: int,
    states: dict[str, int],
    looks: dict[str, tuple[str, Any]],
    parts: Parts,
) -> None:
    """The two parts of the shape over the period."""
    times = np.linspace(0.0, modes.period, _POINTS)
    shape = modes.shapes(times)[mode]
    phase = np.linspace(0.0, 360.0, _POINTS)
    for name, k in states.items():
        color, dashes = looks[name]
        look = {"color": color, "linestyle": dashes, "linewidth": 1.3}
        if parts == "cartesian":
            curves = shape[k].real, shape[k].imag
        else:
            size = np.abs(shape[k])
            angle = np.degrees(np.unwrap(np.angle(shape[k])))
            angle -= 360.0 * np.round(angle.mean() / 360.0)
            curves = size, np.where(size > _FAINT * size.max(), angle, np.nan)
        for axes, curve in zip(panels[:2], curves, strict=True):
            axes.plot(phase, curve, **look, label=plain(name))
    unit = "[unit of state]"
    words = (f"$|p|$ {unit}", r"$\angle p$ [deg]") if parts == "polar" else (f"Re $p$ {unit}", f"Im $p$ {unit}")
    for axes, label in zip(panels[:2], words, strict=True):
        axes.set_ylabel(label)
        axes.margins(y=0.12)
        axes.ticklabel_format(axis="y", useOffset=False)
    if parts == "polar":
        panels[0].set_ylim(bottom=0.0)
        _whole_turns(panels[1])


def _whole_turns(axes: Axes) -> None:
    """Ticks of a phase at multiples of 90 degrees where it turns far enough."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    low, high = axes.get_ylim()
    if high - low < 40.0:  # what hardly turns is no drama
        middle = 0.5 * (low + high)
        low, high = middle - 20.0, middle + 20.0
        axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(
        MultipleLocator(90.0 * np.ceil((high - low) / 450.0)) if high - low > 200.0 else MaxNLocator(4)
    )


def _draw_harmonics(axes: Axes, modes: FloquetModes, mode: int) -> None:
    """The part of each harmonic in the shape's mean square."""
    from matplotlib.ticker import MaxNLocator

    shares = modes.participation[mode]
    kept = np.flatnonzero(shares >= _LEAST)
    low, high = int(modes.harmonics[kept[0]]) - 1, int(modes.harmonics[kept[-1]]) + 1
    inside = (modes.harmonics >= low) & (modes.harmonics <= high) & (shares >= _LEAST)
    axes.bar(modes.harmonics[inside], shares[inside], color=GREY, edgecolor=BLUE, linewidth=0.8, width=0.7)
    axes.set(yscale="log", xlim=(low - 0.4, high + 0.4), ylim=(_LEAST, 2.0), ylabel="part [-]")
    plain_decades(axes)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
