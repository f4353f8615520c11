"""Systems whose responses die within a few periods, and records of many short hits on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from floquid import Channel, ConstantPeriod, Record, floquet

Floats = NDArray[np.float64]
ADVANCE = 0.3
COUPLING = 0.05
STIFFNESS, DAMPING = np.array([12.0, 4.0]), np.array([0.8, 0.05])  # feedback of each joint [N m/rad, N m s/rad]
GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class Case:
    """Hits on one system.

    Parameters
    ----------
    name
        Its name in the table.
    rates
        Derivative of the state from time and state.
    matrix
        A(t) of small deviations (n, n) [1/s].
    size, measured
        The number n of states, and of those that are measured, the first ones.
    period
        T [s].
    hits, revolutions, phases
        Records, their length in periods, and samples a period.
    noise
        Its deviation over the largest value of each channel in any hit.
    blow
        The size of the first state.
    """

    name: str
    rates: Callable[[float, Floats], Floats]
    matrix: Callable[[float], Floats]
    size: int
    measured: int
    period: float
    hits: int
    revolutions: int
    phases: int = 32
    noise: float = 0.01
    blow: float = 1.0

    @property
    def exponents(self) -> NDArray[np.complex128]:
        """The true exponents, by integration of A(t) (size,) [1/s]."""
        return floquet.exponents(self.matrix, self.period)

    def records(self, generator: np.random.Generator) -> list[Record]:
        """One record a hit, each from a random state, with white noise."""
        samples = self.revolutions * self.phases
        times = self.period * np.arange(samples) / self.phases
        starts = self.blow * generator.standard_normal((self.hits, self.size))
        values = np.array([self._motion(times, start) for start in starts])
        sigma = self.noise * np.abs(values).max(axis=(0, 2))[:, None]
        values += sigma * generator.standard_normal(values.shape)
        channels = [Channel(name=f"x{number}") for number in range(self.measured)]
        clock = ConstantPeriod(period=self.period)
        rate = self.phases / self.period
        return [Record(values=each, sample_rate=rate, channels=channels, clock=clock) for each in values]

    def _motion(self, times: Floats, start: Floats) -> Floats:
        """What is measured after one blow (channels, samples)."""
        found = solve_ivp(self.rates, times[[0, -1]], start, t_eval=times, method="DOP853", rtol=1e-9, atol=1e-12)
        return np.asarray(found.y[: self.measured], np.float64)


def _linear(matrix: Callable[[float], Floats]) -> Callable[[float, Floats], Floats]:
    return lambda t, x: matrix(t) @ x


def flapping(lock: float, blades: int, *, hits: int, revolutions: int, **options: float) -> Case:
    r"""Blades in forward flight, each drawn to the mean of all by a weak spring.

    .. math:: \ddot\beta_j + \tfrac\gamma8 (1 + \tfrac43 \mu \sin\psi_j)\, \dot\beta_j
              + \big(1 + \tfrac\gamma8 (\tfrac43 \mu \cos\psi_j + \mu^2 \sin 2\psi_j)\big) \beta_j
              + c\, (\beta_j - \bar\beta) = 0

    with μ the advance ratio and ψ_j = t + 2πj/blades, time in radians of the rotor. Of several blades the angles are
    measured, of one the angle and its rate.
    """
    behind = 2.0 * np.pi * np.arange(blades) / blades
    spring = COUPLING * (np.eye(blades) - 1.0 / blades)

    def matrix(t: float) -> Floats:
        psi = t + behind
        damping = lock / 8.0 * (1.0 + 4.0 / 3.0 * ADVANCE * np.sin(psi))
        stiffness = 1.0 + lock / 8.0 * (4.0 / 3.0 * ADVANCE * np.cos(psi) + ADVANCE**2 * np.sin(2.0 * psi))
        return np.block(
            [[np.zeros((blades, blades)), np.eye(blades)], [-np.diag(stiffness) - spring, -np.diag(damping)]]
        )

    name = f"{blades} blade{'s' if blades > 1 else ''}, Lock number {lock:g}"
    return Case(
        name=name,
        rates=_linear(matrix),
        matrix=matrix,
        size=2 * blades,
        measured=max(blades, 2),
        period=2.0 * np.pi,
        hits=hits,
        revolutions=revolutions,
        **options,  # type: ignore[arg-type]
    )


def _arm(q: Floats, rate: Floats) -> tuple[Floats, Floats]:
    """Mass matrix, and torques of speed and gravity, of two uniform links of 1 kg and 0.5 m each."""
    mass, length = 1.0, 0.5
    half, inertia = 0.5 * length, mass * length**2 / 12.0
    c, s = np.cos(q[1]), np.sin(q[1])
    lower = inertia + mass * half**2
    coupled = mass * length * half
    cross = lower + coupled * c
    upper = inertia + mass * half**2 + mass * length**2 + lower + 2.0 * coupled * c
    speed = coupled * s * np.array([-rate[1] * (2.0 * rate[0] + rate[1]), rate[0] ** 2])
    outer = mass * GRAVITY * half * np.sin(q[0] + q[1])
    inner = GRAVITY * (mass * half + mass * length) * np.sin(q[0])
    return np.array([[upper, cross], [cross, lower]]), speed + np.array([inner + outer, outer])


def _commanded(t: float) -> tuple[Floats, Floats, Floats]:
    """Joint angles that the arm follows, their rates and accelerations, of 1 s period."""
    turn, size, phase = 2.0 * np.pi, np.array([0.8, 1.0]), np.array([0.0, 1.0])
    angle = turn * t + phase
    q = np.array([0.3, 0.6]) + size * np.sin(angle)
    return q, turn * size * np.cos(angle), -(turn**2) * size * np.sin(angle)


def arm(*, hits: int, revolutions: int, **options: float) -> Case:
    """Errors of the joints of a two-link arm that follows a periodic path: computed torque ahead, and PD feedback."""

    def rates(t: float, error: Floats) -> Floats:
        q, rate, acceleration = _commanded(t)
        mass, torque = _arm(q, rate)
        ahead = mass @ acceleration + torque
        mass, torque = _arm(q + error[:2], rate + error[2:])
        push = ahead - STIFFNESS * error[:2] - DAMPING * error[2:] - torque
        return np.concatenate([error[2:], np.linalg.solve(mass, push) - acceleration])

    def matrix(t: float) -> Floats:
        step = 1e-5
        columns = [(rates(t, step * unit) - rates(t, -step * unit)) / (2.0 * step) for unit in np.eye(4)]
        return np.stack(columns, axis=1)

    return Case(
        name="two-link arm",
        rates=rates,
        matrix=matrix,
        size=4,
        measured=2,
        period=1.0,
        hits=hits,
        revolutions=revolutions,
        blow=0.01,
        **options,  # type: ignore[arg-type]
    )


def cases() -> list[Case]:
    """The table's cases."""
    return [
        flapping(6.0, 3, hits=24, revolutions=12),
        flapping(8.0, 3, hits=24, revolutions=12),
        flapping(8.0, 1, hits=2, revolutions=8),
        flapping(12.0, 1, hits=2, revolutions=8),
        arm(hits=12, revolutions=8),
        flapping(8.0, 1, hits=12, revolutions=4),
    ]
