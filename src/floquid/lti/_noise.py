"""The noise of a block of responses, before anything is known of its poles."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from floquid.lti._factor import factor
from floquid.lti._hankel import hankel_covariance

ENOUGH = 16
"""Outputs that tell the noise which all of them share, to two percent of a hundred samples."""

QUARTILE = 0.25
"""The eigenvalue looked at: right as long as the poles are well under three quarters of the window."""


def white_noise_std(responses: NDArray[np.float64]) -> float:
    r"""The standard deviation of the white noise on responses (outputs, samples) that share it.

    .. math:: \hat\sigma^2 = \operatorname{quartile}(\operatorname{eig} H H^T) / (c\, n)

    with H the block Hankel matrix of n columns. A sum of r exponentials lifts r of its eigenvalues, and the others are
    those of noise; c is the quartile's mean for white noise of unit variance and the same size, near 1 for many
    outputs. Of many outputs, some spread evenly over them are looked at. The residual of the maximum-likelihood fit
    corrects the estimate later.

    Parameters
    ----------
    responses
        The responses (outputs, samples).

    Returns
    -------
    float
        The standard deviation [units of the responses].
    """
    responses = responses[:: max(1, len(responses) // ENOUGH)]
    outputs, samples = responses.shape
    window = max(1, min(samples // 2, 128))
    if outputs == 1:
        window = max(1, min(window, samples // 4))
    value = _quartile(responses, window)
    return float(np.sqrt(max(value, 0.0) / _expected_quartile(outputs, samples, window)))


def _quartile(responses: NDArray[np.float64], window: int) -> float:
    """The lower quartile of the eigenvalues of the Hankel covariance, a column."""
    outputs, samples = responses.shape
    values = np.linalg.eigvalsh(hankel_covariance([factor(responses.T)], window))
    # Eigenvalues of a squared matrix: below this share of the largest they are rounding, not noise.
    rounding = 8.0 * np.finfo(float).eps * values[-1]
    return max(float(np.quantile(values, QUARTILE)), rounding) / (outputs * (samples - window + 1))


@lru_cache(maxsize=64)
def _expected_quartile(outputs: int, samples: int, window: int) -> float:
    """The mean of `_quartile` for white noise of unit variance: no closed form is known for Hankel matrices."""
    rng = np.random.default_rng(0)
    draws = 4 if outputs * samples > 100 * window else 16
    return float(np.mean([_quartile(rng.standard_normal((outputs, samples)), window) for _ in range(draws)]))


def product_noise(noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """The product of one number an output and one an input nearest to `noise` (outputs, inputs), in logarithms."""
    logs = np.log(noise)
    return np.exp(logs.mean(axis=1, keepdims=True) + logs.mean(axis=0) - logs.mean())
