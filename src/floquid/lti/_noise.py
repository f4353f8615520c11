"""The noise of a block of responses before anything is known of its poles, and the sums of squares that it explains."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from floquid._arrays import Floats
from floquid.lti._era import hankel_covariance
from floquid.lti._factor import factor


def white_noise_std(responses: Floats) -> float:
    r"""The standard deviation of the white noise on `responses` (outputs, samples) that share it, in their units.

    .. math:: \hat\sigma^2 = \operatorname{quartile}(\operatorname{eig} H H^T) / (c\, n)

    with H the block Hankel matrix of n columns. A sum of r exponentials lifts r of its eigenvalues, and the others are
    those of noise; c is the quartile's mean for white noise of unit variance and the same size, near 1 for many
    outputs. The residual of the maximum-likelihood fit corrects the estimate later.
    """
    outputs, samples = responses.shape
    window = max(1, min(samples // 2, 128))
    if outputs == 1:
        window = max(1, min(window, samples // 4))
    value = _quartile(responses, window)
    return float(np.sqrt(max(value, 0.0) / _expected_quartile(outputs, samples, window)))


def _quartile(responses: Floats, window: int) -> float:
    """The lower quartile of the eigenvalues of the Hankel covariance, a column: poles are fewer than three quarters."""
    outputs, samples = responses.shape
    values = np.linalg.eigvalsh(hankel_covariance([factor(responses.T)], window))
    # Eigenvalues of a squared matrix: below this share of the largest they are rounding, not noise.
    rounding = 8.0 * np.finfo(float).eps * values[-1]
    return max(float(np.quantile(values, 0.25)), rounding) / (outputs * (samples - window + 1))


@lru_cache(maxsize=64)
def _expected_quartile(outputs: int, samples: int, window: int) -> float:
    """The mean of `_quartile` for white noise of unit variance: no closed form is known for Hankel matrices."""
    rng = np.random.default_rng(0)
    draws = 4 if outputs * samples > 100 * window else 16
    return float(np.mean([_quartile(rng.standard_normal((outputs, samples)), window) for _ in range(draws)]))


TRACY_WIDOM = 3.27
"""The largest eigenvalue of a real white Wishart matrix is below this with probability 0.999, centred and scaled."""


def noise_edge(rows: int, columns: int) -> float:
    """The largest singular value of unit noise of `rows` and `columns`, passed once in 1000 (Johnstone 2001)."""
    tall, wide = np.sqrt(rows), np.sqrt(columns)
    scale = (tall + wide) * (1.0 / tall + 1.0 / wide) ** (1.0 / 3.0)
    return float(np.sqrt((tall + wide) ** 2 + TRACY_WIDOM * scale))


@lru_cache(maxsize=256)
def rise_limit(probability: float, degrees: float, samples: float) -> float:
    """The rise of the cost that noise exceeds with `probability`: `degrees` times the limit of an F ratio.

    The noise is estimated from as many numbers as there are samples; with many of them this is a chi-square. The
    tail is that of the beta distribution, since 1 - `probability` would be rounded to 1.
    """
    from scipy.special import betaincinv

    left = max(samples - degrees, 1.0)
    share = float(betaincinv(0.5 * left, 0.5 * degrees, probability))
    return left * (1.0 - share) / share
