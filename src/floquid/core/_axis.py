"""Exponents of a pair near an axis, read from their mean and squared half-difference."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats

NARROW, WIDE = 1.96, 4.0
"""Deviations of q within which a reading must hold the truth by as many of its own: a 95 % interval, and all that is
ever called near."""


def readings(
    mean: float, square: float, covariance: Floats, half_turns: int, fundamental: float
) -> tuple[Complexes, Complexes]:
    r"""Read two exponents and their deviations from their mean σ and squared half-difference q, both (2,) [1/s].

    .. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

    They are two real multipliers where q > 0 and a pair of conjugates about the axis where q < 0. A square root has no
    slope at zero, so its deviation is that of the interval: the largest change of it that k deviations of q make either
    way, over k, for k between 1.96 and 4. Where such an interval of q holds zero, both parts have a deviation, and each reading
    is as far off as the other one is. `covariance` is that of σ and q (2, 2), `half_turns` κ, `fundamental` ω [rad/s].
    """
    sigma, s = (float(np.sqrt(max(variance, 0.0))) for variance in np.diag(covariance))
    apart, turned = _deviation(square, s), _deviation(-square, s)
    shared = 0.0
    if square > WIDE * s > 0.0:  # far from zero σ and √q move together as they are correlated
        shared = 2.0 * float(covariance[0, 1]) / s * apart
    root = np.sqrt(complex(square))
    exponents = mean + np.array([root, -root]) + 0.5j * half_turns * fundamental
    real = np.sqrt(np.maximum(sigma**2 + apart**2 + np.array([shared, -shared]), 0.0))
    return exponents, real + 1j * turned


def _deviation(square: float, s: float) -> float:
    """The largest of |√(q ± k s) - √q|/k, roots of what is negative being zero, for k from `NARROW` to `WIDE`."""
    if s == 0.0:
        return 0.0

    def change(by: float) -> float:
        return abs(float(np.sqrt(max(square + by * s, 0.0)) - np.sqrt(max(square, 0.0)))) / abs(by)

    # Upwards it is largest where q + k s = -q, if q is negative, and downwards where q - k s = 0.
    up, down = (min(max(k, NARROW), WIDE) for k in (-2.0 * square / s, square / s))
    return max(change(up), change(-down))
