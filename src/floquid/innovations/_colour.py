"""Colour of innovations: how much of them is predictable from those before."""

from __future__ import annotations

from itertools import product

import numpy as np

from floquid.innovations._predictor import Predictor
from floquid.inputs import Samples

LAGS = 20
"""Lags of the correlation of the innovations."""


def colour(samples: Samples, found: Predictor) -> tuple[float, float]:
    """The share of the variance of innovations that is predictable, and the probability of so much in white ones.

    Colour that turns with the system is looked for as well as colour that does not (Ljung and Box 1978).
    """
    from scipy.special import chdtrc

    white = found.white(found.innovations)
    turned = samples.turned(1)
    angles = [np.ones(samples.n_samples), 2.0**0.5 * turned.real, 2.0**0.5 * turned.imag]
    squares, count = 0.0, samples.n_samples
    for lag, angle in product(range(1, LAGS + 1), angles):
        both = (white[:, lag:] * angle[lag:]) @ white[:, :-lag].T / count
        squares += count * float(np.sum(both**2))
    degrees = LAGS * len(angles) * len(white) ** 2
    return (squares - degrees) / (count * len(white)), float(chdtrc(degrees, squares))
