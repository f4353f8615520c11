"""Long curves with few points that look the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]


def envelope(x: NDArray[np.float64], y: NDArray[np.float64], points: int) -> Curve:
    """A curve with at most `points` points that looks the same: of each stretch, its smallest and largest value.

    The points kept are points of the curve, in their order, and no extreme is lost. A short curve is kept whole.
    A gap (NaN) stays one where a whole stretch is missing.

    Parameters
    ----------
    x, y
        The curve (samples,), `x` ascending.
    points
        The most points that are kept, 2 or more.

    Returns
    -------
    tuple of numpy.ndarray
        `x` and `y` of the points kept.
    """
    if len(x) <= points:
        return x, y
    stretches = max(points // 2, 1)
    size = -(-len(x) // stretches)
    padded = np.full(-(-len(x) // size) * size, y[-1])
    padded[: len(y)] = y
    blocks = padded.reshape(-1, size)
    missing = np.isnan(blocks)
    lowest, highest = np.where(missing, np.inf, blocks), np.where(missing, -np.inf, blocks)
    inside = np.stack([lowest.argmin(axis=1), highest.argmax(axis=1)])
    kept = np.sort((inside + np.arange(len(blocks)) * size).ravel())
    kept = np.unique(np.minimum(kept, len(x) - 1))
    return x[kept], y[kept]
