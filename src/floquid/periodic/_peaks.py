r"""The strongest decaying exponential in what a fit leaves: looked for on the lines of windowed spectra.

.. math:: G(\sigma, f) = \sum_{c,h} \frac{2\,|\sum_k r_{c,h}(t_k)\, e^{-(\sigma + 2\pi i f) t_k}|^2}
          {s_{c,h}(f)^2 \sum_k e^{-2 \sigma t_k}}

is what one exponential takes out of the misfit; in white noise it is a chi-square of two degrees of freedom a channel
and hit. The noise s is the median level of each of a few bands, so that noise which is coloured makes no peaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.periodic._blocks import Block

BANDS = 8
"""Bands whose median is the level of the noise."""

DECAYS = 8
"""Decay rates looked at, from one over the record to `FASTEST` over a period."""

FEW_DECAYS = 4
"""The same where nothing is to be fitted, and a look is enough."""

FASTEST = 0.7

GROWTH = (2.0, 6.0)
"""Growth over the record of the growing exponentials looked at, as logarithms."""

APART = 2.0
"""Lines on each side of an exponential, beside its width, that a fit takes noise from."""

DIED = 8.0
"""Decays after which an exponential has died."""

SKIRT = 10.0
"""Times what a decaying line has beside its peak below which another peak may be that."""

QUIETEST = 0.01
"""The level of a band over that of the loudest, at least: below, there are but the skirts of what is elsewhere."""


@dataclass(frozen=True, slots=True)
class Peak:
    """An exponential e^{λt}, λ on the upper half, with what it takes out of the misfit and what noise would."""

    exponent: complex
    gain: float
    limit: float


@dataclass(frozen=True, slots=True)
class Rest:
    """What a fit leaves of one block, on the grid it was sampled on: missing samples are zero."""

    values: NDArray[np.float64]
    """(rows, grid)."""
    taken: NDArray[np.int64]
    """Where on the grid there are samples (samples,)."""
    step: float
    """The sampling interval [s]."""
    noise: NDArray[np.float64]
    """The median level over the bands (rows,)."""
    levels: NDArray[np.float64]
    """The level of each band (rows, bands)."""

    @staticmethod
    def of(times: NDArray[np.float64], left: NDArray[np.float64], least: NDArray[np.float64]) -> Rest:
        """From what is left at times [s]; the noise is at least `least` (rows,)."""
        step = float(np.median(np.diff(times)))
        taken = np.rint((times - times[0]) / step).astype(np.int64)
        values = np.zeros((len(left), int(taken[-1]) + 1))
        values[:, taken] = left
        power = _power(values, taken)
        parts = np.array_split(power, min(BANDS, power.shape[1]), axis=1)
        # The power of a line of white noise is exponentially distributed: its median is ln 2 of its mean.
        levels = np.sqrt([np.median(part, axis=1) / np.log(2.0) for part in parts]).T
        levels = np.maximum(levels, np.maximum(least[:, None], QUIETEST * levels.max(axis=1, keepdims=True)))
        return Rest(values, taken, step, np.median(levels, axis=1), levels)

    def level(self) -> Rest:
        """The same with one level for all bands."""
        return replace(self, levels=np.broadcast_to(self.noise[:, None], self.levels.shape))

    def between(self, rates: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The level of each band by the lines that are apart from exponentials of `rates`, and how many these are.

        A fit takes noise away where it has exponentials: nearly all of it in a band that is full of them.

        Parameters
        ----------
        rates
            The rates of the exponentials fitted (rates,) [1/s].

        Returns
        -------
        ndarray, ndarray
            Levels (rows, bands), zero where no line is left, and lines (bands,).
        """
        power, grid = _power(self.values, self.taken), self.values.shape[1] * self.step
        omega = 2.0 * np.pi / grid * np.arange(1, power.shape[1] + 1)
        apart = np.ones(len(omega), bool)
        for rate in rates:
            apart &= np.abs(omega - abs(rate.imag)) > abs(rate.real) + APART * 2.0 * np.pi / grid
        bands = np.array_split(np.arange(len(omega)), min(BANDS, len(omega)))
        kept = [band[apart[band]] for band in bands]
        levels = [np.sqrt(np.median(power[:, own], axis=1) / np.log(2.0)) if len(own) else 0.0 for own in kept]
        full = np.stack([np.broadcast_to(level, len(power)) for level in levels], axis=1)
        return np.maximum(full, self.levels.min(axis=1, keepdims=True)), np.array([len(own) for own in kept])

    @property
    def span(self) -> float:
        """The time between the first and the last sample [s]."""
        return float(self.taken[-1] - self.taken[0]) * self.step


def _power(values: NDArray[np.float64], taken: NDArray[np.int64]) -> NDArray[np.float64]:
    """The power of each line but the zeroth under a Hann window (rows, lines)."""
    window = np.hanning(values.shape[1] + 2)[1:-1]
    return _squared(np.fft.rfft(values * window, axis=1)[:, 1:]) / np.sum(window[taken] ** 2)


