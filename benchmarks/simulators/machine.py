"""A simulated machine: its steps over a period, its free responses, and the modes that these hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmarks.chain.case import Modes, beside, deviations, significant, span_of
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from floquid import Channel, ConstantPeriod, Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

DEAD = 1e-9
"""The size of a multiplier below which a deviation is over within the period, and no mode."""

STEADY = 1e-6
"""The distance of a multiplier from 1 [1] below which its mode repeats each period as the orbit does."""

SEEN = 0.1
"""The share of an exponent's decay below which the bound of its deviation lets it be seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A machine near its steady motion, and how its free responses are measured.

    Parameters
    ----------
    name
        Its name on the command line.
    period, phases, periods
        T [s], samples a period, and the length of a record in periods.
    transitions
        Φ(t_s, 0) at the samples of a period and at its end (phases + 1, states, states).
    outputs
        C(t_s) (phases, channels, states).
    blow
        Standard deviations of the initial state (states,).
    hits
        Records.
    orbit
        What is measured of the steady motion (channels, phases); None without one.
    known
        True where the orbit was measured before the blow, and the record has it.
    motion
        The free response (channels, samples) of an initial state where the machine is not linear; None where it is.
    """

    name: str
    period: float
    phases: int
    periods: int
    transitions: Floats
    outputs: Floats
    blow: Floats
    hits: int = 2
    orbit: Floats | None = None
    known: bool = False
    motion: Callable[[Floats], Floats] | None = None

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def exponents(self) -> Complexes:
        """Every exponent but those of dead deviations (modes,) [1/s]."""
        multipliers = np.linalg.eigvals(self.transitions[-1]).astype(complex)
        return np.log(multipliers[np.abs(multipliers) > DEAD]) / self.period

    def free(self, start: Floats) -> Floats:
        """The free response of an initial state (channels, samples)."""
        if self.motion is not None:
            return self.motion(start)
        seen = np.einsum("sij,sjk->sik", self.outputs, self.transitions[:-1])
        values, state = [], start
        for _ in range(self.periods):
            values.append(seen @ state)
            state = self.transitions[-1] @ state
        return np.concatenate(values).T

    def modes(self, start: Floats) -> Modes:
        """The modes of the response of an initial state, without those that repeat as the orbit does."""
        multipliers, vectors = np.linalg.eig(self.transitions[-1])
        amounts = np.linalg.solve(vectors, start.astype(complex))
        real = np.abs(multipliers.imag) < 1e-9 * np.abs(multipliers)
        kept = (np.abs(multipliers) > DEAD) & (np.abs(multipliers - 1.0) > STEADY) & (real | (multipliers.imag > 0.0))
        exponents = np.log(multipliers[kept].astype(complex)) / self.period
        times = self.period * np.arange(self.phases) / self.phases
        seen = np.einsum("sij,sjk,km->mis", self.outputs, self.transitions[:-1], vectors[:, kept])
        shapes = seen * np.exp(-np.multiply.outer(exponents, times))[:, None, :]
        # The response is twice the real part of the sum: a real multiplier is its own conjugate.
        weights = amounts[kept] * np.where(real[kept], 0.5, 1.0)
        coefficients = np.fft.fft(shapes, axis=2) / self.phases * weights[:, None, None]
        harmonics = np.rint(np.fft.fftfreq(self.phases, 1.0 / self.phases)).astype(np.int64)
        return Modes(exponents=exponents, coefficients=coefficients, harmonics=harmonics, period=self.period)

    def least(self, starts: Floats, sigma: Floats) -> tuple[Complexes, Complexes]:
        """The exponents of the modes and their Cramér-Rao deviations, conjugates both, from all hits (modes,).

        Unknown beside them are the significant harmonics of each mode's shape, its amplitude in each hit, and an orbit
        where the machine has one.
        """
        times = self.period * np.arange(self.phases * self.periods) / self.phases
        angles, hits = self.fundamental * times, [self.modes(start) for start in starts]
        first, blocks = hits[0], np.eye(len(hits))
        real, exponents = first.real, first.exponents
        sizes = [np.sum(each.coefficients * first.coefficients.conj(), axis=(1, 2)) for each in hits]
        ratios = np.array([size / sizes[0] for size in sizes])
        columns = [
            np.outer(ratios[:, mode], np.exp(exponents[mode] * times + 1j * m * angles)).ravel()
            for mode, own in enumerate(significant(first))
            for m in first.harmonics[own]
        ]
        turns = range(self.phases // 2 + 1) if self.orbit is not None else ()
        columns += [np.outer(own, np.exp(1j * turn * angles)).ravel() for turn in turns for own in blocks]
        basis, total = span_of(columns), 0.0
        decays = np.exp(np.outer(exponents, times))
        shapes = np.exp(1j * np.multiply.outer(first.harmonics, angles))
        for channel, deviation in enumerate(sigma):
            parts = np.array([2.0 * (each.coefficients[:, channel] @ shapes) * decays for each in hits])
            moved = [np.moveaxis(times * parts, 0, 1).reshape(len(exponents), -1)]
            moved += [np.einsum("h,mt->mht", own, parts[hit]).reshape(len(exponents), -1)
                      for hit, own in enumerate(blocks) if hit]  # fmt: skip
            slopes = np.concatenate([part for each in moved for part in (each.real, -each[~real].imag)])
            outside = beside(slopes, basis)
            total = total + outside @ outside.T / deviation**2
        least = deviations(np.asarray(total), real)
        return first.listed(exponents), first.listed(least)

    def records(self, noise: float, seed: int) -> tuple[list[Record], Floats, Floats]:
        """One record a hit with white noise of a share of the largest free response; initial states, deviations."""
        generator = np.random.default_rng([seed, sum(self.name.encode())])
        starts = self.blow * generator.standard_normal((self.hits, len(self.blow)))
        free = np.array([self.free(start) for start in starts])
        sigma = noise * np.abs(free).max(axis=(0, 2))
        values = free + sigma[:, None] * generator.standard_normal(free.shape)
        if self.orbit is not None:
            values = values + np.tile(self.orbit, self.periods)
        made = [
            Record(
                values=each,
                sample_rate=self.phases / self.period,
                channels=[Channel(name=f"y{number}") for number in range(len(each))],
                clock=ConstantPeriod(period=self.period),
                orbit=self.orbit if self.known else None,
            )
            for each in values
        ]
        return made, starts, sigma


def stepped(matrix: Callable[[float], Floats], period: float, phases: int) -> Floats:
    """Φ(t_s, 0) of x' = A(t) x by integration (phases + 1, states, states)."""
    size = len(matrix(0.0))
    found = solve_ivp(
        lambda t, x: (matrix(t) @ x.reshape(size, size)).ravel(),
        (0.0, period),
        np.eye(size).ravel(),
        t_eval=np.linspace(0.0, period, phases + 1),
        method="DOP853",
        rtol=1e-10,
        atol=1e-13,
    )
    return np.asarray(found.y.T.reshape(phases + 1, size, size), np.float64)


def differences(run: Callable[[Floats], Floats], start: Floats, steps: Floats) -> Floats:
    """Derivatives by an initial state of what a run gives, by central differences of fourth order (..., states)."""
    columns = []
    for number, step in enumerate(steps):
        unit = step * np.eye(len(start))[number]
        near, far = (run(start + k * unit) - run(start - k * unit) for k in (1.0, 2.0))
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)
