"""Samples that wrapped round: counts beyond the range of their integers, which come back at the other end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.core import Record
from floquid.sync._faults import measuring

BITS = (8, 10, 12, 14, 16, 18, 20, 24, 32)
"""Widths of integers that are looked for."""

FULL = 0.95
"""The share of its range that a channel must span to have wrapped round."""

SMOOTHER = 0.25
"""What taking the jumps out must leave of the second differences, in power."""

WHOLE = 1e-3
"""How far counts may be from whole numbers: a factor of calibration rounds them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrapping:
    """A channel whose counts left the range of their integers.

    Parameters
    ----------
    channel
        The name of the channel.
    bits
        The width of the integers.
    jumps
        The jumps by the whole range.
    """

    channel: str
    bits: int
    jumps: int

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        times = "once" if self.jumps == 1 else f"{self.jumps} times"
        return f"channel {self.channel!r} wraps round: it jumps by {2**self.bits} counts, its whole range, {times}"


def wrapped(record: Record) -> tuple[Wrapping, ...]:
    """The channels whose counts wrapped round in integers that were too narrow.

    Values are whole numbers, or whole multiples of the smallest step between two of them, span the range of an integer
    of some width nearly from end to end and nowhere leave it, jump by more than half of it, and are much smoother once
    the whole range is added after each jump. The channels that `clipped` passes over are passed over.

    Parameters
    ----------
    record
        The record.

    Returns
    -------
    tuple of Wrapping
        One a channel, in the order of the record.
    """
    found = []
    for row, values, quantum in measuring(record):
        there = values[np.isfinite(values)]
        # Of wide integers, hardly any two neighbours are in a record.
        counts = there if (there == np.rint(there)).all() else there / quantum
        if len(there) < 3 or np.abs(counts - np.rint(counts)).max() > WHOLE:
            continue
        for bits in BITS:
            jumps = _jumps(np.rint(counts), 2.0**bits)
            if jumps:
                found.append(Wrapping(channel=record.channels[row].name, bits=bits, jumps=jumps))
                break
    return tuple(found)


def _jumps(counts: NDArray[np.float64], whole: float) -> int:
    """How often counts jump by the whole range; 0 where they do not leave it, or are no smoother without."""
    lowest, highest = float(counts.min()), float(counts.max())
    signed = -0.5 * whole <= lowest and highest < 0.5 * whole
    if not (signed or (lowest >= 0.0 and highest < whole)) or highest - lowest < FULL * (whole - 1.0):
        return 0
    jumps = int((np.abs(np.diff(counts)) > 0.5 * whole).sum())
    rough, smooth = (np.sum(np.diff(own, 2) ** 2) for own in (counts, np.unwrap(counts, period=whole)))
    return jumps if smooth < SMOOTHER * rough else 0
