"""Small records whose truth is known: made sample by sample here, by no function of the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from tests.contracts.likelihoods._decays import Decays, lifted, sampled
from tests.contracts.likelihoods._driven import Driven
from tests.contracts.likelihoods._innovations import Innovations
from tests.contracts.likelihoods._lines import LineData, LinePoint, modal_of
from tests.contracts.likelihoods._point import Data, Group, Mode, Point

from floquid.transfer._modal import Lines

OMEGA, PHASES = 1.3, 16
STEP = 2.0 * np.pi / OMEGA / PHASES


@dataclass(frozen=True, kw_only=True)
class Case:
    """Modes, how their record is made (of a seed; None for no noise), and the point at given modes."""

    name: str
    modes: tuple[Mode, ...]
    data_of: Callable[[int | None], Data | LineData]
    at: Callable[[Data | LineData, Sequence[Mode]], Point]
    weak: tuple[Group, ...]
    """Harmonics that are there, little above the noise."""
    absent: tuple[Group, ...]
    """Harmonics that are not there."""

    @property
    def likelihood(self) -> str:
        return self.name.partition(":")[0]

    @cached_property
    def data(self) -> Data | LineData:
        return self.data_of(1)

    @cached_property
    def truth(self) -> Point:
        """The point of the noisy record at the truth."""
        return self.at(self.data, self.modes)

    @cached_property
    def fit(self) -> Point:
        """The maximum of the likelihood."""
        return self.truth.refit()


def response(modes: Sequence[Mode], drives: np.ndarray, start: float, record: int, *, held: bool) -> np.ndarray:
    """Outputs of modes that signals drive, held between samples or acting at the next one (channels, samples)."""
    count, values = drives.shape[1], 0.0
    times = start + STEP * np.arange(count)
    for mode in modes:
        rates, share = 1j * OMEGA * mode.driven, np.ones(len(mode.driven), complex)
        if held:
            share = (np.exp(rates * STEP) - np.exp(mode.exponent * STEP)) / (rates - mode.exponent)
        drive = np.einsum("il,l,lk,ik->k", mode.gains, share, np.exp(np.outer(rates, times)), drives)
        drive = drive.real if mode.real else drive
        state = np.empty(count, complex)
        state[0] = mode.initial[record]
        for k in range(1, count):
            state[k] = np.exp(mode.exponent * STEP) * state[k - 1] + drive[k - 1]
        values = values + (mode.shape @ np.exp(1j * OMEGA * np.outer(mode.seen, times)) * state).real
    return values


def drawn(seed: int, *sizes: tuple[int, int]) -> list[np.ndarray]:
    """Random complex numbers."""
    some = np.random.default_rng(seed)
    return [some.standard_normal(size) + 1j * some.standard_normal(size) for size in sizes]


def pair(exponent: complex, seed: int, *, channels: int, inputs: int = 0, records: int = 1, weak: float = 0.0) -> Mode:
    """A pair seen in harmonics from -1 to 1, driven by -1 and 0; the first ones of both are weak."""
    shape, gains = drawn(seed, (channels, 3), (inputs, 2))
    sizes = np.array([weak or 0.5, 1.0, 0.4])
    return Mode(
        exponent=exponent,
        seen=np.arange(-1.0, 2.0),
        shape=sizes * shape,
        driven=np.arange(-1.0, 1.0) if inputs else np.zeros(0),
        gains=sizes[:2] * gains if inputs else np.zeros((0, 0), complex),
        initial=np.ones(records) * (0.6 - 0.5j) ** np.arange(records),
    )


def negative(decay: float, seed: int, *, channels: int, inputs: int = 0, records: int = 1) -> Mode:
    """A real negative multiplier of two harmonics, driven by one."""
    shape, gains = drawn(seed, (channels, 2), (inputs, 1))
    driven = np.array([0.5]) if inputs else np.zeros(0)
    gains = gains if inputs else np.zeros((0, 0), complex)
    initial = 0.8 * np.ones(records, complex)
    return Mode(exponent=decay + 0j, seen=np.array([0.5, 1.5]), shape=shape, driven=driven, gains=gains,
                initial=initial, real=True)  # fmt: skip


def positive(decay: float, seed: int, *, weak: float) -> Mode:
    """A real positive multiplier of two harmonics in two channels, the second one weak."""
    (shape,) = drawn(seed, (2, 2))
    shape = np.stack([shape[:, 0].real, weak * shape[:, 1]], axis=1)
    return Mode(exponent=decay + 0j, seen=np.arange(2.0), shape=shape, initial=np.ones(1, complex), real=True)


def free(modes: Sequence[Mode], lengths: Sequence[int], gaps: bool, noise: float, seed: int | None) -> Data:
    """Free responses, the first harmonic of the first mode weak; with samples missing in either channel."""
    some, values = np.random.default_rng(seed), []
    starts = tuple(STEP * 5 * record for record in range(len(lengths)))
    deviations = noise * np.arange(1.0, 1.0 + len(modes[0].shape))
    for record, (start, count) in enumerate(zip(starts, lengths, strict=True)):
        own = response(modes, np.zeros((0, count)), start, record, held=True)
        values.append(own + (0.0 if seed is None else 1.0) * deviations[:, None] * some.standard_normal(own.shape))
    for channel, own in enumerate(values[0] if gaps else ()):
        own[50 + 10 * channel : 90] = np.nan
    nothing = tuple(np.zeros((0, count)) for count in lengths)
    return Data(values=tuple(values), inputs=nothing, starts=starts, step=STEP, omega=OMEGA, noise=deviations)


def forced(modes: Sequence[Mode], lengths: Sequence[int], noise: float, seed: int | None) -> Data:
    """Responses to random inputs, with an offset and a direct term."""
    some, channels, inputs = np.random.default_rng(7), len(modes[0].shape), len(modes[0].gains)
    signals = tuple(some.standard_normal((inputs, count)) for count in lengths)
    direct, starts, values = some.standard_normal((channels, inputs)), (0.4, 1.1)[: len(lengths)], []
    some = np.random.default_rng(seed)
    for record, (start, signal) in enumerate(zip(starts, signals, strict=True)):
        own = response(modes, signal, start, record, held=True) + direct @ signal + 0.7
        values.append(own + (0.0 if seed is None else noise) * some.standard_normal(own.shape))
    return Data(
        values=tuple(values), inputs=signals, starts=starts, step=STEP, omega=OMEGA, noise=np.full(channels, noise)
    )


def ambient(modes: Sequence[Mode], lengths: Sequence[int], seed: int | None) -> Data:
    """Responses to innovations of a full covariance, and to measured inputs if there are gains for them."""
    channels, starts, values = len(modes[0].shape), (0.4, 1.1)[: len(lengths)], []
    known, some = np.random.default_rng(7), np.random.default_rng(seed)
    signals = tuple(known.standard_normal((len(modes[0].gains) - channels, count)) for count in lengths)
    for record, (start, signal) in enumerate(zip(starts, signals, strict=True)):
        noise = np.array([[1.0, 0.0], [0.5, 0.8]]) @ some.standard_normal((channels, signal.shape[1]))
        values.append(response(modes, np.vstack([signal, noise]), start, record, held=False) + noise)
    return Data(values=tuple(values), inputs=signals, starts=starts, step=STEP, omega=OMEGA, noise=np.ones(channels))


def measured(modes: Sequence[Mode], held: bool, noise: float, seed: int | None) -> LineData:
    """G of some lines, of continuous time or of samples; of these what rang at the begin of a record is in it."""
    some = np.random.default_rng(7)
    omega, harmonics = np.linspace(0.1, 2.4, 30), np.arange(-2, 3)
    inputs, outputs = len(modes[0].gains), len(modes[0].shape)
    begins = np.array([0.4]) if held else np.zeros(0)
    weights = 0.05 * some.standard_normal((len(begins), inputs, len(omega))) + 0j
    size = (len(harmonics), outputs, inputs, len(omega))
    lines = Lines(
        omega=omega, harmonics=harmonics, values=np.zeros(size, complex), std=np.full(size, noise * (1.0 + 1.0j)),
        fundamental=OMEGA, held=(STEP, "zero") if held else None, echoes=(weights, begins), alive=held,
    )  # fmt: skip
    some = np.random.default_rng(seed)
    off = some.standard_normal(size) + 1j * some.standard_normal(size)
    values = modal_of(lines, modes).transfer(lines) + (0.0 if seed is None else noise) * off
    return LineData(replace(lines, values=values))


def without_starts(mode: Mode) -> Mode:
    return replace(mode, initial=np.zeros(0, complex))


TAPS = np.array([1.0, -0.6, 0.2])
WEAK, WIDE = -1.0, 2.0

FREE = (pair(-0.03 + 0.47j, 1, channels=2, weak=0.012), negative(-0.05, 2, channels=2))
TWICE = (pair(-0.03 + 0.47j, 1, channels=2, records=2, weak=0.006), pair(0.004 + 0.2j, 3, channels=2, records=2))
REAL = (positive(-0.04, 4, weak=0.02), negative(-0.06, 5, channels=2))
DRIVEN = (pair(-0.06 + 0.47j, 1, channels=2, inputs=2, weak=0.02), negative(-0.2, 2, channels=2, inputs=2))
DRIVEN_TWICE = tuple(
    replace(mode, initial=np.array([0.5, -0.3]) * (1.0 if mode.real else 1.0 + 0.4j)) for mode in DRIVEN
)


def observed(mode: Mode, inputs: int) -> Mode:
    """With gains of the innovations along the shape, as Kalman's are: so the predictor is stable."""
    shape = mode.shape / np.abs(mode.shape) * (1.0 if mode.real else np.array([0.07, 1.0, 0.6]))
    # One gain is the largest, and stays so a step away: it is the scale of the state.
    gains = np.array([[0.3], [0.2]]) * (shape[:, :1] if mode.real else shape[:, :0:-1].conj() * [0.15, 1.0])
    return replace(mode, shape=shape, gains=np.vstack([0.1 * mode.gains[:inputs], gains]))


