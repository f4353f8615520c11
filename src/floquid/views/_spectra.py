"""Spectra of the record and of its lifted responses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.lti import WHITE
from floquid.pipeline import Analysis
from floquid.views._modes import below, checked


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum(Rebuilt):
    """The magnitudes of a transform, with those that noise alone would have.

    Parameters
    ----------
    omega
        The lines (lines,) [rad/s].
    values
        The magnitudes (lines,) [unit of the channel · s].
    noise
        The mean magnitude of the noise alone (lines,) [unit of the channel · s].
    """

    omega: NDArray[np.float64]
    values: NDArray[np.float64]
    noise: NDArray[np.float64]

    def __post_init__(self) -> None:
        lines = len(self.omega)
        for name, axes in (("omega", ("lines",)), ("values", (lines,)), ("noise", (lines,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), name, "Spectrum", axes=axes))


def record_spectrum(analysis: Analysis, channel: int, hit: int = 0) -> Spectrum:
    r"""The transform of the whole periods of a channel, as they were cut from the record.

    .. math:: \Delta t \Big| \sum_n y[n]\, e^{-i\Omega n \Delta t} \Big|

    (Allen 2009, figure 3.)

    Parameters
    ----------
    analysis
        What `identify` found.
    channel, hit
        Which, from 0.

    Returns
    -------
    Spectrum
        Up to half of the sampling rate.

    Raises
    ------
    InputError
        There is no such channel or hit.
    """
    checked(analysis, "record_spectrum", channel=channel, hit=hit)
    cycles = analysis.cycles[hit]
    values = cycles.values[channel].T.ravel()
    return _spectrum(analysis, channel, hit, values, analysis.lifted.period / cycles.n_phases, 1)


def lifted_spectrum(analysis: Analysis, channel: int, phase: int, hit: int = 0) -> Spectrum:
    r"""The transform of one lifted response: the samples of a channel at one phase, one a period.

    .. math:: T \Big| \sum_m y_k[m]\, e^{-i\Omega m T} \Big|

    (Allen 2009, figure 4.)

    Parameters
    ----------
    analysis
        What `identify` found.
    channel, phase, hit
        Which, from 0.

    Returns
    -------
    Spectrum
        Up to half of the fundamental.

    Raises
    ------
    InputError
        There is no such channel, phase or hit.
    """
    of = "lifted_spectrum"
    checked(analysis, of, channel=channel, hit=hit)
    cycles = analysis.cycles[hit]
    below(phase, cycles.n_phases, "phase", of)
    values = cycles.values[channel, phase]
    return _spectrum(analysis, channel, hit, values, analysis.lifted.period, cycles.n_phases)


def _spectrum(
    analysis: Analysis, channel: int, hit: int, values: NDArray[np.float64], step: float, folds: int
) -> Spectrum:
    """Noise that was whitened has the colour that the filter took off, folded as often as the response is."""
    omega = np.asarray(2.0 * np.pi * np.arange(len(values) // 2 + 1) / (len(values) * step), dtype=np.float64)
    magnitudes = np.asarray(np.abs(np.fft.rfft(values)) * step, dtype=np.float64)
    white = WHITE * float(analysis.lifted.noise[channel, hit]) * step * np.sqrt(len(values))
    turns = 1j * (omega + 2.0 * np.pi * np.arange(folds)[:, None] / step)
    colour = np.sqrt(np.mean(np.abs(analysis.lifted.gain(turns)[channel]) ** -2.0, axis=0))
    return Spectrum(omega=omega, values=magnitudes, noise=white * colour)
