"""Records to and from xarray: a dimension of channels and one of time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from floquid._arrays import Floats
from floquid._checks import describe
from floquid.core import Channel, Quantity, Record
from floquid.io import Source, load_package
from floquid.tables import (
    SECONDS,
    Table,
    TimeColumn,
    clock_numbers,
    make_channel,
    real_row,
    record_of,
    stated_number,
    times_of,
    with_units,
)

if TYPE_CHECKING:
    import xarray as xr

_WORDS = ("quantity", "unit", "location", "direction")
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
        orbit=None if orbit is None else _orbit(orbit, channels, source),
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


def _orbit(orbit: Any, channels: list[Channel], source: Source) -> Floats:
    """One period of the orbit of these channels (channels, phases)."""
    if orbit.ndim != 2 or "channel" not in orbit.dims or orbit.sizes["channel"] != len(channels):
        must = f"have `orbit` over `channel` and phases, with {len(channels)} channels"
        raise source.error(must, f"has it with {dict(orbit.sizes)}", "Drop it: `data.drop_vars('orbit')`.")
    return real_row(orbit.transpose("channel", ...).values, "orbit", source)
