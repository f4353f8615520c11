"""Multipliers and exponents of a known A(t), from factors of its monodromy matrix that are never multiplied out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import input_error
from floquid.floquet.matrices import HarmonicMatrix, Prepared, StateMatrix
from floquid.floquet.monodromy_matrix._collocation import Factors, gauss, stages
from floquid.floquet.monodromy_matrix._periodic_schur import multipliers_of, product_logarithms
from floquid.floquet.monodromy_matrix._transition import TOLERANCE, checked, factors

_LOST = 1e-7  # of the sum of the exponents' sizes: largest miss of Liouville's formula that passes


def multipliers(
    system: StateMatrix, period: float | None = None, *, breaks: ArrayLike = (), tolerance: float = TOLERANCE
) -> NDArray[np.complex128]:
    r"""The Floquet multipliers (n,), the eigenvalues of the monodromy matrix.

    .. math:: \mu_r = \mathrm{eig}\,\Phi(T, 0) = e^{\lambda_r T}

    In the order of `exponents`: by the size of their angle, then by falling magnitude, the positive angle of a
    conjugate pair first. One below 1e-308 is zero and one above 1e308 infinite: `exponents` has all.

    Parameters
    ----------
    system, period, breaks, tolerance
        As in `transition`.

    Raises
    ------
    InputError
        As in `exponents`.
    """
    return multipliers_of(_logarithms(system, period, breaks, tolerance, "floquet.multipliers")[0])


def exponents(
    system: StateMatrix, period: float | None = None, *, breaks: ArrayLike = (), tolerance: float = TOLERANCE
) -> NDArray[np.complex128]:
    r"""The Floquet exponents on the principal branch (n,) [1/s].

    .. math:: \lambda_r = \frac{\ln \mu_r}{T}, \qquad -\omega/2 < \mathrm{Im}\,\lambda_r \le \omega/2, \qquad
              \omega = 2\pi/T

    A real negative multiplier has Im λ = +ω/2. Sorted by \|Im λ\|, then by falling real part, the positive imaginary
    part of a conjugate pair first.

    Parameters
    ----------
    system, period, breaks, tolerance
        As in `transition`.

    Raises
    ------
    InputError
        As in `transition`; or the sum of the exponents misses the mean trace of A(t), which it must equal by
        Liouville's formula.

    Notes
    -----
    Allen 2009, eq. (4). The period is split into factors, each well conditioned, and the eigenvalues are those of
    their product without its being formed (periodic Schur form: Bojanczyk, Golub and Van Dooren 1992). The multipliers
    may be as far apart as they like: each is good to about `tolerance` times the number of factors of itself, times
    its condition. Two that are nearly equal and share a shape are good to the root of that; `modes` tells.
    """
    found, length = _logarithms(system, period, breaks, tolerance, "floquet.exponents")
    return found / length


def balanced(found: Factors, prepared: Prepared) -> NDArray[np.float64]:
    """The factors in balanced units (factors, n, n)."""
    return found.matrices * prepared.scale / prepared.scale[:, None]


def refuse_lost(logs: NDArray[np.complex128], found: Factors, prepared: Prepared, of: str) -> None:
    """Refuse exponents whose sum is not the mean trace of A(t)."""
    integral = trace_integral(found, prepared)
    growth = float(logs.real.sum())
    # Each factor's own rounding counts, and so do sizes that cancel in the sum.
    size = 1.0 + np.abs(logs.real).sum() + prepared.size * prepared.matrix.period
    if not abs(growth - integral) <= _LOST * size:
        period = prepared.matrix.period
        raise input_error(
            "system",
            of,
            "have multipliers that can be told from rounding",
            f"their exponents sum to {growth / period:.6g} where the mean trace of A(t) is {integral / period:.6g}",
            "Take the states that decay at once out of A(t), or lower `tolerance`.",
        )


def trace_integral(found: Factors, prepared: Prepared) -> float:
    """The integral of the trace of A over a period."""
    matrix = prepared.matrix
    if isinstance(matrix, HarmonicMatrix):
        mean = np.asarray(matrix.coefficients)[..., np.asarray(matrix.harmonics) == 0].sum(axis=2)
        return float(np.trace(mean).real) * matrix.period
    rule = gauss(stages(len(prepared.scale)))
    width = found.right - found.left
    values = matrix.at(found.left[:, None] + width[:, None] * rule.nodes)
    return float(width @ np.trace(values, axis1=2, axis2=3) @ rule.weights)


def _logarithms(
    system: StateMatrix, period: float | None, breaks: ArrayLike, tolerance: float, of: str
) -> tuple[NDArray[np.complex128], float]:
    """The sorted logarithms of the multipliers, and the period."""
    prepared = checked(system, period, breaks, tolerance, of)
    found = factors(prepared, np.array([0.0, prepared.matrix.period]), tolerance, of)
    logs = product_logarithms(balanced(found, prepared))
    refuse_lost(logs, found, prepared, of)
    return logs, prepared.matrix.period
