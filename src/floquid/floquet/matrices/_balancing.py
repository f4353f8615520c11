"""Units of the states in which the numbers of a matrix are of like size."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats

_STEPS, _MOVED = 50, 1e-9


def binary_units(matrix: Floats) -> Floats:
    """The diagonal of D, powers of two, for which the rows and columns of D⁻¹ M D are of like norm (n,)."""
    from scipy.linalg import matrix_balance

    if not matrix.any():
        return np.ones(len(matrix))
    with np.errstate(invalid="ignore"):  # it makes integers of the units too, where it looks for permutations
        return matrix_balance(matrix, permute=False, separate=True)[1][0]


def balanced_units(matrix: Floats) -> Floats:
    """The diagonal of D for which the rows and columns of D⁻¹ M D are of equal norm, beside the diagonal (n,)."""
    from scipy.sparse.csgraph import connected_components

    scale = binary_units(matrix)
    rest = matrix * (scale[None, :] / scale[:, None])
    np.fill_diagonal(rest, 0.0)
    _, part = connected_components(rest != 0.0, connection="strong")
    rest[part[:, None] != part[None, :]] = 0.0
    weights = rest**2 / max(float((rest**2).max()), 1e-300)
    # The sum of squares is convex in the logarithms u of D (Osborne 1960), and its minimum is what is looked for: by
    # Newton's method, each step cut to a factor e. Where one part of the states drives another and is not driven by
    # it, there is no minimum between the two, and their units are left to each other as they are.
    u = np.zeros(len(scale))
    for _ in range(_STEPS):
        w = weights * np.exp(2.0 * (u[None, :] - u[:, None]))
        slope = w.sum(axis=0) - w.sum(axis=1)
        bend = 2.0 * (np.diag(w.sum(axis=0) + w.sum(axis=1)) - w - w.T)
        step = -np.linalg.lstsq(bend, slope, rcond=1e-12)[0]
        largest = float(np.abs(step).max())
        u = u + step / max(1.0, largest)
        if largest < _MOVED:
            break
    return scale * np.exp(u - u.mean())


def balance(samples: Floats) -> tuple[Floats, float]:
    """Units of the states that balance A (n,), powers of two, and the largest row sum in them."""
    largest = np.abs(samples).max(axis=0)
    scale = binary_units(largest)
    return scale, float((largest * scale / scale[:, None]).sum(axis=1).max())
