"""Content of a file or an object, channels and numbers as it states them, and the record that comes of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import describe, finite, input_error, positive
from floquid._show import Brief
from floquid.core import Channel, ConstantPeriod, Provenance, Record, channel_of, channels_named
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._rows import repair_rows
from floquid.tables._time_axis import TimeAxis, TimeColumn


def make_channel(source: Source, **words: Any) -> Channel:
    """The channel of a `source` that the `words` describe, those that are None left to `Channel`."""
    try:
        return channel_of(words)
    except InputError as error:
        raise source.wrapped(error) from None
    except ValueError:
        got = f"has {words.get('place')!r:.60}"
        raise source.error("say places as floquid writes them", got, "Mend it, or leave it out.") from None


def make_channels(
    source: Source, names: Sequence[str], units: Sequence[str] | None = None, **words: Sequence[str | None] | None
) -> tuple[Channel, ...]:
    """The channels of a `source` by their `names` and `units`; other `words`, one a channel, as `Channel` has them."""
    given = {key: values for key, values in {"unit": units, **words}.items() if values is not None}
    channels = tuple(
        make_channel(source, name=name, **{key: values[row] for key, values in given.items()})
        for row, name in enumerate(names)
    )
    check_distinct(source, [channel.name for channel in channels])
    return channels


def check_distinct(source: Source, names: Iterable[str]) -> None:
    """Refuse two channels of a `source` with one of the `names`."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise source.error("name each channel once", f"has {name!r} twice", "Rename one of them in the file.")
        seen.add(name)


def rows_of(source: Source, named: Sequence[Channel], channels: Sequence[str] | None) -> list[int]:
    """The rows of the `named` channels of a `source` that `channels` asks for, in that order; None asks for all."""
    if channels is None:
        return list(range(len(named)))
    return channels_named(named, channels, argument="channels", of=source.of)


def with_units(channels: Sequence[Channel], units: Mapping[str, str] | None, source: Source) -> tuple[Channel, ...]:
    """The `channels` of a `source`, some with another unit: `units` by their names."""
    if units is None:
        return tuple(channels)
    names = [channel.name for channel in channels]
    if not isinstance(units, Mapping) or (set(units) - set(names)):
        got = f"is {describe(units)}" if not isinstance(units, Mapping) else f"has {sorted(set(units) - set(names))}"
        listing = "The channels are: " + ", ".join(names) + "."
        raise input_error("units", source.of, "give units by the names of channels", got, listing)
    try:
        return tuple(
            replace(channel, unit=units[channel.name], quantity=None) if channel.name in units else channel
            for channel in channels
        )
    except InputError as error:
        raise source.wrapped(error) from None


def real_row(values: NDArray[Any], name: object, source: Source) -> Floats:
    """The `values` (samples,) of the channel `name` of a `source` as numbers."""
    if values.dtype.kind not in "biuf":
        remedy = "Pass its real part." if values.dtype.kind == "c" else "Leave it out, or turn it into numbers."
        raise source.error("hold real numbers", f"has {values.dtype} in {name!r}", remedy)
    return values.astype(np.float64)


MISSING = "Mend that cell (empty or `nan` for a missing sample)"
"""The remedy where a cell may be empty, to be gone on with."""


def number_in(source: Source, cell: str, line: int, column: str, *, remedy: str, shown: str = "") -> float:
    """The number in a `cell` of a text table in a `source`, NaN of an empty one.

    One that is none is refused by its `line` and `column`, as it is `shown` in the file; `remedy` says how to mend it.
    """
    try:
        if "_" in cell or not cell.isascii():  # Python reads 1_000 and foreign digits, no other tool does
            raise ValueError(cell)
        return float(cell) if cell else np.nan
    except ValueError:
        must = "have a number in every cell"
        raise source.error(must, f"has {(shown or cell)[:40]!r} in line {line}, column {column!r}", remedy) from None


