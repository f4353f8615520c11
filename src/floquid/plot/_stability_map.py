"""Map of the stability of a periodic system, over one or two parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import input_error
from floquid.floquet import Instability, StabilityMap
from floquid.plot._style import BLACK, BLUE, ORANGE, PURPLE, VERMILION, Into, drawing, label_values, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS = {  # told apart by their hatching as well as by colour
    Instability.DIVERGENCE: ("unstable: multiplier above 1", VERMILION, "///"),
    Instability.PERIOD_DOUBLING: ("unstable: multiplier below −1", ORANGE, "\\\\\\"),
    Instability.FLUTTER: ("unstable: a complex pair", PURPLE, "xxx"),
}

_RASTER = 700


def stability_map(found: StabilityMap, *, ax: Into = None) -> Figure:
    """The growth over one parameter with the unstable bands, or the unstable region of two with its boundary.

    Bands and regions say by colour and hatching how the system is unstable.

    `found` is what `floquet.stability_map` found, and `ax` the axes to draw into. Raises InputError where one is
    something else.
    """
    if not isinstance(found, StabilityMap):
        must, remedy = "be a StabilityMap", "Pass floquet.stability_map(...)."
        raise input_error("found", "stability_map", must, f"is {found!r:.60}", remedy)
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
    axes.plot(x, found.growth, color=BLUE, linewidth=1.3, label=r"largest Re $\lambda$")
    axes.axhline(found.margin, color=BLACK, linestyle="--", linewidth=0.9, label="limit of stability")
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
        axes.add_collection(LineCollection(list(found.boundary), colors=BLACK, linewidths=0.9, label="boundary"))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), ylabel=plain(found.names[1]))
    axes.grid(visible=False)
