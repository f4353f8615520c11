"""The two levels of a channel of pulses, whatever the duty, the polarity and a few spikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error

OF = "pulse_times"

CLEAR = 15.0
"""Heights of pulses must be so many standard deviations of the base: the threshold is then six above it."""

SEPARATE = 10.0
"""Two levels are told from one by how far apart they are, in standard deviations of the lower."""

MOSTLY = 0.6
"""What is high for longer than this fraction of the time is the base of pulses that go down."""

Samples = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Levels:
    """The base, the height of pulses above it, their polarity, and the noise of the base in heights."""

    base: float
    height: float
    polarity: int
    noise: float


def find_levels(values: Samples, channel: str) -> Levels:
    """The levels of the samples (samples,) of a channel.

    Raises
    ------
    InputError
        The channel is empty, constant or has no two levels.
    """
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
    if high - low < SEPARATE * noise or high == low:
        # Pulses are so rare that they do not show in the middle 99 %.
        base = float(np.median(finite))
        noise = _deviation(finite, base)
        polarity = max((1, -1), key=lambda sign: _typical_height(sign * (values - base), noise))
    height = _typical_height(polarity * (values - base), noise)
    if height < CLEAR * noise or height <= 0.0:
        raise input_error(
            "channel",
            OF,
            "hold pulses that stand out of a base",
            f"what goes highest in channel {channel!r} is {height / noise if noise else 0.0:.3g} standard deviations "
            f"away from its base, and {CLEAR:g} are needed",
            "Choose the tachometer's channel. An angle is an AzimuthSignal; pulses in much noise need a filter first.",
        )
    return Levels(base=base, height=height, polarity=polarity, noise=noise / height)


def _two_levels(values: Samples) -> tuple[float, float, float]:
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


def _deviation(values: Samples, level: float) -> float:
    return 1.4826 * float(np.median(np.abs(values - level)))


def _typical_height(above: Samples, noise: float) -> float:
    """How high pulses go, a few higher spikes and many lower ones left aside: of the highest, then the typical top."""
    largest = float(np.nanmax(above))
    high = np.nan_to_num(above, nan=-np.inf) > max(8.0 * noise, 0.05 * largest, 0.0)
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
