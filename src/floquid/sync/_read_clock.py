"""Clocks that sensors carry, read: the one place that knows how each kind of them shows the angle of the shaft."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import AzimuthSignal, PulseTimes, Record, TachometerSignal
from floquid.findings import note, warning
from floquid.sync._azimuth import OF, Evidence, of_azimuth
from floquid.sync._count_pulses import count
from floquid.sync._pulse_times import pulse_times

TURN = 2.0 * np.pi


@singledispatch
def evidence(clock: object, record: Record) -> Evidence:  # noqa: ARG001  # a clock that is read has a function below
    """Instants at which the angle of the shaft is known, by the `clock` of a `record`."""
    got = "has none" if clock is None else f"has a {type(clock).__name__}, which says the angle already"
    must = "have a clock of pulses or azimuth"
    raise input_error("record", OF, must, got, "Pass record.with_clock(TachometerSignal(channel=...)).")


@singledispatch
def divisible(clock: object, record: Record) -> Record:  # noqa: ARG001  # most can be read in any part of a record
    """Record whose `clock` can be read in each part of it."""
    return record


@evidence.register
def _(clock: AzimuthSignal, record: Record) -> Evidence:
    return of_azimuth(record, clock)


@evidence.register
def _(clock: TachometerSignal, record: Record) -> Evidence:
    return _of_pulses(pulse_times(record, clock.channel), clock, 1.0 / record.sample_rate)


@evidence.register
def _(clock: PulseTimes, record: Record) -> Evidence:  # noqa: ARG001  # told by another instrument
    return _of_pulses(clock.times, clock, 0.0)


@divisible.register
def _(clock: TachometerSignal, record: Record) -> Record:
    # A part alone would count the lines of an encoder from its own first.
    pulses = PulseTimes(
        times=pulse_times(record, clock.channel),
        pulses_per_revolution=clock.pulses_per_revolution,
        periods_per_revolution=clock.periods_per_revolution,
    )
    return record.select([c.name for c in record.channels if c.name != clock.channel]).with_clock(pulses)


def _of_pulses(times: Floats, clock: TachometerSignal | PulseTimes, step: float) -> Evidence:
    """Lines of pulses at these times [s], found to within a `step` of the samples [s]."""
    lines = clock.pulses_per_revolution
    if len(times) < 3:
        must = "have three pulses or more, for the speed and how well it is known"
        remedy = "Use a longer record, or pass ConstantPeriod(period=..., origin=...) from these two."
        raise input_error("record", OF, must, f"has {len(times)}, at {times[0]:.6g} and {times[-1]:.6g} s", remedy)
    found = count(times, lines)
    said = [warning("pulses_guessed", first=first, last=last) for first, last in found.doubtful]
    seen = len(np.unique(found.numbers % lines))
    known = lines > 1 and found.numbers[-1] - found.numbers[0] >= 3 * lines and len(found.kept) >= 2 * seen
    if lines > 1 and not known:
        said.append(note("few_revolutions", lines=lines))
    if lines > 1 and not found.absent:
        said.append(note("no_mark"))
    # Zero at the first pulse of line 0.
    origin = -(-int(found.numbers[0]) // lines) * lines
    return Evidence(
        times=times[found.kept],
        angles=TURN * (found.numbers - origin) / lines,
        lines=found.numbers % lines if known else np.zeros(len(found.kept), dtype=np.int64),
        periods_per_revolution=clock.periods_per_revolution,
        n_lines=lines if known else 1,
        missing=found.missing,
        doubled=found.doubled,
        absent=found.absent,
        step=step,
        said=tuple(said),
    )
