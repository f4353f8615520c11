"""Kinds of records: what is measured of a random system, and what spoils it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.adversary import driven
from benchmarks.adversary.systems import Clock, System, drawn
from benchmarks.chain.case import Case, Modes, bound, tellable, wrapped
from numpy.typing import NDArray

from floquid import ConstantPeriod, Record

PERIOD = 2.0 * np.pi


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of record: how a case is made of a generator, how many are run, and what an answer may be.

    Parameters
    ----------
    make
        The case of a generator of random numbers.
    runs
        How many of the 980.
    measured
        True with a measured clock or a rate out of step.
    benign
        True where a right model must pass and a refusal is a fault.
    """

    make: Callable[[np.random.Generator], Case]
    runs: int
    measured: bool = False
    benign: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A system, its modes, and the instants at which its channels are read."""

    system: System
    modes: Modes
    times: NDArray[np.float64]
    clock: Clock
    rate: float
    generator: np.random.Generator

    @property
    def angles(self) -> NDArray[np.float64]:
        """θ (samples,) [rad]."""
        return self.clock(self.times)

    def free(self) -> NDArray[np.float64]:
        """The free response (channels, samples)."""
        return replace(self.system, force=0.0 * self.system.force).response(self.times, self.clock)

    def noise(self, values: NDArray[np.float64], share: float | None = None) -> NDArray[np.float64]:
        """The deviation of the noise (channels,), 0.2 to 3 % of each channel's largest value."""
        share = np.exp(self.generator.uniform(np.log(0.002), np.log(0.03))) if share is None else share
        return share * np.abs(values).max(axis=1)

    def white(self, values: NDArray[np.float64], sigma: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values with white noise."""
        return values + sigma[:, None] * self.generator.standard_normal(values.shape)

    def record(self, values: NDArray[np.float64]) -> Record:
        """The record of constant period of values (channels, samples)."""
        names = [f"y{number}" for number in range(len(values))]
        return Record(values=values, sample_rate=self.rate, channels=names, clock=ConstantPeriod(period=PERIOD))

    def case(
        self, values: NDArray[np.float64], sigma: NDArray[np.float64], turns: tuple[float, ...] = (), **more: object
    ) -> Case:
        """The case of one record of constant period."""
        return self.of((self.record(values),), sigma, turns, **more)

    def of(
        self, records: tuple[Record, ...], sigma: NDArray[np.float64], turns: tuple[float, ...] = (), **more: object
    ) -> Case:
        """The case of records: a mode must be found if the bound of the first says that it can be."""
        modes = self.modes
        least = bound(modes, self.times, self.angles, sigma, turns)
        exponents, least = modes.listed(modes.exponents), modes.listed(least)
        least = least.real + 1j * np.abs(least.imag)
        must = tellable(exponents, least, modes.fundamental)
        return Case(
            records=records, period=modes.period, exponents=exponents, must=must, bound=least, options=dict(more)
        )


def setting(
    generator: np.random.Generator, *, step: float = 0.0, wander: float = 0.0, most: int = 3, channels: int = 0
) -> Drawn:
    """A system and a record long enough for its slowest mode to fall to a tenth, of 30 to 250 periods."""
    system = drawn(generator, most=most, channels=channels)
    modes = system.modes()
    slowest = -2.0 * np.pi * modes.exponents.real.max()
    periods = int(np.clip(generator.uniform(2.0, 6.0) / slowest, 30, 250))
    phases = int(np.clip(np.ceil(5.0 * system.fastest), 24, 64)) + step
    times = PERIOD / phases * np.arange(int(periods * phases))
    if wander:
        ends = Clock(wander)(times[[0, -1]])
        modes = system.modes(float((ends[1] - ends[0]) / times[-1]))
    return Drawn(
        system=system, modes=modes, times=times, clock=Clock(wander), rate=phases / PERIOD, generator=generator
    )


def plain(generator: np.random.Generator) -> Case:
    """White noise, synchronous."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    return own.case(own.white(free, sigma), sigma)


def two_blows(generator: np.random.Generator) -> Case:
    """Two records of other starts."""
    own = setting(generator)
    other = replace(own, system=replace(own.system, start=generator.permutation(own.system.start)))
    free = own.free(), other.free()
    sigma = own.noise(free[0])
    return own.of(tuple(own.record(own.white(each, sigma)) for each in free), sigma)


def coloured(generator: np.random.Generator) -> Case:
    """Noise of a first-order autoregression."""
    from scipy.signal import lfilter

    own, colour = setting(generator), generator.uniform(-0.7, 0.95)
    free = own.free()
    sigma = own.noise(free)
    white = generator.standard_normal((len(free), free.shape[1] + 1000))
    drawn = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white, axis=1)[:, 1000:]
    case = own.case(free + sigma[:, None] * drawn, sigma)
    # In its own colour a mode may be far worse determined than in white noise as large.
    return _halfway(case, 4.0)


