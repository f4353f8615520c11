"""Lines of records at multiples and fractions of the fundamental: which stand out, and how long a revolution is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid.checks import BESIDE, MOST_PERIODS
from floquid.fit import CHUNK
from floquid.innovations import FINE
from floquid.sync import STEADY

STEADY_LINES = 12
"""Harmonics of the period at which a response that repeats with it is looked for."""

PERIODS_A_LINE = 4.0
"""Periods of the records over the harmonics that are fitted, at least, where all are."""

LOUD = 8.0
"""The amplitude at a harmonic over that beside it from which on it is fitted."""

PURE = 50.0
"""The amplitude of such a line over that beside, at least: few modes that hardly decay are at such a line."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of records at multiples and fractions of the fundamental."""

    outputs: Sequence[Floats]
    inputs: Sequence[Floats]
    times: Sequence[Floats]
    rate: float
    period: float

    def steady(self, periods_of_turn: float) -> tuple[float, ...]:
        """Harmonics of a response that repeats with the period or the revolution: an orbit, gravity, an imbalance.

        Where one stands far above what is beside it all are fitted, as far as the records are long enough: a smaller
        one that is left out would be taken for a mode that never decays.
        """
        turns = self._up_to_highest(periods_of_turn)
        loud = turns[self._above(turns, self.outputs) > LOUD]
        periods = sum(own.shape[1] for own in self.outputs) / (self.rate * self.period)
        return tuple((turns if len(loud) and periods > PERIODS_A_LINE * len(turns) else loud).tolist())

    def periods_of_turn(self) -> int:
        """Periods of the revolution whose lines the outputs have between the harmonics, and no input has."""
        each = {}
        for count in range(2, MOST_PERIODS + 1):
            turns = self._up_to_highest(count)
            each[count] = turns[np.gcd(np.rint(turns * count).astype(np.int64), count) == 1]
        turns = np.concatenate(list(each.values()))
        counts = np.repeat(list(each), [len(own) for own in each.values()])
        pure = self._above(turns, self.outputs) > PURE
        if not pure.any():
            return 1
        driven = self._above(turns, self.inputs) > LOUD
        found = 1
        for count in each:
            if pure[counts == count].any() and not driven[counts == count].any():
                both = math.lcm(found, count)
                found = both if both <= MOST_PERIODS else found  # lines of 1/4 and 1/5 are no revolution of 20 periods
        return found

    def _up_to_highest(self, periods_of_turn: float) -> Floats:
        """The harmonics of the period and of the revolution that are looked at, over the fundamental (harmonics,)."""
        highest = min(STEADY_LINES, int(0.5 * self.rate * self.period - 1e-6))
        fractions = np.arange(1, int(highest * periods_of_turn) + 1) / periods_of_turn
        return np.union1d(np.arange(1.0, highest + 1.0), fractions)

    def _above(self, harmonics: Floats, values: Sequence[Floats]) -> Floats:
        """Lines over those beside, the most of all channels and records (harmonics,)."""
        each = [
            _above_beside(own, times, self.period, harmonics) for own, times in zip(values, self.times, strict=True)
        ]
        return np.max(np.concatenate([np.zeros((1, len(harmonics))), *each]), axis=0)


def _above_beside(values: Floats, times: Floats, period: float, harmonics: Floats) -> Floats:
    """The amplitudes of lines at harmonics over the rms of those beside each (channels, harmonics).

    Phases are products of those at whole harmonics and at fractions, and lines beside are sums with cosines and sines
    that go with the values: 2(|C|² + |S|²) = |C - iS|² + |C + iS|².
    """
    fundamental = 2.0 * np.pi / period
    slow = 2.0 * np.pi * np.arange(1.0, BESIDE + 1.0) / (times[-1] - times[0])
    whole, i = np.unique(np.floor(harmonics), return_inverse=True)
    fractions, j = np.unique(np.round(harmonics - np.floor(harmonics), 12), return_inverse=True)
    values = values - values.mean(axis=1, keepdims=True)
    room = np.empty((len(whole), len(fractions), CHUNK), np.complex128)
    sums = np.zeros((len(values) * (1 + 2 * len(slow)), 2 * len(whole) * len(fractions)))
    for first in range(0, len(times), CHUNK):
        own = times[first : first + CHUNK]
        coarse, fine = (np.exp(-1j * fundamental * np.multiply.outer(one, own)) for one in (whole, fractions))
        turned = np.multiply(coarse[:, None], fine, out=room[..., : len(own)]).reshape(-1, len(own))
        angles = np.multiply.outer(slow, own)
        beside = np.concatenate([np.ones((1, len(own))), np.cos(angles), np.sin(angles)])
        weighted = (values[:, None, first : first + CHUNK] * beside).reshape(-1, len(own))
        sums += weighted @ np.concatenate([turned.real, turned.imag]).T
    shape = (len(values), 1 + 2 * len(slow), 2, len(whole) * len(fractions))
    squares = np.sum(sums.reshape(shape) ** 2, axis=2)[..., i * len(fractions) + j]
    return np.sqrt(squares[:, 0] / np.maximum(squares[:, 1:].sum(axis=1) / len(slow), np.finfo(float).tiny))


