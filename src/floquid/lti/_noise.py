"""The noise of a block of responses, before anything is known of its poles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.lti._esprit import hankel_covariance
from floquid.lti._exponentials import factor


def white_noise_std(responses: NDArray[np.float64]) -> float:
    """The standard deviation of the white noise on responses (outputs, samples) that share it.

    The Hankel covariance of white noise has eigenvalues near σ² times the number of its columns; a sum of n
    exponentials lifts n of them. The lower quartile is taken: it is right as long as n is well under three quarters of
    the window, and the maximum-likelihood residual corrects it later.
    """
    samples = responses.shape[1]
    window = max(1, min(samples // 2, 128))
    values = np.linalg.eigvalsh(hankel_covariance([factor(responses.T)], window))
    columns = responses.shape[0] * (samples - window + 1)
    return float(np.sqrt(max(float(np.quantile(values, 0.25)), 0.0) / columns))
