"""Cases of the paper's rotor: its response put together from its exact Floquet modes, sampled in many ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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

MISSING = 0.02
"""The share of samples that are missing, half of them one by one in each channel, half in stretches of all."""

STRETCH = 20
"""Samples in such a stretch."""

DROPOUTS = (0.21, 0.48, 0.83)
"""Where a record with few but long stretches missing has them, as shares of its length."""

COLOURS = (0.95, 0.9, -0.7)
"""What is left of each sample of coloured noise in the next one, by turns of the seed."""

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
    gaps: bool = False,
    period_error: float | None = None,
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
    if gaps:
        values[absent(values.shape, seed)] = np.nan
    declared = ROTOR.period * (1.0 + (period_error or 0.0))
    record = Record(values=values, sample_rate=sampled.rate, channels=NAMES, clock=ConstantPeriod(period=declared))
    more = {"options": options, "declared": None if period_error is None else declared}
    return synthetic(modes(), record, (sampled.times, sampled.angles), sigma, turns, **more)


def absent(shape: tuple[int, int], seed: int) -> NDArray[np.bool_]:
    """Which samples are missing (channels, samples)."""
    generator = np.random.default_rng([seed, 9])
    missing = generator.random(shape) < 0.5 * MISSING
    for first in generator.integers(0, shape[1] - STRETCH, round(0.5 * MISSING * shape[1] / STRETCH)):
        missing[:, first : first + STRETCH] = True
    return missing


def paper_wander(noise: float, seed: int, *, colour: float = 0.0) -> Case:
    """Out of step on a shaft whose speed wanders by 0.2 %, with an imbalance and a pulse a revolution."""
    run = Run(n_periods=512, samples_per_period=OUT_OF_STEP, seed=seed, start_deg=0.0)
    sampled = Sampled(run.times, 2.0 * run.angle(run.times), run.sample_rate)
    free = free_of(sampled)
    values, sigma = noisy(free + imbalanced(free, sampled.angles), free, noise, seed, colour=colour)
    return with_tach(sampled, values, sigma, seed)


def with_tach(sampled: Sampled, values: NDArray[np.float64], sigma: NDArray[np.float64], seed: int) -> Case:
    """The case of values with an imbalance, and a channel with a pulse of 18 degrees in each revolution."""
    off, half = np.angle(np.exp(0.5j * sampled.angles - 1j)), np.deg2rad(9.0)
    pulses = 2.5 * (np.tanh((off + half) / (0.25 * half)) - np.tanh((off - half) / (0.25 * half)))
    pulses = pulses + 0.005 * np.random.default_rng([seed, 8]).standard_normal(len(off))
    values = np.concatenate([values, pulses[None]])
    record = Record(values=values, sample_rate=sampled.rate, channels=(*NAMES, "tach"))
    options = {"tach": "tach", "periods_per_revolution": 2}
    return synthetic(modes(), record, (sampled.times, sampled.angles), sigma, (0.5, 1.5), options=options)


def paper_imbalance(noise: float, seed: int) -> Case:
    """Synchronous, with an imbalance and an offset."""
    return case_of(steady(50.0, 512), noise, seed, imbalance=True, offset=0.5)


def paper_gaps(noise: float, seed: int) -> Case:
    """Synchronous, with 2 % of the samples missing."""
    return case_of(steady(50.0, 512), noise, seed, gaps=True)


def paper_dropouts(noise: float, seed: int) -> Case:
    """Synchronous, with as many samples missing in three stretches of all channels."""
    case = case_of(steady(50.0, 512), noise, seed)
    values = np.array(case.records[0].values)
    length = round(MISSING * values.shape[1] / len(DROPOUTS))
    for share in DROPOUTS:
        first = round(share * values.shape[1])
        values[:, first : first + length] = np.nan
    return replace(case, records=(replace(case.records[0], values=values),))


def paper_out_of_step_both(noise: float, seed: int) -> Case:
    """Out of step, with an imbalance and an offset, and 2 % of the samples missing."""
    return case_of(steady(OUT_OF_STEP, 512), noise, seed, imbalance=True, offset=0.5, gaps=True)


def coloured_sync_orbit(noise: float, seed: int) -> Case:
    """Coloured noise, synchronous, the orbit of an imbalance left in."""
    return case_of(steady(50.0, 512), noise, seed, imbalance=True, colour=COLOURS[seed % len(COLOURS)])


def coloured_out_of_step(noise: float, seed: int) -> Case:
    """Coloured noise, out of step, the free response alone."""
    return case_of(steady(OUT_OF_STEP, 512), noise, seed, colour=COLOURS[seed % len(COLOURS)])


def coloured_tach(noise: float, seed: int) -> Case:
    """Coloured noise on the record with a wander, an imbalance and a tachometer."""
    return paper_wander(noise, seed, colour=COLOURS[seed % len(COLOURS)])


def period_off(samples: float, error: float) -> Callable[[float, int], Case]:
    """The builder of a record whose period is told with a relative error.

    A believed result is right if its exponents are, modulo its own fundamental, those of the strongest harmonics.
    """
    return lambda noise, seed: case_of(steady(samples, 512), noise, seed, period_error=error)


def paper_clean(noise: float, seed: int, *, validate: bool = True) -> Case:
    """The paper's experiment at its own 2 % of noise, whatever noise is asked for."""
    return case_of(steady(50.0, 1024), 0.02, seed, validate=validate)
