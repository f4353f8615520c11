"""Gramians of a stable periodic system, its H2 norm and Hankel's norm."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from floquid._arrays import Floats, Indices
from floquid._checks import input_error, integer
from floquid.floquet.control._system import PeriodicSystem, checked_system
from floquid.floquet.matrices import AbstractPeriodicMatrix, assembled, joint_breaks, probe_times, stretches
from floquid.floquet.monodromy_matrix import TOLERANCE, checked, factors, product_logarithms

Kind: TypeAlias = Literal["reachability", "observability"]

_UNDAMPED = 1e-9  # decay in a period that cannot be told from none
_PANELS = 4  # of the first quadrature over a period
_POINTS = 10  # of Gauss, in a panel
_DOUBLINGS = 6
_SETTLED = 1e-10
_GRID = 32  # instants of a period between which a largest value is looked for
_LOST = 1e-14  # of the squared Hankel singular values


def gramian(
    system: PeriodicSystem, kind: Kind = "reachability", n_phases: int = 64, *, tolerance: float = TOLERANCE
) -> Floats:
    r"""The periodic Gramian of a stable system, symmetric (phases, n, n).

    .. math:: P(t) &= \int_{-\infty}^{t} \Phi(t, s)\, B(s)\, B(s)^T\, \Phi(t, s)^T\, ds, \qquad
              \dot P = A P + P A^T + B B^T \\
              Q(t) &= \int_{t}^{\infty} \Phi(s, t)^T\, C(s)^T\, C(s)\, \Phi(s, t)\, ds, \qquad
              -\dot Q = A^T Q + Q A + C^T C

    The square roots of the eigenvalues of P are the half axes of what inputs of unit energy reach by the phase;
    those of Q are the energies of the free response from it.

    Bittanti and Colaneri 2009, Periodic Systems: Filtering and Control; Varga 2005, On solving periodic differential
    matrix equations. The integrals over short intervals are read off the transition matrix of a Hamiltonian system
    (Van Loan 1978), and P(0) solves the discrete Lyapunov equation of a period; from there it is carried on in the
    direction in which errors decay.

    Raises InputError where the system is not stable, so that the integral does not exist; it has no inputs; or it
    cannot be integrated.

    Parameters
    ----------
    system
        The periodic system; with inputs for "reachability".
    kind
        "reachability", P, or "observability", Q.
    n_phases
        The number of phases t = 0, T/n, ... at which it is given.
    tolerance
        The relative error that is aimed at, from 1e-14 to 1e-3; damping that is slight loses from it.
    """
    of = "floquet.gramian"
    checked_system(system, of, inputs=kind == "reachability")
    if kind not in get_args(Kind):
        raise input_error("kind", of, 'be "reachability" or "observability"', f"is {kind!r}")
    count = integer(n_phases, "n_phases", of, at_least=1)
    return gramian_at(system, kind, system.period * np.arange(count + 1) / count, tolerance, of)[:-1]


def gramian_at(system: PeriodicSystem, kind: Kind, instants: Floats, tolerance: float, of: str) -> Floats:
    """P or Q at instants that ascend from 0 to T (instants, n, n)."""
    steps = _steps(system, kind, instants, tolerance, of)
    _refuse_unstable(steps, system.period, of)
    factor, gain = np.eye(system.n_states), np.zeros((system.n_states, system.n_states))
    for phi, more in zip(steps.phi, steps.gain, strict=True):
        factor, gain = phi @ factor, phi @ gain @ phi.T + more
    from scipy.linalg import solve_discrete_lyapunov

    now = _symmetric(solve_discrete_lyapunov(factor, _symmetric(gain)))
    values = [now]
    for phi, more in zip(steps.phi, steps.gain, strict=True):
        values.append(_symmetric(phi @ values[-1] @ phi.T + more))
    out = np.array(values)[np.searchsorted(steps.gap, np.arange(-1, len(instants) - 1), side="right")]
    if kind == "observability":  # its steps go backwards from the end of the period
        out = out[::-1]
    return out * steps.units


class _Steps(NamedTuple):
    """X → Φ X Φᵀ + G over short intervals, in the order in which errors decay."""

    gap: Indices
    phi: Floats
    gain: Floats
    units: Floats  # the units of the matrices X (n, n)


def _steps(system: PeriodicSystem, kind: Kind, instants: Floats, tolerance: float, of: str) -> _Steps:
    r"""The steps between the instants.

    .. math:: \begin{bmatrix} A & B B^T \\ 0 & -A^T \end{bmatrix} \to
              \begin{bmatrix} \Phi & G \Phi^{-T} \\ 0 & \Phi^{-T} \end{bmatrix}, \qquad
              \begin{bmatrix} A & 0 \\ C^T C & -A^T \end{bmatrix} \to
              \begin{bmatrix} \Phi & 0 \\ \Phi^{-T} G & \Phi^{-T} \end{bmatrix}
    """
    prepared = checked(system.A, None, (), tolerance, of)
    n, scale, period = system.n_states, prepared.scale, system.period
    reach = kind == "reachability"
    # In units in which A is balanced, and the Gramian grows as quickly as the states move each other: neither a
    # step's error nor its rounding then depends on the units of states, inputs and outputs.
    A = np.diag(1.0 / scale) @ prepared.matrix @ np.diag(scale)
    half = np.diag(1.0 / scale) @ system.B if reach and system.B is not None else np.diag(scale) @ system.C.T
    unit = largest_entry(half) ** 2 / (prepared.size or 1.0 / period)
    source = (half @ half.T) * (1.0 / unit if unit else 0.0)
    none = np.zeros((n, n))
    whole = assembled([[A, source if reach else none], [none if reach else source, -A.T]], period)
    found = factors(checked(whole, None, (), tolerance, of), instants, tolerance, of)
    phi = found.matrices[:, :n, :n]
    if reach:
        gain = found.matrices[:, :n, n:] @ phi.swapaxes(1, 2)
        return _Steps(found.owner, phi, _symmetric(gain), unit * np.outer(scale, scale))
    gain = _symmetric(phi.swapaxes(1, 2) @ found.matrices[:, n:, :n])
    back = len(instants) - 2 - found.owner[::-1]
    return _Steps(back, phi[::-1].swapaxes(1, 2), gain[::-1], unit / np.outer(scale, scale))


def _refuse_unstable(steps: _Steps, period: float, of: str) -> None:
    growth = float(product_logarithms(steps.phi).real.max())
    if growth > -_UNDAMPED:
        must = "be stable, for the integral over all past or future does not exist otherwise"
        remedy = "Shift A(t) by a multiple of the identity, or take out the states that do not decay."
        raise input_error("system", of, must, f"has an exponent of real part {growth / period:.6g} 1/s", remedy)


def largest_entry(matrix: AbstractPeriodicMatrix) -> float:
    """The largest entry, in size, over the period."""
    return float(np.abs(matrix.at(probe_times(matrix.period, 64))).max())


def _symmetric(matrix: Floats) -> Floats:
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def h2_norm(system: PeriodicSystem, *, tolerance: float = TOLERANCE) -> float:
    r"""The H2 norm of a stable periodic `system` with inputs, the mean found to 1e-10; `tolerance` as in `gramian`.

    .. math:: \lVert G \rVert_2^2 = \frac{1}{T} \int_0^T \mathrm{tr}\left[C(t)\, P(t)\, C(t)^T\right] dt
              = \frac{1}{T} \int_0^T \sum_j \int_s^\infty \lVert y_j(t, s) \rVert^2\, dt\, ds

    with P the reachability `gramian` and y_j the response to an impulse at s in input j: the root of the mean energy
    of the impulse responses, or of the mean variance of the outputs under white noise of unit intensity (Colaneri 2000,
    Continuous-time periodic systems in H2 and H∞, part I).

    Raises InputError where D is not zero, or as in `gramian`.
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
    must = f"have a mean of C P Cᵀ that is found to {_SETTLED:g}"
    got = f"it still changes by {change:.2g} of {before:.3g}"
    raise input_error("system", of, must, got, "Name the instants at which its matrices jump in their `breaks`.")


