"""How much of the lifted responses the model explains, line by line of their spectrum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from floquid.lti import WHITE, Composites, composites
from floquid.pipeline import Analysis
from floquid.plot._several import several
from floquid.plot._style import BLACK, BLUE, GREY, ORANGE, VERMILION, finish, new_figure, plain, style
from floquid.views import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def composite(analysis: Analysis | Mapping[str, Analysis], *, points: int = 4000, angular: bool = False) -> Figure:
    """Composites of the data, of the model and of their difference, over the band 0 to ω/2 of the lifted responses.

    A composite is the mean magnitude of the spectra of all lifted responses, each over the standard deviation of its
    noise. Where the difference lies on the level of white noise, the model has explained all there is. Marks show the
    frequencies of the modes, folded into the band.

    Parameters
    ----------
    analysis
        What `identify` found, or several analyses by name: then one panel each.
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
        `analysis` is neither, or there are more of them than fit a figure.
    """
    named = several(analysis, Analysis, "analysis", "composite")
    turn, unit = (2.0 * np.pi, "rad/s") if angular else (1.0, "Hz")
    with style():
        figure = new_figure(7.0, 4.0 if len(named) == 1 else 1.0 + 2.6 * len(named))
        panels = figure.subplots(len(named), sharex=True, squeeze=False)[:, 0]
        for axes, (name, one) in zip(panels, named.items(), strict=True):
            _draw(axes, one, points, turn)
            filtered = "" if one.lifted.whitening is None else ",\nafter the whitening filter"
            axes.set_ylabel(f"mean magnitude / noise [-]{filtered}")
            if name:
                axes.set_title(plain(name), loc="left")
        panels[-1].set_xlabel(rf"frequency in the lifted band, 0 to $\omega$/2 [{unit}]")
        finish(figure)
    return figure


def _draw(axes: Axes, analysis: Analysis, points: int, turn: float) -> None:
    """The composites of one analysis, the level of white noise, and its modes, at `turn` times frequencies in Hz."""
    found = analysis.modal.composites or composites(analysis.lifted.responses, analysis.modal)
    scale = turn / (2.0 * np.pi * analysis.lifted.period)
    curves = {
        "data": (found.data, {"color": BLUE, "linewidth": 2.2}),
        "model": (found.model, {"color": ORANGE, "linewidth": 1.0}),
        "data − model": (found.difference, {"color": VERMILION, "linewidth": 0.8}),
    }
    for name, (values, look) in curves.items():
        axes.plot(*envelope(found.angles * scale, values, points), **look, label=name)
    axes.axhline(WHITE, color=BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
    for number, angle in enumerate(np.unique(np.abs(np.angle(analysis.modal.multipliers)))):
        label = "modes, folded" if number == 0 else None
        axes.axvline(angle * scale, color=GREY, linestyle=(0, (2, 2)), linewidth=0.8, label=label, zorder=1)
    axes.set(yscale="log", xlim=(0.0, np.pi * scale))
    axes.set_ylim(bottom=_floor(found))


def _floor(found: Composites) -> float:
    """The bottom of the axis: the model may fall to nothing far from its modes, and would flatten all the rest."""
    positive = found.difference[found.difference > 0]
    least = min(WHITE, float(positive.min())) if len(positive) else WHITE
    return 0.5 * least
