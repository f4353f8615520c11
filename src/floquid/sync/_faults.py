"""Faults in the samples of a record: clipped tops, dropouts, gaps, counts that wrapped round."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.core import Record, runs_of
from floquid.findings import Finding, failure, note, warning
from floquid.fit import HALF_DIGITS

FLAT = 3  # equal samples in a row that make a flat top
STUCK = 10  # equal samples in a row that make a dropout
FULL = 0.95  # the share of its range that a channel must span to have wrapped round
SMOOTHER = 0.25  # share of the power of second differences that taking the jumps out may leave


def clipped(record: Record) -> tuple[Finding, ...]:
    r"""The channels of `record` that are cut off at their extreme values, in its order, as findings.

    A flat top is a run of three equal samples or more at the channel's highest or lowest value, unless a smooth crest
    explains it. A crest that stays within one quantum q (the smallest step between two values of the channel) for r
    samples is a parabola, which loses at most

    .. math:: q \left(\frac{3r - 1}{r - 1}\right)^2

    r samples further out on either side. A flat top loses more, by half at least. So a coarsely quantised or coarsely
    sampled sine is not called clipped, nor is one of less than about six bits that is. Pulse and angle channels, those
    of the clock and those that switch between two levels are passed over; so are a level of zero, as of a dropout or of
    padding, and a level at which the channel rests for half of the record.

    `Finding.numbers` has the `channel` and its `unit`, the `levels` it is cut at (lowest, highest or both), the
    `samples` in flat tops, and their `share` of those that are not missing.
    """
    found: list[Finding] = []
    for row, values, quantum in measuring(record, standing=True):
        channel = record.channels[row]
        rest = float(np.nanmedian(values))
        levels: list[float] = []
        samples = 0
        for level in (float(np.nanmin(values)), float(np.nanmax(values))):
            tops = [] if level in (0.0, rest) else [run for run in runs_of(values == level) if run[1] - run[0] >= FLAT]
            flat = sum(stop - first for first, stop in tops if _cut(values, first, stop, quantum))
            if flat:
                levels.append(level)
                samples += flat
        if levels:
            share = samples / int(np.isfinite(values).sum())
            numbers = {"channel": channel.name, "unit": channel.unit, "levels": levels, "samples": samples}
            found.append(warning("clipped", **numbers, share=share))
    return tuple(found)


def dropouts(record: Record, *, least: int = STUCK) -> tuple[Finding, ...]:
    """The stretches of `record` in which a channel stands still: zeros put in for lost samples, or a last value held.

    A run of `least` equal samples that the channel enters or leaves by a jump of more than four quanta. Unless it is
    zero, it lies away from the highest and lowest values. The channels that `clipped` passes over are passed over, and
    forces, which rest between blows. In the order of channels, then of time.

    `Finding.numbers` has the `channel` and its `unit`, and the `level` it stands at. It has the times of the `first`
    and the `last` sample [s], and the number of `samples`.
    """
    found: list[Finding] = []
    for row, values, quantum in measuring(record, standing=True):
        channel = record.channels[row]
        if channel.quantity == "force":
            continue
        extremes = (float(np.nanmin(values)), float(np.nanmax(values)))
        # A run of n equal samples is a run of n - 1 differences of zero.
        for first, stop in ((a, b + 1) for a, b in runs_of(np.diff(values) == 0.0)):
            level = float(values[first])
            if stop - first < least or (level in extremes and level != 0.0):
                continue
            beside = [values[n] for n in (first - 1, stop) if 0 <= n < len(values) and np.isfinite(values[n])]
            if max((abs(value - level) for value in beside), default=0.0) > 4.0 * quantum:
                begin, last = (float(record.start + n / record.sample_rate) for n in (first, stop - 1))
                numbers = {"channel": channel.name, "unit": channel.unit, "level": level, "samples": stop - first}
                found.append(warning("stands_still", **numbers, first=begin, last=last))
    return tuple(found)


def gaps(record: Record) -> tuple[Finding, ...]:
    """The runs of missing samples of `record`, in order of time; channels that miss the same stretch share one.

    `Finding.numbers` has the `channels` that miss it `of` all, and the times of the `first` and the `last` sample [s].
    `samples` is their number in each channel.
    """
    where: dict[tuple[int, int], list[str]] = {}
    for channel, values in zip(record.channels, record.values, strict=True):
        for run in runs_of(np.isnan(values)):
            where.setdefault(run, []).append(channel.name)
    return tuple(
        note(
            "missing_samples",
            channels=tuple(where[first, stop]),
            first=float(record.start + first / record.sample_rate),
            last=float(record.start + (stop - 1) / record.sample_rate),
            samples=stop - first,
            of=record.n_channels,
        )
        for first, stop in sorted(where)
    )


def measuring(record: Record, *, standing: bool = False) -> list[tuple[int, Floats, float]]:
    """Row, samples and quantum of channels of smooth motion; with `standing`, those with two equal samples in turn."""
    judged: list[tuple[int, Floats, float]] = []
    for row, (channel, values) in enumerate(zip(record.channels, record.values, strict=True)):
        if channel.quantity in ("pulse", "angle") or channel.name == record.clock_channel:
            continue
        if standing and not (values[1:] == values[:-1]).any():
            continue
        distinct = np.unique(values[np.isfinite(values)])
        if len(distinct) > 1 and not (channel.quantity != "force" and _two_levels(values, distinct[0], distinct[-1])):
            judged.append((row, values, float(np.diff(distinct).min())))
    return judged


def _two_levels(values: Floats, lowest: float, highest: float) -> bool:
    """True where a channel switches between two levels: nine samples of ten within a tenth of the range of either."""
    margin = 0.1 * (highest - lowest)
    low, high = (values <= lowest + margin).sum(), (values >= highest - margin).sum()
    return bool(low + high > 0.9 * np.isfinite(values).sum() and min(low, high) > 0)


def _cut(values: Floats, first: int, stop: int, quantum: float) -> bool:
    """True where no smooth crest explains the flat top."""
    length = stop - first
    beside = [values[n] for n in (first - length, stop - 1 + length) if 0 <= n < len(values)]
    lost = [abs(value - values[first]) for value in beside if np.isfinite(value)]
    most = quantum * ((3 * length - 1) / (length - 1)) ** 2
    return bool(lost) and float(np.mean(lost)) > 1.5 * most


def wrapped(record: Record) -> tuple[Finding, ...]:
    """The channels of `record` whose counts wrapped round in integers that were too narrow, in its order.

    Values are multiples of the smallest step between two of them, and span nearly the range of an integer of some
    width. They jump by more than half of it, and are much smoother once the whole range is added after each jump. The
    channels that `clipped` passes over are passed over.

    `Finding.numbers` has the `channel`, the `bits` of the integers, and the number of `jumps` by the whole range.
    """
    found = []
    for row, values, quantum in measuring(record):
        there = values[np.isfinite(values)]
        # Of wide integers, hardly any two neighbours are in a record.
        counts = there if (there == np.rint(there)).all() else there / quantum
        # The smallest step, and so each count, is known to the rounding of the largest value alone.
        if np.abs(counts - np.rint(counts)).max() > HALF_DIGITS * np.ptp(counts):
            continue
        counts = np.rint(counts)
        ends = float(counts.min()), float(counts.max())
        for bits in range(8, 33):  # the widths of integers
            jumps = _jumps(counts, ends, 2.0**bits)
            if jumps:
                found.append(failure("wraps_round", channel=record.channels[row].name, bits=bits, jumps=jumps))
                break
    return tuple(found)


def _jumps(counts: Floats, ends: tuple[float, float], whole: float) -> int:
    """Number of jumps by the whole range of counts whose lowest and highest are `ends`; 0 where there is no reason."""
    lowest, highest = ends
    signed = -0.5 * whole <= lowest and highest < 0.5 * whole
    if not (signed or (lowest >= 0.0 and highest < whole)) or highest - lowest < FULL * (whole - 1.0):
        return 0
    jumps = int((np.abs(np.diff(counts)) > 0.5 * whole).sum())
    rough, smooth = (np.sum(np.diff(own, 2) ** 2) for own in (counts, np.unwrap(counts, period=whole)))
    return jumps if smooth < SMOOTHER * rough else 0
