r"""The strongest decaying exponential in what a fit leaves: looked for on the lines of windowed spectra.

.. math:: G(\sigma, f) = \sum_{c,h} \frac{2\,|\sum_k r_{c,h}(t_k)\, e^{-(\sigma + 2\pi i f) t_k}|^2}
          {s_{c,h}(f)^2 \sum_k e^{-2 \sigma t_k}}

is what one exponential takes out of the misfit; in white noise it is a chi-square of two degrees of freedom a channel
and hit. The noise s is the median level of each of a few bands, so that noise which is coloured makes no peaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from floquid._arrays import BLOCK, Floats
from floquid.fit import chi2_limit
from floquid.periodic.least_squares import Block, Residual, squared

DECAYS = 8  # decay rates looked at, from one over the record to `FASTEST` over a period
FASTEST = 0.7  # nepers over a period: beyond, the line of a mode is as wide as all the lines between its harmonics
GROWTH = (2.0, 6.0)  # growth over the record of the growing exponentials looked at, as logarithms
DIED = 8.0  # decays after which an exponential has died

ROWS = 4 * BLOCK  # numbers that are transformed at once

SKIRT = 10.0  # times what a decaying line has beside its peak below which another peak may be that


@dataclass(frozen=True, slots=True)
class Peak:
    """An exponential e^{λt}, λ on the upper half, with what it takes out of the misfit and what noise would."""

    exponent: complex
    gain: float
    limit: float


def strongest(blocks: Sequence[Block], residuals: Sequence[Residual], period: float) -> Peak:
    """The exponential that takes most out of the residuals; of noise alone one is expected beyond its limit."""
    return peaks(blocks, residuals, period, most=0)[0]


def peaks(
    blocks: Sequence[Block], residuals: Sequence[Residual], period: float, *, most: int
) -> tuple[Peak, list[Peak]]:
    """The exponential that explains most of the residual, and those that may be tried, at most `most`."""
    # These are apart from one another, strongest first; the first is there in any case, the others pass the limit.
    # Other parameters as of `strongest`.
    span = max(residual.span for residual in residuals)
    looked_at = np.geomspace(1.0 / span, max(FASTEST / period, 2.0 / span), DECAYS)
    rates = np.concatenate([looked_at, -np.array(GROWTH) / span])
    spectra = [_Spectra(residual) for residual in residuals]
    gains, omegas = zip(*(_gains(spectra, rate) for rate in rates), strict=True)
    gain, omega = np.concatenate(gains), np.concatenate(omegas)
    rate = np.repeat(rates, [len(lines) for lines in omegas])
    degrees = 2 * sum(len(block.rows) for block in blocks)
    limit = chi2_limit(degrees, 1.0 / len(omega))

    def at(k: int) -> Peak:
        return Peak(complex(-rate[k], omega[k]), float(gain[k]), limit)

    largest = at(int(np.argmax(gain)))
    chosen: list[Peak] = []
    while len(chosen) < most:
        k = int(np.argmax(gain))
        if chosen and gain[k] < limit:
            break
        chosen.append(at(k))
        if gain[k] < limit:
            break
        # The skirts of a peak are no peaks of their own.
        width = np.maximum(np.maximum(np.abs(rate), abs(rate[k])), 2.0 * np.pi / span)
        apart = np.abs(omega - omega[k]) / width
        gain[gain < SKIRT * gain[k] / (1.0 + apart**2)] = 0.0
    return largest, chosen


def _gains(spectra: Sequence[_Spectra], rate: float) -> tuple[Floats, Floats]:
    """Reduction of the misfit by an exponential of each frequency and one decay, and the frequencies (lines,)."""
    from scipy.fft import next_fast_len

    step = min(spectrum.residual.step for spectrum in spectra)
    grid = max(spectrum.residual.values.shape[1] * spectrum.residual.step for spectrum in spectra)
    # What comes after a fast decay has died is not looked at, and its lines are as wide as it is fast.
    length = min(grid, DIED / rate) if rate > 0.0 else grid
    lines = cast("int", next_fast_len(int(np.ceil(2.0 * (length / step + 1.0))), real=True))
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(lines, step), np.float64)
    gain = np.sum([spectrum.gain(rate, omega, lines) for spectrum in spectra], axis=0)
    gain[0] *= 0.5
    return gain, omega


class _Spectra:
    """The residual of one block over its noise, ready for transforms under many windows."""

    def __init__(self, residual: Residual) -> None:
        self.residual, self.times = residual, np.arange(residual.values.shape[1]) * residual.step
        self.there = np.zeros(len(self.times))
        self.there[residual.taken] = 1.0
        # Rounding of the power in single precision stays below the noise, or it would make lines.
        largest = max(
            float(np.abs(own).max() / noise) for own, noise in zip(residual.values, residual.noise, strict=True)
        )
        self.precision = np.float32 if largest**2 * np.finfo(np.float32).eps < 1.0 else np.float64
        self.values = np.empty(residual.values.shape, self.precision)
        for row, noise in enumerate(residual.noise):
            self.values[row] = residual.values[row] / noise

    def gain(self, decay: float, omega: Floats, lines: int) -> Floats:
        """Reduction of the misfit by an exponential of each frequency (lines,)."""
        from scipy.fft import rfft

        residual, times = self.residual, self.times[:lines]
        window = np.exp(-decay * (times - (0.0 if decay >= 0 else times[-1])))
        bands = residual.levels.shape[1]
        centres = (np.arange(bands) + 0.5) / bands * (np.pi / residual.step)
        gain, step = np.zeros(len(omega)), max(1, ROWS // lines)
        for first in range(0, len(self.values), step):
            rows = slice(first, first + step)
            shares = residual.levels[rows] / residual.noise[rows, None]
            weights = 2.0 / np.square([np.interp(omega, centres, share) for share in shares])
            # scipy's transform of several rows in single precision takes a fifth of the time of numpy's in double.
            lines_of_rows = rfft(self.values[rows, :lines] * window.astype(self.precision), lines, axis=1)
            gain += np.einsum("rl,rl->l", squared(np.asarray(lines_of_rows)), weights.astype(self.precision))
        return gain / float((window * window) @ self.there[:lines])