def heavy_tailed(generator: np.random.Generator) -> Case:
    """Noise of Student's distribution with three to six degrees of freedom."""
    own, degrees = setting(generator), generator.uniform(3.0, 6.0)
    free = own.free()
    sigma = own.noise(free)
    drawn = generator.standard_t(degrees, free.shape) / np.sqrt(degrees / (degrees - 2.0))
    return own.case(free + sigma[:, None] * drawn, sigma)


def imbalanced(generator: np.random.Generator) -> Case:
    """On the orbit of a force, several times the free response."""
    own = setting(generator)
    forced, sigma = _forced(own)
    return own.case(own.white(forced, sigma), sigma, (0.0, 1.0, 2.0, 3.0))


def _forced(own: Drawn) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The response about an orbit, and the noise of its free part."""
    free = own.free()
    system = replace(own.system, force=own.generator.standard_normal(own.system.size))
    orbit = replace(system, start=0.0 * system.start).response(own.times, own.clock)
    scale = own.generator.uniform(0.3, 4.0) * np.abs(free).max() / np.abs(orbit).max()
    return free + scale * orbit, own.noise(free)


def hum(generator: np.random.Generator) -> Case:
    """A steady tone that has nothing to do with the shaft, half the noise's deviation to fivefold."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    frequency = generator.uniform(0.3, 0.4 * own.rate * PERIOD)
    size = np.exp(generator.uniform(np.log(0.5), np.log(5.0)))
    tone = np.cos(frequency * own.times + generator.uniform(0.0, 6.0, (len(free), 1)))
    return own.case(own.white(free, sigma) + size * sigma[:, None] * tone, sigma, (frequency,))


def gaps(generator: np.random.Generator) -> Case:
    """0.2 to 5 % of the samples missing, one by one; in every other draw the rate is out of step, too."""
    own = setting(generator, step=generator.choice([0.0, generator.uniform(0.05, 0.95)]))
    free = own.free()
    sigma = own.noise(free)
    values = own.white(free, sigma)
    values[generator.random(values.shape) < np.exp(generator.uniform(np.log(0.002), np.log(0.05)))] = np.nan
    return own.case(values, sigma)


def drift(generator: np.random.Generator) -> Case:
    """Frequencies that move by 0.02 to 0.13 % over the record."""
    own = setting(generator)
    own = replace(own, system=replace(own.system, drift=np.exp(generator.uniform(np.log(2e-4), np.log(1.3e-3)))))
    free = own.free()
    sigma = own.noise(free)
    return _moving(own, own.case(own.white(free, sigma), sigma))


def _moving(own: Drawn, case: Case) -> Case:
    """The case with bounds as wide as its exponents move: any value in between is right."""
    still = replace(own.system, drift=0.0, stiffness=own.system.stiffness * (1.0 + 2.0 * own.system.drift))
    modes = still.modes()
    ends = modes.listed(modes.exponents)
    gaps = np.subtract.outer(case.exponents, ends)
    gaps = np.abs(gaps.real) + 1j * np.abs(wrapped(gaps.imag, case.fundamental))
    moved = gaps[np.arange(len(gaps)), np.abs(gaps).argmin(axis=1)]
    return replace(case, slack=moved)


