"""Blocks of records: times after phase zero, phase angles, and channels that miss the same samples together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import input_error
from floquid.core import PhaseClock, Record
from floquid.fit import HALF_DIGITS
from floquid.periodic.least_squares._record_block import GappyBlock, RecordBlock


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
    deviation = deviation - deviation.mean()
    if deviation.std() < HALF_DIGITS:
        return None
    square = deviation**2
    factors = np.array([deviation, square - square.mean(), np.gradient(deviation, times)])
    size = factors.std(axis=1, keepdims=True)
    return factors / np.where(size > 0, size, 1.0)
