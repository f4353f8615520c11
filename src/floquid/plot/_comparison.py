"""A comparison: both sets of exponents in the strip, the similarity of all shapes, and each pair close up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._checks import index, input_error
from floquid.comparison import ComparedPoint, Comparison, Pair, mode_number
from floquid.plot._exponents import short_tick
from floquid.plot._style import BLACK, BLUE, GREY, ORANGE, VERMILION, Into, drawing
from floquid.views import in_strip, region_on_branch

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS, MOST = 4, 12  # pairs that are drawn close up in a row, and at most
_A: dict[str, Any] = {"linestyle": "none", "marker": "o", "color": BLUE, "markersize": 6.0, "markerfacecolor": "none"}
_B: dict[str, Any] = {"linestyle": "none", "marker": "x", "color": VERMILION, "markersize": 5.5}


def comparison(found: Comparison, *, point: int | None = None, ax: Into = None) -> Figure:
    """Exponents of both sides in the strip, the similarity of shapes, and each pair close up with regions of 95 %.

    In the strip exponents stand at |Im λ| modulo ω, from zero to ω/2. Close up they stand on the branch of the first
    side, off its value; a region is drawn of a side that has deviations. `found` is what `compare` gave. `point` is the
    number of the point, by default that of the largest difference over its deviation. `ax` are two axes to draw into
    and one more for each pair, twelve at most. Raises InputError where one is something else.
    """
    of = "comparison"
    if not isinstance(found, Comparison):
        raise input_error("found", of, "be a Comparison", f"is {found!r:.60}", "Pass floquid.compare(...).")
    number = 0 if found.worst is None else found.worst.point
    number = number if point is None else index(point, "point", of, len(found.points))
    here = found.points[number]
    pairs = [pair for pair in found.pairs if pair.point == number][:MOST]
    rows = -(-len(pairs) // ACROSS)
    panels = np.vstack(
        [np.repeat([[0, 1]], ACROSS, axis=1), 2 + np.arange(2 * rows * ACROSS).reshape(rows, 2 * ACROSS) // 2]
    )
    panels[panels >= 2 + len(pairs)] = -1
    layout = {"panels": panels.tolist(), "height_ratios": (3.0, *[1.7] * rows), "empty_sentinel": -1}
    with drawing(3.4 + 1.9 * rows, ax, of, **layout) as (figure, (strip, macs, *close)):
        for model, modes, look, label in (
            (here.model_a, here.modes_a, _A, "a"), (here.model_b, here.modes_b, _B, "b"),
        ):  # fmt: skip
            lam = model.exponents[[mode for object_ in modes for mode in object_]]
            strip.plot(lam.real, in_strip(lam, model.fundamental).imag, **look, label=label)
        strip.axvline(0.0, color=BLACK, linewidth=0.9)
        strip.axhline(0.5 * here.model_a.fundamental, color=ORANGE, linestyle="--", linewidth=0.9, label="ω/2")
        strip.set(xlabel="Re λ [1/s]", ylabel="|Im λ| modulo ω [rad/s]", ylim=(0.0, 0.55 * here.model_a.fundamental))
        if found.over is not None:
            strip.set_title(f"{found.over} = {here.value:g}")
        _draw_macs(macs, here)
        for place, (pair, axes) in enumerate(zip(pairs, close, strict=True)):
            _draw_close(axes, here, pair)
            if place % ACROSS == 0:
                axes.set_ylabel("Im λ − a [rad/s]", fontsize=8.0)
            if place + ACROSS >= len(pairs):
                axes.set_xlabel("Re λ − a [1/s]", fontsize=8.0)
    return figure


def _draw_macs(axes: Axes, here: ComparedPoint) -> None:
    """The similarity of each mode of a with each of b, in grey and as a number where there is room."""
    labels = [
        ["/".join(str(mode_number(model, mode)) for mode in modes) for modes in each]
        for model, each in ((here.model_a, here.modes_a), (here.model_b, here.modes_b))
    ]
    axes.imshow(np.nan_to_num(here.macs), cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    axes.grid(False)
    axes.set(xlabel="mode of b", ylabel="mode of a", title="similarity of shapes (mac)")
    if np.isnan(here.macs).all():
        axes.set_title("no common channels: no similarity")
    axes.set_xticks(range(len(labels[1])), labels[1])
    axes.set_yticks(range(len(labels[0])), labels[0])
    for (row, column), value in np.ndenumerate(here.macs if here.macs.size <= 64 else np.empty((0, 0))):
        if np.isfinite(value):
            dark = "white" if value > 0.5 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=dark, fontsize=7.5)


def _draw_close(axes: Axes, here: ComparedPoint, pair: Pair) -> None:
    """One pair close up, off the exponent of a."""
    reach = 1e-12 * here.model_a.fundamental
    apart = pair.exponent_b - pair.exponent_a
    for model, mode, exponent, look in (
        (here.model_a, pair.a, pair.exponent_a, _A), (here.model_b, pair.b, pair.exponent_b, _B),
    ):  # fmt: skip
        off = exponent - pair.exponent_a
        axes.plot([off.real], [off.imag], **look)
        region = region_on_branch(model, mode, exponent)
        if region is not None:
            axes.plot((off + region).real, (off + region).imag, color=look["color"], linewidth=1.0)
            reach = max(reach, *np.abs([region.real, region.imag]).max(axis=1))
    reach = 1.25 * max(reach, abs(apart.real), abs(apart.imag))
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.locator_params(nbins=3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(short_tick)
    axes.tick_params(labelsize=7.0)
    z = "" if np.isnan(pair.z) else f", {pair.z:.3g} deviations"
    numbers = mode_number(here.model_a, pair.a), mode_number(here.model_b, pair.b)
    axes.set_title(f"a {numbers[0]}, b {numbers[1]}{z}", fontsize=8.0)
