"""Transition matrix, multipliers and exponents of a known A(t), by integration over the period."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import finite, frozen_array, input_error
from floquid.floquet._matrix import PeriodicMatrix, StateMatrix

_RTOL = 1e-13
_ATOL = 1e-15  # of a factor of Φ, which starts each interval at the identity
_LOST = 1e-6  # largest error of Σ Re λT, against Liouville's formula, that passes


def transition(
    system: StateMatrix,
    period: float,
    times: ArrayLike,
    *,
    start: float = 0.0,
    breaks: ArrayLike = (),
) -> NDArray[np.float64]:
    r"""The state transition matrix Φ(t, t₀) at `times`.

    .. math:: \dot\Phi(t, t_0) = A(t)\,\Phi(t, t_0), \qquad \Phi(t_0, t_0) = I

    It is integrated from each time to the next by an explicit Runge-Kutta pair of order 8 to a relative error of
    about 1e-13 an interval, and the factors are multiplied.

    Parameters
    ----------
    system
        A(t): a callable, t [s] -> (n, n) [1/s], or its samples (n, n, phases) at the phases 0, 1/P, ..., (P - 1)/P of
        the period, between which it is the trigonometric polynomial through them. Samples must resolve A(t): what
        lies above P/2 harmonics is folded, unseen.
    period
        The period T of A(t) [s].
    times
        Instants t, ascending, none before `start` (times,) [s].
    start
        The instant t₀ [s].
    breaks
        Instants in [0, period) at which A(t) jumps (breaks,) [s]; no step of the integration crosses one.

    Returns
    -------
    NDArray[np.float64]
        Φ(t, t₀) (times, n, n).

    Raises
    ------
    InputError
        `system` is not a finite real (n, n) of that period, `times` does not ascend from `start`, a break lies
        outside the first period, or A(t) cannot be integrated.

    Notes
    -----
    Allen 2009, eq. (3); the integrator is `scipy.integrate.DOP853`.
    """
    of = "floquet.transition"
    matrix = PeriodicMatrix(system, period, breaks, of)
    instants = frozen_array(times, "times", of, axes=("times",))
    begin = finite(start, "start", of, unit="s")
    if instants.size and (instants[0] < begin or (np.diff(instants) < 0).any()):
        raise input_error(
            "times",
            of,
            f"ascend from `start` = {begin:g} [s]",
            f"begins at {instants[0]:g} and may go back",
            "Backwards in time use Φ(t, t₀) = Φ(t₀, t)⁻¹.",
        )
    return _propagate(matrix, begin, instants, of)[0]


def monodromy(system: StateMatrix, period: float, *, start: float = 0.0, breaks: ArrayLike = ()) -> NDArray[np.float64]:
    """The monodromy matrix Φ(t₀ + T, t₀) (n, n): the transition over one period.

    Parameters
    ----------
    system
        A(t), as in `transition`.
    period
        The period T [s].
    start
        The time t₀ [s].
    breaks
        Where A(t) jumps, as in `transition` [s].

    Returns
    -------
    numpy.ndarray
        Φ(t₀ + T, t₀) (n, n).

    Raises
    ------
    InputError
        As in `transition`.
    """
    of = "floquet.monodromy"
    begin = finite(start, "start", of, unit="s")
    matrix = PeriodicMatrix(system, period, breaks, of)
    return _propagate(matrix, begin, np.array([begin + matrix.period]), of)[0][0]


def multipliers(system: StateMatrix, period: float, *, breaks: ArrayLike = ()) -> NDArray[np.complex128]:
    r"""The Floquet multipliers, the eigenvalues of the monodromy matrix.

    .. math:: \mu_r = \mathrm{eig}\,\Phi(T, 0) = e^{\lambda_r T}

    Sorted by the size of their angle, then by falling magnitude, the positive angle of a conjugate pair first.

    Parameters
    ----------
    system, period, breaks
        As in `transition`.

    Returns
    -------
    NDArray[np.complex128]
        The multipliers (n,).

    Raises
    ------
    InputError
        As in `transition`.

    Notes
    -----
    Each is found to about 1e-13 of the largest (more if its eigenvectors are nearly
    parallel): a multiplier smaller than that is lost, and comes out as a number of that size. `exponents` refuses it.
    """
    return _multipliers(system, period, breaks, "floquet.multipliers")[0]


def exponents(system: StateMatrix, period: float, *, breaks: ArrayLike = ()) -> NDArray[np.complex128]:
    r"""The Floquet exponents on the principal branch.

    .. math:: \lambda_r = \frac{\ln \mu_r}{T}, \qquad -\omega/2 < \mathrm{Im}\,\lambda_r \le \omega/2, \qquad
              \omega = 2\pi/T

    A real negative multiplier has Im λ = +ω/2. Sorted by \|Im λ\|, then by falling real part, the positive imaginary
    part of a conjugate pair first.

    Parameters
    ----------
    system, period, breaks
        As in `transition`.

    Returns
    -------
    NDArray[np.complex128]
        The exponents (n,) [1/s].

    Raises
    ------
    InputError
        As in `transition`; or the sum of the exponents misses the mean trace of A(t), which it must equal by
        Liouville's formula: the multipliers differ so much in size that the smallest is lost.

    Notes
    -----
    Allen 2009, eq. (4). The error of λ is that of the multiplier over \|μ\| T, so multipliers a factor 1e6 below the
    largest have lost six digits: shooting over a whole period at once serves systems whose exponents differ by less
    than about 15/T in their real parts.
    """
    of = "floquet.exponents"
    mu, trace = _multipliers(system, period, breaks, of)
    with np.errstate(divide="ignore"):
        growth = float(np.log(np.abs(mu)).sum())
    if not abs(growth - trace) <= _LOST:
        raise input_error(
            "system",
            of,
            "have multipliers near enough in size to be found together",
            f"their exponents sum to {growth / float(period):.6g} where the mean trace of A(t) is "
            f"{trace / float(period):.6g} (multipliers from {np.abs(mu).min():.2g} to {np.abs(mu).max():.2g})",
            "Take the fast-decaying states out of A(t), or use `multipliers`, whose largest are right.",
        )
    return np.asarray(np.log(mu) / float(period), dtype=np.complex128)


def _multipliers(
    system: StateMatrix, period: float, breaks: ArrayLike, of: str
) -> tuple[NDArray[np.complex128], float]:
    """The sorted multipliers, and the integral of the trace of A over the period."""
    matrix = PeriodicMatrix(system, period, breaks, of)
    phi, trace = _propagate(matrix, 0.0, np.array([matrix.period]), of)
    mu = np.linalg.eigvals(phi[0]).astype(np.complex128)
    mu.imag += 0.0  # -0.0 would put a real negative multiplier on the lower edge of the strip
    angle = np.angle(mu)
    return mu[np.lexsort((-angle, -np.abs(mu), np.abs(angle)))], trace


def _propagate(
    matrix: PeriodicMatrix, start: float, times: NDArray[np.float64], of: str
) -> tuple[NDArray[np.float64], float]:
    """Φ(times, start), and the integral of tr A from `start` to the last of `times`."""
    phi, trace, now = np.eye(matrix.n), 0.0, start
    out = np.empty((len(times), matrix.n, matrix.n))
    for index, time in enumerate(times):
        for end in (*_breaks_between(matrix, now, time), time):
            if end > now:
                factor, part = _factor(matrix, now, end, of)
                phi, trace, now = factor @ phi, trace + part, end
        out[index] = phi
    return out, trace


def _breaks_between(matrix: PeriodicMatrix, start: float, end: float) -> NDArray[np.float64]:
    """The instants strictly between `start` and `end` at which A jumps, in any period."""
    if not matrix.breaks.size:
        return matrix.breaks
    turns = np.arange(np.floor(start / matrix.period), np.ceil(end / matrix.period) + 1.0)
    instants = np.sort(np.add.outer(turns * matrix.period, matrix.breaks).ravel())
    return instants[(instants > start) & (instants < end)]


def _factor(matrix: PeriodicMatrix, start: float, end: float, of: str) -> tuple[NDArray[np.float64], float]:
    """The transition matrix from `start` to `end`, and the integral of tr A."""
    from scipy.integrate import solve_ivp

    n = matrix.n
    # The stages at both ends of a step that ends on a jump must see A on this side of it.
    margin = 16.0 * np.finfo(float).eps * max(abs(start), abs(end), matrix.period) if matrix.breaks.size else 0.0

    def derivative(time: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        a = matrix.at(min(max(time, start + margin), end - margin))
        return np.append(a @ state[:-1].reshape(n, n), np.trace(a))

    first = np.append(np.eye(n), 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        result = solve_ivp(derivative, (start, end), first, method="DOP853", rtol=_RTOL, atol=_ATOL)
    last = result.y[:, -1]
    if not result.success or not np.isfinite(last).all():
        raise input_error(
            "system",
            of,
            "be integrable",
            f"the integration stopped at t = {result.t[-1]:g} ({result.message})",
            "Name the instants at which A(t) jumps in `breaks`, or take a shorter interval.",
        )
    return last[:-1].reshape(n, n), float(last[-1])