def stated_number(stated: Mapping[Any, Any], key: str, source: Source, *, above_zero: bool) -> float | None:
    """The number that a `source` states as `key` in `stated`, `above_zero` or of any sign; None without one."""
    value = stated.get(key)
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or (above_zero and number <= 0.0):
        must = f"state a {'positive' if above_zero else 'finite'} number as `{key}`"
        raise source.error(must, f"states {describe(value)}", "Correct it, or delete it.")
    return number


def texts_of(record: Record) -> dict[str, list[str]]:
    """The words of the channels of `record`, one text a channel, by the names in our files."""
    channels = record.channels
    places = {f"{key}s": [getattr(c, key) for c in channels] for key in ("location", "direction", "place")}
    return {
        "channels": [channel.name for channel in channels],
        "units": [channel.unit for channel in channels],
        "quantities": [str(channel.quantity) for channel in channels],
        **{key: texts for key, texts in places.items() if any(texts)},
    }


def numbers_of(record: Record) -> dict[str, float]:
    """The rate of `record` [Hz], its start and its clock [s], by the names in our files."""
    return {"sample_rate": record.sample_rate, "start": record.start, **clock_numbers(record)}


def clock_numbers(record: Record) -> dict[str, float]:
    """The `period` and the `origin` [s] of `record`; empty where it has no constant period."""
    return {} if record.period is None else {"period": record.period, "origin": record.origin}


def orbit_of(record: Record) -> dict[str, Floats]:
    """The orbit of `record`, by its name in our files; empty where there is none."""
    return {} if record.orbit is None else {"orbit": record.orbit}


def refuse_blurred_times(record: Record) -> None:
    """Refuse to write times of a `record` whose neighbours are one number."""
    if np.spacing(np.abs(record.times).max()) * record.sample_rate > 0.01:
        must = "have times that a table of numbers can tell apart"
        got = f"starts at {record.start:.6g} s with steps of {1.0 / record.sample_rate:.3g} s"
        raise input_error("record", "write", must, got, "Write it as .npz, or count its time from a nearer start.")


_COUNTER = re.compile(
    r"(unnamed|sample|scan|row|line|(data ?)?point|record|frame|sequence|index|idx|id|count(er)?|no|nr|num(ber)?|n|#)?"
    r"[ _.:-]*(0|index|idx|id|count(er)?|no|nr|num(ber)?|#)?[.:]?",
    re.IGNORECASE,
)
"""Names of a column that counts rows."""


def counts_rows(values: Floats) -> bool:
    """True of `values` that go up by one from row to row, from a whole number on: they count the rows."""
    return len(values) > 1 and float(values[0]).is_integer() and bool((np.diff(values) == 1.0).all())


def without_counters(table: Table) -> Table:
    """The `table` without channels that count its rows, by their names and numbers, unless it has no others."""
    counters = [
        bool(_COUNTER.fullmatch(channel.name)) and counts_rows(row)
        for channel, row in zip(table.channels, table.values, strict=True)
    ]
    if not any(counters) or all(counters):
        return table
    kept = [row for row, counts in enumerate(counters) if not counts]
    names = ", ".join(f"`{channel.name}`" for channel, counts in zip(table.channels, counters, strict=True) if counts)
    note = f"{names} counts the rows and is no channel; name it with `channels=` to read it all the same."
    return replace(
        table,
        values=table.values[kept],
        channels=tuple(table.channels[row] for row in kept),
        orbit=None if table.orbit is None else table.orbit[kept],
        notes=(*table.notes, note),
    )


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
    point
        The operating point: numbers by name.
    notes
        Sentences on what else there is.
    labels
        Names that texts in the file may give the channels, by what those texts are called.
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
    point: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)


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
            point=table.point,
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
        return repair_rows(table.time, table.channels, table.values, source)
    times = table.time.values * (table.time.scale or 1.0)
    if np.array_equal(times, times[0] + np.arange(len(times)) / stated):
        return TimeAxis(sample_rate=stated, start=float(times[0]), notes=(note,))
    fitted = repair_rows(table.time, table.channels, table.values, source)
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