def _squared(lines: NDArray[np.complexfloating]) -> NDArray[np.floating]:
    """Their squared sizes, without the roots that `abs` takes."""
    return lines.real**2 + lines.imag**2


def strongest(
    blocks: Sequence[Block],
    rests: Sequence[Rest],
    period: float,
    false_alarm: float,
) -> Peak:
    """The exponential that takes most out of what is left.

    Parameters
    ----------
    blocks
        The blocks.
    rests
        What is left of each.
    period
        The period [s].
    false_alarm
        The probability at which noise alone passes the limit, over all lines.

    Returns
    -------
    Peak
        The strongest.
    """
    return peaks(blocks, rests, period, false_alarm, most=0, decays=FEW_DECAYS)[0]


def peaks(
    blocks: Sequence[Block],
    rests: Sequence[Rest],
    period: float,
    false_alarm: float,
    passed: Sequence[float] = (),
    *,
    most: int,
    decays: int = DECAYS,
) -> tuple[Peak, list[Peak]]:
    """The exponential that takes most out of what is left, and those that may be tried, at most so many.

    These are apart from one another and from the angular frequencies `passed` [rad/s], strongest first; the first is
    there in any case, the others pass the limit. Other parameters as of `strongest`.
    """
    from scipy.special import chdtri

    span = max(rest.span for rest in rests)
    looked_at = np.geomspace(1.0 / span, max(FASTEST / period, 2.0 / span), decays)
    rates = np.concatenate([looked_at, -np.array(GROWTH) / span])
    spectra = [_Spectra(rest) for rest in rests]
    gains, omegas = zip(*(_gains(spectra, rate) for rate in rates), strict=True)
    gain, omega = np.concatenate(gains), np.concatenate(omegas)
    rate = np.repeat(rates, [len(own) for own in omegas])
    degrees = 2 * sum(len(block.rows) for block in blocks)
    limit = float(chdtri(degrees, false_alarm / len(omega)))

    def at(k: int) -> Peak:
        return Peak(complex(-rate[k], omega[k]), float(gain[k]), limit)

    largest = at(int(np.argmax(gain)))
    for frequency in passed:
        gain[np.abs(omega - frequency) <= 8.0 * np.pi / span] = 0.0
    found: list[Peak] = []
    while len(found) < most:
        k = int(np.argmax(gain))
        if found and gain[k] < limit:
            break
        found.append(at(k))
        if gain[k] < limit:
            break
        # The skirts of a peak are no peaks of their own.
        width = np.maximum(np.maximum(np.abs(rate), abs(rate[k])), 2.0 * np.pi / span)
        apart = np.abs(omega - omega[k]) / width
        gain[(gain < SKIRT * gain[k] / (1.0 + apart**2)) | (apart < 8.0)] = 0.0
    return largest, found


def _gains(spectra: Sequence[_Spectra], rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What an exponential of each frequency and one decay takes out of the misfit, and the frequencies (lines,)."""
    from scipy.fft import next_fast_len

    step = min(own.rest.step for own in spectra)
    grid = max(own.rest.values.shape[1] * own.rest.step for own in spectra)
    # What comes after a fast decay has died is not looked at, and its lines are as wide as it is fast.
    length = min(grid, DIED / rate) if rate > 0.0 else grid
    lines = next_fast_len(int(np.ceil(2.0 * (length / step + 1.0))), real=True)
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(lines, step), np.float64)
    gain = np.sum([own.gain(rate, omega, lines) for own in spectra], axis=0)
    gain[0] *= 0.5
    return gain, omega


class _Spectra:
    """What a fit leaves of one block, ready for transforms under many windows."""

    def __init__(self, rest: Rest) -> None:
        self.rest, self.times = rest, np.arange(rest.values.shape[1]) * rest.step
        self.there = np.zeros(len(self.times))
        self.there[rest.taken] = 1.0
        self.weights: dict[int, NDArray[np.float64]] = {}

    def gain(self, decay: float, omega: NDArray[np.float64], lines: int) -> NDArray[np.float64]:
        """What an exponential of each frequency takes out of the misfit (lines,)."""
        rest, times = self.rest, self.times[:lines]
        window = np.exp(-decay * (times - (0.0 if decay >= 0 else times[-1])))
        if lines not in self.weights:
            bands = rest.levels.shape[1]
            centres = (np.arange(bands) + 0.5) / bands * (np.pi / rest.step)
            levels = np.array([np.interp(omega, centres, own) for own in rest.levels])
            self.weights[lines] = 2.0 / (levels * levels)
        power = _squared(np.fft.rfft(rest.values[:, :lines] * window, lines, axis=1))
        return np.einsum("rl,rl->l", power, self.weights[lines]) / float((window * window) @ self.there[:lines])
