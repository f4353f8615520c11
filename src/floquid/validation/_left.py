"""What a model leaves: tones and lines where they would be expected, lines elsewhere, and colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel

MOST_TONES = 64
"""Harmonics of the period that are looked at, at most."""

BESIDE = 4
"""Harmonics on each side of a mode's band that are looked at."""

LAGS = 16
"""Autocorrelations that are looked at, at most."""

CHUNK = 4096
"""Samples whose exponentials are formed at a time."""

PIECE = 64
"""Lines of a spectrum over which its level is taken."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Exponentials e^{λt + i(m + q)θ}, growing ones counted from the end of the record."""

    exponents: NDArray[np.complex128]
    """(columns,) [1/s]."""
    turns: NDArray[np.float64]
    """M + q (columns,)."""

    def at(self, times: NDArray[np.float64], angles: NDArray[np.float64], last: float) -> NDArray[np.complex128]:
        """Their values (samples, columns), each of modulus one where it is largest."""
        values, where = np.unique(self.exponents, return_inverse=True)
        origin = np.where(values.real > 0, last, 0.0)
        decays = np.exp(values * (times[:, None] - origin))
        own, which = np.unique(self.turns, return_inverse=True)
        return decays[:, where] * np.exp(1j * np.multiply.outer(angles, own))[:, which]


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


def projected(
    left: NDArray[np.float64], times: NDArray[np.float64], angles: NDArray[np.float64], columns: Columns
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""The amplitude of each column in each channel, alone, and the sum of squares that it takes off.

    .. math:: \min_B \sum_k \big(e(t_k) - 2 \Re B z(t_k)\big)^2

    Parameters
    ----------
    left
        e (channels, samples); NaN where no sample is.
    times, angles
        Of the samples (samples,) [s], [rad].
    columns
        Which exponentials.

    Returns
    -------
    amplitudes, squares
        2|B| and the sums (channels, columns).
    """
    there = ~np.isnan(left)
    filled = np.where(there, left, 0.0)
    # Where all channels miss the same samples, one row of weights does for all.
    weights = (there[:1] if (there == there[:1]).all() else there).astype(float)
    n = len(columns.turns)
    seen, gram = np.zeros((2, len(left), n)), np.zeros((3, len(weights), n))
    for first in range(0, len(times), CHUNK):
        part = slice(first, first + CHUNK)
        if not weights[:, part].any():
            continue
        z = columns.at(times[part], angles[part], float(times[-1]))
        seen += np.stack([filled[:, part] @ z.real, filled[:, part] @ z.imag])
        gram += np.stack([weights[:, part] @ own for own in (z.real**2, z.imag**2, z.real * z.imag)])
    cosines, sines, both = gram
    total = np.maximum(cosines + sines, np.finfo(float).tiny)
    determinant = cosines * sines - both**2
    round_ = determinant > 1e-6 * total**2  # else a column that does not turn: one number, not two
    safe = np.where(round_, determinant, 1.0)
    alpha = np.where(round_, (sines * seen[0] - both * seen[1]) / safe, seen[0] / total)
    beta = np.where(round_, (cosines * seen[1] - both * seen[0]) / safe, seen[1] / total)
    return np.hypot(alpha, beta), alpha * seen[0] + beta * seen[1]


def without(
    left: NDArray[np.float64], times: NDArray[np.float64], angles: NDArray[np.float64], columns: Columns
) -> NDArray[np.float64]:
    """What is left of one channel (samples,) without these columns, fitted together."""
    there = ~np.isnan(left)
    z = columns.at(times[there], angles[there], float(times[-1]))
    both = np.concatenate([z.real, z.imag], axis=1)
    rest = left.copy()
    rest[there] -= both @ np.linalg.lstsq(both, left[there], rcond=1e-9)[0]
    return rest


def peaks(left: NDArray[np.float64], noise: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The highest line of the spectrum of each channel over its level there, and where it is, in turns a sample.

    White noise alone has an exponential distribution of mean one at each line. The level is that of the noise given, or
    of the spectrum about the line where that is higher.
    """
    there = ~np.isnan(left)
    spectrum = np.abs(np.fft.rfft(np.where(there, left, 0.0), axis=1)) ** 2
    level = noise[:, None] ** 2 * np.maximum(there.sum(axis=1, keepdims=True), 1)
    pieces = max(spectrum.shape[1] // PIECE, 1)
    local = np.array([np.median(piece, axis=1) for piece in np.array_split(spectrum, pieces, axis=1)]) / np.log(2.0)
    where = np.repeat(np.arange(pieces), [len(p) for p in np.array_split(np.arange(spectrum.shape[1]), pieces)])
    over = spectrum / np.maximum(level, local.T[:, where] if pieces > 1 else 0.0)
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
