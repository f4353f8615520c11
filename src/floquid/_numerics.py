"""What several fits do with their information matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def sandwich(
    information: NDArray[np.float64], scatter: NDArray[np.float64], *, smallest: float = 1e-14
) -> NDArray[np.float64]:
    """The covariance I⁻¹ H I⁻¹ of parameters with the information I, whose gradient has the covariance H.

    The information is brought to a unit diagonal first: a weak mode beside a strong one is not a null direction.
    Directions below the share `smallest` of the largest are.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    both = np.outer(scale, scale)
    inverse = np.linalg.pinv(information / both, rcond=smallest, hermitian=True)
    return inverse @ (scatter / both) @ inverse / both


def positive_part(whole: NDArray[np.float64], reduced: NDArray[np.float64]) -> NDArray[np.float64]:
    """`reduced` between a hundredth of `whole` and all of it in each direction, so that it stays definite."""
    if not len(whole):
        return whole
    size = np.diag(whole)
    scale = np.sqrt(np.where(size > np.finfo(float).tiny, size, 1.0))
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 1e-15 * max(values[-1], 1e-15)))
    inner = np.linalg.solve(root, np.linalg.solve(root, reduced / np.outer(scale, scale)).T)
    share, directions = np.linalg.eigh(0.5 * (inner + inner.T))
    kept = root @ (directions * np.clip(share, 1e-2, 1.0)) @ directions.T @ root.T
    return kept * np.outer(scale, scale)