def cubic(generator: np.random.Generator) -> Case:
    """A cubic stiffness that is 0.1 to 1 % of the linear one where the response is largest."""
    own = setting(generator, most=2)
    share = np.exp(generator.uniform(np.log(0.001), np.log(0.01)))
    free, largest = own.free(), np.abs(own.system.moved(own.times, own.clock, np.append(own.system.start, 1.0)))
    size = np.median(own.system.stiffness.diagonal()) / largest[: own.system.size].max() ** 2
    values = _nonlinear(own, share * size)
    sigma = own.noise(free)
    case = own.case(own.white(values, sigma), sigma)
    # To first order the frequency moves by three eighths of that share of its own where the response is largest.
    return replace(case, slack=np.abs(case.exponents.imag) * share * (0.2 + 1.0j))


def _nonlinear(own: Drawn, kappa: float) -> NDArray[np.float64]:
    """The response with a cubic stiffness, by Runge and Kutta's steps."""
    system, n = own.system, own.system.size
    step = own.times[1] - own.times[0]
    inner = int(np.ceil(step * system.fastest / 0.1))
    h = step / inner
    halves = 0.5 * h * np.arange(2 * inner * len(own.times) + 1)
    a = system.matrices(halves, 0.0 * halves)[:, :-1, :-1]
    state, out = system.start.copy(), [system.start]

    def rates(matrix: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = matrix @ x
        moved[n:] -= kappa * x[:n] ** 3
        return moved

    for number in range(inner * (len(own.times) - 1)):
        one, two, three = a[2 * number], a[2 * number + 1], a[2 * number + 2]
        k1 = rates(one, state)
        k2 = rates(two, state + 0.5 * h * k1)
        k3 = rates(two, state + 0.5 * h * k2)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(three, state + h * k3))
        if (number + 1) % inner == 0:
            out.append(state)
    return system.seen(np.array(out).T, own.angles)


def ambient(generator: np.random.Generator) -> Case:
    """Driven by white noise all along: no free response at all."""
    own = setting(generator, channels=3)
    n = own.system.size
    kicks = np.zeros((len(own.times) - 1, 2 * n + 1))
    kicks[:, n:-1] = generator.standard_normal((len(kicks), n))
    states = own.system.moved(own.times, own.clock, np.append(np.zeros(2 * n), 1.0), kicks)
    values = own.system.seen(states, own.angles)
    sigma = own.noise(values)
    case = own.case(own.white(values, sigma), sigma)
    return replace(case, must=np.zeros(len(case.must), bool))


def clipped(generator: np.random.Generator) -> Case:
    """One channel clipped at 40 to 90 % of its largest value."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    values = own.white(free, sigma)
    most = generator.uniform(0.4, 0.9) * np.abs(values[0]).max()
    values[0] = np.clip(values[0], -most, most)
    return _halfway(own.case(values, sigma), 3.0)


def spikes(generator: np.random.Generator) -> Case:
    """One to twenty samples that have nothing to do with the response."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    values = own.white(free, sigma)
    count = int(generator.integers(1, 21))
    at = generator.integers(0, len(values), count), generator.integers(0, values.shape[1], count)
    values[at] += generator.choice([-1.0, 1.0], count) * generator.uniform(0.3, 3.0, count) * np.abs(free).max()
    return own.case(values, sigma)


