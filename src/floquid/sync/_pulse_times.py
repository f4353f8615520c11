"""Instants of the pulses of a tachometer, to a small fraction of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Indices
from floquid._checks import input_error
from floquid.core import Record, channels_named
from floquid.errors import InputError
from floquid.sync._count_pulses import DOUBT, SPAN

OF = "pulse_times"

RISE, FALL = 0.45, 0.25
"""A pulse begins above the one and ends below the other, in heights: narrow pulses rarely show their full height."""

ENDS = (2, 1, 4)
"""Samples of base and of top that the sum over an edge takes in beyond the rise: filters ring, and noise adds up."""

NEAR = 16  # most samples beside an edge from which the levels there are taken: bases drift, and teeth differ in height
CLEAR, CLEAR_AND_EVEN = 15.0, 6.0
"""Least height of pulses over the deviation of the base: the threshold is then six above it. Some that come evenly, as
excursions of noise do not, may be lower."""

MOSTLY = 0.6  # fraction of the time beyond which a high level is the base: pulses of half the time go up


def pulse_times(record: Record, channel: str) -> Floats:
    r"""The times of the pulses of a channel, on the time axis of the record, ascending (pulses,) [s].

    .. math:: t = t_b - \Delta t \sum_{k=a}^{b} \frac{v_k - v_\mathrm{base}}{v_\mathrm{top} - v_\mathrm{base}}

    with samples a … b from the base to the top and :math:`t_b` the end of the last one's interval: the area under an
    edge tells its instant exactly however it falls between the samples, as long as nothing in it is faster than the
    sampling rate. A wide pulse is timed by its leading edge, half-way up. One of a few samples, without a top to see,
    is timed by its middle: half the sum of what the area says of its two edges, or its centroid above the base,
    whichever makes the pulses come the more evenly. Each is a fixed angle of the shaft.

    The levels, the polarity (a pulse is where the signal is for less than 60 % of the time) and the rise are found. A
    pulse is left out whose edge (of a narrow one: any part) is cut by the record's ends or lacks samples. The base may
    drift by a twentieth of the height.

    Where the clock of the `record` is a `TachometerSignal` of this `channel`, the evenness is judged from one
    revolution to the next. Raises InputError where there is no such channel, it holds fewer than two pulses, or they do
    not stand out of its noise: by 15 deviations, or by 6 where 22 and more come evenly.
    """
    (row,) = channels_named(record.channels, [channel], argument="channel", of=OF)
    values = record.values[row]
    levels = find_levels(values, channel)
    heights = levels.polarity * (values - levels.base) / levels.height
    begins, ends = _excursions(heights)
    lines = record.clock.pulses_per_revolution if record.clock is not None and record.clock.channel == channel else 1
    positions = _positions(heights, begins, ends, levels, lines)
    if levels.noise * CLEAR > 1.0 and not _come_evenly(positions, lines):
        raise _no_pulses(channel, 1.0 / levels.noise)
    if len(positions) < 2:
        got = f"channel {channel!r} holds {len(positions) or 'no'} whole pulse" + ("s" if not len(positions) else "")
        remedy = "Choose the tachometer's channel, use a longer record, or give the period."
        raise input_error("channel", OF, "hold two pulses or more", got, remedy)
    return record.start + positions / record.sample_rate


def edges_between(record: Record, channel: str) -> bool:
    """True where hardly any sample lies on an edge, as of a logic level: each edge is then known to a sample only."""
    (row,) = channels_named(record.channels, [channel], argument="channel", of=OF)
    levels = find_levels(record.values[row], channel)
    heights = levels.polarity * (record.values[row] - levels.base) / levels.height
    on_edges = np.count_nonzero((heights > FALL) & (heights < 1.0 - FALL))
    return bool(on_edges < DOUBT * np.count_nonzero(np.diff(heights > RISE)))


@dataclass(frozen=True, slots=True)
class _Shape:
    """Width, gap and rise of a typical pulse of the channel [samples]."""

    width: float
    gap: float
    rise: int


def _excursions(heights: Floats) -> tuple[Indices, Indices]:
    """First sample of each pulse, and the first after it: between the thresholds, and in gaps, the state is kept."""
    state = np.zeros(len(heights), dtype=np.int8)
    state[heights > RISE] = 1
    state[heights < FALL] = -1
    last = np.maximum.accumulate(np.where(state != 0, np.arange(len(state)), 0))
    high = state[last] > 0
    turns = np.flatnonzero(np.diff(high.astype(np.int8), prepend=0, append=0))
    return turns[::2], turns[1::2]


def _positions(heights: Floats, begins: Indices, ends: Indices, levels: Levels, lines: int) -> Floats:
    """Position of each pulse that is seen whole [samples]."""
    if len(begins) < 2:
        whole = (begins > 0) & (ends < len(heights))
        return begins[whole].astype(float)
    shape = _Shape(
        width=float(np.median(ends - begins)),
        gap=float(np.median(begins[1:] - ends[:-1])),
        rise=_rise(heights, begins, levels.noise),
    )
    room = min(shape.width, shape.gap)
    halves = [-(-shape.rise // 2) + more for more in ENDS]
    if room < 2 * halves[0] + 1:
        estimates = _middles(heights, begins, ends, shape)
    else:
        estimates = [_edges(heights, begins, shape, half) for half in halves if room >= 2 * half + 1]
    return min(estimates, key=lambda positions: _unevenness(positions, lines))


def _rise(heights: Floats, begins: Indices, noise: float) -> int:
    """The samples that a typical leading edge has between base and top."""
    margin = max(0.1, 3.0 * noise)
    low, high = np.flatnonzero(heights < margin), np.flatnonzero(heights > 1.0 - margin)
    before, after = np.searchsorted(low, begins) - 1, np.searchsorted(high, begins)
    seen = (before >= 0) & (after < len(high))
    if not seen.any():
        return 0
    return int(np.median(high[after[seen]] - low[before[seen]] - 1))


def _windows(heights: Floats, starts: Indices, size: int) -> Floats:
    """`size` samples from each start on (pulses, size); NaN beyond the record."""
    index = starts[:, None] + np.arange(size)
    inside = (index >= 0) & (index < len(heights))
    return np.where(inside, heights[np.clip(index, 0, len(heights) - 1)], np.nan)


def _level(samples: Floats, default: float) -> Floats:
    """The median of each row (pulses, 1), or the default where most of the row is missing."""
    few = np.isnan(samples).mean(axis=1) > 0.5 if samples.shape[1] else np.ones(len(samples), dtype=bool)
    level = np.full(len(samples), default)
    if not few.all():
        level[~few] = np.nanmedian(samples[~few], axis=1)
    return level[:, None]


def _edges(heights: Floats, begins: Indices, shape: _Shape, half: int) -> Floats:
    """Leading edges by the area method, each between its own base and its own top."""
    before = int(np.clip(shape.gap - 2 * half, 0, NEAR))
    after = int(np.clip(shape.width - 2 * half, 0, NEAR))
    base = _level(_windows(heights, begins - half - before, before), 0.0)
    top = _level(_windows(heights, begins + half, after), 1.0)
    base, top = np.where(top - base > 0.5, base, 0.0), np.where(top - base > 0.5, top, 1.0)
    area = ((_windows(heights, begins - half, 2 * half) - base) / (top - base)).sum(axis=1)
    positions = begins + half - 0.5 - area
    return positions[np.isfinite(positions)]


def _middles(heights: Floats, begins: Indices, ends: Indices, shape: _Shape) -> list[Floats]:
    """Middles of narrow pulses: by the areas of their halves, and their centroids."""
    apart = shape.gap + shape.width
    half = max(min(int(np.ceil(0.5 * (shape.width + shape.rise))) + ENDS[0], int(0.5 * apart)), 1)
    beside = int(np.clip(0.5 * apart - half - 0.5, 0, NEAR))
    offsets = np.arange(-half, half + 1)
    middle, centroid = np.array([]), 0.5 * (begins + ends - 1)
    window = np.empty((0, 2 * half + 1))
    for _ in range(2):  # the window is centred on what it shows
        middle = np.round(centroid).astype(np.intp)
        around = [_windows(heights, start, beside) for start in (middle - half - beside, middle + half + 1)]
        window = _windows(heights, middle - half, 2 * half + 1) - _level(np.hstack(around), 0.0)
        centroid = middle + (window @ offsets) / window.sum(axis=1)
        seen = np.isfinite(centroid) & (np.abs(centroid - middle) < half)
        middle, centroid, window = middle[seen], centroid[seen], window[seen]
    # The areas on the two sides of a boundary between two samples, the one nearest to the middle, tell how far the two
    # edges are from it.
    right = centroid >= middle
    before = np.where(right, window[:, : half + 1].sum(axis=1), window[:, :half].sum(axis=1))
    after = window.sum(axis=1) - before
    halves: Floats = np.where(right, middle + 0.5, middle - 0.5) + 0.5 * (after - before)
    return [halves, np.asarray(centroid, dtype=np.float64)]


def _unevenness(positions: Floats, lines: int) -> float:
    """The median size of the second differences from one revolution to the next."""
    bends = positions[2 * lines :] - 2.0 * positions[lines:-lines] + positions[: -2 * lines]
    return float(np.median(np.abs(bends))) if len(bends) else 0.0


def _come_evenly(positions: Floats, lines: int) -> bool:
    """True of pulses that are as many as chance does not make even, and whose gaps hardly change."""
    if len(positions) < max(2 * SPAN, 2 * lines + 1):
        return False
    return _unevenness(positions, lines) < DOUBT * lines * float(np.median(np.diff(positions)))


@dataclass(frozen=True, slots=True)
class Levels:
    """The base, the height of pulses above it, their polarity, and the noise of the base in heights."""

    base: float
    height: float
    polarity: int
    noise: float


def find_levels(values: Floats, channel: str) -> Levels:
    """The levels of the samples (samples,) of a channel."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0 or np.ptp(finite) == 0.0:
        got = f"channel {channel!r} is " + ("constant" if len(finite) else "missing throughout")
        raise input_error("channel", OF, "hold pulses", got, "Choose the tachometer's channel.")
    clipped = np.clip(finite, *np.quantile(finite, [0.005, 0.995]))
    low, high, split = _two_levels(clipped)
    below, above = finite[finite <= split], finite[finite > split]
    polarity = 1 if len(above) <= MOSTLY * len(finite) else -1
    group = below if polarity > 0 else above
    base = low if polarity > 0 else high
    noise = _deviation(group, base)
    if high - low < CLEAR_AND_EVEN * noise or high == low:
        # Pulses are so rare that they do not show in the middle 99 %.
        base = float(np.median(finite))
        noise = _deviation(finite, base)
        polarity = max((1, -1), key=lambda sign: _typical_height(sign * (values - base), noise))
    height = _typical_height(polarity * (values - base), noise)
    if height < CLEAR_AND_EVEN * noise or height <= 0.0:
        raise _no_pulses(channel, height / noise if noise else 0.0)
    return Levels(base=base, height=height, polarity=polarity, noise=noise / height)


