"""Cutting a synchronous record into periods, and joining them again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._checks import input_error, several
from floquid.core import ConstantPeriod, Cycles, PhaseClock, Record
from floquid.errors import NotSynchronousError
from floquid.sync._shaft_angle import tied

LARGEST_DRIFT = 0.01
"""Samples by which the last cycle may have slipped against the first in a record that counts as synchronous."""


def segment(records: Record | Sequence[Record]) -> tuple[Cycles, ...]:
    r"""Cut each record into whole periods of P samples, all of them to one first phase.

    .. math:: \Delta t = T/P, \qquad t_{k + mP} = t_0 + (k + mP)\,\Delta t

    (Allen 2009, before eq. 7.) The values are a view of the record. Records after the first lose the samples before the
    first one's phase; a part of a period at the end is left out, and the provenance says so. `records` is one record,
    or one a hit on the same system: the same channels, rate and period.

    Raises NotSynchronousError where a record is not a whole number of samples a period, or is sampled at another rate
    than the first, or at other phases; InputError where a record has no clock, holds no whole period, has missing
    samples, or differs from the first in period or channels.
    """
    hits = several(records, Record)
    if not hits:
        raise input_error("records", "segment", "hold at least one record", "is empty")
    first = hits[0]
    phases = samples_per_period(first)
    phase = _clock(first).phase(first.start)
    refuse_unlike(hits, "segment")
    for number, record in enumerate(hits[1:], start=2):
        _check_alike(first, record, number)
    return tuple(_cut(record, phases, phase) for record in hits)


def samples_per_period(record: Record) -> int:
    """The whole number P of samples a period.

    Raises NotSynchronousError where the period is not a whole number of samples over the length of the record;
    InputError where the record has no clock, or its period is shorter than a sample or longer than the record.
    """
    period = _clock(record).period
    exact = period * record.sample_rate
    if exact < 0.5:
        must = f"be at least one sampling interval ({1.0 / record.sample_rate:.6g} s)"
        got = f"{period:.6g} s is {exact:.4g} samples"
        raise input_error("period", "segment", must, got, "Check the units of the period and of the sampling rate.")
    cycles = record.n_samples / exact
    if cycles < 1.0:
        must, got = f"be shorter than the record ({record.duration:.6g} s)", f"is {period:.6g} s"
        raise input_error("period", "segment", must, got, "Check the unit of the period, or use a longer record.")
    phases = round(exact)
    if abs(exact - phases) * cycles > LARGEST_DRIFT:
        error = input_error(
            "period",
            "segment",
            "be a whole number of sampling intervals",
            f"{period:.12g} s is {exact:.8g} samples at {record.sample_rate:.12g} Hz: over the {cycles:.0f} periods of "
            f"the record the phase would slip by {abs(exact - phases) * cycles:.3g} samples",
            f"If the period is really {phases} samples, pass period={phases / record.sample_rate:.16g}; if not, "
            "resample the record to a whole number of samples a period first.",
        )
        raise NotSynchronousError(str(error), "whole number")
    return phases


def refuse_unlike(records: Sequence[Record], of: str) -> None:
    """Refuse records that cannot be hits on one system: of other channels, or in other units, than the first."""
    for number, record in enumerate(records[1:], start=2):
        both = (records[0].channels, record.channels)
        one, other = (", ".join(f"{own.name} [{own.unit or '-'}]" for own in channels) for channels in both)
        for what, field in (("channels", "name"), ("units", "unit")):
            if len({tuple(getattr(own, field) for own in channels) for channels in both}) > 1:
                must, got = f"have the same {what}", f"number 1 has {one} and number {number} has {other}"
                raise input_error("records", of, must, got, "Choose common channels with `channels=`, in one order.")


def rejoin(cycles: Cycles) -> Record:
    """The record of the cycles, end to end: the exact inverse of `segment` for whole periods.

    Raises InputError where the cycles differ in length.
    """
    if np.ptp(cycles.periods) > 1e-12 * cycles.period:
        must = "have one period"
        raise input_error("cycles", "rejoin", must, f"has periods differing by {np.ptp(cycles.periods):g} s")
    values = cycles.values.transpose(0, 2, 1).reshape(cycles.n_channels, -1)
    return Record(
        values=values,
        sample_rate=cycles.n_phases / cycles.period,
        channels=cycles.channels,
        clock=ConstantPeriod(period=cycles.period),
        start=cycles.first_phase * cycles.period,
        provenance=cycles.provenance,
    )


def _clock(record: Record) -> PhaseClock:
    if record.clock is None:
        remedy = "Give the period: `period=`, or `read(path, period=...)`."
        raise input_error("records", "segment", "have a clock", "the record has none", remedy)
    if record.period is None:
        must = "have a clock of constant period"
        remedy = "Resample the record to a whole number of samples a period first."
        raise input_error("records", "segment", must, f"one has a {type(record.clock).__name__}", remedy)
    return tied(record)


def _check_alike(first: Record, record: Record, number: int) -> None:
    """Refuse a record of another rate or period than the first."""
    numbers = {
        "sample rate": (first.sample_rate, record.sample_rate, "Hz"),
        "period": (_clock(first).period, _clock(record).period, "s"),
    }
    for what, (one, other, unit) in numbers.items():
        if abs(one - other) > 1e-9 * one:
            error = input_error(
                "records",
                "segment",
                f"have the same {what}",
                f"number 1 has {one:.12g} {unit} and number {number} has {other:.12g} {unit}",
                "Hits identified together are records of one system, sampled alike.",
            )
            raise NotSynchronousError(str(error), "rates") if what == "sample rate" else error


def _cut(record: Record, phases: int, phase: float) -> Cycles:
    """Whole periods of one record from the first sample at `phase` on."""
    if np.isnan(record.values).any():
        rows, columns = np.nonzero(np.isnan(record.values))
        raise input_error(
            "records",
            "segment",
            "have no missing samples",
            f"{len(rows)} are missing, the first in channel {record.channels[rows[0]].name!r} at sample {columns[0]}"
            + (f" of {record.provenance.sources[0]}" if len(record.provenance.sources) == 1 else ""),
            "Cut the record to a part without gaps, or leave the channel out with `channels=`.",
        )
    clock = _clock(record)
    ahead = ((phase - clock.phase(record.start)) % 1.0) * phases
    skip = round(ahead) % phases
    off = abs(ahead - round(ahead))
    if off > LARGEST_DRIFT:
        error = input_error(
            "records",
            "segment",
            "be sampled at the same phases of the period",
            f"one is {off:.3g} samples off the grid of the first",
            "Resample the records to common phases first.",
        )
        raise NotSynchronousError(str(error), "phases")
    n_cycles = (record.n_samples - skip) // phases
    if n_cycles < 1:
        got = f"one has {record.n_samples} samples, {skip} of them before the first phase, at {phases} samples a period"
        raise input_error("records", "segment", "hold at least one whole period", got, "Use a longer record.")
    used = record.values[:, skip : skip + n_cycles * phases]
    left = record.n_samples - n_cycles * phases
    step = f"cut into {n_cycles} periods of {phases} samples" + (f"; {left} samples left out" if left else "")
    return Cycles(
        values=used.reshape(record.n_channels, n_cycles, phases).transpose(0, 2, 1),
        periods=np.full(n_cycles, clock.period),
        first_phase=phase,
        channels=record.channels,
        provenance=record.provenance.then(step),
    )
