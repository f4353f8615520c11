"""Random mechanical systems with periodic coefficients and what is measured of them, of equations of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from floquid import Channel, ConstantPeriod, Record

QUANTITIES = ("displacement", "velocity", "acceleration")
DECAYS = (0.02, 0.4)
"""Of every mode, the least and the largest decay in a period [nepers]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    r"""Displacements u in a stiffness and a damping that turn with a period of 1 s.

    .. math:: \ddot u + D(t)\, \dot u + K(t)\, u = 0, \quad
              K(t) = K_0 + \sum_{k=1}^{3} K_k^c \cos 2\pi k t + K_k^s \sin 2\pi k t

    Parameters
    ----------
    stiffness, damping
        K₀, K₁ᶜ, K₁ˢ, … and D₀, D₁ᶜ, D₁ˢ, … (7, n, n).
    start
        u and its rate after the blow (2 n,).
    quantity
        What the channels measure of u.
    periods, phases
        The length of the record, and samples a period.
    noise
        Its deviation, over the largest value of each channel.
    """

    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    start: NDArray[np.float64]
    quantity: str
    periods: int
    phases: int
    noise: float

    @property
    def size(self) -> int:
        """The number n of displacements."""
        return self.stiffness.shape[1]

    @property
    def names(self) -> list[str]:
        """The channels."""
        return [f"y{number}" for number in range(self.size)]

    @property
    def kept(self) -> tuple[int, bool, int]:
        """Harmonics of the stiffness, True where it is symmetric, and harmonics of the damping."""
        symmetric = bool(np.allclose(self.stiffness, np.swapaxes(self.stiffness, 1, 2)))
        return _harmonics(self.stiffness), symmetric, _harmonics(self.damping)

    def system(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """A of u and its rate at times (times, 2 n, 2 n) [1/s]."""
        n, turns = self.size, 2.0 * np.pi * np.multiply.outer(times, np.arange(1, 4))
        waves = np.stack([np.cos(turns), np.sin(turns)], axis=-1).reshape(len(times), 6)
        waves = np.concatenate([np.ones((len(times), 1)), waves], axis=1)
        a = np.zeros((len(times), 2 * n, 2 * n))
        a[:, :n, n:] = np.eye(n)
        a[:, n:, :n] = -np.tensordot(waves, self.stiffness, 1)
        a[:, n:, n:] = -np.tensordot(waves, self.damping, 1)
        return a

    def transition(self) -> NDArray[np.float64]:
        """Φ(t, 0) at the samples of a period and its end (phases + 1, 2 n, 2 n)."""
        n = 2 * self.size

        def rates(t: float, flat: NDArray[np.float64]) -> NDArray[np.float64]:
            return (self.system(np.array([t]))[0] @ flat.reshape(n, n)).ravel()

        at = np.linspace(0.0, 1.0, self.phases + 1)
        found = solve_ivp(rates, (0.0, 1.0), np.eye(n).ravel(), t_eval=at, method="DOP853", rtol=1e-10, atol=1e-12)
        return np.moveaxis(found.y.reshape(n, n, -1), -1, 0)

    def record(self, generator: np.random.Generator) -> Record:
        """The record with white noise."""
        n, phi = self.size, self.transition()
        starts = [self.start]
        for _ in range(self.periods - 1):
            starts.append(phi[-1] @ starts[-1])
        states = np.einsum("pij,cj->cpi", phi[:-1], np.array(starts))
        if self.quantity == "acceleration":
            rows = self.system(np.arange(self.phases) / self.phases)[:, n:]
            seen = np.einsum("pij,cpj->icp", rows, states).reshape(n, -1)
        else:
            rows = slice(0, n) if self.quantity == "displacement" else slice(n, None)
            seen = states[..., rows].reshape(-1, n).T
        sigma = self.noise * np.abs(seen).max(axis=1, keepdims=True)
        return Record(
            values=seen + sigma * generator.standard_normal(seen.shape),
            sample_rate=self.phases,
            channels=[Channel(name=name, quantity=self.quantity) for name in self.names],
            clock=ConstantPeriod(period=1.0),
        )


def _harmonics(block: NDArray[np.float64]) -> int:
    """The highest harmonic that a block (7, n, n) has."""
    return int((np.flatnonzero(np.abs(block).max(axis=(1, 2)))[-1] + 1) // 2)


def drawn(generator: np.random.Generator) -> Mechanism:
    """A stable mechanism of one to three displacements, whose modes neither decay too fast nor hardly at all."""
    while True:
        n = int(generator.integers(1, 4))
        natural = 2.0 * np.pi * np.exp(generator.uniform(np.log(0.3), np.log(4.0), n))
        basis = np.linalg.qr(np.eye(n) + 0.4 * generator.standard_normal((n, n)))[0]
        stiffness, damping = np.zeros((2, 7, n, n))
        stiffness[0] = basis @ np.diag(natural**2) @ basis.T
        root = np.sqrt(stiffness[0].diagonal())
        damping[0] = (
            basis @ np.diag(2.0 * natural * np.exp(generator.uniform(np.log(0.003), np.log(0.03), n))) @ basis.T
        )
        depth = np.exp(generator.uniform(np.log(0.03), np.log(0.4)))
        for k in range(1, 1 + generator.integers(0, 4)):
            for part in (2 * k - 1, 2 * k):
                wave = generator.standard_normal((n, n))
                stiffness[part] = 0.25 * depth ** (0.5 + 0.5 * k) * (wave + wave.T) * np.outer(root, root)
        if generator.random() < 0.15:
            stiffness[0] += 0.1 * generator.standard_normal((n, n)) * np.outer(root, root)
        swing = generator.choice([0.0, 0.1, 0.5])
        for part in (1, 2):
            wave = generator.standard_normal((n, n))
            damping[part] = 0.5 * swing * (wave + wave.T) * np.sqrt(np.outer(*2 * [damping[0].diagonal()]))
        if n > 1 and generator.random() < 0.5:
            skew = 0.4 * generator.standard_normal((n, n))
            damping[0] += skew - skew.T
        found = Mechanism(
            stiffness=stiffness,
            damping=damping,
            start=np.concatenate([0.3 * generator.standard_normal(n) / natural, generator.standard_normal(n)]),
            quantity=str(generator.choice(QUANTITIES)),
            periods=int(np.exp(generator.uniform(np.log(20), np.log(150)))),
            phases=int(np.ceil(5.0 * natural.max() / (2.0 * np.pi))) + 16,
            noise=float(np.exp(generator.uniform(np.log(0.002), np.log(0.02)))),
        )
        decays = -np.log(np.abs(np.linalg.eigvals(found.transition()[-1])))
        if DECAYS[0] < decays.min() and decays.max() < DECAYS[1]:
            return found
