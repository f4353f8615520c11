"""Harmonic transfer functions: a curve of magnitudes for each harmonic, with its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from floquid._checks import index
from floquid.inputs import TransferFunctions
from floquid.plot._style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, drawing
from floquid.views import magnitude_bands

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


HARMONIC_COLORS = (BLACK, BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
HARMONIC_DASHES = ("-", "--", ":", "-.")
LINES = 150  # frequencies up to which a deviation is a bar


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
