"""The covariance of innovations along a period, which random excitation that turns makes vary, and their colour."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid.fit import FEW_STEPS, IN_VAIN, LAGS
from floquid.innovations._predictor import Predictor
from floquid.inputs import MOST_ROWS, Samples


def reweighed(samples: Samples, at: Predictor) -> Predictor:
    """The predictor with the covariance along a period that its innovations have."""
    return replace(at, whitening=whitening_of(samples, at.level))


def whitening_of(samples: Samples, innovations: NDArray[np.float64]) -> NDArray[np.float64]:
    r"""W (samples, channels, channels) of innovations (channels, samples): that of W e is constant along a period.

    .. math:: e_i = \sum_{j < i} \varphi_{ij}(t)\, e_j + d_i(t)\, \varepsilon_i, \qquad W = D^{-1} (1 - \Phi)

    φ and log d² have few harmonics, as many as the criterion of Schwarz (1978) has, and are those of maximum likelihood
    (Pourahmadi 1999). The geometric mean of each d is 1: the likelihood needs no more than the covariance of W e.
    W is 1 at samples that were not measured.
    """
    count, there = len(innovations), samples.there
    innovations = innovations[:, there]
    found = np.zeros((samples.count, count, count))
    highest = int(np.pi / (samples.fundamental * samples.step))
    basis = [np.ones((1, samples.count))]
    for channel, own in enumerate(innovations):
        best, found_at = np.inf, 0
        for harmonics in range(highest + 1):
            if harmonics == len(basis):
                angle = samples.turned(harmonics)[there]
                basis.append(np.array([angle.real, angle.imag]))
            columns = np.concatenate(basis[: harmonics + 1])
            if harmonics > found_at + IN_VAIN or (harmonics and len(columns) * channel > MOST_ROWS * samples.count):
                break
            shares, log_variance = _fitted(own, innovations[:channel], columns)
            parameters = shares.size + len(columns)
            criterion = log_variance.sum() + parameters * np.log(samples.count)
            if criterion < best:
                best, found_at = criterion, harmonics
                deviation = np.exp(0.5 * (log_variance - log_variance.mean()))
                found[:, channel, :channel] = -(columns.T @ shares) / deviation[:, None]
                found[:, channel, channel] = 1.0 / deviation
    whole = np.broadcast_to(np.eye(count), (samples.n_samples, count, count)).copy()
    whole[there] = found
    return whole


def _fitted(
    own: NDArray[np.float64], others: NDArray[np.float64], columns: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shares of other signals (columns, others) in a signal, and the logarithm of the variance beside (samples,)."""
    rows = (columns[:, None] * others).reshape(-1, len(own))
    log_variance = np.zeros_like(own)
    shares = np.zeros(len(rows))
    for _ in range(2):
        weights = np.exp(-log_variance)
        shares = np.linalg.solve((rows * weights) @ rows.T, (rows * weights) @ own)
        log_variance = _log_variance((own - shares @ rows) ** 2, columns)
    return np.asarray(shares.reshape(len(columns), -1), np.float64), log_variance


def _log_variance(squares: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The logarithm of a variance that is a sum of columns, by squares (samples,)."""
    inverse = np.linalg.inv(columns @ columns.T)
    found = np.full_like(squares, np.log(squares.mean()))
    for _ in range(FEW_STEPS):
        found = found + (inverse @ (columns @ np.expm1(np.log(squares + 1e-300) - found))) @ columns
    # At the maximum the mean of the squares over the variance is 1.
    return np.asarray(found + np.log(np.mean(squares * np.exp(-found))), np.float64)


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
