"""Modes over an operating point, and maps of stability over one or two parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import an_instance, index, wrong_value
from floquid.fit import WITHIN
from floquid.floquet import Instability, StabilityMap
from floquid.plot._style import Into, drawing, grid_of, label_values, plain
from floquid.surveys import (
    DAMPING,
    Damping,
    Survey,
    Track,
    damping_of,
    link_runs,
    looks,
    order_end,
    order_lines,
    unstable_spans,
)
from floquid.views import Ink, over_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WAY = 48  # steps of the way of a multiplier from one point to the next
FAN = 4  # harmonics of a fan on either side


def campbell(
    found: Survey, *, orders: tuple[int, ...] | None = None, fan: int | None = None, ax: Into = None
) -> Figure:
    """Frequencies over the operating point, a line a mode, with bars of 95 % where they can be seen.

    Triangles point up where a mode whirls forward, and down where backward. Weak modes are open marks, locked ones
    squares, and doubtful links dashed. Spans in which a mode is unstable are shaded, the intervals of their edges
    darker. Dotted are whole orders of the speed, where it is known, and dashed half the fundamental, at which a mode
    locks with itself. Where modes are named by patterns over blades, the tower is blue, flap green, edge red, and the
    drive train brown; lines are full of what does not turn, dashed backward, dash-dotted forward, and dotted in doubt.

    `found` is what `survey` found, `orders` are those of the speed that are drawn, by default 1, 2 and 3, and 1, n, 2n
    and 3n of n blades, and `ax` the axes to draw into.
    `fan` is the number of a track whose lines λ + imω are drawn too, wide where much of the shape is; None for none.
    Raises InputError where `found` is no survey, `fan` no track, or the axes do not fit.
    """
    of = "campbell"
    an_instance(found, Survey, "found", of, "Pass floquid.survey(...).")
    chosen = None if fan is None else found.tracks[index(fan, "fan", of, len(found.tracks))]
    with drawing(4.2, ax, of) as (figure, (axes,)):
        _spans(axes, found)
        top = 0.0
        for number, track in enumerate(found.tracks):
            hertz = np.abs(track.frequency) / (2.0 * np.pi)
            top = max(top, float(hertz.max(initial=0.0)))
            _line(axes, found, number, hertz, track.frequency_std / (2.0 * np.pi))
        _unlinked(axes, found)
        _references(axes, found, orders, 1.15 * top)
        if chosen is not None:
            _fan(axes, found, chosen)
        _label(axes, found)
        axes.set(ylabel="frequency [Hz]", ylim=(0.0, 1.15 * top or 1.0))
    return figure


def damping(found: Survey, *, unit: Damping = "decay", ax: Into = None) -> Figure:
    """Decay or damping over the operating point, a line a mode, with bars of 95 %; what is unstable is shaded.

    A couple of real multipliers has two decays, joined by a bar, and neither a damping ratio nor a decrement: it has no
    frequency of its own.

    `found` is what `survey` found. `unit` is "decay" for Re λ [1/s], "ratio" for ζ in percent, or "decrement" for
    δ = -2π Re λ/|Im λ|; `ax` the axes to draw into. Raises InputError where one is something else.
    """
    of = "damping"
    an_instance(found, Survey, "found", of, "Pass floquid.survey(...).")
    if unit not in DAMPING:
        raise wrong_value("unit", of, f"be one of {', '.join(DAMPING)}", unit)
    with drawing(4.2, ax, of) as (figure, (axes,)):
        _spans(axes, found)
        for number, track in enumerate(found.tracks):
            x = found.values[track.points]
            values, std = damping_of(track, unit)
            _line(axes, found, number, values, std)
            if unit == "decay":
                for place in np.flatnonzero(track.locked):
                    ends = track.exponents[place].real
                    axes.plot(
                        x[[place, place]], ends, "s-", color=looks(found)[number][0], markersize=3.5, linewidth=1.6
                    )
        axes.axhline(0.0, color=Ink.BLACK, linewidth=0.9)
        low, high = axes.get_ylim()
        unstable = (0.0, max(high, 0.0)) if unit == "decay" else (min(low, 0.0), 0.0)
        axes.axhspan(*unstable, facecolor=Ink.VERMILION, alpha=0.08, zorder=0)
        _label(axes, found)
        axes.set(ylabel=DAMPING[unit], ylim=(low, high))
    return figure


def multipliers(found: Survey, *, ax: Into = None) -> Figure:
    """The size of multipliers over the operating point, and their ways in the plane beside the unit circle.

    A mode that leaves the circle is unstable; arrows point to higher operating points. `found` is what `survey` found,
    and `ax` two axes to draw into. Raises InputError where one is something else.
    """
    of = "multipliers"
    an_instance(found, Survey, "found", of, "Pass floquid.survey(...).")
    with drawing(3.9, ax, of, panels=grid_of(1, 2)) as (figure, (left, right)):
        _spans(left, found)
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        right.plot(np.cos(angle), np.sin(angle), color=Ink.SILVER, linewidth=0.9)
        for number, track in enumerate(found.tracks):
            periods = np.array([_period(found, point) for point in track.points.tolist()])
            sizes = np.exp(track.growth * periods)
            _line(left, found, number, sizes, sizes * periods * track.growth_std)
            turned = track.exponents * periods[:, None]
            free, places = np.where(track.locked, np.nan, turned[:, 0]), np.arange(len(periods))
            # An angle of many turns goes round the circle from point to point, and not straight across it.
            with np.errstate(invalid="ignore"):
                way = np.exp(np.interp(np.linspace(0.0, places[-1], WAY * places[-1] + 1), places, free))
            right.plot(way.real, way.imag, color=looks(found)[number][0], linewidth=0.9)
            for pair in np.exp(turned[track.locked]):
                right.plot(pair.real, pair.imag, "s", color=looks(found)[number][0], markersize=3.0)
            if np.isfinite(way[-2:]).all():
                ends = [(value.real, value.imag) for value in way[[-1, -2]]]
                right.annotate("", *ends, arrowprops={"arrowstyle": "->", "color": looks(found)[number][0]})
        left.axhline(1.0, color=Ink.BLACK, linewidth=0.9)
        _label(left, found)
        left.set_ylabel("|μ|")
        right.set(xlabel="Re μ", ylabel="Im μ", aspect="equal")
    return figure


def _line(axes: Axes, found: Survey, number: int, values: Floats, std: Floats) -> None:
    """One track: its line, dashed where a link is doubtful, and its marks with bars."""
    track, x = found.tracks[number], found.values[found.tracks[number].points]
    colour, dash, doubt = looks(found)[number]
    axes.plot([], [], color=colour, linestyle=dash, linewidth=1.1, label=track.name)
    for run, doubtful in link_runs(track):
        axes.plot(x[run], values[run], color=colour, linestyle=doubt if doubtful else dash, linewidth=1.1)
    form: dict[str, Any] = {"color": colour, "linestyle": "none", "capsize": 0.0, "elinewidth": 0.9}
    kinds = [(~track.locked & (track.sense == side), marker) for side, marker in ((0, "o"), (1, "^"), (-1, "v"))]
    for kind, marker in (*kinds, (track.locked, "s")):
        for weak, face in ((False, colour), (True, "white")):
            at = kind & (track.weak == weak)
            if at.any():
                look = {"marker": marker, "markersize": 4.0, "markerfacecolor": face}
                axes.errorbar(x[at], values[at], WITHIN * std[at], **form, **look)


def _unlinked(axes: Axes, found: Survey) -> None:
    """Modes on no track, as crosses."""
    models = [(point, found.points[point].model, mode) for point, mode in found.unlinked]
    x = [found.values[point] for point, model, _ in models if model is not None]
    hertz = [abs(model.exponents[mode].imag) / (2.0 * np.pi) for _, model, mode in models if model is not None]
    if x:
        axes.plot(x, hertz, "x", color=Ink.SILVER, markersize=5.0, label="on no track")


def _period(found: Survey, point: int) -> float:
    model = found.points[point].model
    assert model is not None
    return model.period


def _spans(axes: Axes, found: Survey) -> None:
    """Shade where a mode is unstable, the intervals of the edges darker."""
    for spans, alpha in ((unstable_spans(found), 0.12), ([edge.interval for edge in found.edges], 0.3)):
        for low, high in spans:
            axes.axvspan(low, high, facecolor=Ink.VERMILION, alpha=alpha, edgecolor="none", zorder=0)


def _references(axes: Axes, found: Survey, orders: tuple[int, ...] | None, top: float) -> None:
    """Orders of the speed, dotted, and half the fundamental, dashed."""
    x = found.values
    for label, hertz in order_lines(found, orders):
        axes.plot(x, hertz, ":", color=Ink.SILVER, linewidth=0.9)
        style: dict[str, Any] = {"textcoords": "offset points", "color": Ink.SILVER, "va": "center"}
        end = order_end(found, hertz, top)
        if end is not None and end[1] < top:
            axes.annotate(label, (1.0, end[1]), (3, 0), xycoords=axes.get_yaxis_transform(), **style)
        elif end is not None:  # it leaves the figure at its top
            axes.annotate(label, end, (3, -7), **style)
    known = [k for k, point in enumerate(found.points) if point.model is not None]
    axes.plot(
        x[known], [0.5 / _period(found, k) for k in known], "--", color=Ink.SILVER, linewidth=0.9, label="half of 1/T"
    )


def _fan(axes: Axes, found: Survey, track: Track) -> None:
    """Lines of one track at whole harmonics, as wide as their share of the shape."""
    shares = np.zeros((len(track.points), 2 * FAN + 1))
    lines = np.zeros_like(shares)
    for place, point in enumerate(track.points.tolist()):
        model = found.points[point].model
        assert model is not None
        energy = np.sum(np.abs(model.coefficients[track.modes[place, 0]]) ** 2, axis=(0, 1))
        side = -1 if track.mirrored[place] else 1
        for k, m in enumerate(range(-FAN, FAN + 1)):
            lines[place, k] = abs(track.frequency[place] + m * model.fundamental) / (2.0 * np.pi)
            shares[place, k] = energy[model.harmonics == side * (m + track.shifts[place])].sum() / energy.sum()
    for k in range(2 * FAN + 1):
        if k != FAN:
            width = 0.3 + 3.0 * shares[:, k].mean()
            axes.plot(found.values[track.points], lines[:, k], color=Ink.SILVER, linewidth=width, zorder=1)


def _label(axes: Axes, found: Survey) -> None:
    """Label the operating point, and show all of the survey."""
    x = found.values
    margin = 0.02 * (float(np.ptp(x)) or 1.0)
    axes.set(xlabel=over_label(found.over), xlim=(x.min() - margin, x.max() + margin))


LOOKS = {  # told apart by their hatching as well as by colour
    Instability.DIVERGENCE: ("unstable: multiplier above 1", Ink.VERMILION, "///"),
    Instability.PERIOD_DOUBLING: ("unstable: multiplier below −1", Ink.ORANGE, "\\\\\\"),
    Instability.FLUTTER: ("unstable: a complex pair", Ink.PURPLE, "xxx"),
}

_RASTER = 700


def stability_map(found: StabilityMap, *, ax: Into = None) -> Figure:
    """The growth over one parameter with the unstable bands, or the unstable region of two with its boundary.

    Bands and regions say by colour and hatching how the system is unstable.

    `found` is what `floquet.stability_map` found, and `ax` the axes to draw into. Raises InputError where one is
    something else.
    """
    an_instance(found, StabilityMap, "found", "stability_map", "Pass floquet.stability_map(...).")
    with drawing(3.6 if len(found.names) == 1 else 5.0, ax, "stability_map") as (figure, (axes,)):
        if len(found.names) == 1:
            _draw_growth(axes, found)
        else:
            _draw_region(axes, found)
        axes.set_xlabel(plain(found.names[0]))
    return figure


def _draw_growth(axes: Axes, found: StabilityMap) -> None:
    """The growth, and the bands by the kind of the fastest growth in each."""
    x = found.points[:, 0]
    for low, high in [] if found.bands is None else found.bands:
        inside = np.flatnonzero((x >= low) & (x <= high) & found.unstable)
        if not inside.size:
            continue
        kind = Instability(int(found.kind[inside[found.growth[inside].argmax()]]))
        label, color, hatch = LOOKS[kind]
        axes.axvspan(low, high, facecolor=color, alpha=0.25, edgecolor="none")
        axes.axvspan(low, high, facecolor="none", edgecolor=color, hatch=hatch, linewidth=0.8, label=label)
    axes.plot(x, found.growth, color=Ink.BLUE, linewidth=1.3, label=r"largest Re $\lambda$")
    axes.axhline(found.margin, color=Ink.BLACK, linestyle="--", linewidth=0.9, label="limit of stability")
    axes.set_xlim(float(x[0]), float(x[-1]))
    axes.margins(y=0.1)
    label_values(axes, r"growth", "1/s", float(np.abs(found.growth).max()))


def _draw_region(axes: Axes, found: StabilityMap) -> None:
    """The unstable region, of each pixel the kind of the nearest point that was evaluated, and its boundary."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb
    from scipy.spatial import KDTree

    low = np.array([grid[0] for grid in found.grids])
    high = np.array([grid[-1] for grid in found.grids])
    steps = np.array([(high[k] - low[k]) / (len(found.grids[k]) - 1) for k in range(2)])
    raster = [low[k] + (np.arange(_RASTER) + 0.5) / _RASTER * (high[k] - low[k]) for k in range(2)]
    pixels = np.stack(np.meshgrid(*raster, indexing="xy"), axis=-1).reshape(-1, 2)
    kinds = found.kind[KDTree(found.points / steps).query(pixels / steps)[1]].reshape(_RASTER, _RASTER)
    image = np.ones((_RASTER, _RASTER, 3))
    for kind, (label, color, hatch) in LOOKS.items():
        here = kinds == kind
        if not here.any():
            continue
        image[here] = 0.72 + 0.28 * np.array(to_rgb(color))
        hatched = axes.contourf(*raster, here.astype(float), levels=[0.5, 1.5], colors="none", hatches=[hatch])
        hatched.set_edgecolor(color)
        hatched.set_linewidth(0.0)
        # A point, for the entry of the legend.
        face = image[here][0].tolist()
        axes.fill([low[0]], [low[1]], facecolor=face, edgecolor=color, hatch=hatch, linewidth=0.0, label=label)
    axes.imshow(image, origin="lower", extent=(low[0], high[0], low[1], high[1]), aspect="auto", zorder=0.5)
    if found.boundary is not None and len(found.boundary):
        axes.add_collection(LineCollection(list(found.boundary), colors=Ink.BLACK, linewidths=0.9, label="boundary"))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), ylabel=plain(found.names[1]))
    axes.grid(visible=False)
