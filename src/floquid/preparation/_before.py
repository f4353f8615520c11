"""Steps before the fit: the orbit subtracted, hits cut out, channels that are no responses left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, warning
from floquid.fit import CHUNK
from floquid.preparation._mended import NO_RESPONSE, begins_free, without_faults, without_spikes
from floquid.preparation._refuse import NAMED
from floquid.preparation._settings import Settings
from floquid.sync import clipped, divisible, dropouts, find_hits, gaps, split_hits, tied

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
