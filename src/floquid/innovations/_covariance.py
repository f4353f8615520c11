"""The covariance of innovations along a period, which random excitation that turns makes vary, and their colour."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK
from floquid._checks import Rebuilt
from floquid.fit import CHUNK, FEW_STEPS, IN_VAIN, LAGS
from floquid.innovations._predictor import Predictor
from floquid.inputs import MOST_ROWS, Samples, sealed


def reweighed(samples: Samples, at: Predictor) -> Predictor:
    """The predictor with the covariance along a period that its innovations have."""
    return replace(at, whitening=whitening_of(samples, at.level))


@dataclass(frozen=True, eq=False)
class Whitening(Rebuilt):
    """W of samples (samples, channels, channels), formed where it is asked for by a slice or a mask."""

    angle: NDArray[np.complex128]  # e^{iωt} (samples,)
    there: NDArray[np.bool_]  # Mask of the samples that were measured (samples,)
    # φ of each channel (columns, channels before it), and log d (columns,), of the columns of `_columns`
    shares: tuple[NDArray[np.float64], ...]
    deviations: tuple[NDArray[np.float64], ...]

    def __post_init__(self) -> None:
        sealed(self)

    def __getitem__(self, own: slice | NDArray[np.bool_]) -> NDArray[np.float64]:
        if len(self.there) * len(self.shares) ** 2 < BLOCK:
            return self._all[own]
        return self._of(self.angle[own], self.there[own])

    @cached_property
    def _all(self) -> NDArray[np.float64]:
        return self._of(self.angle, self.there)

    def _of(self, angle: NDArray[np.complex128], there: NDArray[np.bool_]) -> NDArray[np.float64]:
        found = np.zeros((len(angle), len(self.shares), len(self.shares)))
        columns = _columns(angle, max(map(len, self.deviations)) // 2)
        for channel, (shares, deviations) in enumerate(zip(self.shares, self.deviations, strict=True)):
            inner = columns[: len(deviations)]
            size = np.exp(-deviations @ inner)
            found[:, channel, :channel] = -(inner.T @ shares) * size[:, None]
            found[:, channel, channel] = size
        found[~there] = np.eye(len(self.shares))
        return found


def _columns(angle: NDArray[np.complex128], harmonics: int) -> NDArray[np.float64]:
    """One, and real and imaginary part of each harmonic (columns, samples)."""
    found, turned = np.ones((1 + 2 * harmonics, len(angle))), angle
    for place in range(1, 2 * harmonics, 2):
        found[place], found[place + 1] = turned.real, turned.imag
        turned = turned * angle
    return found


def whitening_of(samples: Samples, innovations: NDArray[np.float64]) -> Whitening:
    r"""W of innovations (channels, samples): that of W e is constant along a period.

    .. math:: e_i = \sum_{j < i} \varphi_{ij}(t)\, e_j + d_i(t)\, \varepsilon_i, \qquad W = D^{-1} (1 - \Phi)

    φ and log d² have few harmonics, as many as the criterion of Schwarz (1978) has, and are those of maximum likelihood
    (Pourahmadi 1999). The geometric mean of each d is 1: the likelihood needs no more than the covariance of W e.
    W is 1 at samples that were not measured.
    """
    there, angle = samples.there, samples.turned(1.0)
    used = slice(None) if there.all() else there
    innovations, measured = innovations[:, used], angle[used]
    highest = int(np.pi / (samples.fundamental * samples.step))
    columns, fits = _columns(measured, 0), []
    for channel, own in enumerate(innovations):
        best, found_at, fit = np.inf, 0, (np.zeros((1, channel)), np.zeros(1))
        for harmonics in range(highest + 1):
            count = 1 + 2 * harmonics
            if harmonics > found_at + IN_VAIN or (harmonics and count * channel > MOST_ROWS * samples.count):
                break
            columns = columns if len(columns) >= count else _columns(measured, harmonics)
            shares, logs = _fitted(own, innovations[:channel], columns[:count])
            mean = float(np.mean(logs @ columns[:count]))
            criterion = samples.count * mean + (shares.size + count) * np.log(samples.count)
            if criterion < best:
                best, found_at = criterion, harmonics
                fit = shares, 0.5 * (logs - mean * (np.arange(count) == 0))
        fits.append(fit)
    shares, deviations = zip(*fits, strict=True)
    return Whitening(angle, there, shares, deviations)


def _fitted(
    own: NDArray[np.float64], others: NDArray[np.float64], columns: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares of other signals (columns, others) in a signal, and the logarithm of the variance beside (columns,)."""
    logs, count = np.zeros(len(columns)), len(columns) * len(others)
    shares, length = np.zeros((len(columns), len(others))), max(BLOCK // max(count, 1), CHUNK)
    parts = [slice(first, first + length) for first in range(0, len(own), length)]
    for _ in range(2):
        gram, seen = np.zeros((count, count)), np.zeros(count)
        for part in parts:
            rows = (columns[:, None, part] * others[:, part]).reshape(count, len(own[part]))
            weighted = rows * np.exp(-logs @ columns[:, part])
            gram += weighted @ rows.T
            seen += weighted @ own[part]
        shares = np.linalg.solve(gram, seen).reshape(shares.shape)
        left = own.copy()
        for part in parts:
            left[part] -= np.einsum("jn,jn->n", shares.T @ columns[:, part], others[:, part])
        logs = _log_variance(left**2, columns)
    return np.asarray(shares, np.float64), np.asarray(logs, np.float64)


def _log_variance(squares: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The logarithm of a variance that is a sum of columns, by squares (columns,)."""
    inverse, found = np.linalg.inv(columns @ columns.T), np.zeros(len(columns))
    found[0], logs = np.log(squares.mean()), np.log(squares + 1e-300)
    for _ in range(FEW_STEPS):
        found = found + inverse @ (columns @ np.expm1(logs - found @ columns))
    # At the maximum the mean of the squares over the variance is 1: the first column is one.
    found[0] += np.log(np.mean(squares * np.exp(-found @ columns)))
    return found


def colour(samples: Samples, found: Predictor) -> tuple[float, float]:
    """The share of the variance of innovations that is predictable, and the probability of so much in white ones."""
    # Colour that turns with the system is looked for as well as colour that does not (Ljung and Box 1978).
    from scipy.special import chdtrc

    white = found.white(found.innovations)
    turned = samples.turned(1)
    angles = [np.ones(samples.n_samples), 2.0**0.5 * turned.real, 2.0**0.5 * turned.imag]
    squares, count, there = 0.0, samples.count, samples.there
    for lag, angle in product(range(1, LAGS + 1), angles):
        pairs = samples.n_samples - int(np.sum(~(there[lag:] & there[:-lag])))
        both = (white[:, lag:] * angle[lag:]) @ white[:, :-lag].T / pairs
        squares += pairs * float(np.sum(both**2))
    degrees = LAGS * len(angles) * len(white) ** 2
    return (squares - degrees) / (count * len(white)), float(chdtrc(degrees, squares))


def white(samples: Samples, found: Predictor, alarm: float) -> bool:
    """True unless white innovations had so much colour with a probability of `alarm` at most: a mode is missing."""
    return colour(samples, found)[1] > alarm