@dataclass(frozen=True, slots=True)
class Tone:
    """A steady tone: its frequency [cycles a sample], and its amplitude in each output (channels,)."""

    frequency: float
    amplitudes: Floats


def tones_of(values: Floats, inputs: Floats, known: Floats, fundamental: float) -> tuple[Tone, ...]:
    """Tones in the outputs of a record (channels, samples) beside what is known of them (columns, samples).

    One stands as far above the lines beside it as `LOUD` says: a mode that is excited all along does only if it loses
    less than two nepers in the record, and then no record of outputs alone tells its decay. What an input has at the
    same frequency is no tone, nor what it has whole multiples of the `fundamental` [cycles a sample] away. Nor is what
    is beside a harmonic of it: that may be a harmonic of the true period, and the one given be wrong.
    """
    taken: list[float] = []
    while True:
        angles = 2.0 * np.pi * np.multiply.outer(np.array(taken), np.arange(values.shape[1]))
        columns = np.concatenate([np.concatenate([np.cos(angles), np.sin(angles)]), known])
        fitted = np.linalg.lstsq(columns.T, values.T, rcond=None)[0].T
        left = values - fitted @ columns
        found = _loudest(left, inputs, fundamental) if len(taken) < STEADY_LINES else None
        if found is None:
            break
        taken.append(found)
    amplitudes = np.hypot(*np.split(fitted[:, : 2 * len(taken)], 2, axis=1))
    return tuple(Tone(frequency, own) for frequency, own in zip(taken, amplitudes.T, strict=True))


def _loudest(left: Floats, inputs: Floats, fundamental: float) -> float | None:
    """The frequency of the tone that is furthest above what is beside it; None where none is [cycles a sample]."""
    count = left.shape[1]
    ratios, level = _above(left)
    margin = FINE * (BESIDE + 1)
    ratios[:margin] = ratios[-margin:] = 0.0
    driven = _above(inputs - inputs.mean(axis=1, keepdims=True))[0] > LOUD
    for place in np.argsort(-ratios)[: max(int(np.sum(ratios > LOUD)), 0)]:
        frequency = place / (FINE * count)
        harmonic = np.rint(frequency / fundamental)
        if abs(frequency - harmonic * fundamental) < max(STEADY * fundamental, 2.0 / count):
            continue
        at = place + FINE * count * fundamental * np.arange(-STEADY_LINES, STEADY_LINES + 1)
        beside = np.abs(np.rint(at)).astype(np.int64) % (FINE * count)
        beside = np.minimum(beside, FINE * count - beside)
        if any(driven[max(own - FINE, 0) : own + FINE + 1].any() for own in beside):
            continue
        weights = 1.0 / np.maximum(level[:, place], np.finfo(float).tiny)
        return _refined(left, weights, frequency, 1.0 / (FINE * count))
    return None


def _above(values: Floats) -> tuple[Floats, Floats]:
    """The amplitude of each line over that of those beside it, the most of all channels (lines,)."""
    from scipy.fft import rfft

    length = FINE * values.shape[1]
    most, level = np.zeros(length // 2 + 1), np.zeros((len(values), length // 2 + 1))
    for own, beside in zip(values, level, strict=True):  # spectra of all channels at once take five times as much
        power = np.abs(rfft(own, length)) ** 2
        for line in range(1, BESIDE + 1):
            by = FINE * line
            beside[by:] += power[:-by]
            beside[:-by] += power[by:]
        beside /= BESIDE
        power /= np.maximum(beside, np.finfo(float).tiny)
        np.maximum(most, power, out=most)
    return np.sqrt(most), level


def _refined(left: Floats, weights: Floats, near: float, by: float) -> float:
    """The frequency near one at which a line is largest, over the levels beside it: that of least squares."""
    from scipy.optimize import minimize_scalar

    ticks = np.arange(left.shape[1])

    def missed(frequency: float) -> float:
        turned = np.exp(-2j * np.pi * frequency * ticks)
        return -float(weights @ np.abs(left @ turned) ** 2)

    bounds = (near - by, near + by)
    return float(minimize_scalar(missed, bounds=bounds, method="bounded", options={"xatol": 1e-4 * by}).x)
