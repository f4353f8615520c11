"""Figures for papers: each function takes floquid's own types and returns a matplotlib `Figure` that it alone owns.

matplotlib is loaded when the first figure is drawn, without pyplot and without touching its global settings.
"""

from typing import TYPE_CHECKING

from floquid.plot._comparison import comparison, monitor, periodic_amount
from floquid.plot._exponents import exponents
from floquid.plot._record import speed, synchronisation, synthesis, time_record
from floquid.plot._shapes import periodic_shapes
from floquid.plot._spectra import harmonic_spectra, spectra
from floquid.plot._stabilisation import composite, indicators, stabilisation
from floquid.plot._style import FIGURES, figure_of_fit, save_figure, save_figures, style
from floquid.plot._survey import campbell, damping, multipliers, stability_map
from floquid.plot._system_elements import system_elements
from floquid.plot._transfer import nyquist, transfer

if TYPE_CHECKING:
    # For annotations elsewhere: no other room imports matplotlib.
    from matplotlib.figure import Figure as Figure

__all__ = [
    "FIGURES", "campbell", "comparison", "composite", "damping", "exponents", "harmonic_spectra", "indicators",
    "monitor", "multipliers", "nyquist", "periodic_amount", "periodic_shapes", "save_figure", "save_figures", "spectra",
    "speed", "stabilisation", "stability_map", "synchronisation", "synthesis", "system_elements", "time_record",
    "transfer",
]  # fmt: skip
