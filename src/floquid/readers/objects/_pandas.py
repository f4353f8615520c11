"""Records to and from pandas: a row a sample, a column a channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import describe
from floquid.core import Channel, Record
from floquid.io import Source, load_package
from floquid.tables import (
    Table,
    TimeColumn,
    clock_numbers,
    find_time,
    make_channel,
    name_and_unit,
    real_row,
    record_of,
    stated_number,
    times_of,
    with_units,
)

if TYPE_CHECKING:
    import pandas as pd

OWN = "floquid"  # the entry of `attrs` that holds what a table cannot say. It is plain JSON, as Parquet keeps it.

_WORDS = ("name", "quantity", "unit", "location", "direction")


def to_pandas(record: Record) -> pd.DataFrame:
    """The record as a table: a row a sample, a column a channel headed `x [m]`, the times as index [s].

    What a table cannot say (the exact rate, a constant period, quantities, the orbit) is in `attrs["floquid"]`, in
    plain JSON. pandas forgets it in many operations: the times and the units in the headings are left.

    The values are a copy (samples, channels). Raises InputError where pandas is not installed.
    """
    pandas = load_package("pandas", "to_pandas")
    said: dict[str, Any] = {"sample_rate": record.sample_rate}
    said |= clock_numbers(record)
    said["channels"] = {channel.label: {word: getattr(channel, word) for word in _WORDS} for channel in record.channels}
    if record.orbit is not None:
        said["orbit"] = {c.label: row.tolist() for c, row in zip(record.channels, record.orbit, strict=True)}
    frame = pandas.DataFrame(
        record.values.T,
        index=pandas.Index(record.times, name="time [s]"),
        columns=[channel.label for channel in record.channels],
        copy=True,
    )
    frame.attrs[OWN] = said
    return frame


def from_pandas(
    frame: pd.DataFrame | pd.Series,
    *,
    rate: float | None = None,
    units: Mapping[str, str] | None = None,
    period: float | None = None,
    origin: float = 0.0,
) -> Record:
    """A record from a table: a row a sample, a column a channel.

    The times are the index, where it holds dates, durations, fractions without a name, or numbers under a name such
    as `time [ms]`; otherwise the column that is headed as a time. They are repaired as those of a file are
    (`floquid.read`). Dates count from the first of them, at 0 s. NaN and `pandas.NA` are missing samples. A column
    that does not hold real numbers is refused, not left out.

    Of what `to_pandas` gave it is the record that was, except for its provenance. Raises InputError where pandas is not
    installed, times are uneven, or there are no times and no rate. So it does where a column, a unit or a number is not
    possible.

    Parameters
    ----------
    frame
        The table, or a Series of one channel.
    rate
        The sampling rate [Hz]; the times are then ignored, and the record starts at zero.
    units
        Units by the names of channels. By default those in `frame.attrs["units"]`, or in brackets in the headings:
        `x [m]`.
    period
        The period T of the system [s]; attaches `ConstantPeriod(period, origin)`.
    origin
        The time of phase zero [s].
    """
    source = Source(argument="frame", of="from_pandas")
    pandas = load_package("pandas", source.of)
    if isinstance(frame, pandas.Series):
        attrs = frame.attrs
        frame = frame.to_frame("x" if frame.name is None else frame.name)
        frame.attrs.update(attrs)
    if not isinstance(frame, pandas.DataFrame):
        raise source.error("be a DataFrame or a Series", f"is {describe(frame)}", "Pass a row a sample.")
    said = _own(frame.attrs, source)
    labels = [_label(column) for column in frame.columns]
    parts = [name_and_unit(label) for label in labels]
    times, column = None if rate is not None else _index_times(frame.index, source, parts), None
    if times is None:
        column, scale = find_time(source, parts)
        if column is not None and rate is None:
            times = times_of(_plain(frame.iloc[:, column]), scale=scale, label=labels[column])
            if times is None:
                got = f"has {frame.iloc[:, column].dtype} in {labels[column]!r}"
                raise source.error("have times that are numbers, durations or dates", got, "Use `pandas.to_datetime`.")
    kept = [position for position in range(len(labels)) if position != column]
    if not kept:
        raise source.error("have a column for each channel", "has none", "Pass the channels too.")
    values = np.empty((len(kept), len(frame)))
    for row, position in enumerate(kept):
        values[row] = real_row(_plain(frame.iloc[:, position]), labels[position], source)
    channels = _channels([labels[k] for k in kept], [parts[k] for k in kept], frame.attrs, said, source)
    orbit, lost = _orbit([labels[k] for k in kept], said, source)
    table = Table(
        binding=False,
        kind="a pandas DataFrame",
        values=values,
        channels=with_units(channels, units, source),
        time=None if times is None else times[0],
        sample_rate=stated_number(said, "sample_rate", source, above_zero=True),
        period=stated_number(said, "period", source, above_zero=True),
        origin=stated_number(said, "origin", source, above_zero=False),
        orbit=orbit,
        notes=(*(() if times is None else times[1]), *lost),
    )
    return record_of(table, source, rate=rate, period=period, origin=origin)


def _own(attrs: Mapping[Any, Any], source: Source) -> Mapping[str, Any]:
    """Attributes that `to_pandas` wrote; empty where it did not."""
    said = attrs.get(OWN, {})
    tables = [said.get(key, {}) for key in ("channels", "orbit")] if isinstance(said, Mapping) else [None]
    if not all(isinstance(table, Mapping) for table in tables):
        must = f"have `attrs[{OWN!r}]` as `to_pandas` wrote it"
        raise source.error(must, "has another", "Delete it: the rest is enough.")
    return said


def _label(column: Any) -> str:
    """A column's heading as one text, that of several levels joined."""
    return "/".join(str(part) for part in column if str(part)) if isinstance(column, tuple) else str(column)


