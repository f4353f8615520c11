"""Harmonic power spectra of outputs alone, and the lines that the modes of the model have in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Sealed, input_error
from floquid.innovations import harmonic_spectra
from floquid.pipeline import Analysis
from floquid.views._modes import frozen

SMALLEST = 1e-3  # the share of a mode's energy below which a line is not marked


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectraOfModes(Sealed):
    """Singular values of the harmonic power spectra of a record, and the lines of the modes of its model.

    Parameters
    ----------
    frequencies_hz
        From zero to half the rate (lines,) [Hz].
    values
        Singular values, descending (lines, signals) [`unit`].
    unit
        That of the channels squared over Hz; channels of different units are divided by their rms.
    modes
        Of each conjugate pair and each real mode, the frequencies at which it shows (lines of the mode,) [Hz], the
        strongest first.
    end
        Half a fundamental above the highest of them, or half the rate where that is less [Hz].
    """

    frequencies_hz: Floats
    values: Floats
    unit: str
    modes: tuple[Floats, ...]
    end: float


def spectra_of_modes(analysis: Analysis, harmonics: int = 1, periods: int | None = None) -> SpectraOfModes:
    """The harmonic power spectra of a record of outputs alone, and the lines |Im λ + mω| of its modes in them.

    `analysis` is what `identify` found of records whose excitation goes on. With `harmonics` M outputs are modulated by
    -M to M: lines show up to M fundamentals beside those of a mode. A segment is `periods` long, or a twelfth of the
    shortest record. Raises InputError where a number is not possible.
    """
    model, driven = analysis.model, analysis.driven
    if driven is None:
        got = "is of free responses"
        raise input_error("analysis", "spectra_of_modes", "be of records whose excitation goes on", got)
    samples = driven.samples
    found = harmonic_spectra(samples, harmonics, periods)
    units = {channel.unit for channel in model.channels}
    scale = np.ones(len(samples.values)) if len(units) == 1 else 1.0 / samples.values.std(axis=1)
    scale = np.tile(scale, len(found.harmonics))
    values = np.linalg.svd(found.values * scale[:, None] * scale, compute_uv=False)
    unit = units.pop() if len(units) == 1 else "-"
    squared = "1" if unit == "-" else f"{unit}²" if unit.isalpha() else f"({unit})²"
    modes = tuple(_lines_of(analysis, mode, found.harmonics) for mode in model.upper_modes)
    nyquist = float(found.frequencies_hz[-1])
    return SpectraOfModes(
        frequencies_hz=found.frequencies_hz,
        values=np.asarray(values, np.float64),
        unit=f"{squared}/Hz",
        modes=modes,
        end=min(nyquist, max((float(own.max()) for own in modes), default=nyquist) + 0.5 / model.period),
    )


def _lines_of(analysis: Analysis, mode: int, moved: Integers) -> Floats:
    """Frequencies of a mode's harmonics that are seen, the strongest first, and of those moved (lines,) [Hz]."""
    model = analysis.model
    energy = np.sum(np.abs(model.coefficients[mode, :, 0] / analysis.noise) ** 2, axis=0)
    seen = model.harmonics[energy > SMALLEST * energy.sum()]
    turns = [model.harmonics[np.argmax(energy)], *np.unique(np.add.outer(seen, moved))]
    return frozen(np.abs(model.exponents[mode].imag + model.fundamental * np.array(turns)) / (2.0 * np.pi))
