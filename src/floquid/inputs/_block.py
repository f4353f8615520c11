r"""Two real states as one: numbers a + b j with j² = q, whatever the sign of q.

.. math:: \dot z = (\sigma + j) z, \qquad f(\sigma + j) = \tfrac12 (f_+ + f_-) + \frac{f_+ - f_-}{2 \sqrt q}\, j,
          \qquad f_\pm = f(\sigma \pm \sqrt q)

Both parts are entire in q: a pair of conjugates, a defective multiplier and two real multipliers are one formula.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

LEAST = 1e-5
"""q over the squared decay below which parts are interpolated in q: differences lose 1e-13, interpolation 1e-10."""

Function: TypeAlias = Callable[[complex], NDArray]


def parts_of(function: Function, square: float, decay: float) -> NDArray:
    """Parts of a function of j (2, …) from its values at ±√q; it varies on a `decay` [1/s]."""
    return _through_zero(lambda own: _parts(function, own), square, decay)


def slopes_along_square(function: Function, slope: Function, square: float, decay: float) -> NDArray:
    r"""Derivatives of both parts by q (2, …), by the slope of the function along j.

    .. math:: \frac{\partial f_1}{\partial q} = \tfrac12 f'_2, \qquad
              \frac{\partial f_2}{\partial q} = \frac{f'_1 - f_2}{2 q}
    """

    def slopes(own: float) -> NDArray:
        even, odd = _parts(slope, own)
        return 0.5 * np.stack([odd, (even - _parts(function, own)[1]) / own])

    return _through_zero(slopes, square, decay)


def by_root(values: NDArray, square: float) -> NDArray:
    """The product with j of both parts (2, …)."""
    return np.stack([square * values[1], values[0]])


def _parts(function: Function, square: float) -> NDArray:
    root = complex(np.sqrt(complex(square)))
    up, down = function(root), function(-root)
    return 0.5 * np.stack([up + down, (up - down) / root])


def _through_zero(of: Callable[[float], NDArray], square: float, decay: float) -> NDArray:
    """A function of q, near zero from its values on either side."""
    least = LEAST * decay**2
    if abs(square) >= least:
        return of(square)
    share = 0.5 + 0.5 * square / least
    return share * of(least) + (1.0 - share) * of(-least)
