"""Random mechanical systems with periodic coefficients and what is measured of them, of equations of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from tests.driven import Driven, ambient_of, record_of

from floquid import Channel, ConstantPeriod, Record

Family = Literal["springs", "crank", "duffing"]
Drawn = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Stiffness, damping, and natural frequencies [rad/s] (n,)."""

QUANTITIES = ("displacement", "velocity", "acceleration")
DECAYS = (0.02, 0.4)
"""Of every mode, the least and the largest decay in a period [nepers]."""
POINTS = 256
"""Samples of a period that a Fourier series is taken from."""
LONGER = {"inputs": 3, "ambient": 8}
"""Times that a record of other excitation is longer than a free decay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    r"""Displacements u in a stiffness and a damping that turn with a period of 1 s.

    .. math:: \ddot u + D(t)\, \dot u + K(t)\, u = [f], \quad
              K(t) = K_0 + \sum_{k=1}^{H} K_k^c \cos 2\pi k t + K_k^s \sin 2\pi k t

    Parameters
    ----------
    stiffness, damping
        K₀, K₁ᶜ, K₁ˢ, … and D₀, D₁ᶜ, D₁ˢ, … (1 + 2 H, n, n).
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
        n, most = self.size, len(self.stiffness) // 2
        turns = 2.0 * np.pi * np.multiply.outer(times, np.arange(1, most + 1))
        waves = np.stack([np.cos(turns), np.sin(turns)], axis=-1).reshape(len(times), 2 * most)
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

    def excited(self, kind: str, seed: int) -> Record:
        """A record with forces u0, u1, … on every displacement, or the outputs of such forces alone ("ambient").

        Accelerations, in which the forces are seen at once, are measured as displacements.
        """
        n, quantity = self.size, "displacement" if self.quantity == "acceleration" else self.quantity
        seen = np.eye(2 * n)[slice(0, n) if quantity == "displacement" else slice(n, None)]
        forces = np.eye(2 * n)[:, n:]
        system = Driven(A=lambda t: self.system(np.array([t]))[0], B=lambda _: forces, C=lambda _: seen, period=1.0)
        channels = [Channel(name=name, quantity=quantity) for name in self.names]
        periods = LONGER[kind] * self.periods
        if kind == "ambient":
            values = ambient_of(system, periods, self.phases, self.noise, seed)
        else:
            values = np.concatenate(record_of(system, periods, self.phases, self.noise, seed))
            channels += [Channel(name=f"u{number}", quantity="force") for number in range(n)]
        clock = ConstantPeriod(period=1.0)
        return Record(values=values, sample_rate=self.phases, channels=channels, clock=clock)


def _harmonics(block: NDArray[np.float64]) -> int:
    """The highest harmonic that a block (1 + 2 H, n, n) has, above rounding."""
    sizes = np.abs(block).max(axis=(1, 2))
    return int((np.flatnonzero(sizes > 1e-9 * sizes.max())[-1] + 1) // 2)


def drawn(generator: np.random.Generator, family: Family = "springs") -> Mechanism:
    """A stable mechanism whose modes neither decay too fast nor hardly at all, measured for some tens of periods."""
    while True:
        stiffness, damping, natural = DRAWS[family](generator)
        found = Mechanism(
            stiffness=stiffness,
            damping=damping,
            start=np.concatenate(
                [0.3 * generator.standard_normal(len(natural)) / natural, generator.standard_normal(len(natural))]
            ),
            quantity=str(generator.choice(QUANTITIES)),
            periods=int(np.exp(generator.uniform(np.log(20), np.log(150)))),
            phases=int(np.ceil(5.0 * natural.max() / (2.0 * np.pi))) + 16,
            noise=float(np.exp(generator.uniform(np.log(0.002), np.log(0.02)))),
        )
        decays = -np.log(np.abs(np.linalg.eigvals(found.transition()[-1])))
        if DECAYS[0] < decays.min() and decays.max() < DECAYS[1]:
            return found


def _springs(generator: np.random.Generator) -> Drawn:
    """One to three displacements, stiffness of up to three harmonics and damping of one."""
    n = int(generator.integers(1, 4))
    natural = 2.0 * np.pi * np.exp(generator.uniform(np.log(0.3), np.log(4.0), n))
    basis = np.linalg.qr(np.eye(n) + 0.4 * generator.standard_normal((n, n)))[0]
    stiffness, damping = np.zeros((2, 7, n, n))
    stiffness[0] = basis @ np.diag(natural**2) @ basis.T
    root = np.sqrt(stiffness[0].diagonal())
    damping[0] = basis @ np.diag(2.0 * natural * np.exp(generator.uniform(np.log(0.003), np.log(0.03), n))) @ basis.T
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
    return stiffness, damping, natural


def _crank(generator: np.random.Generator) -> Drawn:
    r"""One displacement on a crank: whole series of harmonics in both blocks.

    .. math:: (J \dot u)^{\cdot} + c\, \dot u + k\, u = 0, \quad J = 1 + a \cos 4\pi t + b \cos 2\pi t
    """
    a, b = generator.uniform(0.1, 0.3), generator.uniform(0.03, 0.15)
    natural, damping = _oscillator(generator)
    turn = 2.0 * np.pi * np.arange(POINTS) / POINTS
    inertia = 1.0 + a * np.cos(2.0 * turn) + b * np.cos(turn)
    slope = -2.0 * np.pi * (2.0 * a * np.sin(2.0 * turn) + b * np.sin(turn))
    return _series(natural**2 / inertia), _series((damping + slope) / inertia), np.array([natural])


def _duffing(generator: np.random.Generator) -> Drawn:
    r"""One displacement about an orbit of a cubic spring: stiffness of even harmonics alone.

    .. math:: \ddot u + c\, \dot u + k\, (1 + 3 a x^2)\, u = 0, \quad x = \cos 2\pi t + b \cos(6\pi t + 0.4)
    """
    natural, damping = _oscillator(generator)
    a, b = generator.uniform(0.1, 0.5), generator.uniform(0.0, 0.2)
    turn = 2.0 * np.pi * np.arange(POINTS) / POINTS
    orbit = np.cos(turn) + b * np.cos(3.0 * turn + 0.4)
    return _series(natural**2 * (1.0 + 3.0 * a * orbit**2)), _series(np.full(POINTS, damping)), np.array([natural])


def _oscillator(generator: np.random.Generator) -> tuple[float, float]:
    """A natural frequency [rad/s] and a damping of 0.5 to 3 % of it."""
    natural = 2.0 * np.pi * float(np.exp(generator.uniform(np.log(0.3), np.log(3.0))))
    return natural, 2.0 * natural * float(np.exp(generator.uniform(np.log(0.005), np.log(0.03))))


def _series(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The Fourier series of one element, of its samples over a period (1 + 2 H, 1, 1)."""
    lines = np.fft.rfft(values)[: POINTS // 8] / POINTS
    return np.concatenate([[lines[0].real], np.stack([2.0 * lines.real, -2.0 * lines.imag], 1)[1:].ravel()])[
        :, None, None
    ]


DRAWS: dict[Family, Callable[[np.random.Generator], Drawn]] = {
    "springs": _springs,
    "crank": _crank,
    "duffing": _duffing,
}