def quiet_first(generator: np.random.Generator) -> Case:
    """The blow some periods after the record's beginning."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    before = int(generator.uniform(1.0, 12.0) * own.rate * PERIOD)
    late = replace(own, clock=Clock(begin=PERIOD * before / (own.rate * PERIOD)))
    values = np.concatenate([np.zeros((len(free), before)), late.free()], axis=1)
    return own.case(own.white(values, sigma), sigma)


def second_blow(generator: np.random.Generator) -> Case:
    """Another blow between a third and two thirds of the record."""
    own = setting(generator)
    free = own.free()
    sigma = own.noise(free)
    values = free.copy()
    first = int(generator.uniform(0.33, 0.66) * free.shape[1])
    again = replace(own.system, start=generator.permutation(own.system.start))
    rest = own.times[first:]
    values[:, first:] += again.response(rest - rest[0], Clock(begin=float(rest[0])))
    return _halfway(own.case(own.white(values, sigma), sigma), 3.0)


def late_channel(generator: np.random.Generator) -> Case:
    """One of several channels zero for some periods."""
    own = setting(generator, channels=3)
    free = own.free()
    sigma = own.noise(free)
    values = own.white(free, sigma)
    values[1, : int(generator.uniform(2.0, 10.0) * own.rate * PERIOD)] = 0.0
    return _halfway(own.case(values, sigma), 2.0)


def ac_coupled(generator: np.random.Generator) -> Case:
    """Channels behind a high-pass filter of the first order, whose own pole is in the response."""
    from scipy.signal import lfilter

    own = setting(generator)
    corner = generator.uniform(0.01, 0.1)
    # The bilinear filter, begun as if the response had been zero before.
    tan = np.tan(0.5 * corner / own.rate)
    free = lfilter([1.0 / (1.0 + tan), -1.0 / (1.0 + tan)], [1.0, -(1.0 - tan) / (1.0 + tan)], own.free(), axis=1)
    sigma = own.noise(free)
    pole = np.log((1.0 - tan) / (1.0 + tan)) * own.rate
    case = own.case(own.white(free, sigma), sigma)
    return replace(
        _halfway(case, 3.0),
        exponents=np.append(case.exponents, pole),
        must=np.append(case.must, False),
        bound=None,
    )


def out_of_step(generator: np.random.Generator) -> Case:
    """A rate that is no whole number a period; every other one about an orbit."""
    own = setting(generator, step=generator.uniform(0.05, 0.95))
    turns: tuple[float, ...] = ()
    free = own.free()
    values, sigma = free, own.noise(free)
    if generator.random() < 0.5:
        (values, sigma), turns = _forced(own), (0.0, 1.0, 2.0, 3.0)
    return own.case(own.white(values, sigma), sigma, turns)


def wandering(
    generator: np.random.Generator, *, orbit: bool = True
) -> tuple[Drawn, NDArray[np.float64], NDArray[np.float64]]:
    """A shaft whose speed changes by up to 0.02 to 0.12 %, and the noisy response, in half of the draws on an orbit."""
    wander = np.exp(generator.uniform(np.log(2e-4), np.log(1.2e-3)))
    own = setting(generator, step=generator.uniform(0.05, 0.95), wander=wander)
    free = own.free()
    values, sigma = _forced(own) if orbit and generator.random() < 0.5 else (free, own.noise(free))
    return own, own.white(values, sigma), sigma


TURNS = (0.0, 1.0, 2.0, 3.0)


def tachometer(generator: np.random.Generator) -> Case:
    """A channel with a pulse a turn, sampled with the others."""
    own, values, sigma = wandering(generator)
    off, half = np.angle(np.exp(1j * (own.angles - 2.0))), np.deg2rad(12.0)
    pulse = 2.5 * (np.tanh((off + half) / (0.3 * half)) - np.tanh((off - half) / (0.3 * half)))
    pulse += 0.01 * generator.standard_normal(len(off))
    values = np.concatenate([values, pulse[None]])
    names = [*(f"y{n}" for n in range(len(sigma))), "tach"]
    record = Record(values=values, sample_rate=own.rate, channels=names)
    return own.of((record,), sigma, TURNS, tach="tach")


def exact_pulses(generator: np.random.Generator) -> Case:
    """A channel with a pulse of a counter's edge: rises and falls within a sample, no noise; on no orbit.

    The edge is known to a sample, 6 to 15 degrees: what that makes of an orbit no chain could tell from modes.
    """
    own, values, sigma = wandering(generator, orbit=False)
    high = (np.mod(own.angles - 2.0, 2.0 * np.pi) < 1.0).astype(float)
    values = np.concatenate([values, 5.0 * high[None]])
    names = [*(f"y{n}" for n in range(len(sigma))), "tach"]
    record = Record(values=values, sample_rate=own.rate, channels=names)
    return own.of((record,), sigma, TURNS, tach="tach")


def azimuth(generator: np.random.Generator) -> Case:
    """A channel of the shaft's angle, modulo a turn, with or without noise."""
    own, values, sigma = wandering(generator)
    angle = own.angles + generator.choice([0.0, 1e-3]) * generator.standard_normal(len(own.times))
    values = np.concatenate([values, np.mod(np.rad2deg(angle), 360.0)[None]])
    names = [*(f"y{n}" for n in range(len(sigma))), "Azimuth"]
    record = Record(values=values, sample_rate=own.rate, channels=names)
    return own.of((record,), sigma, TURNS, azimuth="Azimuth")


