"""What a model leaves: tones and lines where they would be expected, lines elsewhere, and colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel

MOST_TONES = 64
"""Harmonics of the period that are looked at, at most."""

BESIDE = 4
"""Harmonics on each side of a mode's band that are looked at."""

LAGS = 16
"""Autocorrelations that are looked at, at most."""

PIECE = 64
"""Lines of a spectrum over which its level is taken."""


def tones_of(highest: float, per_revolution: float) -> NDArray[np.float64]:
    """The harmonics of the period at which a forced response would be, from zero on and below `highest`.

    Those of the revolution, j/ν with ν periods in one; all of the period where that is the longer of the two.
    """
    parts = max(per_revolution, 1.0)
    most = int(min(MOST_TONES * parts, np.ceil(highest * parts - 1e-6) - 1))
    return np.arange(max(most, 0) + 1) / parts


def lines_of(model: PeriodicModel, highest: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The mode and the harmonic of each line beside the bands, those below `highest` fundamentals; a pair once."""
    kept = (model.coefficients != 0).any(axis=(1, 2))
    modes, harmonics = [], []
    for mode, row in enumerate(kept):
        alone = not (np.delete(model.exponents, mode) == model.exponents[mode].conj()).any()
        if not row.any() or (model.exponents[mode].imag < 0 and not alone):
            continue
        low, high = model.harmonics[row][[0, -1]]
        near = np.concatenate([np.arange(low - BESIDE, low), np.arange(high + 1, high + 1 + BESIDE)])
        at = model.exponents[mode].imag / model.fundamental + near
        near = near[(np.abs(at) < highest) & ((at > 0) | ~np.full(at.shape, alone))]
        modes.append(np.full(len(near), mode))
        harmonics.append(near)
    empty = [np.zeros(0, np.int64)]
    return np.concatenate(modes or empty).astype(np.int64), np.concatenate(harmonics or empty).astype(np.int64)


def peaks(left: NDArray[np.float64], noise: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The highest line of the spectrum of each channel over its level there, and where it is, in turns a sample.

    White noise alone has an exponential distribution of mean one at each line. The level is that of the noise given, or
    of the spectrum about the line where that is higher.
    """
    there = ~np.isnan(left)
    lines = np.fft.rfft(np.where(there, left, 0.0), axis=1)
    spectrum = lines.real**2 + lines.imag**2
    level = noise[:, None] ** 2 * np.maximum(there.sum(axis=1, keepdims=True), 1)
    pieces = spectrum.shape[1] // PIECE
    if pieces > 1:
        size = spectrum.shape[1] // pieces
        cut = spectrum[:, : pieces * size].reshape(len(left), pieces, size)
        local = np.median(cut, axis=2) / np.log(2.0)
        level = np.maximum(level, local[:, np.minimum(np.arange(spectrum.shape[1]) // size, pieces - 1)])
    over = spectrum / level
    over[:, 0] = 0.0  # the mean is one of the tones
    if left.shape[1] % 2 == 0:
        over[:, -1] *= 0.5  # half the sampling rate: one number, not two
    place = np.argmax(over, axis=1)
    return over[np.arange(len(left)), place], place / left.shape[1]


def colour(
    left: NDArray[np.float64], step: float, rates: NDArray[np.complex128], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    r"""The sum of squared autocorrelations of each channel (Ljung and Box 1978), the number of samples, and of lags.

    .. math:: Q = \sum_{k=1}^{K} \frac{n}{n_k} \Big(r_k + \frac{1}{n}\sum_j e^{s_j k \Delta t}\Big)^2

    A fit takes of white noise what looks like its columns e^{st}: at lag k it leaves the mean correlation
    -Σ_j e^{s_j kΔt}/n, which is taken off here.

    Parameters
    ----------
    left
        (channels, samples); NaN where no sample is.
    step
        The sampling interval [s].
    rates
        s of every column of the model, conjugates too (columns,) [1/s].
    most
        The highest lag.

    Returns
    -------
    squares, numbers, lags
        Q (channels,), of expectation K/n; n (channels,); K.
    """
    there = ~np.isnan(left)
    filled = np.where(there, left, 0.0)
    numbers = there.sum(axis=1)
    lags = int(max(min(LAGS, most, left.shape[1] // 4), 1))
    power = np.maximum(np.sum(filled**2, axis=1), np.finfo(float).tiny)
    total = np.zeros(len(left))
    for lag in range(1, lags + 1):
        pairs = np.sum(there[:, lag:] & there[:, :-lag], axis=1)
        expected = -np.exp(rates * lag * step).sum().real
        moment = np.sum(filled[:, lag:] * filled[:, :-lag], axis=1) / power
        total += numbers / np.maximum(pairs, 1) * (moment - expected / np.maximum(numbers, 1)) ** 2
    return total, numbers, lags


def rates_of(model: PeriodicModel) -> NDArray[np.complex128]:
    """Rates s of every column that a model has (columns,) [1/s], growing ones seen from their end."""
    kept = (model.coefficients != 0).any(axis=(1, 2))
    own = -np.abs(model.exponents.real) + 1j * model.exponents.imag
    return (own[:, None] + 1j * model.fundamental * model.harmonics)[kept]


def gains(taps: NDArray[np.float64], rates: NDArray[np.complex128], step: float) -> NDArray[np.complex128]:
    r"""What filters multiply e^{st} by (channels, ...): Σ_i a_i e^{-s i Δt}."""
    turned = np.exp(-np.multiply.outer(np.arange(taps.shape[1]) * step, rates))
    return np.asarray(np.tensordot(taps, turned, axes=1), np.complex128)


def filtered(values: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (channels, samples) after the filter of each channel; NaN where one that it needs is missing."""
    out = np.full(values.shape, np.nan)
    order = taps.shape[1] - 1
    size = values.shape[1] - order
    if size > 0:
        out[:, order:] = sum(taps[:, i, None] * values[:, order - i : order - i + size] for i in range(order + 1))
    return out
