"""Records to and from the labelled arrays of pandas and xarray."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import describe
from floquid.core import Channel, Quantity, Record, point_of
from floquid.io import Source, load_package
from floquid.tables import (
    SECONDS,
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
    import xarray as xr

OWN = "floquid"  # the entry of `attrs` that holds what a table cannot say. It is plain JSON, as Parquet keeps it.

_WORDS = ("quantity", "unit", "location", "direction", "place")


def to_pandas(record: Record) -> pd.DataFrame:
    """The record as a table: a row a sample, a column a channel headed `x [m]`, the times as index [s].

    What a table cannot say (the exact rate, a constant period, quantities, the orbit) is in `attrs["floquid"]`, in
    plain JSON. pandas forgets it in many operations: the times and the units in the headings are left.

    The values are a copy (samples, channels). Raises InputError where pandas is not installed.
    """
    pandas = load_package("pandas", "to_pandas")
    said: dict[str, Any] = {"sample_rate": record.sample_rate}
    said |= clock_numbers(record)
    said["channels"] = {
        channel.label: {word: getattr(channel, word) for word in ("name", *_WORDS)} for channel in record.channels
    }
    if record.orbit is not None:
        said["orbit"] = {c.label: row.tolist() for c, row in zip(record.channels, record.orbit, strict=True)}
    if record.point:
        said["point"] = dict(record.point)
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
    orbit, lost = _orbit_of_columns([labels[k] for k in kept], said, source)
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
        point=said.get("point", {}),
        notes=(*(() if times is None else times[1]), *lost),
    )
    return record_of(table, source, rate=rate, period=period, origin=origin)


def _own(attrs: Mapping[Any, Any], source: Source) -> Mapping[str, Any]:
    """Attributes that `to_pandas` wrote; empty where it did not."""
    said = attrs.get(OWN, {})
    tables = [said.get(key, {}) for key in ("channels", "orbit", "point")] if isinstance(said, Mapping) else [None]
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
            channels.append(make_channel(source, **{word: own.get(word) for word in ("name", *_WORDS)}))
        else:
            other = listed.get(label, listed.get(name, unit))
            channels.append(make_channel(source, name=name, unit=None if other is None else str(other)))
    return channels


def _orbit_of_columns(
    labels: Sequence[str], said: Mapping[str, Any], source: Source
) -> tuple[Floats | None, tuple[str, ...]]:
    """The orbit of these columns, and a note where it is not that of all of them."""
    rows = [said.get("orbit", {}).get(label) for label in labels]
    if "orbit" not in said or None in rows:
        lost = ("The orbit is not known of all columns, and is left out.",) if "orbit" in said else ()
        return None, lost
    try:
        return np.array(rows, dtype=np.float64), ()
    except (TypeError, ValueError):
        raise source.error("have an orbit of as many phases in each channel", "has not", "Delete it.") from None


_REMEDY = "Pass `DataArray(values, dims=('channel', 'time'), coords={'time': times, 'channel': names})`."


def record_to_xarray(record: Record) -> xr.Dataset:
    """The arrays of a `record`, as `floquid.to_xarray` describes them."""
    xarray = load_package("xarray", "to_xarray")
    numbers = {"sample_rate": record.sample_rate}
    numbers |= clock_numbers(record)
    coordinates: dict[str, Any] = {
        "channel": [channel.name for channel in record.channels],
        "time": ("time", record.times, {"units": "s", "long_name": "time"}),
    }
    coordinates = {**record.point, **coordinates}
    for word in _WORDS:
        coordinates[word] = ("channel", [str(getattr(channel, word)) for channel in record.channels])
    variables: dict[str, Any] = {"response": (("channel", "time"), record.values.copy(), numbers)}
    if record.orbit is not None:
        variables["orbit"] = (("channel", "phase"), record.orbit.copy())
    return xarray.Dataset(variables, coords=coordinates)


def from_xarray(
    data: xr.DataArray | xr.Dataset,
    *,
    time: str = "time",
    rate: float | None = None,
    units: Mapping[str, str] | None = None,
    period: float | None = None,
    origin: float = 0.0,
) -> Record:
    """A record from labelled arrays: a DataArray over time, or over channels and time, or a variable a channel.

    The coordinate of time is in seconds, or in its `attrs["units"]`, or holds durations or dates, which count from
    the first of them; it is repaired as the times of a file are (`floquid.read`). Names are the coordinate of the
    other dimension, or those of the variables. Units are the coordinate `unit`, or `attrs["units"]`.

    Of what `to_xarray` gave it is the record that was, except for its provenance. Raises InputError where xarray is not
    installed, times are uneven, or there are no times and no rate. So it does where a dimension, a unit or a number is
    not possible.

    Parameters
    ----------
    data
        The DataArray, in whichever order of dimensions, or the Dataset: with the variable `response`, as
        `to_xarray` gives it, or with variables over time alone.
    time
        The name of the dimension of time.
    rate, units, period, origin
        Those of `from_pandas`; without a period there is that of `attrs["period"]`.
    """
    source = Source(argument="data", of="from_xarray")
    xarray = load_package("xarray", source.of)
    orbit = None
    if isinstance(data, xarray.Dataset) and "response" in data.data_vars:
        orbit = data.get("orbit")
        data = data["response"].assign_attrs(data.attrs | data["response"].attrs)
    if isinstance(data, xarray.Dataset):
        values, channels = _by_variable(data, time, source)
    elif isinstance(data, xarray.DataArray):
        values, channels = _by_row(data, time, source)
    else:
        raise source.error("be a DataArray or a Dataset", f"is {describe(data)}", _REMEDY)
    times = None if rate is not None or time not in data.coords else _times(data, time, source)
    table = Table(
        binding=False,
        kind=f"an xarray {type(data).__name__}",
        values=values,
        channels=with_units(channels, units, source),
        time=None if times is None else times[0],
        sample_rate=stated_number(data.attrs, "sample_rate", source, above_zero=True),
        period=stated_number(data.attrs, "period", source, above_zero=True),
        origin=stated_number(data.attrs, "origin", source, above_zero=False),
        orbit=None if orbit is None else _orbit_of_rows(orbit, channels, source),
        point=point_of({str(k): float(v) for k, v in data.coords.items() if v.ndim == 0 and v.dtype.kind in "iuf"}),
        notes=() if times is None else times[1],
    )
    return record_of(table, source, rate=rate, period=period, origin=origin)


def _times(data: Any, time: str, source: Source) -> tuple[TimeColumn, tuple[str, ...]] | None:
    coordinate = data.coords[time]
    unit = str(coordinate.attrs.get("units", ""))
    found = None
    if coordinate.dtype.kind in "Mm" or unit in ("", *SECONDS):
        found = times_of(coordinate.values, scale=SECONDS.get(unit), label=time)
    if found is None:
        must = f"have `{time}` as numbers in one of s, ms, us, ns, min, h, as durations or as dates"
        raise source.error(must, f"has {coordinate.dtype} in {unit!r}", "Set `attrs['units']` of that coordinate.")
    return found


def _by_variable(data: Any, time: str, source: Source) -> tuple[Floats, list[Channel]]:
    """A variable a channel, each over time alone."""
    others = [f"`{name}` with {variable.dims}" for name, variable in data.data_vars.items() if variable.dims != (time,)]
    if others or not data.data_vars:
        must = f"have the variable `response`, or variables over `{time}` alone, one a channel"
        got = f"has {', '.join(others)}" if others else "has no variable"
        raise source.error(must, got, "Choose among them, as in `data[['x', 'y']]`, or name the dimension by `time`.")
    rows = [real_row(variable.values, name, source) for name, variable in data.data_vars.items()]
    channels = [_channel(str(name), variable.attrs, source) for name, variable in data.data_vars.items()]
    return np.stack(rows), channels


def _by_row(data: Any, time: str, source: Source) -> tuple[Floats, list[Channel]]:
    """One array, over time or over channels and time, in whichever order."""
    if time not in data.dims or data.ndim > 2:
        must = f"have the dimension `{time}`, and beside it one of channels at most"
        raise source.error(must, f"has the dimensions {data.dims}", _REMEDY)
    (dimension,) = [word for word in data.dims if word != time] or ["channel"]
    if data.ndim == 1:  # what a user has chosen one channel from keeps its coordinates, as single values
        names = np.atleast_1d(data.coords["channel"].values if "channel" in data.coords else data.name or "x")
        values = real_row(data.values, str(names[0]), source)[None, :]
    else:
        there = dimension in data.coords
        names = data.coords[dimension].values if there else np.arange(1, data.sizes[dimension] + 1)
        values = real_row(data.transpose(dimension, time).values, dimension, source)
    words = {
        key: np.broadcast_to(data.coords[key].values, names.shape)
        for key in (*_WORDS, "units")
        if key in data.coords and data.coords[key].dims in ((), (dimension,))
    }
    channels = [
        _channel(str(name), data.attrs | {key: column[row] for key, column in words.items()}, source)
        for row, name in enumerate(names)
    ]
    return values, channels


def _channel(name: str, stated: Mapping[Any, Any], source: Source) -> Channel:
    """A channel by its attributes; a `quantity` in other words than ours is passed over."""
    words = {key: str(stated[key]) for key in _WORDS if key in stated}
    if words.get("quantity") not in get_args(Quantity):
        words.pop("quantity", None)
    if "unit" not in words and "units" in stated:
        words["unit"] = str(stated["units"])
    return make_channel(source, name=name, **words)


def _orbit_of_rows(orbit: Any, channels: list[Channel], source: Source) -> Floats:
    """One period of the orbit of these channels (channels, phases)."""
    if orbit.ndim != 2 or "channel" not in orbit.dims or orbit.sizes["channel"] != len(channels):
        must = f"have `orbit` over `channel` and phases, with {len(channels)} channels"
        raise source.error(must, f"has it with {dict(orbit.sizes)}", "Drop it: `data.drop_vars('orbit')`.")
    return real_row(orbit.transpose("channel", ...).values, "orbit", source)
