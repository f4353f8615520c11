"""The H2 norm and Hankel's norm of a stable periodic system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.floquet.control._gramians import gramian_at
from floquid.floquet.control._system import PeriodicSystem, checked_system
from floquid.floquet.matrices import joint_breaks, stretches
from floquid.floquet.monodromy_matrix import TOLERANCE

_PANELS = 4  # of the first quadrature over a period
_POINTS = 10  # of Gauss, in a panel
_DOUBLINGS = 6
_SETTLED = 1e-10
_GRID = 32  # instants of a period between which a largest value is looked for
_LOST = 1e-14  # of the squared Hankel singular values


def h2_norm(system: PeriodicSystem, *, tolerance: float = TOLERANCE) -> float:
    r"""The H2 norm of a stable periodic system.

    .. math:: \lVert G \rVert_2^2 = \frac{1}{T} \int_0^T \mathrm{tr}\left[C(t)\, P(t)\, C(t)^T\right] dt
              = \frac{1}{T} \int_0^T \sum_j \int_s^\infty \lVert y_j(t, s) \rVert^2\, dt\, ds

    with P the reachability `gramian` and y_j the response to an impulse at s in input j: the root of the mean energy
    of the impulse responses, or of the mean variance of the outputs under white noise of unit intensity.

    Parameters
    ----------
    system
        The periodic system, with inputs.
    tolerance
        As in `gramian`; the mean is found to 1e-10.

    Raises
    ------
    InputError
        The system is not stable, D is not zero, or as in `gramian`.

    Notes
    -----
    Colaneri 2000, Continuous-time periodic systems in H2 and H∞, part I.
    """
    of = "floquet.h2_norm"
    checked_system(system, of, inputs=True)
    assert system.B is not None
    assert system.D is not None
    if system.D.at(stretches(system.D)).any():
        remedy = "An impulse would pass straight to the outputs, with infinite energy: leave D out, or use `linf_norm`."
        raise input_error("system", of, "have no direct term", "has a D(t) that is not zero", remedy)
    breaks = joint_breaks((system.A, system.B, system.C), system.period)
    bounds = np.unique(np.concatenate([[0.0, system.period], breaks]))
    before, change = 0.0, np.inf
    for doubling in range(_DOUBLINGS):
        now = _mean_variance(system, bounds, _PANELS * 2**doubling, tolerance, of)
        change = abs(now - before)
        if doubling and change <= _SETTLED * now:
            return float(np.sqrt(now))
        before = now
    raise input_error(
        "system",
        of,
        f"have a mean of C P Cᵀ that is found to {_SETTLED:g}",
        f"it still changes by {change:.2g} of {before:.3g}",
        "Name the instants at which its matrices jump in their `breaks`.",
    )


def hankel_norm(system: PeriodicSystem, *, tolerance: float = TOLERANCE) -> float:
    r"""Hankel's norm of a stable periodic system.

    .. math:: \lVert G \rVert_H = \max_t \sqrt{\lambda_{\max}\left[P(t)\, Q(t)\right]}

    the largest gain from the energy of the inputs before a phase to that of the outputs after it.

    Parameters
    ----------
    system
        The periodic system, with inputs.
    tolerance
        As in `gramian`.

    Raises
    ------
    InputError
        As in `gramian`.

    Notes
    -----
    The largest value is looked for beside the largest at 32 phases and at the breaks. Colaneri 2000; Bittanti and
    Colaneri 2009, Periodic Systems: Filtering and Control.
    """
    of = "floquet.hankel_norm"
    checked_system(system, of, inputs=True)
    from scipy.optimize import fminbound

    instants = grid(system)
    values = hankel_values(system, instants, tolerance, of)
    place = int(np.argmax(values))
    if values[place] == 0.0:
        return 0.0
    # What is before the first phase is one period later.
    around = (instants[-2] - system.period, instants[1]) if place == 0 else (instants[place - 1], instants[place + 1])

    def negative(time: float) -> float:
        between = np.array([0.0, np.mod(time, system.period), system.period])
        return -float(hankel_values(system, between, tolerance, of)[1])

    best = np.asarray(fminbound(negative, *around, xtol=1e-5 * system.period)).item()
    return max(float(values[place]), -negative(best))


def _mean_variance(
    system: PeriodicSystem, bounds: NDArray[np.float64], panels: int, tolerance: float, of: str
) -> float:
    """The mean of tr(C P Cᵀ) over a period, by Gauss quadrature on panels of which none crosses a bound."""
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    parts = np.maximum(1, np.ceil(np.diff(bounds) * panels / system.period - 1e-9)).astype(np.intp)
    edges = np.concatenate(
        [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(bounds, bounds[1:], parts, strict=False)]
    )
    widths = np.diff(np.append(edges, system.period))
    times = (edges[:, None] + 0.5 * widths[:, None] * (1.0 + nodes)).ravel()
    variances = gramian_at(system, "reachability", np.concatenate([[0.0], times, [system.period]]), tolerance, of)[1:-1]
    outputs = system.C.at(times)
    values = np.einsum("tij,tjk,tik->t", outputs, variances, outputs)
    return float(0.5 * np.outer(widths, weights).ravel() @ values / system.period)


def hankel_values(
    system: PeriodicSystem, instants: NDArray[np.float64], tolerance: float, of: str
) -> NDArray[np.float64]:
    """The largest Hankel singular value at instants from 0 to T (instants,); zero if it may be rounding alone."""
    reach, observe = (gramian_at(system, kind, instants, tolerance, of) for kind in ("reachability", "observability"))
    values = np.linalg.eigvals(reach @ observe).real.max(axis=1)
    lost = _LOST * np.einsum("tij,tji->t", np.abs(reach), np.abs(observe)).max()  # whatever the units of the states
    return np.sqrt(np.where(values > lost, values, 0.0))


def grid(system: PeriodicSystem) -> NDArray[np.float64]:
    """Instants from 0 to T, the breaks among them."""
    matrices = tuple(matrix for matrix in (system.A, system.B, system.C) if matrix is not None)
    even = np.linspace(0.0, system.period, _GRID + 1)
    return np.unique(np.concatenate([even, joint_breaks(matrices, system.period)]))
