r"""The algebra of a real block of two states: numbers a + b j with j² = q, whatever the sign of q.

.. math:: \dot z = \begin{pmatrix} \sigma & q \\ 1 & \sigma \end{pmatrix} z = (\sigma + j)\, z, \qquad
          f(\sigma + j) = \tfrac12 \big(f(\sigma + \sqrt q) + f(\sigma - \sqrt q)\big)
          + \frac{f(\sigma + \sqrt q) - f(\sigma - \sqrt q)}{2 \sqrt q}\, j

Both parts are analytic in q, through q = 0: a pair of conjugates, a defective multiplier and two real multipliers are
one formula. Elements are stored as (…, 2, samples) or as two arrays.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

LEAST = 1e-8
"""q h² below which a function is interpolated in q: quotients of differences there lose 1e-12, interpolation 1e-16."""


def of_block(
    function: Callable[[complex], NDArray[np.complex128]], mean: float, square: float, step: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """The two parts of an analytic function of σ + j; `step` [s] is the scale on which the function varies."""

    def parts(own: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        root = np.sqrt(complex(own))
        up, down = function(mean + root), function(mean - root)
        return 0.5 * (up + down), 0.5 * (up - down) / root

    least = LEAST / step**2
    if abs(square) >= least:
        return parts(square)
    share = 0.5 + 0.5 * square / least
    low, high = parts(-least), parts(least)
    first, second = (share * above + (1.0 - share) * below for above, below in zip(high, low, strict=True))
    return first, second


def transition(mean: float, square: float, step: float) -> tuple[float, float]:
    """e^{(σ + j)h} as a + b j."""
    first, second = of_block(lambda rate: np.exp(np.asarray(rate * step)), mean, square, step)
    return float(first.real), float(second.real)


def by_root(values: NDArray, square: float) -> NDArray:
    """The product with j of elements (…, 2, samples)."""
    return np.stack([square * values[..., 1, :], values[..., 0, :]], axis=-2)


def product(one: tuple[float, float], values: tuple[NDArray, NDArray], square: float) -> tuple[NDArray, NDArray]:
    """The product of an element with others."""
    (a, b), (first, second) = one, values
    return a * first + square * b * second, a * second + b * first


def summed_block(decay: tuple[float, float], square: float, added: NDArray[np.float64]) -> NDArray[np.float64]:
    """The sums z[k] = (a + b j) z[k - 1] + added[k] from zero (…, 2, samples): one band of both states in turn."""
    from scipy.linalg import get_lapack_funcs

    count = added.shape[-1]
    if not added.size:  # without a right-hand side LAPACK writes beyond the array
        return np.zeros_like(added)
    (solve,) = get_lapack_funcs(("tbtrs",), (added,))
    band = np.zeros((4, 2 * count), order="F")
    band[0] = 1.0
    band[1, 1::2] = -square * decay[1]
    band[2] = -decay[0]
    band[3, ::2] = -decay[1]
    mixed = np.swapaxes(added, -1, -2).reshape(-1, 2 * count).T
    found = solve(band, mixed, uplo="L", diag="U")[0].T.reshape(*added.shape[:-2], count, 2)
    return np.ascontiguousarray(np.swapaxes(found, -1, -2))
