"""ESPRIT on the Gram matrix: the poles from the shift invariance of the signal subspace of the Hankel covariance.

R. Roy and T. Kailath, "ESPRIT - Estimation of Signal Parameters via Rotational Invariance Techniques", IEEE Trans. ASSP
37(7), 1989. The Hankel covariance is the sum of the shifted diagonal blocks of Y Yᵀ, so no Hankel matrix is formed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.lti._exponentials import Factor

LARGEST_GRAM = 2000
"""Samples up to which the Gram matrix is formed whole; beyond, only the diagonals that the window reaches."""


def hankel_covariance(factors: Sequence[Factor], window: int) -> NDArray[np.float64]:
    """Σ_i F[i:i+L] F[i:i+L]ᵀ (L, L), summed over blocks that are at least L long."""
    total = np.zeros((window, window))
    for block in factors:
        samples = len(block.values)
        if samples < window:
            continue
        gram = block.values @ block.values.T if samples <= LARGEST_GRAM else None
        for lag in range(window):
            products = np.diagonal(gram, lag) if gram is not None else _lagged(block.values, lag)
            sums = np.concatenate([[0.0], np.cumsum(products)])
            shifts = samples - window + 1
            along = sums[shifts : shifts + window - lag] - sums[: window - lag]
            rows = np.arange(window - lag)
            total[rows, rows + lag] += along
            if lag:
                total[rows + lag, rows] += along
    return total


def _lagged(values: NDArray[np.float64], lag: int) -> NDArray[np.float64]:
    """F[n]·F[n + lag] for each n (samples - lag,): one diagonal of F Fᵀ."""
    return np.einsum("nr,nr->n", values[: len(values) - lag], values[lag:])


def signal_vectors(factors: Sequence[Factor], window: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues, descending (L,), and eigenvectors (L, L) of the Hankel covariance."""
    values, vectors = np.linalg.eigh(hankel_covariance(factors, window))
    return values[::-1], vectors[:, ::-1]


def shift_poles(vectors: NDArray[np.float64], order: int) -> NDArray[np.complex128]:
    """The multipliers (order,) of the subspace spanned by the first `order` vectors (total least squares)."""
    lead = vectors[:, :order]
    both = np.concatenate([lead[:-1], lead[1:]], axis=1)
    # All right vectors, also those of a short window's null space: the last `order` of them are the solution.
    _, _, right = np.linalg.svd(both, full_matrices=True)
    right = right.T
    v12, v22 = right[:order, order:], right[order:, order:]
    return np.linalg.eigvals(-v12 @ np.linalg.pinv(v22)).astype(complex)