def hankel_norm(system: PeriodicSystem, *, tolerance: float = TOLERANCE) -> float:
    r"""Hankel's norm of a stable periodic `system` with inputs; `tolerance` and errors as in `gramian`.

    .. math:: \lVert G \rVert_H = \max_t \sqrt{\lambda_{\max}\left[P(t)\, Q(t)\right]}

    the largest gain from the energy of the inputs before a phase to that of the outputs after it (Colaneri 2000;
    Bittanti and Colaneri 2009, Periodic Systems: Filtering and Control), looked for beside the largest at 32 phases and
    the breaks.
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


def _mean_variance(system: PeriodicSystem, bounds: Floats, panels: int, tolerance: float, of: str) -> float:
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


def hankel_values(system: PeriodicSystem, instants: Floats, tolerance: float, of: str) -> Floats:
    """The largest Hankel singular value at instants from 0 to T (instants,); zero if it may be rounding alone."""
    reach, observe = (gramian_at(system, kind, instants, tolerance, of) for kind in ("reachability", "observability"))
    values = np.linalg.eigvals(reach @ observe).real.max(axis=1)
    lost = _LOST * np.einsum("tij,tji->t", np.abs(reach), np.abs(observe)).max()  # whatever the units of the states
    return np.sqrt(np.where(values > lost, values, 0.0))


def grid(system: PeriodicSystem) -> Floats:
    """Instants from 0 to T, the breaks among them."""
    matrices = tuple(matrix for matrix in (system.A, system.B, system.C) if matrix is not None)
    even = np.linspace(0.0, system.period, _GRID + 1)
    return np.unique(np.concatenate([even, joint_breaks(matrices, system.period)]))
