"""How much of the lifted responses the model explains, line by line of their spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.pipeline import Analysis
from floquid.plot._style import BLACK, BLUE, GREY, ORANGE, VERMILION, envelope, finish, new_figure, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WHITE = np.sqrt(np.pi) / 2.0
"""The mean magnitude of a spectral line of white noise of unit variance: |z| of a complex normal z with E|z|² = 1."""

BLOCK = 2**22
"""The most numbers that are transformed at once."""


@dataclass(frozen=True, slots=True)
class Composites:
    """Mean magnitudes of the spectra of all lifted responses over their noise, at frequencies [Hz], all (lines,)."""

    frequencies: NDArray[np.float64]
    data: NDArray[np.float64]
    model: NDArray[np.float64]
    difference: NDArray[np.float64]


def composites(lifted: Lifted, modal: ModalModel) -> Composites:
    r"""The composites of the data, of the model and of their difference.

    .. math:: c(\omega_l) = \frac1{OH} \sum_{o,h} \frac1{\sigma_{oh} \sqrt{N_h}}
              \Big| \sum_{m=0}^{N_h-1} y_{oh}[m]\, e^{-i\omega_l m T} \Big|

    With this scale white noise has √π/2 on every line. The model is summed over the same finite record: a shorter hit
    is followed by zeros in both.
    """
    responses = lifted.responses
    outputs, hits, samples = responses.values.shape
    lines = samples // 2 + 1
    powers = modal.multipliers[:, None] ** np.arange(samples)
    sums = np.zeros((3, lines))
    step = max(1, BLOCK // samples)
    for hit, length in enumerate(responses.lengths):
        basis = np.fft.fft(powers[:, :length], n=samples)[:, :lines]
        for start in range(0, outputs, step):
            block = slice(start, start + step)
            scale = 1.0 / (responses.noise[block, hit, None] * np.sqrt(length))
            data = np.fft.rfft(responses.values[block, hit, :length], n=samples) * scale
            model = (modal.residues[:, block, hit].T @ basis) * scale
            sums += np.abs([data, model, data - model]).sum(axis=1)
    frequencies = np.arange(lines) / (samples * lifted.period)
    return Composites(frequencies, *(sums / (outputs * hits)))


def composite(analysis: Analysis, *, points: int = 4000) -> Figure:
    """Composites of the data, of the model and of their difference, over the band 0 to ω/2 of the lifted responses.

    A composite is the mean magnitude of the spectra of all lifted responses, each over the standard deviation of its
    noise. Where the difference lies on the level of white noise, the model has explained all there is. Marks show the
    frequencies of the modes, folded into the band.

    Parameters
    ----------
    analysis
        What `identify` found.
    points
        The most points a curve is drawn with.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    found = composites(analysis.lifted, analysis.modal)
    period = analysis.lifted.period
    folded = np.unique(np.abs(np.angle(analysis.modal.multipliers)) / (2.0 * np.pi * period))
    with style():
        figure = new_figure(7.0, 4.0)
        axes = figure.add_subplot()
        curves = {
            "data": (found.data, {"color": BLUE, "linewidth": 2.2}),
            "model": (found.model, {"color": ORANGE, "linewidth": 1.0}),
            "data − model": (found.difference, {"color": VERMILION, "linewidth": 0.8}),
        }
        for name, (values, look) in curves.items():
            axes.plot(*envelope(found.frequencies, values, points), **look, label=name)
        axes.axhline(WHITE, color=BLACK, linestyle="--", linewidth=0.9, label="white noise alone")
        for number, frequency in enumerate(folded):
            label = "modes, folded" if number == 0 else None
            axes.axvline(frequency, color=GREY, linestyle=(0, (2, 2)), linewidth=0.8, label=label, zorder=1)
        axes.set(
            yscale="log",
            xlim=(0.0, 0.5 / period),
            xlabel=r"frequency in the lifted band, 0 to $\omega$/2 [Hz]",
            ylabel="mean magnitude / noise [-]",
        )
        axes.set_ylim(bottom=_floor(found))
        finish(figure)
    return figure


def _floor(found: Composites) -> float:
    """The bottom of the axis: the model may fall to nothing far from its modes, and would flatten all the rest."""
    positive = found.difference[found.difference > 0]
    least = min(WHITE, float(positive.min())) if len(positive) else WHITE
    return 0.5 * least
