"""Lines of records at multiples and fractions of the fundamental: which stand out, and how long a revolution is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.checks import MOST_PERIODS

STEADY_LINES = 12
"""Harmonics of the period at which a response that repeats with it is looked for."""

BESIDE = (1, 2, 3, 4)
"""Lines on either side of a harmonic by which the level there is judged."""

BLOCK = 256
"""Samples that are summed to lines at once."""

PERIODS_A_LINE = 4.0
"""Periods of the records over the harmonics that are fitted, at least, where all are."""

LOUD = 8.0
"""The amplitude at a harmonic over that beside it from which on it is fitted."""

PURE = 50.0
"""The amplitude of such a line over that beside, at least: few modes that hardly decay are at such a line."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of records at multiples and fractions of the fundamental."""

    outputs: Sequence[NDArray[np.float64]]
    inputs: Sequence[NDArray[np.float64]]
    times: Sequence[NDArray[np.float64]]
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

    def _up_to_highest(self, periods_of_turn: float) -> NDArray[np.float64]:
        """The harmonics of the period and of the revolution that are looked at, over the fundamental (harmonics,)."""
        highest = min(STEADY_LINES, int(0.5 * self.rate * self.period - 1e-6))
        fractions = np.arange(1, int(highest * periods_of_turn) + 1) / periods_of_turn
        return np.union1d(np.arange(1.0, highest + 1.0), fractions)

    def _above(self, harmonics: NDArray[np.float64], values: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Lines over those beside, the most of all channels and records (harmonics,)."""
        each = [
            _above_beside(own, times, self.period, harmonics) for own, times in zip(values, self.times, strict=True)
        ]
        return np.max(np.concatenate([np.zeros((1, len(harmonics))), *each]), axis=0)


def _above_beside(
    values: NDArray[np.float64], times: NDArray[np.float64], period: float, harmonics: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The amplitudes of lines at harmonics over the rms of those beside each (channels, harmonics).

    Phases are products of those at whole harmonics and at fractions, and lines beside are sums with cosines and sines
    that go with the values: 2(|C|² + |S|²) = |C - iS|² + |C + iS|².
    """
    fundamental = 2.0 * np.pi / period
    slow = 2.0 * np.pi * np.array(BESIDE) / (times[-1] - times[0])
    whole, i = np.unique(np.floor(harmonics), return_inverse=True)
    fractions, j = np.unique(np.round(harmonics - np.floor(harmonics), 12), return_inverse=True)
    values = values - values.mean(axis=1, keepdims=True)
    room = np.empty((len(whole), len(fractions), BLOCK), np.complex128)
    sums = np.zeros((len(values) * (1 + 2 * len(slow)), 2 * len(whole) * len(fractions)))
    for first in range(0, len(times), BLOCK):
        own = times[first : first + BLOCK]
        coarse, fine = (np.exp(-1j * fundamental * np.multiply.outer(one, own)) for one in (whole, fractions))
        turned = np.multiply(coarse[:, None], fine, out=room[..., : len(own)]).reshape(-1, len(own))
        angles = np.multiply.outer(slow, own)
        beside = np.concatenate([np.ones((1, len(own))), np.cos(angles), np.sin(angles)])
        weighted = (values[:, None, first : first + BLOCK] * beside).reshape(-1, len(own))
        sums += weighted @ np.concatenate([turned.real, turned.imag]).T
    shape = (len(values), 1 + 2 * len(slow), 2, len(whole) * len(fractions))
    squares = np.sum(sums.reshape(shape) ** 2, axis=2)[..., i * len(fractions) + j]
    return np.sqrt(squares[:, 0] / np.maximum(squares[:, 1:].sum(axis=1) / len(slow), np.finfo(float).tiny))
