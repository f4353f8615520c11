"""Content of a file or an object, and the record that comes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import finite, input_error, positive
from floquid._show import Brief
from floquid.core import Channel, ConstantPeriod, Provenance, Record
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._time_axis import TimeAxis, TimeColumn, repair

OPTION = "`rate=`"
"""The option that says the sampling rate where nothing else does."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table(Brief):
    """The samples of a file or an object with all that it says of them; None for what it does not.

    Parameters
    ----------
    values, channels
        The samples (channels, samples), NaN where one is missing, and their channels.
    kind
        What they are from, in words.
    time
        The times as they are there.
    sample_rate, rate_note, binding
        The rate that is stated [Hz]; the sentence on where it is from, if "as stated" is not all; and whether it is as
        good as the times. Otherwise it may be out of date, as attributes outlive the rows that they were written for,
        and only sharpens times that agree with it.
    start, period, origin
        The time of the first sample, the period and the time of phase zero [s].
    orbit
        One period of the periodic orbit that the response was about (channels, phases).
    notes
        Sentences on what else there is.
    """

    values: Floats
    channels: tuple[Channel, ...]
    kind: str = "a file"
    time: TimeColumn | None = None
    sample_rate: float | None = None
    rate_note: str | None = None
    binding: bool = True
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    orbit: Floats | None = None
    notes: tuple[str, ...] = ()


def check_table(table: Table, source: Source) -> None:
    """Refuse a `table` of a `source` that no record can be made of, whatever its times are."""
    if table.values.shape[1] == 0:
        raise source.error("hold samples", "holds none", "Export the samples too.")
    bad = np.argwhere(np.isinf(table.values))
    if len(bad):
        row, sample = (int(index) for index in bad[0])
        first = f"the first in channel {table.channels[row].name!r}, sample {sample}"
        must = "hold finite samples (NaN alone marks a missing one)"
        raise source.error(must, f"has {len(bad)} in `values` that are not, {first}", "Save NaN in their place.")
    for key in ("sample_rate", "period"):
        stated = getattr(table, key)
        if stated is not None and not (np.isfinite(stated) and stated > 0.0):
            raise source.error(f"state a positive `{key}`", f"states {stated!r}", "Mend it, or delete it.")


def record_of(
    table: Table, source: Source, *, rate: float | None, period: float | None, origin: float, step: str = ""
) -> Record:
    """The record that a `table` of a `source` describes.

    `rate` [Hz], `period` and `origin` [s] come before what it states; `step` says in a sentence how it was had.
    """
    if rate is not None:
        rate = positive(rate, "rate", source.of, unit="Hz", remedy="Pass the number of samples a second.")
    check_table(table, source)
    axis = settle_axis(table, source, rate)
    if axis is None:
        remedy = f"Pass {OPTION} [Hz], or call the times in it `time` (in a text table `time [s]`)."
        raise source.error("say its sampling rate", "has neither a rate nor a column of times", remedy)
    clock = _clock(table, source, period, origin)
    values = axis.place(table.values)
    step = step or f"Took {values.shape[0]} channels of {values.shape[1]} samples from {table.kind}."
    name = table.kind if source.name == "it" else source.name
    try:
        return Record(
            values=values,
            sample_rate=axis.sample_rate,
            channels=table.channels,
            clock=clock,
            start=axis.start,
            orbit=table.orbit,
            provenance=Provenance(sources=(name,), steps=(step, *axis.notes, *table.notes)),
        )
    except InputError as error:
        raise source.wrapped(error) from None


def _clock(table: Table, source: Source, period: float | None, origin: float) -> ConstantPeriod | None:
    """The clock by the `period` and the `origin` given [s], or else by what is stated; None if there is no period."""
    origin = finite(origin, "origin", source.of, unit="s")
    if period is not None:
        period = positive(period, "period", source.of, unit="s", remedy="Pass the length of a period in seconds.")
        return ConstantPeriod(period=period, origin=origin)
    if table.period is not None:
        try:
            return ConstantPeriod(period=table.period, origin=origin or table.origin or 0.0)
        except InputError as error:
            raise source.wrapped(error) from None
    if origin != 0.0:
        must = "come with a period"
        raise input_error("origin", source.of, must, f"is {origin:g} without one", "Pass `period` [s] too.")
    return None


def settle_axis(table: Table, source: Source, rate: float | None) -> TimeAxis | None:
    """The time axis of a `table` of a `source`: the `rate` given [Hz], the rate stated, or the times; or None."""
    stated, who = table.sample_rate, "the file" if table.kind == "a file" else "it"
    if rate is not None:
        was = "" if stated in (None, rate) else f"; {who} states {stated:.12g} Hz"
        return TimeAxis(
            sample_rate=rate, start=table.start or 0.0, notes=(f"Sampling rate {rate:.12g} Hz: as given{was}.",)
        )
    note = table.rate_note or f"Sampling rate {stated:.12g} Hz: as {who} states." if stated is not None else ""
    if table.time is None:
        even = TimeAxis(sample_rate=stated or 0.0, start=table.start or 0.0, notes=(note,))
        return even if stated is not None and table.binding else None
    if stated is None:
        return repair(table.time, source)
    times = table.time.values * (table.time.scale or 1.0)
    if np.array_equal(times, times[0] + np.arange(len(times)) / stated):
        return TimeAxis(sample_rate=stated, start=float(times[0]), notes=(note,))
    fitted = repair(table.time, source)
    drift = abs(stated / fitted.sample_rate - 1.0) * (table.values.shape[1] - 1)
    if drift > 0.5 and table.binding:
        times_say = f"its times make {fitted.sample_rate:.12g} Hz: {drift:.3g} samples apart at its end"
        got = f"states {stated:.12g} Hz, while {times_say}"
        raise source.error("state the rate that its times have", got, f"Pass {OPTION} [Hz] to say which is right.")
    if drift > 0.5:
        note = f"A rate of {stated:.12g} Hz is stated, which is not that of the times: the times are believed."
        return replace(fitted, notes=(*fitted.notes, note))
    return replace(fitted, sample_rate=stated, notes=(note, *fitted.notes[1:]))


def times_of(values: NDArray[Any], *, scale: float | None, label: str) -> tuple[TimeColumn, tuple[str, ...]] | None:
    """The times in the `values` (samples,) of an index or a column called `label`, and notes; None of no such type.

    Numbers are in units of `scale` seconds (None where no unit is stated). Durations are as they are, and dates count
    from the first of them.
    """
    kind, notes = values.dtype.kind, ()
    if kind == "M" and values.size:
        notes = (f"The times are dates: they count from the first, {values[0]}.",)
        values = values - values[0]
        kind = "m"
    if kind == "m":
        # Divided, not multiplied: decimals stay those of the clock, by which its rounding is told.
        return TimeColumn(values=values / np.timedelta64(1, "s"), scale=1.0, label=label), notes
    if kind not in "iuf":
        return None
    return TimeColumn(values=values.astype(np.float64), scale=scale, label=label), notes