def _plain(column: pd.Series) -> NDArray[Any]:
    """A column as numpy has it: dates in universal time, numbers as floats where some may be missing."""
    dtype = column.dtype
    if getattr(dtype, "tz", None) is not None:
        return column.dt.tz_convert("UTC").dt.tz_localize(None).to_numpy()
    if not isinstance(dtype, np.dtype) and getattr(dtype, "kind", "O") in "biuf":
        return column.to_numpy(np.float64, na_value=np.nan)
    return column.to_numpy()


def _index_times(
    index: pd.Index, source: Source, parts: Sequence[tuple[str, str | None]]
) -> tuple[TimeColumn, tuple[str, ...]] | None:
    """The times in an index of dates or durations, of numbers that is named so, or of fractions without a name."""
    pandas = load_package("pandas", source.of)
    if isinstance(index, pandas.MultiIndex):
        return None
    values = _plain(index.to_series())
    label = "the index" if index.name is None else _label(index.name)
    if values.dtype.kind in "Mm":
        return times_of(values, scale=1.0, label=label)
    name, unit = ("", None) if index.name is None else name_and_unit(_label(index.name))
    column, scale = find_time(source, [(name, unit)])
    is_time = column is not None or (
        index.name is None and values.dtype.kind == "f" and find_time(source, parts)[0] is None
    )
    return times_of(values, scale=scale, label=label) if is_time else None


def _channels(
    labels: Sequence[str],
    parts: Sequence[tuple[str, str | None]],
    attrs: Mapping[Any, Any],
    said: Mapping[str, Any],
    source: Source,
) -> list[Channel]:
    """Each channel as `to_pandas` said, or by `attrs["units"]`, or by its heading."""
    stated = attrs.get("units")
    listed = stated if isinstance(stated, Mapping) else {}
    channels = []
    for label, (name, unit) in zip(labels, parts, strict=True):
        own = said.get("channels", {}).get(label)
        if isinstance(own, Mapping):
            channels.append(make_channel(source, **{word: own.get(word) for word in _WORDS}))
        else:
            other = listed.get(label, listed.get(name, unit))
            channels.append(make_channel(source, name=name, unit=None if other is None else str(other)))
    return channels


def _orbit(labels: Sequence[str], said: Mapping[str, Any], source: Source) -> tuple[Floats | None, tuple[str, ...]]:
    """The orbit of these columns, and a note where it is not that of all of them."""
    rows = [said.get("orbit", {}).get(label) for label in labels]
    if "orbit" not in said or None in rows:
        lost = ("The orbit is not known of all columns, and is left out.",) if "orbit" in said else ()
        return None, lost
    try:
        return np.array(rows, dtype=np.float64), ()
    except (TypeError, ValueError):
        raise source.error("have an orbit of as many phases in each channel", "has not", "Delete it.") from None
