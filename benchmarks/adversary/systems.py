"""Random linear time-periodic systems, their Floquet modes and their motion, of equations written for this alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from benchmarks.chain.case import Modes
from numpy.typing import NDArray

TURN = 0.03
"""The angle that the fastest natural frequency turns by in a step of the integration, at most [rad]."""

PHASES = 96
"""Instants of a period at which modes are sampled for their Fourier coefficients."""

HARMONICS = 16

DECAYS = (0.008, 0.6)
"""Of every mode, the least and the largest decay in a period [nepers]."""

CHUNK = 4096
"""Steps of the integration whose matrices are in memory at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    r"""Oscillators with a periodic stiffness and a gyroscopic coupling, seen by channels some of which turn.

    .. math:: \ddot u + (D + G)\,\dot u + (K_0(1 + 2 d s) + K_c \cos\theta + K_s \sin 2\theta)\, u
              + \kappa u^3 = f \cos(\theta + \varphi), \qquad y = (L + L_c \cos\theta)\, u

    s is the share of the record that is over and d the drift of the frequencies. The period is 2π s at the speed of
    1 rad/s.

    Parameters
    ----------
    damping, stiffness, cosine, sine
        D + G, K₀, K_c and K_s (degrees of freedom, degrees of freedom).
    outputs, turning
        L and L_c (channels, degrees of freedom).
    start
        u and its rate after the blow (2 degrees of freedom,).
    force
        f (degrees of freedom,).
    drift, cubic
        d and κ.
    """

    damping: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    outputs: NDArray[np.float64]
    turning: NDArray[np.float64]
    start: NDArray[np.float64]
    force: NDArray[np.float64]
    drift: float = 0.0
    cubic: float = 0.0

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return len(self.stiffness)

    @property
    def fastest(self) -> float:
        """The highest natural frequency [rad/s]."""
        return float(np.sqrt(np.abs(np.linalg.eigvals(self.stiffness)).max()))

    def matrices(self, angles: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """A of the state (u, rate, 1) at angles of the shaft (instants, states, states)."""
        n, cos, sin = self.size, np.cos(angles)[:, None, None], np.sin(2.0 * angles)[:, None, None]
        a = np.zeros((len(angles), 2 * n + 1, 2 * n + 1))
        a[:, :n, n : 2 * n] = np.eye(n)
        drifted = (1.0 + 2.0 * self.drift * shares)[:, None, None]
        a[:, n : 2 * n, :n] = -(self.stiffness * drifted + self.cosine * cos + self.sine * sin)
        a[:, n : 2 * n, n : 2 * n] = -self.damping
        a[:, n : 2 * n, -1] = self.force * np.cos(angles + 0.4)[:, None]
        return a

    def seen(self, states: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the channels see of states (states, instants), as (channels, instants)."""
        u = states[: self.size]
        return self.outputs @ u + (self.turning @ u) * np.cos(angles)

    def moved(
        self,
        times: NDArray[np.float64],
        clock: Clock,
        start: NDArray[np.float64],
        kicks: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """The states at even times from a start, or several (2 n + 1, starts), as (2 n + 1, instants[, starts]).

        `kicks` are added to the state at each instant but the first (instants - 1, 2 n + 1).
        """
        step = times[1] - times[0]
        inner = int(np.ceil(step * self.fastest / TURN))
        h, state, out = step / inner, start, [start]
        for first in range(0, len(times) - 1, max(CHUNK // inner, 1)):
            rows = times[first : min(first + max(CHUNK // inner, 1), len(times) - 1)]
            begins = (rows[:, None] + h * np.arange(inner)).ravel()
            # A of a step's beginning, middle and end: Runge and Kutta's fourth-order step is a matrix.
            at = [self.matrices(clock(begins + part * h), (begins + part * h) / times[-1]) for part in (0.0, 0.5, 1.0)]
            one = np.eye(len(start))
            k1 = at[0]
            k2 = at[1] @ (one + 0.5 * h * k1)
            k3 = at[1] @ (one + 0.5 * h * k2)
            k4 = at[2] @ (one + h * k3)
            steps = (one + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)).reshape(len(rows), inner, *one.shape)
            whole = steps[:, 0]
            for number in range(1, inner):
                whole = steps[:, number] @ whole
            for number, matrix in enumerate(whole, start=first):
                state = matrix @ state if kicks is None else matrix @ state + kicks[number]
                out.append(state)
        return np.moveaxis(np.array(out), 0, 1)

    def response(self, times: NDArray[np.float64], clock: Clock) -> NDArray[np.float64]:
        """What the channels see after the blow (channels, instants); with a force, about its orbit."""
        start = np.append(self.start + self.orbit(), 1.0)
        return self.seen(self.moved(times, clock, start), clock(times))

    def orbit(self, speed: float = 1.0) -> NDArray[np.float64]:
        """The state at angle zero on the periodic response to the force, at a `speed` [rad/s] (2 n,)."""
        if not self.force.any():
            return np.zeros(2 * self.size)
        end = self._period(speed)[:, -1]
        return np.linalg.solve(np.eye(2 * self.size) - end[:-1, :-1], end[:-1, -1])

    def _period(self, speed: float = 1.0) -> NDArray[np.float64]:
        """Φ of the state with its force at phases of one period of constant speed (states, phases + 1, states)."""
        times = 2.0 * np.pi / speed * np.arange(PHASES + 1) / PHASES
        return replace(self, drift=0.0).moved(times, Clock(speed=speed), np.eye(2 * self.size + 1))

    def modes(self, speed: float = 1.0) -> Modes:
        """The Floquet modes, each real multiplier and one of each pair, on the branch of the strongest harmonic.

        At another `speed` than 1 rad/s, the mean of a shaft that wanders, each branch but one is elsewhere.
        """
        harmonics = np.arange(-HARMONICS, HARMONICS + 1)
        angles = 2.0 * np.pi * np.arange(PHASES) / PHASES
        exponents, coefficients = [], []
        for exponent, shape in self.shapes(speed):
            exponents.append(exponent)
            coefficients.append(np.fft.fft(self.seen(shape, angles), axis=1)[:, harmonics % PHASES] / PHASES)
        return Modes(
            exponents=np.array(exponents, complex),
            coefficients=np.array(coefficients),
            harmonics=harmonics,
            period=2.0 * np.pi / speed,
        )

    def shapes(self, speed: float = 1.0) -> list[tuple[complex, NDArray[np.complex128]]]:
        """λ of each mode and the shape of the states at phases of a period (2 n, phases), as the blow excites it.

        The free motion is twice the real part of the sum of shapes times e^{λt}.
        """
        n, found = self.size, []
        transition = self._period(speed)[: 2 * n, :, : 2 * n]
        multipliers, vectors = np.linalg.eig(transition[:, -1])
        amounts = np.linalg.solve(vectors, self.start.astype(complex))
        angles = 2.0 * np.pi * np.arange(PHASES) / PHASES
        real = np.abs(multipliers.imag) < 1e-9 * np.abs(multipliers)
        for number in np.flatnonzero(real | (multipliers.imag > 0)):
            exponent = np.log(complex(multipliers[number])) * speed / (2.0 * np.pi)
            shape = np.einsum("ijk,k->ij", transition[:, :-1], vectors[:, number]) * np.exp(-exponent * angles / speed)
            shape = shape * amounts[number]
            if real[number]:
                shape = 0.5 * shape
                exponent = exponent.real + 0.5j * speed * (multipliers[number].real < 0)
            else:
                lines = np.fft.fft(self.seen(shape, angles), axis=1)
                shift = int(np.fft.fftfreq(PHASES, 1.0 / PHASES)[np.argmax(np.linalg.norm(lines, axis=0))])
                exponent, shape = exponent + 1j * speed * shift, shape * np.exp(-1j * shift * angles)
            found.append((exponent, shape))
        return found


@dataclass(frozen=True, slots=True)
class Clock:
    """The angle of the shaft over time: about `speed` the speed changes by `wander` rad/s at most."""

    wander: float = 0.0
    rates: tuple[float, ...] = (0.011, 0.027, 0.041)
    begin: float = 0.0
    speed: float = 1.0

    def __call__(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """θ at times [rad]."""
        share = self.wander / len(self.rates)
        bends = [share / rate * (np.sin(rate * times + 1.3 * k) - np.sin(1.3 * k)) for k, rate in enumerate(self.rates)]
        return self.begin + self.speed * times + np.sum(bends, axis=0)


def drawn(generator: np.random.Generator, *, most: int = 3, channels: int = 0) -> System:
    """A stable system of one to `most` degrees of freedom, no mode of which decays too fast or hardly at all."""
    while True:
        n = int(generator.integers(1, most + 1))
        natural = np.exp(generator.uniform(np.log(0.2), np.log(5.0), n))
        basis = np.linalg.qr(generator.standard_normal((n, n)))[0]
        stiffness = basis @ np.diag(natural**2) @ basis.T
        damping = basis @ np.diag(2.0 * natural * np.exp(generator.uniform(np.log(0.003), np.log(0.04), n))) @ basis.T
        skew = generator.standard_normal((n, n)) * generator.choice([0.0, 0.3])
        depth = np.exp(generator.uniform(np.log(0.03), np.log(0.5)))
        root = np.sqrt(stiffness.diagonal())
        varied = [(part + part.T) * np.outer(root, root) for part in generator.standard_normal((2, n, n))]
        count = channels or int(generator.integers(1, 5))
        system = System(
            damping=damping + skew - skew.T,
            stiffness=stiffness,
            cosine=0.4 * depth * varied[0],
            sine=0.2 * depth * varied[1],
            outputs=generator.standard_normal((count, n)),
            turning=generator.standard_normal((count, n)) * generator.choice([0.0, 0.7]),
            start=np.concatenate([0.3 * generator.standard_normal(n) / natural, generator.standard_normal(n)]),
            force=np.zeros(n),
        )
        decays = -2.0 * np.pi * system.modes().exponents.real
        if DECAYS[0] < decays.min() and decays.max() < DECAYS[1]:
            return system
