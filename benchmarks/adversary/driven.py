"""Records with measured inputs, and of outputs alone: what drives a random system, and what spoils its record."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from benchmarks.adversary.systems import PHASES, Clock, System, drawn
from benchmarks.chain.case import Case, Modes, beside, deviations, significant, span_of, tellable, wrapped
from numpy.typing import NDArray

from floquid import ConstantPeriod, Record

PERIOD = 2.0 * np.pi

SURE = 0.02
"""The share of the fundamental below which both deviations of a confident exponent are, of outputs alone: these tell
exponents some ten times worse than a decay of as many samples does."""

SPARE = 3.0
"""How far below the largest allowed one a bound must be: input vectors are taken for known in it."""

INNER = 0.05
"""The angle that the fastest natural frequency turns by in a step of the integration, at most [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Driving:
    """A system, forces on it, and the instants at which its channels are read.

    Parameters
    ----------
    system
        What is driven.
    directions
        F and F_c of (F + F_c cos θ) u (2, degrees of freedom, inputs).
    times
        Of each sample (samples,) [s].
    rate
        Samples a second.
    generator
        Of everything that is random.
    """

    system: System
    directions: NDArray[np.float64]
    times: NDArray[np.float64]
    rate: float
    generator: np.random.Generator

    def white(self, count: int) -> NDArray[np.float64]:
        """White noise of unit deviation (count, samples)."""
        return self.generator.standard_normal((count, len(self.times)))

    def states(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The states (2 degrees of freedom, samples) from rest, inputs (inputs, samples) held, by Runge and Kutta."""
        n, step = self.system.size, self.times[1] - self.times[0]
        inner = int(np.ceil(step * self.system.fastest / INNER))
        h, state = step / inner, np.zeros(2 * n)
        begins = (self.times[:, None] + h * np.arange(inner)).ravel()
        a, b = zip(*(self._matrices(begins + part * h) for part in (0.0, 0.5, 1.0)), strict=True)
        held = np.repeat(inputs.T, inner, axis=0)
        forces = [np.einsum("tij,tj->ti", own, held) for own in b]
        cubic, out = self.system.cubic, np.empty((len(self.times), 2 * n))

        def rates(part: int, number: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
            moved = a[part][number] @ x + forces[part][number]
            if cubic:
                moved[n:] -= cubic * x[:n] ** 3
            return moved

        for number in range(len(begins)):
            if number % inner == 0:
                out[number // inner] = state
            one = rates(0, number, state)
            two = rates(1, number, state + 0.5 * h * one)
            three = rates(1, number, state + 0.5 * h * two)
            state = state + h / 6.0 * (one + 2.0 * two + 2.0 * three + rates(2, number, state + h * three))
        return out.T

    def _matrices(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        n = self.system.size
        a = self.system.matrices(times, times / self.times[-1])[:, : 2 * n, : 2 * n]
        forces = self.directions[0] + self.directions[1] * np.cos(times)[:, None, None]
        return a, np.concatenate([np.zeros_like(forces), forces], axis=1)

    def response(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the channels see from rest (channels, samples)."""
        return self.system.seen(self.states(inputs), self.times)

    def noise(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The deviation of the noise (channels,), 0.5 to 10 % of each channel's own."""
        return np.exp(self.generator.uniform(np.log(0.005), np.log(0.1))) * values.std(axis=1)

    def noisy(self, values: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values with white noise."""
        return values + sigma[:, None] * self.white(len(values))

    def case(
        self,
        values: NDArray[np.float64],
        sigma: NDArray[np.float64],
        inputs: NDArray[np.float64],
        measured: NDArray[np.float64] | None = None,
        **more: object,
    ) -> Case:
        """The case with inputs: a mode must be found where the bound says so, with some to spare."""
        modes = self.system.modes()
        exponents = modes.listed(modes.exponents)
        least = modes.listed(self.bound(modes, inputs, sigma))
        least = least.real + 1j * np.abs(least.imag)
        given = inputs if measured is None else measured
        names = [f"u{number}" for number in range(len(given))]
        return Case(
            records=(self._record(values, given),),
            period=PERIOD,
            exponents=exponents,
            must=tellable(exponents, SPARE * least, modes.fundamental),
            options={"inputs": names, **more},
        )

    def alone(self, values: NDArray[np.float64], sigma: NDArray[np.float64], **more: object) -> Case:
        """The case of outputs alone: modes must be found that are above the noise, apart, and excited long enough."""
        modes = self.system.modes()
        exponents = modes.listed(modes.exponents)
        coordinates, _ = self.coordinates(modes, self.white(self.system.size))
        turned = np.exp(1j * np.multiply.outer(modes.harmonics, self.times))
        seen = 2.0 * (np.einsum("rch,hn->rcn", modes.coefficients, turned) * coordinates[:, None]).real
        strong = modes.listed((seen.std(axis=2) > sigma).any(axis=1).astype(complex)).real > 0.0
        # A process of white noise through a pole of decay σ tells it to √(2 σ / length), at best.
        least = np.sqrt(2.0 * np.abs(exponents.real) / self.times[-1]) * (1.0 + 1.0j)
        sure = np.abs(SPARE * least) < SURE * modes.fundamental
        gaps = np.abs(np.subtract.outer(exponents, exponents)) + np.diag(np.full(len(exponents), np.inf))
        apart = gaps.min(axis=1, initial=np.inf) > 5.0 * SPARE * np.abs(least)
        return Case(
            records=(self._record(values, np.empty((0, values.shape[1]))),),
            period=PERIOD,
            exponents=exponents,
            must=strong & sure & apart,
            options={"excitation": "ambient", **more},
            sure=SURE,
        )

    def bound(self, modes: Modes, inputs: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.complex128]:
        """The Cramér-Rao bound of the exponents (modes,), input vectors known and shapes unknown."""
        coordinates, slopes = self.coordinates(modes, inputs)
        shapes = np.exp(1j * np.multiply.outer(modes.harmonics, self.times))
        columns = [
            one * shapes[m]
            for one, own in zip(coordinates, significant(modes), strict=True)
            for m in np.flatnonzero(own)
        ]
        basis, total = span_of(columns), np.zeros(())
        for channel, deviation in enumerate(sigma):
            moved = 2.0 * slopes * (modes.coefficients[:, channel] @ shapes)
            outside = beside(np.concatenate([moved.real, -moved[~modes.real].imag]), basis)
            total = total + outside @ outside.T / deviation**2
        return deviations(total, modes.real)

    def coordinates(
        self, modes: Modes, inputs: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Each mode's coordinate and its derivative with respect to λ (modes, samples).

        The coordinate is that of shapes of which the response is twice the real part: the true one, from the states.
        """
        from scipy.signal import lfilter

        states, step = self.states(inputs), self.times[1] - self.times[0]
        lines = np.array([np.fft.fft(shape, axis=1) / PHASES for _, shape in self.system.shapes()])
        turned = np.exp(1j * np.multiply.outer(np.fft.fftfreq(PHASES, 1.0 / PHASES), self.times))
        # A real multiplier stands once in the states, and as twice the real part of its half in the response.
        vectors = (lines @ turned) * (1.0 + modes.real)[:, None, None]
        whole = np.concatenate([vectors, vectors[~modes.real].conj()]).transpose(2, 1, 0)
        found = np.linalg.solve(whole, states.T[:, :, None].astype(complex))[:, : len(vectors), 0].T
        slopes = np.empty_like(found)
        for row, exponent in enumerate(modes.exponents):
            ahead = np.exp(exponent * step)
            # z' = λ z + w has ∂z/∂λ' = λ ∂z/∂λ + z.
            slopes[row] = lfilter([0.0, step * ahead], [1.0, -ahead], found[row])
        return found, slopes

    def _record(self, values: NDArray[np.float64], inputs: NDArray[np.float64]) -> Record:
        names = [f"y{number}" for number in range(len(values))] + [f"u{number}" for number in range(len(inputs))]
        return Record(
            values=np.concatenate([values, inputs]),
            sample_rate=self.rate,
            channels=names,
            clock=ConstantPeriod(period=PERIOD),
        )


def setting(generator: np.random.Generator, *, step: float = 0.0, alone: bool = False, most: int = 3) -> Driving:
    """A system with one or two forces; records of 40 to 150 periods, of outputs alone 300 to 800 with all forces."""
    system = drawn(generator, most=most, channels=int(generator.integers(2, 4)) if alone else 0)
    phases = int(np.clip(np.ceil(5.0 * system.fastest), 16, 48)) + step
    periods = generator.integers(300, 800) if alone else generator.integers(40, 150)
    forces = system.size if alone else int(generator.integers(1, min(system.size, 2) + 1))
    directions = generator.standard_normal((2, system.size, forces))
    directions[1] *= generator.choice([0.0, 0.5])
    return Driving(
        system=system,
        directions=directions,
        times=PERIOD / phases * np.arange(int(periods * phases)),
        rate=phases / PERIOD,
        generator=generator,
    )


def _driven(own: Driving, inputs: NDArray[np.float64] | None = None) -> tuple[NDArray[np.float64], ...]:
    """Inputs, white unless given, the response to them, and the deviation of its noise."""
    given = own.white(own.directions.shape[2]) if inputs is None else inputs
    values = own.response(given)
    return given, values, own.noise(values)


def forced(generator: np.random.Generator) -> Case:
    """White noise on measured forces, and on what is measured."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    return own.case(own.noisy(values, sigma), sigma, inputs)


def swept(generator: np.random.Generator) -> Case:
    """Forces that sweep through frequencies, each at another pace."""
    own = setting(generator)
    share, last = own.times / own.times[-1], 1.5 * own.system.fastest
    paces = generator.uniform(0.6, 1.0, own.directions.shape[2])
    turns = [pace * last * own.times[-1] * (0.02 * share + 0.5 * share**2) for pace in paces]
    inputs, values, sigma = _driven(own, np.sin(turns))
    return own.case(own.noisy(values, sigma), sigma, inputs)


def coloured(generator: np.random.Generator) -> Case:
    """Noise of a first-order autoregression on what is measured."""
    from scipy.signal import lfilter

    own, colour = setting(generator), generator.uniform(-0.7, 0.95)
    inputs, values, sigma = _driven(own)
    drawn_noise = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], own.white(len(values)), axis=1)
    # In its own colour a mode may be far worse determined than in white noise as large.
    return own.case(values + sigma[:, None] * drawn_noise, 4.0 * sigma, inputs)


def late(generator: np.random.Generator) -> Case:
    """Forces that begin after a tenth to a half of the record; noise alone before."""
    own = setting(generator)
    inputs = own.white(own.directions.shape[2])
    inputs[:, : int(generator.uniform(0.1, 0.5) * inputs.shape[1])] = 0.0
    inputs, values, sigma = _driven(own, inputs)
    return own.case(own.noisy(values, sigma), sigma, inputs)


def missing(generator: np.random.Generator) -> Case:
    """0.2 to 5 % of the samples of the response missing, one by one."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    values = own.noisy(values, sigma)
    values[generator.random(values.shape) < np.exp(generator.uniform(np.log(0.002), np.log(0.05)))] = np.nan
    return own.case(values, sigma, inputs)


def hum(generator: np.random.Generator) -> Case:
    """A steady tone that has nothing to do with the shaft, half the noise's deviation to fivefold."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    tone = np.exp(generator.uniform(np.log(0.5), np.log(5.0))) * sigma[:, None] * np.sqrt(2.0)
    turns = generator.uniform(0.3, 0.45) * own.rate * 2.0 * np.pi * own.times
    values = own.noisy(values, sigma) + tone * np.cos(turns + generator.uniform(0.0, 6.0, (len(values), 1)))
    return own.case(values, sigma, inputs)


def out_of_step(generator: np.random.Generator) -> Case:
    """A rate that is no whole number a period."""
    own = setting(generator, step=float(generator.uniform(0.05, 0.95)))
    inputs, values, sigma = _driven(own)
    return own.case(own.noisy(values, sigma), sigma, inputs)


def noisy_inputs(generator: np.random.Generator) -> Case:
    """Noise of 0.5 to 5 % on the measured forces."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    share = np.exp(generator.uniform(np.log(0.005), np.log(0.05)))
    return own.case(own.noisy(values, sigma), sigma, inputs, inputs + share * own.white(len(inputs)))


def shaken(generator: np.random.Generator) -> Case:
    """Forces that nobody measured, too, 1 to 10 % of those that are."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    others = replace(own, directions=generator.standard_normal((2, own.system.size, own.system.size)))
    besides = others.response(own.white(own.system.size))
    share = np.exp(generator.uniform(np.log(0.01), np.log(0.1))) * values.std() / besides.std()
    return own.case(own.noisy(values + share * besides, sigma), sigma, inputs)


def drifting(generator: np.random.Generator) -> Case:
    """Frequencies that move by 0.02 to 0.13 % over the record."""
    own = setting(generator)
    by = np.exp(generator.uniform(np.log(2e-4), np.log(1.3e-3)))
    moving = replace(own, system=replace(own.system, drift=by))
    inputs, values, sigma = _driven(moving)
    return _between(own.case(own.noisy(values, sigma), sigma, inputs), own.system, by)


def _between(case: Case, system: System, by: float) -> Case:
    """The case with bounds as wide as its exponents move: any value in between is right."""
    modes = replace(system, stiffness=system.stiffness * (1.0 + 2.0 * by)).modes()
    gaps = np.subtract.outer(case.exponents, modes.listed(modes.exponents))
    gaps = np.abs(gaps.real) + 1j * np.abs(wrapped(gaps.imag, case.fundamental))
    return replace(case, slack=gaps[np.arange(len(gaps)), np.abs(gaps).argmin(axis=1)])


def cubic(generator: np.random.Generator) -> Case:
    """A cubic stiffness that is 0.1 to 1 % of the linear one at the response's deviation."""
    own = setting(generator, most=2)
    inputs = own.white(own.directions.shape[2])
    share = np.exp(generator.uniform(np.log(0.001), np.log(0.01)))
    size = own.states(inputs)[: own.system.size].std()
    by = share * np.median(own.system.stiffness.diagonal()) / size**2
    bent = replace(own, system=replace(own.system, cubic=by))
    values = bent.response(inputs)
    sigma = own.noise(values)
    case = own.case(own.noisy(values, sigma), sigma, inputs)
    # A cubic spring is, in the mean over a normal response, one of three times the square of its deviation.
    return replace(case, slack=np.abs(case.exponents.imag) * share * (0.5 + 2.0j))


def clipped(generator: np.random.Generator) -> Case:
    """One channel clipped at 40 to 90 % of its largest value."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    values = own.noisy(values, sigma)
    most = generator.uniform(0.4, 0.9) * np.abs(values[0]).max()
    values[0] = np.clip(values[0], -most, most)
    return own.case(values, sigma, inputs)


def spiked(generator: np.random.Generator) -> Case:
    """One to twenty samples that have nothing to do with the response."""
    own = setting(generator)
    inputs, values, sigma = _driven(own)
    values = own.noisy(values, sigma)
    count = int(generator.integers(1, 21))
    rows, columns = generator.integers(0, len(values), count), generator.integers(0, values.shape[1], count)
    values[rows, columns] += generator.choice([-1.0, 1.0], count) * generator.uniform(2.0, 10.0, count) * values.std()
    return own.case(values, sigma, inputs)


def _ambient(own: Driving) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The response to white forces that nobody measures, and the deviation of its noise."""
    values = own.response(own.white(own.system.size))
    return values, own.noise(values)


def alone(generator: np.random.Generator) -> Case:
    """White forces that nobody measures."""
    own = setting(generator, alone=True)
    values, sigma = _ambient(own)
    return own.alone(own.noisy(values, sigma), sigma)


def alone_missing(generator: np.random.Generator) -> Case:
    """The same, with 0.2 to 2 % of the samples missing, one by one."""
    own = setting(generator, alone=True)
    values, sigma = _ambient(own)
    values = own.noisy(values, sigma)
    values[generator.random(values.shape) < np.exp(generator.uniform(np.log(0.002), np.log(0.02)))] = np.nan
    return own.alone(values, sigma)


def alone_hum(generator: np.random.Generator) -> Case:
    """The same, with a steady tone of another machine, a tenth of the response to as much as it."""
    own = setting(generator, alone=True)
    values, sigma = _ambient(own)
    tone = np.exp(generator.uniform(np.log(0.1), 0.0)) * values.std(axis=1, keepdims=True) * np.sqrt(2.0)
    turns = generator.uniform(0.3, 0.45) * own.rate * 2.0 * np.pi * own.times
    values = own.noisy(values, sigma) + tone * np.cos(turns + generator.uniform(0.0, 6.0, (len(values), 1)))
    return own.alone(values, sigma)


def alone_orbit(generator: np.random.Generator) -> Case:
    """The same, about the response to a force that turns with the shaft."""
    own = setting(generator, alone=True)
    values, sigma = _ambient(own)
    force = replace(own.system, force=generator.standard_normal(own.system.size))
    still = force.seen(force.moved(own.times, Clock(), np.append(force.orbit(), 1.0)), own.times)
    values = values + generator.uniform(0.3, 3.0) * values.std() / still.std() * still
    return own.alone(own.noisy(values, sigma), sigma)


def alone_drifting(generator: np.random.Generator) -> Case:
    """The same, with frequencies that move by 0.1 to 1 % over the record."""
    own = setting(generator, alone=True)
    by = np.exp(generator.uniform(np.log(1e-3), np.log(1e-2)))
    values, sigma = _ambient(replace(own, system=replace(own.system, drift=by)))
    return _between(own.alone(own.noisy(values, sigma), sigma), own.system, by)


def alone_coloured(generator: np.random.Generator) -> Case:
    """The same, with forces behind a low-pass filter of the first order; its pole is one of the answer."""
    from scipy.signal import lfilter

    own = setting(generator, alone=True)
    pole = np.exp(-generator.uniform(1.0, 4.0) * own.system.fastest / own.rate)
    forces = lfilter([1.0 - pole], [1.0, -pole], own.white(own.system.size), axis=1)
    values = own.response(forces)
    sigma = own.noise(values)
    case = own.alone(own.noisy(values, sigma), sigma)
    filters = np.full(own.system.size, np.log(pole) * own.rate, complex)
    return replace(
        case,
        exponents=np.append(case.exponents, filters),
        must=np.append(case.must, np.zeros(len(filters), bool)),
    )


def alone_halved(generator: np.random.Generator) -> Case:
    """The same, with twice the frequency of the shaft declared."""
    own = setting(generator, alone=True)
    values, sigma = _ambient(own)
    case = own.alone(own.noisy(values, sigma), sigma, period=PERIOD / 2.0)
    return replace(case, must=np.zeros(len(case.must), bool))
