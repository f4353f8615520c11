"""Steps before the fit: faults mended, the orbit subtracted, hits cut out, channels that are no responses left out."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import Record
from floquid.errors import FloquidError, IdentificationError
from floquid.findings import Finding, note, warning
from floquid.fit import CHUNK, DEVIATIONS
from floquid.preparation._refuse import NAMED
from floquid.preparation._settings import Settings
from floquid.sync import Impact, clipped, divisible, dropouts, find_hits, find_impacts, gaps, split_hits, tied

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


CENSORED = 0.02
"""The share of clipped samples of outputs alone that is left out, at most: they are missing because they were large.
At 1 % exponents were within 1.1 of their deviations, at 13 % off by 3.0 (rms of 8 draws)."""


def without_orbit(records: tuple[Record, ...]) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    r"""The records without the periodic orbit that they hold, and that it was subtracted.

    .. math:: o(t) = \sum_k O_k\, e^{2 \pi i k \theta(t)}

    with O the discrete Fourier transform of the orbit over its phases, and θ the phase, in periods.
    """
    if all(record.orbit is None or record.clock is None for record in records):
        return records, ()
    free = []
    for record in records:
        if record.orbit is None or record.clock is None:
            free.append(record)
            continue
        values = record.values - _at(record.orbit, tied(record).turns(record.times))
        values.flags.writeable = False
        free.append(replace(record, values=values, orbit=None))
    return tuple(free), (note("orbit_subtracted"),)


def _at(orbit: Floats, turns: Floats) -> Floats:
    """The orbit at phases in periods (channels, samples)."""
    phases = orbit.shape[1]
    parts = np.fft.rfft(orbit, axis=1) / phases
    parts[:, 1 : (phases + 1) // 2] *= 2.0
    harmonics = np.arange(parts.shape[1])
    found = np.empty((len(orbit), len(turns)))
    for first in range(0, len(turns), CHUNK):
        turned = np.exp(2j * np.pi * np.multiply.outer(harmonics, turns[first : first + CHUNK] % 1.0))
        found[:, first : first + CHUNK] = (parts @ turned).real
    return found


def faults_of(records: tuple[Record, ...], *, repair: bool) -> tuple[Finding, ...]:
    """Findings on samples: channels that are clipped or stand still; with `repair` that is not all that is done."""
    found = [
        replace(fault, where=_name(number, records))
        for number, record in enumerate(records, start=1)
        for fault in (*clipped(record), *dropouts(record))
    ]
    return (*found, *([warning("bad_samples")] if found and not repair else []))


def missing_of(records: tuple[Record, ...]) -> tuple[Finding, ...]:
    """Findings on missing samples."""
    found = []
    for number, record in enumerate(records, start=1):
        where, own = _name(number, records), gaps(record)
        found += [replace(gap, where=where) for gap in own[:NAMED]]
        if len(own) > NAMED:
            found.append(note("more_gaps", where=where, number=len(own) - NAMED))
    return tuple(found)


def _name(number: int, records: tuple[Record, ...]) -> str:
    """Name of a record where there are several."""
    return f"record {number}" if len(records) > 1 else ""


def later(records: tuple[Record, ...], skip: float) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records without their first `skip` periods, and that they were left out."""
    cut = []
    for record in records:
        if record.clock is None:
            must, got = "come with a clock, since it counts periods", "the period is not known"
            raise input_error("skip", "identify", must, got, "Give the period.")
        period = tied(record).period
        samples = int(np.ceil(skip * period * record.sample_rate))
        if samples > record.n_samples - 2:
            got = f"is {skip:g} periods, and a record holds {record.duration / period:.4g}"
            raise input_error("skip", "identify", "leave most of each record", got, "Skip less.")
        cut += from_sample([record], samples)
    return tuple(cut), (note("skipped", periods=skip),)


def begun(records: tuple[Record, ...], settings: Settings) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records without their first periods and without the orbit that they hold, as far as that is asked for."""
    said: tuple[Finding, ...] = ()
    if settings.skip:
        records, said = later(records, settings.skip)
    if settings.orbit:
        records, more = without_orbit(records)
        said += more
    return records, said


def from_sample(records: Sequence[Record], first: int) -> tuple[Record, ...]:
    """The records from a sample on."""
    cut = []
    for record in records:
        values = record.values[:, first:]
        values.flags.writeable = False
        cut.append(replace(record, values=values, start=record.start + first / record.sample_rate))
    return tuple(cut)


def responses_of(records: tuple[Record, ...], settings: Settings) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records without channels that are no responses, forces and pulses, and which were left out."""
    kept, left = [], {}
    for record in records:
        keep = {*settings.channels, record.clock_channel}
        names = [c.name for c in record.channels if c.name in keep or c.quantity not in NO_RESPONSE]
        if len(names) == record.n_channels or not set(names) - keep:
            kept.append(record)
            continue
        kept.append(record.select(names))
        left |= {(c.name, c.quantity): None for c in record.channels if c.name not in names}
    return tuple(kept), tuple(note("no_response", channel=name, quantity=quantity) for name, quantity in left)


def mended(records: tuple[Record, ...], settings: Settings) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records whose excitation goes on without samples that are none, and which are missing or were left out."""
    said = missing_of(records)
    if not settings.repair:
        return records, said
    most = CENSORED if settings.kind == "ambient" else 1.0
    records, more = repaired(records, settings.inputs, most)
    used = []
    for number, record in enumerate(records, start=1):
        found, _, spikes = without_spikes(record, settings.inputs)
        used.append(found)
        more += tuple(replace(own, where=_name(number, records)) for own in spikes)
    return tuple(used), (*said, *more)


def repaired(
    records: tuple[Record, ...], inputs: Sequence[str] = (), most: float = 1.0
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records without samples that are none, and what was left out; channels that are clipped more stay."""
    used, said = [], []
    for number, record in enumerate(records, start=1):
        clips = (fault for fault in clipped(record) if fault.numbers["share"] <= most)
        faults = (*clips, *dropouts(record))
        found, more = without_faults(record, faults, inputs)
        used.append(found)
        said += [replace(own, where=_name(number, records)) for own in more]
    return tuple(used), tuple(said)


def parted(records: tuple[Record, ...], settings: Settings) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records without spikes, each cut where its response was hit inside it, and what was done."""
    free, said = [], []
    for number, record in enumerate(records, start=1):
        used, blows, more = without_spikes(record)
        said += [replace(own, where=_name(number, records)) for own in more]
        if blows and begins_free(used, blows[0]):
            blows = (used.start, *blows)
        if not blows:
            free.append(used)
            continue
        pieces, more = hits_of((used,), settings, blows)
        free += pieces
        said += [warning("cut_at_blows", where=_name(number, records), **own.numbers) for own in more]
    return tuple(free), tuple(said)


def hits_of(
    records: tuple[Record, ...], settings: Settings, given: tuple[float, ...] = ()
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The free response after each impact as a record of its own, and which impacts were found, or are `given` [s]."""
    free, said = [], []
    for number, record in enumerate(records, start=1):
        where = _name(number, records)
        record = divisible(record.clock, record)
        instants = given or find_hits(record)
        if not instants:
            said.append(note("no_impact", where=where))
            free.append(record)
            continue
        period = 0.0 if record.clock is None else tied(record).period
        parts = split_hits(record, instants, skip=(settings.skip or 0.0) * period)
        if not parts:
            raise IdentificationError(
                "No free response is long enough after the impacts found. Give the records of single hits, or less "
                "`skip=`."
            )
        free += parts
        said.append(note("impacts", where=where, instants=instants, hits=len(parts)))
    return tuple(free), tuple(said)
