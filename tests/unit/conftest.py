"""Known systems with their modes by oracle, and estimates of their response whose errors have a known law.

The errors are drawn from the law that `Estimates` states, so that what is said of anything computed from them can be
held against brute force without a record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from floquid import floquet
from floquid.core import Channel, Estimates, PeriodicModel
from floquid.floquet import FunctionMatrix

QUANTITIES = ("displacement", "velocity", "acceleration")


@dataclass(frozen=True)
class Sensor:
    """What a channel sees: a sum of states of A(t), or its derivative of some order."""

    sees: tuple[float, ...]
    derivative: int = 0


@dataclass(frozen=True)
class System:
    """x' = A(t) x; with `half`, of second order and so many displacements."""

    matrix: Callable[[NDArray], NDArray]
    period: float = 2.0
    half: int = 0

    @property
    def fundamental(self) -> float:
        return 2.0 * np.pi / self.period

    def at(self, times) -> NDArray:
        return self.matrix(np.atleast_1d(np.asarray(times, float)))

    def oracle(self, period: float | None = None) -> FunctionMatrix:
        return FunctionMatrix(function=self.matrix, period=period or self.period, vectorised=True)

    @staticmethod
    def second_order(stiffness, damping, period=2.0) -> System:
        """From lists of matrices: constant, cos 1, sin 1, cos 2, ..."""
        k, d = (np.array(block, float) for block in (stiffness, damping))
        k, d = (np.concatenate([block, np.zeros_like(block[: (len(block) + 1) % 2])]) for block in (k, d))
        n, fundamental = k.shape[-1], 2.0 * np.pi / period

        def waves(times, count):
            orders = np.arange(1, count // 2 + 1)
            both = [f(fundamental * m * times) for m in orders for f in (np.cos, np.sin)]
            return np.stack([np.ones_like(times), *both], axis=-1)

        def matrix(times):
            times = np.asarray(times, float)
            out = np.zeros((*times.shape, 2 * n, 2 * n))
            out[..., :n, n:] = np.eye(n)
            out[..., n:, :n] = -np.tensordot(waves(times, len(k)), k, 1)
            out[..., n:, n:] = -np.tensordot(waves(times, len(d)), d, 1)
            return out

        return System(matrix, period, n)


@dataclass(frozen=True)
class Known:
    """A system seen by sensors after some hits, and the law of the errors of its estimates."""

    system: System
    sensors: tuple[Sensor, ...]
    amplitudes: NDArray
    """(modes of the estimates, hits)."""
    model: PeriodicModel
    """Without errors, with its estimates."""

    @property
    def estimates(self) -> Estimates:
        assert self.model.estimates is not None
        return self.model.estimates

    @property
    def free(self) -> NDArray[np.intp]:
        """Which of p are parameters."""
        return np.flatnonzero(np.diag(self.estimates.covariance) > 0)

    def parts(self) -> NDArray:
        """All errors that there are, as columns that a unit normal number each multiplies: p, then each row's."""
        own = self.estimates
        blocks = [np.linalg.cholesky(own.covariance[np.ix_(self.free, self.free)])]
        return blocks[0]

    def drawn(self, generator: np.random.Generator) -> PeriodicModel:
        """A model with errors."""
        own, n = self.estimates, len(self.estimates.modes)
        off = np.zeros(len(own.covariance))
        off[self.free] = self.parts() @ generator.standard_normal(len(self.free))
        noise = np.zeros(own.coefficients.shape, complex)
        used = np.concatenate([np.ones(n, bool), own.turning])
        for row in np.ndindex(*own.blocks.shape):
            root = np.zeros((2 * n, int(used.sum())))
            root[used] = np.linalg.cholesky(own.spread[own.blocks[row]][np.ix_(used, used)])
            both = root @ generator.standard_normal(root.shape[1])
            noise[(slice(None), *row)] = both[:n] + 1j * both[n:]
        return self.moved(off, own.slopes @ off + own.scales * noise)

    def each(self, step: float) -> Iterator[tuple[PeriodicModel, PeriodicModel]]:
        """Models moved up and down by `step` deviations along independent errors that make the whole covariance."""
        own, n = self.estimates, len(self.estimates.modes)
        for column in self.parts().T:
            off = np.zeros(len(own.covariance))
            off[self.free] = step * column
            shift = own.slopes @ off
            yield self.moved(off, shift), self.moved(-off, -shift)
        used = np.concatenate([np.ones(n, bool), own.turning])
        for row in np.ndindex(*own.blocks.shape):
            root = np.zeros((2 * n, int(used.sum())))
            root[used] = np.linalg.cholesky(own.spread[own.blocks[row]][np.ix_(used, used)])
            for column in root.T:
                shift = np.zeros(own.coefficients.shape, complex)
                at = (slice(None), *row)
                shift[at] = step * own.scales[at] * (column[:n] + 1j * column[n:])
                yield (
                    self.moved(np.zeros(len(own.covariance)), shift),
                    self.moved(np.zeros(len(own.covariance)), -shift),
                )

    def moved(self, off: NDArray, shift: NDArray) -> PeriodicModel:
        """The model with other p and B (real parts, imaginary parts, ω) and (terms, channels, hits)."""
        own, count = self.estimates, len(self.estimates.exponents)
        fundamental = own.fundamental + off[-1]
        exponents = own.exponents + off[:count] + 1j * np.where(own.real, 0.5 * own.half_turns * off[-1], off[count:-1])
        other = replace(own, exponents=exponents, fundamental=fundamental, coefficients=own.coefficients + shift)
        return model_of(other, self.model)

    def variances(self, function: Callable[[PeriodicModel], NDArray], step: float = 1e-3) -> NDArray:
        """The variance of anything that a model gives, to first order, by differences of the function itself."""
        total = 0.0
        for up, down in self.each(step):
            total = total + ((function(up) - function(down)) / (2.0 * step)) ** 2
        return np.asarray(total)


def model_of(estimates: Estimates, like: PeriodicModel | None, channels: Sequence[Channel] = ()) -> PeriodicModel:
    """The model of estimates, conjugates and mirror images set beside them."""
    own = estimates
    mirror = -own.half_turns[own.modes] - own.harmonics
    whole = np.concatenate([own.harmonics, -own.harmonics, mirror])
    width = int(np.abs(whole).max())
    rows, exponents = [], []
    for mode, lam in enumerate(own.exponents):
        shape = np.zeros((*own.blocks.shape, 2 * width + 1), complex)
        for k in np.flatnonzero(own.modes == mode):
            if own.real[mode]:
                shape[..., mirror[k] + width] = own.coefficients[k].conj()
            shape[..., own.harmonics[k] + width] = own.coefficients[k]
        rows.append(shape)
        exponents.append(lam)
        if not own.real[mode]:
            rows.append(shape[..., ::-1].conj())
            exponents.append(lam.conjugate())
    std = own.std()
    deviations = np.zeros((len(rows), *own.blocks.shape, 2 * width + 1), complex)
    place = 0
    parts = []
    for mode in range(len(own.exponents)):
        for k in np.flatnonzero(own.modes == mode):
            for m in {own.harmonics[k], mirror[k]} if own.real[mode] else {own.harmonics[k]}:
                deviations[place, ..., m + width] = std[k]
            if not own.real[mode]:
                deviations[place + 1, ..., width - own.harmonics[k]] = std[k]
        parts += [(mode, 1.0)] if own.real[mode] else [(mode, 1.0), (mode, -1.0)]
        place += 1 if own.real[mode] else 2
    count = len(own.exponents)
    of_parts = np.zeros((2 * len(rows), 2 * count + 1))
    for r, (mode, sign) in enumerate(parts):
        of_parts[r, mode] = 1.0
        if own.real[mode]:
            of_parts[len(rows) + r, -1] = 0.5 * own.half_turns[mode]
        else:
            of_parts[len(rows) + r, count + mode] = sign
    return PeriodicModel(
        exponents=exponents,
        coefficients=rows,
        harmonics=np.arange(-width, width + 1),
        period=2.0 * np.pi / own.fundamental,
        channels=like.channels if like is not None else channels,
        covariance=of_parts @ own.covariance @ of_parts.T,
        coefficient_std=deviations,
        estimates=own,
    )


def spread_of(generator, n: int, turning: NDArray) -> NDArray:
    """A random covariance (2n, 2n) near the identity, zero where a term does not turn."""
    root = np.eye(2 * n) + 0.3 * generator.standard_normal((2 * n, 2 * n)) / np.sqrt(n)
    root[n:][~turning] = 0.0
    return root @ root.T


@cache
def modes_of(system: System):
    return floquet.modes(system.oracle())


def make_known(
    system: System,
    sensors: Sequence[Sensor],
    *,
    width: int = 3,
    hits: int = 1,
    size: float = 1e-6,
    free_period: bool = False,
    seed: int = 0,
    units: Sequence[float] | None = None,
    turns: Sequence[int] = (),
) -> Known:
    """A system seen by sensors; `size` is the deviation of a coefficient over the channel's largest coefficient.

    `turns` moves the exponents of the estimates to other branches.
    """
    generator = np.random.default_rng(seed)
    found, omega = modes_of(system), system.fundamental
    twice = 2.0 * found.exponents.imag / omega
    principal = np.abs(found.multipliers.imag) < 1e-9 * np.abs(found.multipliers)
    chosen = np.flatnonzero(principal | (found.exponents.imag > 0))
    real = principal[chosen]
    lam = found.exponents[chosen]
    lam = np.where(real, lam.real + 0.5j * omega * np.rint(twice[chosen]), lam)
    shapes = found.coefficients[chosen]
    shift = np.zeros(len(chosen), int)
    shift[: len(turns)] = turns
    modes, harmonics, values = [], [], []
    gains = np.ones(len(sensors)) if units is None else np.asarray(units, float)
    for mode, branch in enumerate(shift):
        rates = lam[mode] + 1j * omega * found.harmonics
        seen = np.array([np.array(one.sees) @ shapes[mode] * rates**one.derivative for one in sensors])
        seen = seen * gains[:, None]
        kappa = int(np.rint(2.0 * lam[mode].imag / omega)) if real[mode] else 0
        if real[mode]:
            strongest = int(np.argmax(np.abs(shapes[mode]).sum(axis=0)))
            image = int(np.flatnonzero(found.harmonics == -kappa - found.harmonics[strongest])[0])
            state = int(np.argmax(np.abs(shapes[mode][:, strongest])))
            turned = np.sqrt(shapes[mode][state, strongest] * shapes[mode][state, image])
            seen = seen * np.abs(turned) / turned
        lam[mode] += 1j * omega * branch
        kappa += 2 * branch if real[mode] else 0
        for m in range(-width - branch, width - branch + 1):
            if real[mode] and 2 * m + kappa < 0:
                continue
            modes.append(mode)
            harmonics.append(m)
            values.append(seen[:, found.harmonics == m + branch][:, 0])
    modes, harmonics = np.array(modes), np.array(harmonics)
    amplitudes = generator.standard_normal((len(lam), hits)) + 1j * generator.standard_normal((len(lam), hits))
    amplitudes[real] = 1.0 + np.abs(amplitudes[real])
    amplitudes[~real] += 1.5 * amplitudes[~real] / np.abs(amplitudes[~real])
    coefficients = np.array(values)[:, :, None] * amplitudes[modes][:, None, :]
    n, parts = len(modes), 2 * len(lam) + 1
    half = np.where(real, np.rint(2.0 * lam.imag / omega), 0).astype(int)
    turning = ~(real[modes] & (2 * harmonics + half[modes] == 0))
    assert np.abs(coefficients[~turning].imag).max(initial=0.0) < 1e-8 * np.abs(coefficients).max()
    coefficients[~turning] = coefficients[~turning].real
    largest = np.abs(coefficients).max(axis=0)
    free = np.concatenate([np.arange(len(lam)), len(lam) + np.flatnonzero(~real), [parts - 1] * free_period]).astype(
        int
    )
    root = np.zeros((parts, len(free)))
    root[free] = np.eye(len(free)) + 0.4 * generator.standard_normal((len(free), len(free)))
    root *= 0.3 * size * omega
    slopes = generator.standard_normal((*coefficients.shape, parts)) + 1j * generator.standard_normal(
        (*coefficients.shape, parts)
    )
    slopes *= largest[None, :, :, None] / omega
    slopes[..., np.setdiff1d(np.arange(parts), free)] = 0.0
    slopes[~turning] = slopes[~turning].real
    factors = 0.5 + generator.random(coefficients.shape) + 1j * generator.standard_normal(coefficients.shape)
    factors[~turning] = factors[~turning].real
    estimates = Estimates(
        exponents=lam,
        real=real,
        fundamental=omega,
        modes=modes,
        harmonics=harmonics,
        coefficients=coefficients,
        covariance=root @ root.T,
        slopes=slopes,
        spread=np.array([spread_of(generator, n, turning) for _ in range(2)]),
        blocks=generator.integers(0, 2, coefficients.shape[1:]),
        scales=size * largest * factors,
    )
    channels = [
        Channel(name=f"c{i}", quantity=QUANTITIES[sensor.derivative] if system.half else "other")
        for i, sensor in enumerate(sensors)
    ]
    return Known(system, tuple(sensors), amplitudes, model_of(estimates, None, channels))


def displacements(count: int, derivatives: Sequence[int] = (0,)) -> list[Sensor]:
    """One sensor of each displacement for each derivative."""
    return [Sensor(tuple(np.eye(2 * count)[i]), p) for p in derivatives for i in range(count)]


K = np.array([[14.0, 3.0], [3.0, 29.0]])
CLOSE = np.array([[6.0, 1.0], [1.0, 11.0]])
SYSTEMS = {
    "pairs": System.second_order(
        [K, [[2.0, 0.7], [0.7, -1.5]], [[0.5, 1.2], [1.2, 0.4]]], [[[0.20, 0.03], [0.03, 0.32]]]
    ),
    "gyroscopic": System.second_order(
        [K, [[2.0, 0.7], [0.7, -1.5]], [[0.5, 1.2], [1.2, 0.4]]], [[[0.20, 0.93], [-0.87, 0.32]]]
    ),
    "one": System.second_order([[[5.0]], [[1.0]], [[0.4]]], [[[0.3]]]),
    "growing": System.second_order([K, [[2.0, 0.7], [0.7, -1.5]]], [[[-0.10, 0.03], [0.03, 0.25]]]),
    # x'' + 2ζx' + (a - 2q cos 2t)x = 0 in its tongue: both multipliers negative.
    "locked": System.second_order([[[1.0]], [[-0.4]]], [[[0.3]]], period=np.pi),
    "overdamped": System.second_order([[[1.0]], [[0.3]], [[0.1]]], [[[2.6]]]),
    # Flapping, γ = 12, μ = 0.3.
    "blade": System.second_order(
        [[[1.0]], [[0.6]], [[0.0]], [[0.0]], [[0.135]]], [[[1.5]], [[0.0]], [[0.6]]], period=2.0 * np.pi
    ),
    "pair and real": System.second_order(
        [np.diag([14.0, 2.0]) + 0.5, [[2.0, 0.3], [0.3, 0.2]]], [[[0.3, 0.05], [0.05, 3.5]]]
    ),
}


class Oracle:
    """What the tests take from here."""

    System = System
    Sensor = Sensor
    systems = SYSTEMS
    known = staticmethod(make_known)
    displacements = staticmethod(displacements)
    model_of = staticmethod(model_of)


@pytest.fixture(scope="session")
def oracle() -> type[Oracle]:
    return Oracle
