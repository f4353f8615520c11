"""Samples of records with measured inputs, one after another, and the known columns beside the modes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt

Hold: TypeAlias = Literal["zero", "first", "none"]
"""The input between its samples: held, linear, or acting at the samples alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples(Rebuilt):
    """Outputs and inputs of records of one rate, put one after another, with the angle of the system.

    Parameters
    ----------
    values, inputs
        y (channels, samples) and u (inputs, samples).
    begins
        The first sample of each record, and one past the last of all (records + 1,).
    times
        The angle of the system over ω (samples,) [s]: the time after phase zero where the speed is constant.
    step, fundamental
        The sampling interval [s], and ω [rad/s].
    hold
        The input between its samples.
    known
        Columns beside the modes: an offset of each record, and what repeats with the period (columns, samples).
    """

    values: NDArray[np.float64]
    inputs: NDArray[np.float64]
    begins: tuple[int, ...]
    times: NDArray[np.float64]
    step: float
    fundamental: float
    hold: Hold
    known: NDArray[np.float64]

    @property
    def records(self) -> list[slice]:
        """The samples of each record."""
        return [slice(a, b) for a, b in pairwise(self.begins)]

    @property
    def first_times(self) -> NDArray[np.float64]:
        """Times of the first sample of each record (records,) [s]."""
        return self.times[list(self.begins[:-1])]

    @property
    def n_samples(self) -> int:
        """Samples of all records."""
        return self.values.shape[1]

    @property
    def input_size(self) -> NDArray[np.float64]:
        """The rms of each input (inputs,)."""
        return np.sqrt(np.mean(self.inputs**2, axis=1))

    @cached_property
    def moving(self) -> NDArray[np.float64]:
        """The values less the offset, and what repeats with the period, that fit them best (channels, samples)."""
        steady = np.linalg.lstsq(self.known.T, self.values.T, rcond=None)[0]
        return self.values - steady.T @ self.known

    @cached_property
    def swing(self) -> NDArray[np.float64]:
        """The largest that each channel is beside an offset and what repeats with the period (channels,)."""
        return np.abs(self.moving).max(axis=1)

    def turned(self, turns: float) -> NDArray[np.complex128]:
        """e^{i turns ωt} (samples,)."""
        known = self._angles
        found = known.get(turns)
        if found is None:
            found = known[turns] = np.exp(1j * turns * self.fundamental * self.times)
        return found

    @cached_property
    def _angles(self) -> dict[float, NDArray[np.complex128]]:
        """Turned phases by their number of turns, of those that were asked for."""
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
    values: Sequence[NDArray[np.float64]],
    inputs: Sequence[NDArray[np.float64]],
    starts: Sequence[float | NDArray[np.float64]],
    *,
    step: float,
    fundamental: float,
    hold: Hold = "zero",
    turns: Sequence[float] = (),
) -> Samples:
    """The samples of records, with an offset of each and the harmonics `turns` of a periodic response beside.

    Outputs and inputs of each record are (channels, samples) and (inputs, samples), `starts` are the times of the first
    samples after phase zero [s], or the angles of all samples over ω (samples,) [s].
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
    return Samples(
        values=np.concatenate(values, axis=1),
        inputs=np.concatenate(inputs, axis=1),
        begins=begins,
        times=times,
        step=step,
        fundamental=fundamental,
        hold=hold,
        known=np.concatenate(known),
    )
