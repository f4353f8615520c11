"""Samples of records with measured inputs, one after another, and the known columns beside the modes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Complexes, Floats, Mask
from floquid._checks import Rebuilt
from floquid.core import BRIDGED, Hold, over_gaps, runs_of
from floquid.fit import CHUNK, HALF_DIGITS

LEAKAGE = 0.02
"""The share of a sample by which a whole number of periods may not be one of samples: less leaks than noise has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples(Rebuilt):
    """Outputs and inputs of records of one rate, put one after another, with the angle of the system."""

    values: Floats  # y (channels, samples)
    inputs: Floats  # u (inputs, samples)
    begins: tuple[int, ...]  # The first sample of each record, and one past the last of all (records + 1,)
    # The angle of the system over ω (samples,) [s]: the time after phase zero where the speed is constant
    times: Floats
    step: float  # The sampling interval [s]
    fundamental: float  # ω [rad/s]
    hold: Hold  # The input between its samples
    # Columns beside the modes: an offset of each record, and what repeats with the period (columns, samples)
    known: Floats
    # Mask of the samples that were measured (samples,). Of others the input is known, y and the columns are zero.
    there: Mask
    floor: float = 0.0  # The least share of a channel's largest value that noise is taken to be

    @property
    def records(self) -> list[slice]:
        """The samples of each record."""
        return [slice(a, b) for a, b in pairwise(self.begins)]

    @property
    def first_times(self) -> Floats:
        """Times of the first sample of each record (records,) [s]."""
        return self.times[list(self.begins[:-1])]

    @property
    def n_samples(self) -> int:
        """Samples of all records."""
        return self.values.shape[1]

    @cached_property
    def count(self) -> int:
        """Samples that were measured: each is one equation of every output."""
        return int(self.there.sum())

    @cached_property
    def gaps(self) -> list[tuple[int, int]]:
        """First and one past the last of the samples that were not measured, of each gap."""
        return runs_of(~self.there)

    @cached_property
    def stretches(self) -> list[slice]:
        """The samples of each record between gaps that are too long to be bridged."""
        found = []
        for own in self.records:
            there = [slice(own.start + a, own.start + b) for a, b in runs_of(self.there[own])]
            joined = there[:1]
            for one in there[1:]:
                near = one.start - joined[-1].stop <= self._bridged
                joined = [*joined[:-1], slice(joined[-1].start, one.stop)] if near else [*joined, one]
            found += joined
        return found

    @property
    def _bridged(self) -> float:
        """Samples of the longest gap that is bridged for a start."""
        return BRIDGED * 2.0 * np.pi / (self.fundamental * self.step)

    def bridged(self, values: NDArray) -> NDArray:
        """Values with cubics over the samples that are not there, for a start alone (rows, samples)."""
        if self.count == self.n_samples:
            return values
        return np.concatenate([over_gaps(values[:, own], ~self.there[own]) for own in self.records], axis=1)

    def kept(self, rows: NDArray) -> NDArray:
        """Rows with zeros where nothing was measured: there they count for nothing (…, samples)."""
        return rows if self.count == self.n_samples else rows * self.there

    def gained(self, gains: NDArray) -> NDArray:
        """Gains of what was measured, none where nothing was (samples, …)."""
        return gains if self.count == self.n_samples else gains * self.there.reshape(-1, *[1] * (gains.ndim - 1))

    @property
    def highest(self) -> int:
        """The highest harmonic that samples tell from all lower ones."""
        return int(np.ceil(np.pi / (self.fundamental * self.step) - HALF_DIGITS)) - 1

    @property
    def input_size(self) -> Floats:
        """The rms of each input (inputs,)."""
        return np.sqrt(np.mean(self.inputs**2, axis=1))

    @property
    def moving(self) -> Floats:
        """The values less the offset, and what repeats with the period, that fit them best (channels, samples)."""
        steady = np.linalg.lstsq(self.known.T, self.values.T, rcond=None)[0]
        return self.values - steady.T @ self.known

    @cached_property
    def swing(self) -> Floats:
        """The largest that each channel is beside an offset and what repeats with the period (channels,)."""
        return np.abs(self.moving).max(axis=1)

    def only(self, place: slice | Mask, begins: tuple[int, ...]) -> Samples:
        """Samples of a place or a mask, in records that begin at these numbers of them."""
        return replace(
            self,
            values=self.values[:, place],
            inputs=self.inputs[:, place],
            begins=begins,
            times=self.times[place],
            known=self.known[:, place],
            there=self.there[place],
        )

    def part(self, own: slice) -> Samples:
        """Samples that follow one another in a record, as a record of their own; they share the values."""
        found = self.only(own, (0, own.stop - own.start))
        self.turned(1.0)
        found.angles.update({turns: angle[own] for turns, angle in self.angles.items()})
        return found

    def parts(self, numbers: int) -> list[list[slice]]:
        """Parts of each record, so long that `numbers` of each sample make `BLOCK` of them."""
        length = max(BLOCK // max(numbers, 1), CHUNK)
        return [
            [slice(first, min(first + length, own.stop)) for first in range(own.start, own.stop, length)]
            for own in self.records
        ]

    def in_parts(self, numbers: int) -> Iterator[tuple[slice, Samples]]:
        """Such parts one after another, each with its place among all samples."""
        for own in (own for parts in self.parts(numbers) for own in parts):
            yield own, self if own.stop - own.start == self.n_samples else self.part(own)

    def turned(self, turns: float) -> Complexes:
        """e^{i turns ωt} (samples,)."""
        found = self.angles.get(turns)
        if found is None:
            if turns < 0.0:
                found = self.turned(-turns).conj()
            elif turns > 1.0:
                most = float(np.ceil(0.5 * turns))
                found = self.turned(most) * self.turned(turns - most)
            else:
                found = np.exp(1j * turns * self.fundamental * self.times)
            # Of many samples those of one turn alone are kept: of each harmonic they take as much as two channels.
            if turns == 1.0 or (1 + len(self.angles)) * self.n_samples < BLOCK:
                self.angles[turns] = found
        return found

    @cached_property
    def angles(self) -> dict[float, Complexes]:
        """Turned phases by their number of turns, of those that are kept."""
        return {}

    def later(self, number: int, seconds: float) -> Samples:
        """With one record later in the period, harmonics that are known beside the modes left as they are."""
        times = self.times.copy()
        times[self.records[number]] += seconds
        return replace(self, times=times)

    def each(self, values: NDArray, of: Callable[[NDArray], NDArray]) -> NDArray:
        """A function of the samples of each record, put one after another (…, samples)."""
        return np.concatenate([of(values[..., own]) for own in self.records], axis=-1)


def samples_of(
    values: Sequence[Floats],
    inputs: Sequence[Floats],
    starts: Sequence[float | Floats],
    *,
    step: float,
    fundamental: float,
    hold: Hold = "zero",
    turns: Sequence[float] = (),
    tones: Sequence[Sequence[float]] = (),
    floor: float = 0.0,
) -> Samples:
    """The samples of records, with an offset of each and the harmonics `turns` of a periodic response beside.

    Outputs and inputs of each record are (channels, samples) and (inputs, samples), `starts` are the times of the first
    samples after phase zero [s], or the angles of all samples over ω (samples,) [s]. A sample at which an output is NaN
    is not there. Each record may have steady `tones` of its own [Hz].
    """
    begins = (0, *np.cumsum([own.shape[1] for own in values]).tolist())
    times = np.concatenate(
        [
            start + step * np.arange(own.shape[1]) if np.ndim(start) == 0 else start
            for own, start in zip(values, starts, strict=True)
        ]
    )
    known = [np.zeros((len(values), begins[-1]))]
    for number, (first, last) in enumerate(pairwise(begins)):
        known[0][number, first:last] = 1.0
    for turn in turns:
        angle = turn * fundamental * times
        known.append(np.array([np.cos(angle), np.sin(angle)]))
    for own, (first, last) in zip(tones or [()] * len(values), pairwise(begins), strict=True):
        for hertz in own:
            angle, both = 2.0 * np.pi * hertz * step * np.arange(last - first), np.zeros((2, begins[-1]))
            both[:, first:last] = np.cos(angle), np.sin(angle)
            known.append(both)
    joined = np.concatenate(values, axis=1)
    there = np.all(np.isfinite(joined), axis=0, keepdims=True)[0]
    return Samples(
        values=np.where(there, joined, 0.0),
        inputs=np.concatenate(inputs, axis=1),
        begins=begins,
        times=times,
        step=step,
        fundamental=fundamental,
        hold=hold,
        known=np.concatenate(known) * there,
        there=there,
        floor=floor,
    )
