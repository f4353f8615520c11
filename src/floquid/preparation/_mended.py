"""Repair the faults of a record: leave out false samples, and cut it where it was hit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.core import Record
from floquid.errors import FloquidError
from floquid.findings import Finding, warning
from floquid.fit import DEVIATIONS
from floquid.sync import Impact, find_impacts

NO_RESPONSE = ("force", "pulse", "angle")
"""Quantities of channels that say what drives a system, or how far it has turned."""

GROWN = 1.3  # times that the typical size of a response grows by at a blow, at least, from one stretch to the next
STRETCH = 64  # samples of such a stretch, at most; a blow nearer to the ends of a record is not looked for
NEAR, ALONE = 12, 0.35
"""Samples about a fault that are compared with it, and how far, as its share, they may be from their neighbours."""

MOST_ABSENT = 0.5  # the share of a channel's samples that may be missing: beyond, the record is mostly gap


def without_faults(
    record: Record, faults: Sequence[Finding], inputs: Sequence[str]
) -> tuple[Record, tuple[Finding, ...]]:
    """The record with clipped samples, and those of a response that stands still, missing; and which."""
    values, found = np.array(record.values), []
    rows = {record.channels[row].name: row for row in _responses(record, inputs)}
    for fault in (own.numbers for own in faults):
        if fault["channel"] not in rows:
            continue
        row = rows[fault["channel"]]
        if "levels" in fault:
            bad = np.isin(record.values[row], fault["levels"])
        else:
            bad = (record.times >= fault["first"]) & (record.times <= fault["last"])
        if bad.mean() <= MOST_ABSENT:
            values[row, bad] = np.nan
            found.append(warning("left_out", channel=fault["channel"], samples=int(bad.sum())))
    return (_with(record, values), tuple(found)) if found else (record, ())


def without_spikes(record: Record, inputs: Sequence[str] = ()) -> tuple[Record, tuple[float, ...], tuple[Finding, ...]]:
    """The record with samples that no response explains missing, the instants at which it was hit, and what was done.

    What an autoregression does not foretell is a blow where the response is larger after it, and else a fault of the
    samples, if it is short and no input jumps there.
    """
    rows = _responses(record, inputs)
    driving = [row for row, channel in enumerate(record.channels) if channel.name in inputs]
    impacts: tuple[Impact, ...] = ()
    with suppress(FloquidError):
        impacts = find_impacts(record, channels=[record.channels[row].name for row in rows])
    if not rows or not impacts or impacts[0].channel is not None:
        return record, (), ()
    values, blows, left = np.array(record.values), [], []
    for impact in impacts:
        first, last = (round((at - record.start) * record.sample_rate) for at in (impact.start, impact.end))
        spike = _stands_alone(record.values[rows], first, last)
        spike = spike and not (driving and _stands_alone(record.values[driving], first, last))
        if not spike and first >= STRETCH // 2 and _grows(record.values[rows], first, last):
            blows.append(impact.start)
        elif spike:
            values[np.ix_(rows, range(max(first - 1, 0), last + 2))] = np.nan
            left.append(impact.start)
    found = (warning("spikes", instants=left, number=len(left)),) if left else ()
    return (_with(record, values) if left else record), tuple(blows), found


def begins_free(record: Record, blow: float) -> bool:
    """True where what comes before a blow lasts long enough, and is a response: noise is not smooth."""
    before = record.values[_responses(record)][:, record.times < blow]
    if before.shape[1] < STRETCH:
        return False
    before = np.nan_to_num(before - np.nanmean(before, axis=1, keepdims=True))
    power = np.maximum(np.sum(before**2, axis=1), np.finfo(float).tiny)
    correlation = np.sum(before[:, 1:] * before[:, :-1], axis=1) / power
    return bool((correlation > DEVIATIONS / np.sqrt(before.shape[1])).any())


def _responses(record: Record, inputs: Sequence[str] = ()) -> list[int]:
    """The rows of the channels that are responses."""
    return [
        row
        for row, channel in enumerate(record.channels)
        if channel.name not in (record.clock_channel, *inputs) and channel.quantity not in NO_RESPONSE
    ]


def _grows(values: Floats, first: int, last: int) -> bool:
    """True where a channel is typically larger in the stretch after these samples than in that before."""
    before = values[:, max(first - STRETCH, 0) : first]
    after = values[:, last + 1 : last + 1 + STRETCH]
    if min(before.shape[1], after.shape[1]) < STRETCH // 2:
        return False
    middle = np.nanmedian(values, axis=1, keepdims=True)
    sizes = [np.nanmedian(np.abs(part - middle), axis=1) for part in (before, after)]
    return bool((sizes[1] > GROWN * sizes[0]).any())


def _stands_alone(values: Floats, first: int, last: int) -> bool:
    """True where a sample of this stretch is far from both its neighbours, and these are not from theirs.

    A lone sample bends the line through three by its height there, and by half of it the other way on either side; a
    step bends it both ways, and a kink once.
    """
    begin = max(first - NEAR, 0)
    part = values[:, begin : last + NEAR + 1]
    bends = part[:, 1:-1] - 0.5 * (part[:, :-2] + part[:, 2:])
    if not np.isfinite(bends).any():
        return False
    row, place = np.unravel_index(int(np.nanargmax(np.abs(bends))), bends.shape)
    if not (max(first - begin - 2, 1) <= place <= min(last - begin + 1, bends.shape[1] - 2)):
        return False
    shares = bends[row] / bends[row, place]
    others = np.abs(np.delete(shares, [place - 1, place, place + 1]))
    return bool(max(np.abs(shares[[place - 1, place + 1]] + 0.5)) < 0.5 * ALONE and np.nanmax(others) < ALONE)


def _with(record: Record, values: Floats) -> Record:
    """The record with other values."""
    values.flags.writeable = False
    return replace(record, values=values)
