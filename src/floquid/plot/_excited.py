"""Figures of records whose excitation goes on: harmonic power spectra, and harmonic transfer functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import index, input_error, positive
from floquid.innovations import harmonic_spectra as spectra_of
from floquid.inputs import TransferFunctions
from floquid.pipeline import AmbientAnalysis
from floquid.plot._style import BLACK, BLUE, GREEN, ORANGE, POINTS, PURPLE, SKY, VERMILION, drawing, plain
from floquid.views import envelope, magnitude_bands

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


COLORS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE)
DASHES = ((0, (4, 2)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)))
CURVES = 4  # singular values that are drawn: three of them are seldom modes at once
SMALLEST = 1e-3  # the share of a mode's energy below which a line is not marked


def harmonic_spectra(
    analysis: AmbientAnalysis, *, harmonics: int = 1, periods: int | None = None, limit: float | None = None
) -> Figure:
    r"""Singular values of the harmonic power spectra of a record of outputs alone, and the lines of its modes.

    .. math:: \sigma_k\{S(\Omega)\}, \qquad
              S_{mn}(\Omega) = \frac{1}{J} \sum_j Y_j(\Omega + m\omega)\, Y_j(\Omega + n\omega)^H

    with Y the transforms of segments (Allen, Sracic, Chauhan and Hansen 2011). A mode is a peak of the first at each of
    \|Im λ + mω\| that it has in the outputs, and up to M fundamentals beside; a second singular value that rises there
    is another mode. Lines are those of the model, the strongest of each mode thick. Channels of different units are
    divided by their rms.

    Raises InputError where this is no result of outputs alone, or an option is not possible.

    Parameters
    ----------
    analysis
        What `identify_ambient` found.
    harmonics
        M: outputs are modulated by -M to M.
    periods
        Periods a segment; a twelfth of the record where not given.
    limit
        The highest frequency [Hz]; half of the fundamental above the highest line where not given.
    """
    of = "harmonic_spectra"
    if not isinstance(analysis, AmbientAnalysis):
        raise input_error("analysis", of, "be a result of `identify_ambient`", f"is {type(analysis).__name__}")
    model, samples = analysis.model, analysis.fit.samples
    found = spectra_of(samples, harmonics, periods)
    units = {channel.unit for channel in model.channels}
    scale = np.ones(len(samples.values)) if len(units) == 1 else 1.0 / samples.values.std(axis=1)
    scale = np.tile(scale, len(found.harmonics))
    sizes: Floats = np.asarray(np.linalg.svd(found.values * scale[:, None] * scale, compute_uv=False), np.float64)
    lines = [_lines(analysis, mode, found.harmonics) for mode in model.upper_modes]
    highest = max((own.max() for own in lines), default=found.frequencies_hz[-1]) + 0.5 / model.period
    end = min(float(found.frequencies_hz[-1]), highest if limit is None else positive(limit, "limit", of, unit="Hz"))
    inside = found.frequencies_hz <= end
    with drawing(4.2) as figure:
        axes = figure.add_subplot()
        for number in range(min(CURVES, sizes.shape[1])):
            x, y = envelope(found.frequencies_hz[inside], sizes[inside, number], POINTS)
            width, alpha = (0.8, 0.75 - 0.15 * number) if number else (1.3, 1.0)
            label = None if number else "singular values, descending"
            axes.plot(x, y, color=BLACK, linewidth=width, alpha=alpha, label=label)
        for number, own in enumerate(lines):
            look = {"color": COLORS[number % len(COLORS)], "linestyle": DASHES[number // len(COLORS) % len(DASHES)]}
            for place, line in enumerate(own):
                label = rf"mode {number + 1}, $|\mathrm{{Im}}\,\lambda + m\omega|/2\pi$" if place == 0 else None
                axes.axvline(line, **look, linewidth=1.6 if place == 0 else 0.9, zorder=1, label=label)
        axes.set_yscale("log")
        axes.set_xlim(0.0, end)
        axes.set_xlabel("frequency [Hz]")
        unit = "-" if len(units) > 1 else plain(units.copy().pop())
        squared = "1" if unit == "-" else f"{unit}²" if unit.isalpha() else f"({unit})²"
        axes.set_ylabel(f"harmonic power spectra, M = {harmonics} [{squared}/Hz]")
    return figure


def _lines(analysis: AmbientAnalysis, mode: int, moved: Integers) -> Floats:
    """Frequencies of a mode's harmonics that are seen, the strongest first, and of those moved (lines,) [Hz]."""
    model = analysis.model
    energy = np.sum(np.abs(model.coefficients[mode, :, 0] / analysis.noise) ** 2, axis=0)
    seen = model.harmonics[energy > SMALLEST * energy.sum()]
    turns = [model.harmonics[np.argmax(energy)], *np.unique(np.add.outer(seen, moved))]
    return np.abs(model.exponents[mode].imag + model.fundamental * np.array(turns)) / (2.0 * np.pi)


HARMONIC_COLORS = (BLACK, BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
HARMONIC_DASHES = ("-", "--", ":", "-.")
LINES = 150  # up to so many frequencies a deviation is a bar


def transfer(
    found: TransferFunctions | Callable[[], TransferFunctions], *, output: int = 0, driven_by: int = 0
) -> Figure:
    r"""Magnitudes of the harmonic transfer functions :math:`|G_m(\Omega)|` from one input to one output.

    A curve a harmonic m: the response at Ω + mω to an input at Ω. Bands are 95 % intervals, of lines that were measured
    bars. `found` are transfer functions, or what makes them (`analysis.transfer`); `output` and `driven_by` are which
    output and which input, from 0. Raises InputError where there is no such one.
    """
    own = found() if callable(found) else found
    row = index(output, "output", "transfer", len(own.outputs))
    column = index(driven_by, "driven_by", "transfer", len(own.inputs))
    sizes, low, high, floor = magnitude_bands(own, row, column)
    measured = not np.isfinite(own.values).all() or len(own.frequencies_hz) <= LINES
    with drawing(4.2) as figure:
        axes = figure.add_subplot()
        for place, harmonic in sorted(enumerate(own.harmonics.tolist()), key=lambda one: (abs(one[1]), one[1])):
            there = np.isfinite(sizes[place])
            if not sizes[place, there].any():
                continue
            size, hertz = sizes[place, there], own.frequencies_hz[there]
            number = 2 * abs(harmonic) - (harmonic > 0)
            color, dash = (
                HARMONIC_COLORS[number % len(HARMONIC_COLORS)],
                HARMONIC_DASHES[number // len(HARMONIC_COLORS) % len(HARMONIC_DASHES)],
            )
            axes.plot(
                hertz, size, color=color, linestyle=dash, label=f"m = {harmonic}", linewidth=0.6 if measured else None
            )
            if own.std is not None and measured:
                axes.vlines(hertz, low[place, there], high[place, there], color=color, linewidth=1.2)
            elif own.std is not None:
                axes.fill_between(hertz, low[place, there], high[place, there], color=color, alpha=0.2, linewidth=0.0)
        axes.set_yscale("log")
        axes.set_ylim(bottom=floor)
        axes.set_xlabel(r"frequency of the input $\Omega/2\pi$ [Hz]")
        one, other = own.outputs[row], own.inputs[column]
        axes.set_ylabel(rf"$|G_m|$, {other.name} to {one.name} [{own.unit(row, column)}]")
    return figure
