"""Blocks of a record as it was sampled: any times, any phase angle, channels with the same samples missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import input_error
from floquid.core import PhaseClock, Record
from floquid.fit import CHUNK, HALF_DIGITS, filter_gain, filtered
from floquid.periodic.least_squares._sample_block import (
    FOLLOWS,
    TREND,
    Block,
    Columns,
    Sums,
    own_function,
    reals_of,
)
from floquid.periodic.least_squares._uniform_grid import EvenColumns, step_of


@dataclass(frozen=True)  # no slots: what is asked often is kept
class RecordBlock(Block):
    """Samples at times after phase zero (samples,) [s]; the phase angle at each [rad], None for ωt."""

    times: Floats
    values: Floats  # (rows, samples)
    hit: int
    rows: Integers
    noise: Floats
    angles: Floats | None = None
    speeds: Floats | None = None
    """Functions that follow the speed (`followed`) (factors, samples); None for a steady shaft."""
    ends: tuple[float, float] | None = None
    """Origins of growth and trends, where they are not the first and the last of the times [s]."""
    taps: Floats | None = None  # the filter that the values went through (rows, taps); None where there was none
    before: RecordBlock | None = None
    """The samples that the filter had before the first, at a wandering speed: there it is applied to the columns."""

    @property
    def n_samples(self) -> int:
        """Samples of each channel."""
        return len(self.times)

    @property
    def last(self) -> float:
        """The time of the last sample [s]: growing columns are counted from there."""
        return float(self.times[-1] if self.ends is None else self.ends[1])

    @property
    def middle(self) -> float:
        """The time about which trends are counted [s]."""
        return 0.5 * (self.first + self.last)

    @property
    def first(self) -> float:
        """The time of the first sample [s]."""
        return float(self.times[0] if self.ends is None else self.ends[0])

    @property
    def half(self) -> float:
        """Unit of trends [s]: half of the time between the first and the last sample."""
        return max(0.5 * (self.last - self.first), np.finfo(float).tiny)

    @cached_property
    def step(self) -> float | None:
        """The step of the times [s], None where they are not evenly spaced."""
        return step_of(self.times)

    def with_noise(self, noise: Floats) -> RecordBlock:
        """Samples with other noise (rows,)."""
        return replace(self, noise=noise)

    def placed(self, hit: int, rows: Integers) -> RecordBlock:
        """Samples as those of another hit, and of other channels."""
        return replace(self, hit=hit, rows=rows)

    def gain(self, rates: Complexes, *, slope: bool = False) -> Complexes:
        """Gain of the filter at e^{st}, or its slope (rows, rates): 1 where the columns go through it."""
        if self.taps is None or self.before is not None:
            return super().gain(rates, slope=slope)
        return filter_gain(self.taps, np.arange(self.taps.shape[1]) * self.interval, rates, slope=slope)

    @property
    def wanders(self) -> bool:
        """True where the speed of the shaft wanders."""
        return self.speeds is not None

    @property
    def interval(self) -> float:
        """The sampling interval [s]."""
        return float(np.median(np.diff(self.times)))

    def filtered(self, taps: Floats) -> RecordBlock | None:
        """The block after a filter along the record (rows, taps); None where samples are missing between others."""
        order, interval = taps.shape[1] - 1, self.interval
        if len(self.times) <= 2 * order or np.ptp(np.diff(self.times)) > 1e-6 * interval:
            return None
        values = filtered(self.values, taps)

        def cut(part: slice) -> dict[str, Floats | None]:
            return {
                "times": self.times[part],
                "angles": None if self.angles is None else self.angles[part],
                "speeds": None if self.speeds is None else self.speeds[:, part],
            }

        ends, early = (self.first, self.last), slice(0, order)
        before = None
        if self.angles is not None and order:
            before = replace(self, **cut(early), values=self.values[:, early], ends=ends)
        return replace(self, **cut(slice(order, None)), values=values, ends=ends, taps=taps, before=before)

    @property
    def largest(self) -> Floats:
        """The largest size of a sample (rows,)."""
        return np.abs(self.values).max(axis=1)

    def residual(self, columns: Columns, coefficients: Complexes) -> tuple[NDArray, NDArray]:
        """Times (samples,) [s] and what the model leaves at each (rows, samples)."""
        even = self._even(columns)
        if even is not None:
            return self.times, even.residual(self.values, coefficients)
        residual = self.values.copy()
        for chunk in self._chunks():
            both = self._columns(columns, chunk)
            residual[:, chunk] -= reals_of(coefficients).T @ both.T
        return self.times, residual

    def sums(self, columns: Columns, coefficients: Complexes) -> Sums:
        """The sums of the scaled columns, and of what the model 2 Re Σ B_j z_j leaves."""
        even = self._even(columns)
        if even is not None:
            return even.sums(self.values, coefficients)
        n, rows = 2 * len(columns.modes), len(self.rows)
        gram, mixed, slopes = np.zeros((3, n, n))
        seen, late, squares = np.zeros((n, rows)), np.zeros((n, rows)), np.zeros(rows)
        weights = reals_of(coefficients).T
        for chunk in self._chunks():
            both, timed = self._with_times(columns, chunk)
            residual = self.values[:, chunk] - weights @ both.T
            gram += both.T @ both
            mixed += both.T @ timed
            slopes += timed.T @ timed
            seen += both.T @ residual.T
            late += timed.T @ residual.T
            squares += np.einsum("cn,cn->c", residual, residual)
        return Sums(gram, mixed, slopes, seen, late, squares)

    def _even(self, columns: Columns) -> EvenColumns | None:
        """The columns in pieces, None where the times are not evenly spaced, or the shaft is not steady."""
        if self.angles is not None:
            return None
        return EvenColumns.of(columns, self.times, self.step, middle=self.middle, half=self.half, last=self.last)

    def _with_times(self, columns: Columns, chunk: slice) -> tuple[Floats, Floats]:
        """The columns, and the columns times t (samples, 2 columns)."""
        if self.before is not None:
            return self._through(columns, chunk)
        both = self._columns(columns, chunk)
        return both, both * self.times[chunk, None]

    def _through(self, columns: Columns, chunk: slice) -> tuple[Floats, Floats]:
        """Factors after the filter, which is one for all rows."""
        assert self.before is not None
        assert self.taps is not None
        plain, order = replace(self, before=None, taps=None), self.taps.shape[1] - 1
        parts = [plain._columns(columns, slice(max(chunk.start - order, 0), chunk.stop))]  # noqa: SLF001  # its own class
        times = [self.times[max(chunk.start - order, 0) : chunk.stop]]
        missing = max(order - chunk.start, 0)
        if missing:
            last = slice(order - missing, order)
            parts.insert(0, self.before._columns(columns, last))  # noqa: SLF001  # its own class
            times.insert(0, self.before.times[last])
        whole, instants = np.concatenate(parts), np.concatenate(times)[:, None]
        timed, n = whole * instants, len(whole) - order
        both, late = np.zeros((n, whole.shape[1])), np.zeros((n, whole.shape[1]))
        for i, tap in enumerate(self.taps[0]):
            both += tap * whole[order - i : order - i + n]
            late += tap * timed[order - i : order - i + n]
        return both, late

    def _chunks(self) -> list[slice]:
        return [slice(first, first + CHUNK) for first in range(0, len(self.times), CHUNK)]

    def _columns(self, columns: Columns, chunk: slice) -> Floats:
        """Re z and Im z beside each other (samples, 2 columns)."""
        if self.before is not None:
            return self._through(columns, chunk)[0]
        times = self.times[chunk]
        angles = columns.fundamental * times if self.angles is None else self.angles[chunk]
        grows = columns.exponents.real > 0
        decays = np.exp(np.multiply.outer(np.where(grows | columns.paired, 0.0, columns.exponents), times))
        decays[grows] = np.exp(np.multiply.outer(columns.exponents[grows], times - self.last))
        decays[columns.factors == TREND] *= (times - self.middle) / self.half
        for entry in np.flatnonzero(columns.paired):
            decays[entry] = own_function(columns, int(entry), times, growth=self.last)
        if self.speeds is not None:
            for factor, factors in zip(FOLLOWS, self.speeds, strict=True):
                decays[columns.factors == factor] *= factors[chunk]
        turns, where = np.unique(columns.turns, return_inverse=True)
        z: Complexes = decays[columns.modes] * _turned(turns, angles)[where]
        return np.concatenate([z.real, z.imag]).T


def _turned(turns: Floats, angles: Floats) -> Complexes:
    """Exponentials e^{iqθ} of sorted turns q (turns, angles): each a step of one from the one before, where it is."""
    unit, exponentials = np.exp(1j * angles), np.empty((len(turns), len(angles)), complex)
    for k, turn in enumerate(turns):
        if k and turn == turns[k - 1] + 1.0:
            np.multiply(exponentials[k - 1], unit, out=exponentials[k])
        else:
            exponentials[k] = np.exp(1j * turn * angles)
    return exponentials


@dataclass(frozen=True, kw_only=True)
class GappyBlock(RecordBlock):
    """Evenly spaced samples with some missing: sums over all, with any values there, less those of these."""

    holes: RecordBlock  # the missing samples with the values that stand for them
    taken: Integers  # indices of the samples that are there (samples there,)

    @property
    def n_samples(self) -> int:
        """Samples of each channel that are there."""
        return len(self.taken)

    def residual(self, columns: Columns, coefficients: Complexes) -> tuple[NDArray, NDArray]:
        """Times (samples,) [s] and what the model leaves at each (rows, samples)."""
        times, residual = super().residual(columns, coefficients)
        return times[self.taken], residual[:, self.taken]

    def sums(self, columns: Columns, coefficients: Complexes) -> Sums:
        """The sums of the scaled columns, and of what the model 2 Re Σ B_j z_j leaves."""
        whole, holes = super().sums(columns, coefficients), self.holes.sums(columns, coefficients)
        names = ("gram", "mixed", "slopes", "seen", "late", "left")
        return Sums(*(getattr(whole, name) - getattr(holes, name) for name in names))

    def filtered(self, taps: Floats) -> GappyBlock | None:
        """The block after a filter along the record (rows, taps), of samples that have all their past."""
        whole = super().filtered(taps)
        there = np.isin(np.arange(len(self.times)), self.taken)
        past = np.asarray(np.lib.stride_tricks.sliding_window_view(there, taps.shape[1]).all(axis=1), bool)
        return None if whole is None or past.mean() < 0.5 else GappyBlock.with_holes(whole, whole.values, past)

    @staticmethod
    def of(grid: RecordBlock, taken: Mask) -> GappyBlock | None:
        """The block of samples `taken` of an evenly spaced grid; None where it is no grid, or too few are there."""
        # Where most are missing, sums over all less those of the missing ones are the dearer way.
        if grid.angles is not None or grid.step is None or taken.mean() < 0.5:
            return None
        index = np.arange(len(taken))
        filled = np.array([np.interp(index, index[taken], row[taken]) for row in grid.values])
        return GappyBlock.with_holes(grid, np.where(taken, grid.values, filled), taken)

    @staticmethod
    def with_holes(grid: RecordBlock, values: Floats, taken: Mask) -> GappyBlock:
        """The samples `taken` of a grid whose values are all finite."""
        shared = {name: getattr(grid, name) for name in ("hit", "rows", "noise", "taps")}
        ends = (grid.first, grid.last)
        holes = RecordBlock(times=grid.times[~taken], values=values[:, ~taken], ends=ends, **shared)
        places = np.flatnonzero(taken)
        return GappyBlock(times=grid.times, values=values, ends=grid.ends, holes=holes, taken=places, **shared)


def record_blocks(
    records: Sequence[Record], clocks: Sequence[PhaseClock], nu: float
) -> tuple[tuple[RecordBlock, ...], float, float]:
    """Blocks of the records, of channels that miss the same samples; the fundamental and periods a revolution."""
    if not len(records) or len(records) != len(clocks):
        must, got = "hold one clock a record", f"there are {len(records)} records and {len(clocks)} clocks"
        raise input_error("clocks", "fit", must, got)
    if any([c.name for c in r.channels] != [c.name for c in records[0].channels] for r in records):
        raise input_error("records", "fit", "have the same channels", "they differ", "Select common channels.")
    period = float(np.mean([clock.period for clock in clocks]))
    nu = clocks[0].periods_per_revolution or nu
    blocks: list[RecordBlock] = []
    for hit, (record, clock) in enumerate(zip(records, clocks, strict=True)):
        times, angles = clock.since_phase_zero(record.start, np.arange(record.n_samples) / record.sample_rate)
        speeds = _speeds(clock, record.times)
        missing = np.isnan(record.values)
        alike: dict[bytes, list[int]] = {}  # a million samples are too many fields for `np.unique`
        for row, absent in enumerate(np.packbits(missing, axis=1)):
            alike.setdefault(absent.tobytes(), []).append(row)
        for rows in map(np.array, alike.values()):
            taken = ~missing[rows[0]]
            if taken.sum() < 2:
                must = "have samples in each channel"
                got = f"channel {record.channels[rows[0]].name!r} of record {hit + 1} has none"
                raise input_error("records", "fit", must, got, "Leave it out with `channels=`.")
            whole_record = bool(taken.all()) and len(rows) == record.n_channels
            grid = RecordBlock(
                times=times,
                values=record.values if whole_record else record.values[rows],
                hit=hit,
                rows=rows,
                noise=np.ones(len(rows)),
                angles=angles,
                speeds=speeds,
            )
            blocks.append(grid if taken.all() else _with_gaps(grid, taken))
    return tuple(blocks), 2.0 * np.pi / period, nu


def _with_gaps(grid: RecordBlock, taken: Mask) -> RecordBlock:
    """The block of some samples of a grid."""
    gappy = GappyBlock.of(grid, taken)
    if gappy is not None:
        return gappy
    return replace(
        grid,
        times=grid.times[taken],
        values=grid.values[:, taken],
        angles=None if grid.angles is None else grid.angles[taken],
        speeds=None if grid.speeds is None else grid.speeds[:, taken],
    )


def _speeds(clock: PhaseClock, times: Floats) -> Floats | None:
    """The factors that follow the speed (3, samples), each of unit size; None for a steady shaft."""
    deviation = clock.fluctuation(times)
    if deviation is None:
        return None
    return None if deviation.std() < HALF_DIGITS else followed(deviation)


def followed(deviation: Floats) -> Floats:
    """Functions of a speed's deviation that a response follows (5, samples), each of mean zero and unit size.

    The deviation, its rate, that one's rate, the square of the deviation, and its product with the rate: a response
    that is almost steady is a series in the speed and in its derivatives.
    """
    deviation = deviation - deviation.mean()
    rate = np.gradient(deviation)
    factors = np.array([deviation, rate, np.gradient(rate), deviation**2, deviation * rate])
    factors -= factors.mean(axis=1, keepdims=True)
    size = factors.std(axis=1, keepdims=True)
    return factors / np.where(size > 0.0, size, 1.0)