def both(inputs: int, records: int) -> tuple[Mode, ...]:
    """A pair and a negative multiplier that innovations drive beside inputs."""
    sizes = {"channels": 2, "inputs": 1, "records": records}
    return tuple(observed(mode, inputs) for mode in (pair(-0.06 + 0.47j, 1, **sizes), negative(-0.2, 2, **sizes)))


AMBIENT, BESIDE = both(0, 1), both(1, 2)

SEEN, REACHED = (0, "seen", WEAK), (0, "driven", WEAK)
MORE_SEEN, MORE_REACHED = (0, "seen", WIDE), (0, "driven", 1.0)

CASES = (
    Case(name="decays: lifted, two hits", modes=TWICE, data_of=partial(free, TWICE, (480, 400), False, 0.01),
         at=lambda data, modes: Decays.at(data, modes, lifted), weak=(SEEN,), absent=(MORE_SEEN,)),
    Case(name="decays: lifted, after a filter", modes=FREE, data_of=partial(free, FREE, (480,), False, 0.01),
         at=lambda data, modes: Decays.at(data, modes, partial(lifted, taps=TAPS)), weak=(SEEN,), absent=(MORE_SEEN,)),
    Case(name="decays: as sampled, two hits", modes=TWICE, data_of=partial(free, TWICE, (477, 301), False, 0.01),
         at=lambda data, modes: Decays.at(data, modes, sampled), weak=(SEEN,), absent=(MORE_SEEN,)),
    Case(name="decays: real multipliers", modes=REAL, data_of=partial(free, REAL, (480,), False, 0.01),
         at=lambda data, modes: Decays.at(data, modes, lifted), weak=((0, "seen", 1.0),), absent=(MORE_SEEN,)),
    Case(name="decays: with gaps", modes=FREE, data_of=partial(free, FREE, (1200,), True, 0.01),
         at=lambda data, modes: Decays.at(data, modes, sampled), weak=(SEEN,), absent=(MORE_SEEN,)),
    Case(name="decays: with gaps, after a filter", modes=FREE, data_of=partial(free, FREE, (1200,), True, 0.01),
         at=lambda data, modes: Decays.at(data, modes, partial(sampled, taps=TAPS)), weak=(SEEN,), absent=(MORE_SEEN,)),
    Case(name="driven: one record", modes=DRIVEN, data_of=partial(forced, DRIVEN, (600,), 0.2),
         at=Driven.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
    Case(name="driven: two records", modes=DRIVEN_TWICE, data_of=partial(forced, DRIVEN_TWICE, (400, 300), 0.2),
         at=Driven.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
    Case(name="innovations: outputs alone", modes=AMBIENT, data_of=partial(ambient, AMBIENT, (2400,)),
         at=Innovations.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
    Case(name="innovations: beside an input, two records", modes=BESIDE, data_of=partial(ambient, BESIDE, (1500, 900)),
         at=Innovations.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
    Case(name="lines: of continuous time", modes=tuple(map(without_starts, DRIVEN)),
         data_of=partial(measured, tuple(map(without_starts, DRIVEN)), False, 0.05),
         at=LinePoint.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
    Case(name="lines: of samples, with what rang at the begin", modes=DRIVEN,
         data_of=partial(measured, DRIVEN, True, 0.05),
         at=LinePoint.at, weak=(SEEN, REACHED), absent=(MORE_SEEN, MORE_REACHED)),
)  # fmt: skip
