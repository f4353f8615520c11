"""The effect of harmonics left out on A(t) and Φ: a part of their deviations that no noise makes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.core import Estimates
from floquid.reconstruction._modal_matrix import Jacobian

UNSEEN = 2.0
"""Standard deviations that a harmonic which is left out may be larger than it was seen."""


def sizes_left_out(estimates: Estimates, kept: NDArray[np.bool_], rows: NDArray[np.bool_]) -> NDArray[np.float64]:
    r"""The size that the first harmonic left out on each side of a band may have (terms, channels, hits).

    .. math:: b = \min\Big(|B_L| \frac{\lVert B_L \rVert}{\lVert B_{L'} \rVert},\ |\hat B| + 2\sigma\Big)

    with L the outermost harmonic kept and L' the one before it, and norms over the noise: the series goes on falling as
    it does, but no higher than what was seen there allows. Where one harmonic alone is kept, what was seen there
    decides.

    Parameters
    ----------
    estimates
        The estimates.
    kept
        The terms that are kept (terms,).
    rows
        The channels of the states (channels,).
    """
    values = np.abs(estimates.coefficients)
    std = estimates.std()
    seen = values + UNSEEN * np.abs(std) / np.sqrt(2.0)
    # Over the noise: a noisy channel of little weight would make the series fall slowly.
    noise = np.sqrt(np.mean(np.abs(std) ** 2, axis=0))
    norm = np.sqrt(np.sum((values[:, rows] / noise[rows]) ** 2, axis=(1, 2)))
    sizes = np.zeros(values.shape)
    for mode in range(len(estimates.exponents)):
        own = np.flatnonzero(estimates.modes == mode)
        own = own[np.argsort(estimates.harmonics[own])]
        inside = np.flatnonzero(kept[own])
        if not len(inside):
            continue
        strongest = inside[np.argmax(norm[own[inside]])]
        for last, step in ((inside[0], -1), (inside[-1], 1)):
            following = last + step
            if not 0 <= following < len(own):
                continue
            limit = seen[own[following]]
            if last != strongest:
                falls = norm[own[last]] / norm[own[last - step]]
                limit = np.minimum(limit, values[own[last]] * min(falls, 1.0))
            sizes[own[following]] = limit
    return sizes


def spread_of(sizes: NDArray[np.float64], slopes: Jacobian) -> NDArray[np.float64]:
    """The variance that coefficients of these sizes and of any phase add to the elements (states, states)."""
    return 0.5 * np.einsum("ijkch,kch->ij", np.abs(slopes.by_coefficient) ** 2, sizes**2)
