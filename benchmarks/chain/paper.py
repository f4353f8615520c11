"""Cases of the paper's rotor: its response put together from its exact Floquet modes, sampled in many ways."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from benchmarks.chain.case import Case, Modes, noisy, response, synthetic
from numpy.typing import NDArray

from floquid import ConstantPeriod, Record, floquet
from floquid.systems import JeffcottRotor, Run

ROTOR = JeffcottRotor()
PHASES = 64
OUT_OF_STEP = 50.19
NAMES = tuple(channel.name for channel in ROTOR.channels)

RATIO = 5.0
"""The response to the imbalance over the largest free response."""


@dataclass(frozen=True, slots=True)
class Sampled:
    """When the rotor is looked at: times [s], and its angle, 2π a period (samples,)."""

    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    rate: float


@cache
def modes() -> Modes:
    """The rotor's modes after an impulse at 45 degrees, as its four channels see them."""
    found = floquet.modes(ROTOR.system, ROTOR.period)
    start = np.array([0.0, 0.0, 1.0, 1.0]) / np.sqrt(2.0)
    amounts = np.linalg.solve(found.shapes([0.0])[..., 0].T, start.astype(complex))
    times = ROTOR.period * np.arange(PHASES) / PHASES
    seen = np.einsum("tcn,rnt->rct", ROTOR.outputs(times), found.shapes(times)) * amounts[:, None, None]
    harmonics = np.arange(-8, 9)
    lines = np.fft.fft(seen, axis=2)[..., harmonics % PHASES] / PHASES
    upper = found.exponents.imag > 0
    return Modes(exponents=found.exponents[upper], coefficients=lines[upper], harmonics=harmonics, period=ROTOR.period)


@cache
def orbit() -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Harmonics of the revolution in the response to an imbalance, and their sizes (channels, harmonics)."""
    run = Run(n_periods=4, samples_per_period=float(PHASES), wander=0.0, imbalance=1.0, noise=0.0, start_deg=0.0)
    _, forced = run.responses()
    harmonics = np.array([1, 3, 5])
    return harmonics, np.fft.fft(forced, axis=1)[:, 2 * harmonics] / forced.shape[1]


def imbalanced(free: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """The response to an imbalance, its largest in the first channel `RATIO` times the free one's."""
    harmonics, sizes = orbit()
    forced = 2.0 * (sizes @ np.exp(0.5j * np.multiply.outer(harmonics, angles))).real
    return forced * RATIO * np.abs(free[0]).max() / np.abs(forced[0]).max()


def steady(samples: float, n_periods: int) -> Sampled:
    """A shaft that turns evenly, `samples` a period."""
    times = np.arange(int(n_periods * samples)) * (ROTOR.period / samples)
    return Sampled(times, times * (2.0 * np.pi / ROTOR.period), samples / ROTOR.period)


def free_of(sampled: Sampled) -> NDArray[np.float64]:
    """The free response (channels, samples)."""
    own = modes()
    return response(own.exponents, own.coefficients, own.harmonics, sampled.times, sampled.angles)


def case_of(
    sampled: Sampled,
    noise: float,
    seed: int,
    *,
    imbalance: bool = False,
    offset: float = 0.0,
    colour: float = 0.0,
    **options: object,
) -> Case:
    """The rotor on a shaft that turns evenly; an offset is a share of each channel's largest free response."""
    free = free_of(sampled)
    values = free + offset * np.abs(free).max(axis=1, keepdims=True)
    turns = (0.0,) if offset else ()
    if imbalance:
        values = values + imbalanced(free, sampled.angles)
        turns = (*turns, 0.5, 1.5)
        options["periods_per_revolution"] = 2
    values, sigma = noisy(values, free, noise, seed, colour=colour)
    clock = ConstantPeriod(period=ROTOR.period)
    record = Record(values=values, sample_rate=sampled.rate, channels=NAMES, clock=clock)
    return synthetic(modes(), record, (sampled.times, sampled.angles), sigma, turns, options=options)


def paper_wander(noise: float, seed: int) -> Case:
    """Out of step on a shaft whose speed wanders by 0.2 %, with an imbalance and a pulse a revolution."""
    run = Run(n_periods=512, samples_per_period=OUT_OF_STEP, seed=seed, start_deg=0.0)
    sampled = Sampled(run.times, 2.0 * run.angle(run.times), run.sample_rate)
    free = free_of(sampled)
    values, sigma = noisy(free + imbalanced(free, sampled.angles), free, noise, seed)
    off = np.angle(np.exp(0.5j * sampled.angles - 1j))
    half = 0.5 * np.deg2rad(run.pulse_deg)
    pulses = 2.5 * (np.tanh((off + half) / (0.25 * half)) - np.tanh((off - half) / (0.25 * half)))
    pulses = pulses + 0.005 * np.random.default_rng([seed, 8]).standard_normal(len(off))
    values = np.concatenate([values, pulses[None]])
    record = Record(values=values, sample_rate=sampled.rate, channels=(*NAMES, "tach"))
    options = {"tach": "tach", "periods_per_revolution": 2}
    at = (sampled.times, sampled.angles)
    return synthetic(modes(), record, at, sigma, (0.5, 1.5), options=options)


def paper_imbalance(noise: float, seed: int) -> Case:
    """Synchronous, with an imbalance and an offset."""
    return case_of(steady(50.0, 512), noise, seed, imbalance=True, offset=0.5)