def _no_pulses(channel: str, height: float) -> InputError:
    """The refusal of a channel that goes up by this height, over the deviation of its base, at most."""
    return input_error(
        "channel",
        OF,
        "hold pulses that stand out of a base",
        f"what goes highest in channel {channel!r} is {height:.3g} standard deviations away from its base, and "
        f"{CLEAR:g} are needed, or {CLEAR_AND_EVEN:g} of {2 * SPAN} pulses that come evenly",
        "Choose the tachometer's channel. An angle is an AzimuthSignal; pulses in much noise need a filter first.",
    )


def _two_levels(values: Floats) -> tuple[float, float, float]:
    """The medians of two groups of values, and what splits them: half-way between the two."""
    low, high = float(values.min()), float(values.max())
    for _ in range(50):
        split = 0.5 * (low + high)
        above = values > split
        if above.all() or not above.any():
            break
        found = float(np.median(values[~above])), float(np.median(values[above]))
        if found == (low, high):
            break
        low, high = found
    return low, high, 0.5 * (low + high)


def _deviation(values: Floats, level: float) -> float:
    return 1.4826 * float(np.median(np.abs(values - level)))


def _typical_height(above: Floats, noise: float) -> float:
    """Height of pulses, a few higher spikes and many lower ones left aside: of the highest, then the typical top."""
    largest = float(np.nanmax(above))
    high = np.nan_to_num(above, nan=-np.inf) > max(CLEAR_AND_EVEN * noise, 0.05 * largest, 0.0)
    turns = np.flatnonzero(np.diff(high.astype(np.int8), prepend=0, append=0))
    if len(turns) == 0:
        return 0.0
    filled = np.where(np.isnan(above), -np.inf, above)
    peaks = np.maximum.reduceat(filled, turns[turns < len(filled)])[::2]
    count = len(peaks)
    reference = float(np.sort(peaks)[max(count - 1 - max(count // 20, 1), 0)])
    tops = above[np.nan_to_num(above, nan=-np.inf) > 0.75 * reference]
    tops = tops[tops < 1.5 * reference]
    # Of narrow pulses, samples on the flanks are as many as samples at the top.
    peaks = peaks[(peaks > 0.5 * reference) & (peaks < 1.5 * reference)]
    return float(np.median(tops)) if len(tops) > 5 * len(peaks) else float(np.median(peaks))
