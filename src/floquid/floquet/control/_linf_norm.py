"""The largest gain of a stable periodic system."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import finite, input_error, positive
from floquid._show import Brief
from floquid.floquet.control._gramians import grid, hankel_values, largest_entry
from floquid.floquet.control._system import PeriodicSystem, balanced_system, checked_system
from floquid.floquet.matrices import AbstractPeriodicMatrix, FunctionMatrix, constant_value, joint_breaks, stretches
from floquid.floquet.monodromy_matrix import (
    TOLERANCE,
    checked,
    divided,
    exponents,
    factors,
    gauss,
    product_logarithms,
    stages,
)

_OF = "floquet.linf_norm"
_TURN = 1.0  # of the Hamiltonian flow in one step [rad]: none can turn by a quarter unseen
_ROUNDING, _COARSEST = 1e-14, 1e-6
_DOUBLINGS = 60  # of the horizon
_FADED = 1e-9  # what is left of a state after the horizon, when a longer one changes nothing


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeakGain(Brief):
    """The largest gain of a periodic system from the energy of its inputs to that of its outputs.

    Parameters
    ----------
    gain
        The norm.
    error
        By how much it may be wrong.
    omega
        Where it peaks [rad/s], from 0 to ω/2: an input of this frequency and those beside it by multiples of ω.
        Infinite where it is that of D alone, and no frequency attains it.
    """

    gain: float
    error: float
    omega: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", finite(self.gain, "gain", "PeakGain"))
        object.__setattr__(self, "error", finite(self.error, "error", "PeakGain"))


def linf_norm(system: PeriodicSystem, *, tolerance: float = 1e-6) -> PeakGain:
    r"""The largest gain of a stable periodic system, and the frequency where it peaks.

    .. math:: \lVert G \rVert_\infty = \sup_u \frac{\lVert y \rVert}{\lVert u \rVert}
              = \max_{0 \le \Omega \le \omega/2} \sigma_{\max}\left[\mathcal H(i\Omega)\right]

    with norms of energy and 𝓗 the whole harmonic transfer function, of which nothing is cut off: γ is bisected. It is
    above the norm if it is above that of D(t), and the periodic Riccati equation

    .. math:: -\dot X = F^T X + X F + X B R^{-1} B^T X + C^T (I + D R^{-1} D^T)\, C, \qquad
              R = \gamma^2 I - D^T D, \qquad F = A + B R^{-1} D^T C

    has a solution from X = 0 backwards without end. The horizon is doubled until it does not matter.

    Colaneri 2000, Continuous-time periodic systems in H2 and H∞, part I. That the Hamiltonian matrix of the equation
    has no multiplier on the unit circle is necessary, not sufficient: the singular values over Ω fill bands, and γ may
    lie in a gap between two. Doubling: Chu, Fan, Lin and Wang 2004, Structure-preserving algorithms for periodic
    discrete-time algebraic Riccati equations. A gain close to that of D, or far below what B and C could give, takes
    many short steps.

    The `system` has inputs. The relative error that is aimed at is `tolerance`, from 1e-9 to 0.1; very slight damping
    allows less, see `PeakGain.error`. Raises InputError where the system is not stable, it has no inputs, or it cannot
    be integrated.
    """
    checked_system(system, _OF, inputs=True)
    accuracy = positive(tolerance, "tolerance", _OF)
    if not 1e-9 <= accuracy <= 0.1:
        raise input_error("tolerance", _OF, "lie in [1e-9, 0.1]", f"is {accuracy:g}")
    direct = _largest_direct(system)
    hankel = float(hankel_values(system, grid(system), TOLERANCE, _OF).max())
    if hankel == 0.0:  # what the inputs reach is not seen
        return PeakGain(gain=direct, error=accuracy * direct, omega=np.inf)
    low = max(direct, hankel)  # the gain is below neither
    decay = float(-exponents(system.A).real.max()) * system.period
    accuracy = max(accuracy, TOLERANCE / decay)  # the decay itself is known no better
    scaled = _scaled(system, direct)
    high = 2.0 * low
    while not _bounds(scaled, high):
        low, high = high, 2.0 * high
    while high - low > accuracy * low:
        middle = 0.5 * (low + high)
        if _bounds(scaled, middle):
            high = middle
        else:
            low = middle
    gain = 0.5 * (low + high)
    return PeakGain(gain=gain, error=accuracy * gain, omega=np.inf if low == direct else _peak(scaled, high))


class _Scaled(NamedTuple):
    """A, B, C and D in units in which A is balanced, and how large the others are."""

    A: AbstractPeriodicMatrix
    B: AbstractPeriodicMatrix
    C: AbstractPeriodicMatrix
    D: AbstractPeriodicMatrix
    ratio: float  # of the largest entry of C to that of B
    direct: float  # the gain of D alone


class _Horizon(NamedTuple):
    r"""The maps by stretches of time of a state before and a costate after them (stretches, n, n).

    .. math:: x_1 = F x_0 + W p_1, \qquad p_0 = G x_0 + F^T p_1
    """

    F: Floats
    W: Floats
    G: Floats


def _scaled(system: PeriodicSystem, direct: float) -> _Scaled:
    A, B, C, D = balanced_system(system, checked(system.A, None, (), TOLERANCE, _OF), _OF)
    return _Scaled(A, B, C, D, largest_entry(C) / largest_entry(B), direct)


def _bounds(scaled: _Scaled, gain: float) -> bool:
    """True if no input has as large a gain, over any horizon."""
    now = _steps(scaled, gain)
    least = np.linalg.eigvalsh(np.concatenate([now.W, now.G]))[:, 0]
    if (least < -1e-9).any():
        return False
    n = now.F.shape[1]
    while len(now.F) > 1:
        if len(now.F) % 2:
            still = np.zeros((1, n, n))
            now = _Horizon(*(np.concatenate(p) for p in zip(now, (still + np.eye(n), still, still), strict=True)))
        joined = _joined(_Horizon(*(p[::2] for p in now)), _Horizon(*(p[1::2] for p in now)))
        if joined is None:
            return False
        now = joined
    for _ in range(_DOUBLINGS):
        longer = _joined(now, now)
        if longer is None:
            return False
        if np.abs(now.F).max() < _FADED:
            return True
        now = longer
    return False


def _joined(first: _Horizon, second: _Horizon) -> _Horizon | None:
    """One stretch and the next together; None if over both some input has the gain."""
    coupling = first.W @ second.G
    if not np.isfinite(coupling).all() or (np.linalg.eigvals(coupling).real.max(axis=1) >= 1.0).any():
        return None
    inner = np.eye(coupling.shape[1]) - coupling
    past, gained = np.linalg.solve(inner, first.F), np.linalg.solve(inner, first.W)
    before = first.F.swapaxes(1, 2)
    W = second.W + second.F @ gained @ second.F.swapaxes(1, 2)
    G = first.G + before @ second.G @ past
    return _Horizon(second.F @ past, 0.5 * (W + W.swapaxes(1, 2)), 0.5 * (G + G.swapaxes(1, 2)))


def _steps(scaled: _Scaled, gain: float) -> _Horizon:
    """The short steps of a period."""
    n = scaled.A.shape[0]
    matrices = _factors(scaled, gain)
    forwards = np.asarray(np.linalg.inv(matrices[:, n:, n:]), dtype=np.float64)  # Fᵀ
    W, G = matrices[:, :n, n:] @ forwards, -forwards @ matrices[:, n:, :n]
    return _Horizon(forwards.swapaxes(1, 2), 0.5 * (W + W.swapaxes(1, 2)), 0.5 * (G + G.swapaxes(1, 2)))


def _peak(scaled: _Scaled, gain: float) -> float:
    """The |Im λ| [rad/s] of the exponent of the Hamiltonian matrix that is nearest to the imaginary axis."""
    logs = product_logarithms(_factors(scaled, gain))
    return float(np.abs(logs[np.argmin(np.abs(logs.real))].imag)) / scaled.A.period


def _factors(scaled: _Scaled, gain: float) -> Floats:
    r"""The transition matrices of a period of the Hamiltonian matrix, in short steps (steps, 2n, 2n).

    .. math:: \begin{bmatrix} A + B R^{-1} D^T C & B R^{-1} B^T \\
              -C^T (I + D R^{-1} D^T)\, C & -(A + B R^{-1} D^T C)^T \end{bmatrix}
    """
    A, B, C, D = scaled[:4]
    period, unit = A.period, scaled.ratio * gain  # of the costates, so that both ways to them are as quick

    def hamiltonian(times: Floats) -> Floats:
        a, b, c, d = (matrix.at(times) for matrix in (A, B, C, D))
        dt = d.swapaxes(1, 2)
        inverse = np.linalg.inv(gain**2 * np.eye(d.shape[2]) - dt @ d)
        closed = a + b @ inverse @ dt @ c
        upper = unit * b @ inverse @ b.swapaxes(1, 2)
        lower = -c.swapaxes(1, 2) @ (np.eye(d.shape[1]) + d @ inverse @ dt) @ c / unit
        return np.block([[closed, upper], [lower, -closed.swapaxes(1, 2)]])

    breaks = joint_breaks((A, B, C, D), period)
    whole = FunctionMatrix(function=hamiltonian, period=period, breaks=breaks, vectorised=True)
    # R is a difference, known to its rounding alone: close to the gain of D no step can be better than that.
    tolerance = min(_COARSEST, max(TOLERANCE, _ROUNDING / ((gain + scaled.direct) * (gain - scaled.direct) / gain**2)))
    prepared = checked(whole, None, (), tolerance, _OF)._replace(scale=np.ones(whole.shape[0]))
    found = factors(prepared, np.array([0.0, period]), tolerance, _OF)
    width = found.right - found.left
    nodes = found.left[:, None] + width[:, None] * gauss(stages(whole.shape[0])).nodes
    turn = width * np.abs(prepared.matrix.at(nodes)).sum(axis=3).max(axis=(1, 2))
    parts = np.maximum(1, np.ceil(turn / _TURN)).astype(np.intp)
    if (parts == 1).all():
        return found.matrices
    instants = np.append(divided(found.left, found.right, parts)[1], period)
    return factors(prepared, instants, tolerance, _OF).matrices


def _largest_direct(system: PeriodicSystem) -> float:
    """The largest singular value of D(t)."""
    from scipy.optimize import fminbound

    D = system.D
    assert D is not None
    if constant_value(D) is not None:
        return float(np.linalg.norm(D.at(0.0), 2))

    def size(times: ArrayLike) -> Floats:
        return np.linalg.norm(D.at(times), 2, axis=(-2, -1))

    largest = 0.0
    for times in stretches(D):
        sizes = size(times)
        place = int(np.argmax(sizes))
        around = times[max(place - 1, 0)], times[min(place + 1, len(times) - 1)]
        best = np.asarray(fminbound(lambda t: -float(size(t)), *around)).item()
        largest = max(largest, float(sizes[place]), float(size(best)))
    return largest