def _halfway(case: Case, factor: float) -> Case:
    """The case of a record that says less than its length: only modes with that much to spare must be found."""
    wide = case.bound * factor
    return replace(case, must=case.must & tellable(case.exponents, wide, case.fundamental))


KINDS: dict[str, Kind] = {
    "plain": Kind(make=plain, runs=150),
    "two blows": Kind(make=two_blows, runs=40),
    "coloured noise": Kind(make=coloured, runs=50),
    "heavy tails": Kind(make=heavy_tailed, runs=40),
    "orbit": Kind(make=imbalanced, runs=60),
    "hum": Kind(make=hum, runs=50),
    "gaps": Kind(make=gaps, runs=40),
    "drift": Kind(make=drift, runs=40, benign=False),
    "cubic": Kind(make=cubic, runs=30, benign=False),
    "ambient": Kind(make=ambient, runs=15, benign=False),
    "clipped": Kind(make=clipped, runs=15, benign=False),
    "spikes": Kind(make=spikes, runs=15, benign=False),
    "quiet first": Kind(make=quiet_first, runs=15),
    "second blow": Kind(make=second_blow, runs=15, benign=False),
    "late channel": Kind(make=late_channel, runs=10, benign=False),
    "AC coupled": Kind(make=ac_coupled, runs=15, benign=False),
    "out of step": Kind(make=out_of_step, runs=60, measured=True),
    "tachometer": Kind(make=tachometer, runs=40, measured=True),
    "exact pulses": Kind(make=exact_pulses, runs=20, measured=True),
    "azimuth": Kind(make=azimuth, runs=30, measured=True),
    "inputs": Kind(make=driven.forced, runs=30),
    "inputs: swept": Kind(make=driven.swept, runs=15),
    "inputs: coloured noise": Kind(make=driven.coloured, runs=15),
    "inputs: late": Kind(make=driven.late, runs=10),
    "inputs: gaps": Kind(make=driven.missing, runs=10),
    "inputs: hum": Kind(make=driven.hum, runs=10),
    "inputs: out of step": Kind(make=driven.out_of_step, runs=15, measured=True),
    "inputs: noise on them": Kind(make=driven.noisy_inputs, runs=10, benign=False),
    "inputs: others unmeasured": Kind(make=driven.shaken, runs=10, benign=False),
    "inputs: drift": Kind(make=driven.drifting, runs=7, benign=False),
    "inputs: cubic": Kind(make=driven.cubic, runs=6, benign=False),
    "inputs: clipped": Kind(make=driven.clipped, runs=6, benign=False),
    "inputs: spikes": Kind(make=driven.spiked, runs=6, benign=False),
    "alone": Kind(make=driven.alone, runs=30),
    "alone: gaps": Kind(make=driven.alone_missing, runs=10),
    "alone: hum": Kind(make=driven.alone_hum, runs=10, benign=False),
    "alone: orbit": Kind(make=driven.alone_orbit, runs=10),
    "alone: drift": Kind(make=driven.alone_drifting, runs=7, benign=False),
    "alone: coloured forces": Kind(make=driven.alone_coloured, runs=7, benign=False),
    "alone: half the period": Kind(make=driven.alone_halved, runs=6, benign=False),
}
"""750 free responses, 600 of constant period and rate in step, 150 with a measured clock or out of step; 150 with
inputs, and 80 of outputs alone."""
