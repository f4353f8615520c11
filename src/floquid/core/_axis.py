r"""Exponents of a real block of two states, read from its mean and its squared half-difference with deviations.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

σ and q are regular where a pair of conjugates becomes two real multipliers, at q = 0; their exponents are not.
"""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats

MAPPED = (1.959963984540054, 3.0)
"""Deviations of q that are mapped to the exponents, to either side: by the first alone one in 250 was four off."""

ROUNDED = 1e-9
"""Added to a mapped interval: that of zero ends there exactly, and rounding would decide."""


def readings(
    mean: float, square: float, covariance: Floats, half_turns: int, fundamental: float
) -> tuple[Complexes, Complexes]:
    """Both exponents (2,) [1/s] of a block, and their deviations, from those of σ and q (2, 2).

    The deviations stay finite through q = 0: intervals of q are mapped. Where they hold zero, both parts of the
    exponents have a deviation, and nothing is claimed of the kind. `half_turns` is κ.
    """
    root = np.sqrt(complex(square))
    exponents = np.array([mean + root, mean - root]) + 0.5j * half_turns * fundamental
    slopes, more = slopes_of_readings(square, float(covariance[1, 1]))
    variance = np.einsum("epk,kl,epl->ep", slopes, covariance, slopes) + more
    std = np.sqrt(np.maximum(variance, 0.0))
    return exponents, std[:, 0] + 1j * std[:, 1]


def slopes_of_readings(square: float, variance: float) -> tuple[Floats, Floats]:
    """Slopes of both exponents by σ and q (exponents, parts, 2), and the variance that they leave out (parts,).

    Parts are the real and the imaginary one; `variance` is that of q.
    """
    std = max(float(np.sqrt(variance)), 1e-300)
    apart, turning = (_spread_of_root(way * square, std) for way in (1.0, -1.0))
    slopes = np.zeros((2, 2, 2))
    slopes[:, 0, 0] = 1.0
    # Near q = 0 an error of either sign drives the exponents apart: it goes along with σ only where q is far from it.
    along = min(max(square / (MAPPED[0] * std), 0.0), 1.0)
    slopes[:, 0, 1] = along * apart / std * np.array([1.0, -1.0])
    real = (1.0 - along**2) * apart**2
    if square < 0.0:
        slopes[:, 1, 1] = turning / std * np.array([-1.0, 1.0])
        return slopes, np.array([real, 0.0])
    return slopes, np.array([real, turning**2])


def _spread_of_root(square: float, std: float) -> float:
    """The deviation of √max(q, 0): the wider half of each mapped interval of q, over its deviations."""

    def root(value: float) -> float:
        return float(np.sqrt(max(value, 0.0)))

    halves = [abs(root(square + way * many * std) - root(square)) / many for many in MAPPED for way in (1.0, -1.0)]
    return (1.0 + ROUNDED) * max(halves)
