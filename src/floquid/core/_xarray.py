"""Records to and from xarray: a dimension of channels and one of time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from floquid._checks import describe
from floquid.core._channel import Channel, Quantity
from floquid.core._clock import ConstantPeriod
from floquid.core._given import (
    Content,
    Given,
    load_package,
    make_channel,
    real_row,
    record_of,
    stated_number,
    times_of,
    with_units,
)
from floquid.core._record import Record
from floquid.core._time_axis import SECONDS, TimeColumn

if TYPE_CHECKING:
    import xarray as xr

_WORDS = ("quantity", "unit", "location", "direction")
_REMEDY = "Pass `DataArray(values, dims=('channel', 'time'), coords={'time': times, 'channel': names})`."


def to_xarray(record: Record) -> xr.Dataset:
    """See `Record.to_xarray`."""
    xarray = load_package("xarray", "Record.to_xarray")
    numbers = {"sample_rate": record.sample_rate}
    if isinstance(record.clock, ConstantPeriod):
        numbers |= {"period": record.clock.period, "origin": record.clock.origin}
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
    time: str,
    rate: float | None,
    units: Mapping[str, str] | None,
    period: float | None,
    origin: float,
) -> Record:
    """See `Record.from_xarray`."""
    given = Given(argument="data", of="Record.from_xarray")
    xarray = load_package("xarray", given.of)
    orbit = None
    if isinstance(data, xarray.Dataset) and "response" in data.data_vars:
        orbit = data.get("orbit")
        data = data["response"].assign_attrs(data.attrs | data["response"].attrs)
    if isinstance(data, xarray.Dataset):
        values, channels = _by_variable(data, time, given)
    elif isinstance(data, xarray.DataArray):
        values, channels = _by_row(data, time, given)
    else:
        raise given.error("be a DataArray or a Dataset", f"is {describe(data)}", _REMEDY)
    times = None if rate is not None or time not in data.coords else _times(data, time, given)
    content = Content(
        binding=False,
        kind=f"an xarray {type(data).__name__}",
        values=values,
        channels=with_units(channels, units, given),
        time=None if times is None else times[0],
        sample_rate=stated_number(data.attrs, "sample_rate", given, above_zero=True),
        period=stated_number(data.attrs, "period", given, above_zero=True),
        origin=stated_number(data.attrs, "origin", given, above_zero=False),
        orbit=None if orbit is None else _orbit(orbit, channels, given),
        notes=() if times is None else times[1],
    )
    return record_of(content, given, rate=rate, period=period, origin=origin)


def _times(data: Any, time: str, given: Given) -> tuple[TimeColumn, tuple[str, ...]] | None:
    coordinate = data.coords[time]
    unit = str(coordinate.attrs.get("units", "s"))
    found = None
    if coordinate.dtype.kind in "Mm" or unit in SECONDS:
        found = times_of(coordinate.values, scale=SECONDS.get(unit, 1.0), label=time)
    if found is None:
        raise given.error(
            f"have `{time}` as numbers in one of s, ms, us, ns, min, h, as durations or as dates",
            f"has {coordinate.dtype} in {unit!r}",
            "Set `attrs['units']` of that coordinate.",
        )
    return found


def _by_variable(data: Any, time: str, given: Given) -> tuple[NDArray[np.float64], list[Channel]]:
    """A variable a channel, each over time alone."""
    others = [f"`{name}` with {variable.dims}" for name, variable in data.data_vars.items() if variable.dims != (time,)]
    if others or not data.data_vars:
        raise given.error(
            f"have the variable `response`, or variables over `{time}` alone, one a channel",
            f"has {', '.join(others)}" if others else "has no variable",
            "Choose among them, as in `data[['x', 'y']]`, or name the dimension by `time`.",
        )
    rows = [real_row(variable.values, name, given) for name, variable in data.data_vars.items()]
    channels = [_channel(str(name), variable.attrs, given) for name, variable in data.data_vars.items()]
    return np.stack(rows), channels


def _by_row(data: Any, time: str, given: Given) -> tuple[NDArray[np.float64], list[Channel]]:
    """One array, over time or over channels and time, in whichever order."""
    if time not in data.dims or data.ndim > 2:
        must = f"have the dimension `{time}`, and beside it one of channels at most"
        raise given.error(must, f"has the dimensions {data.dims}", _REMEDY)
    (dimension,) = [word for word in data.dims if word != time] or ["channel"]
    if data.ndim == 1:  # what a user has chosen one channel from keeps its coordinates, as single values
        names = np.atleast_1d(data.coords["channel"].values if "channel" in data.coords else data.name or "x")
        values = real_row(data.values, str(names[0]), given)[None, :]
    else:
        there = dimension in data.coords
        names = data.coords[dimension].values if there else np.arange(1, data.sizes[dimension] + 1)
        values = real_row(data.transpose(dimension, time).values, dimension, given)
    words = {
        key: np.broadcast_to(data.coords[key].values, names.shape)
        for key in (*_WORDS, "units")
        if key in data.coords and data.coords[key].dims in ((), (dimension,))
    }
    channels = [
        _channel(str(name), data.attrs | {key: column[row] for key, column in words.items()}, given)
        for row, name in enumerate(names)
    ]
    return values, channels


def _channel(name: str, stated: Mapping[Any, Any], given: Given) -> Channel:
    """A channel by its attributes; a `quantity` in other words than ours is passed over."""
    words = {key: str(stated[key]) for key in _WORDS if key in stated}
    if words.get("quantity") not in get_args(Quantity):
        words.pop("quantity", None)
    if "unit" not in words and "units" in stated:
        words["unit"] = str(stated["units"])
    return make_channel(given, name=name, **words)


def _orbit(orbit: Any, channels: list[Channel], given: Given) -> NDArray[np.float64]:
    """One period of the orbit of these channels (channels, phases)."""
    if orbit.ndim != 2 or "channel" not in orbit.dims or orbit.sizes["channel"] != len(channels):
        must = f"have `orbit` over `channel` and phases, with {len(channels)} channels"
        raise given.error(must, f"has it with {dict(orbit.sizes)}", "Drop it: `data.drop_vars('orbit')`.")
    return real_row(orbit.transpose("channel", ...).values, "orbit", given)
