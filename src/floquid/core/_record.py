"""A measured record: channels sampled together at one rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt, finite, frozen_array, input_error, positive
from floquid.core._channel import Channel, channels_named
from floquid.core._clock import Clock
from floquid.core._provenance import Provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record(Rebuilt):
    """Samples of several channels at a constant rate: sample n is at `start` + n/`sample_rate` [s].

    Parameters
    ----------
    values
        The samples (channels, samples); NaN marks a missing one. Held read-only: a writable array is copied.
    sample_rate
        Samples a second [Hz].
    channels
        One `Channel` a row of `values`, or their names.
    clock
        What ties time to the phase of the system, or None while that is not known.
    start
        The time of the first sample [s].
    orbit
        One period of the periodic orbit that the response was about (channels, phases), from phase zero on; None where
        there is none or it is not known. It is part of `values` until `identify` subtracts it.
    provenance
        Where the record comes from.

    Raises
    ------
    InputError
        A shape, a rate, a name or a value is not possible.
    """

    values: NDArray[np.float64]
    sample_rate: float
    channels: tuple[Channel, ...]
    clock: Clock | None = None
    start: float = 0.0
    orbit: NDArray[np.float64] | None = None
    provenance: Provenance = field(default_factory=Provenance)

    def __init__(
        self,
        *,
        values: ArrayLike,
        sample_rate: float,
        channels: Sequence[Channel | str],
        clock: Clock | None = None,
        start: float = 0.0,
        orbit: ArrayLike | None = None,
        provenance: Provenance | None = None,
    ) -> None:
        named = as_channels(channels, "Record")
        flat = isinstance(values, np.ndarray) and values.ndim == 1
        array = frozen_array(
            values,
            "values",
            "Record",
            axes=("channels", "samples"),
            missing=True,
            remedy="One row a channel, also when there is only one: pass `values[None, :]`." if flat else "",
        )
        if array.shape[0] != len(named):
            raise input_error(
                "values",
                "Record",
                f"have shape (channels, samples) with {len(named)} channels",
                f"has shape {array.shape}",
                "Time is the last axis: pass `values.T`."
                if array.shape[1] == len(named)
                else "Name every row of `values` in `channels`.",
            )
        if array.shape[1] == 0:
            raise input_error("values", "Record", "hold at least one sample", f"has shape {array.shape}")
        if clock is not None and not isinstance(clock, Clock):
            must = "be a ConstantPeriod, TachometerSignal, AzimuthSignal, PulseTimes or None"
            raise input_error("clock", "Record", must, f"is {clock!r}", "Pass ConstantPeriod(period=...).")
        put = object.__setattr__
        put(self, "values", array)
        put(self, "sample_rate", positive(sample_rate, "sample_rate", "Record", unit="Hz"))
        put(self, "channels", named)
        put(self, "clock", clock)
        put(self, "start", finite(start, "start", "Record", unit="s"))
        if orbit is not None:
            orbit = frozen_array(orbit, "orbit", "Record", axes=(len(named), "phases"))
            if orbit.shape[1] == 0:
                raise input_error("orbit", "Record", "have at least one phase", "has none", "Pass None for no orbit.")
        put(self, "orbit", orbit)
        put(self, "provenance", provenance if provenance is not None else Provenance())

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return self.values.shape[0]

    @property
    def n_samples(self) -> int:
        """The number of samples of each channel."""
        return self.values.shape[1]

    @property
    def duration(self) -> float:
        """Samples over rate [s]."""
        return self.n_samples / self.sample_rate

    @property
    def times(self) -> NDArray[np.float64]:
        """The time of each sample (samples,) [s]."""
        return self.start + np.arange(self.n_samples) / self.sample_rate

    def select(self, names: Sequence[str]) -> Record:
        """The record of the channels called `names`, in that order.

        Raises
        ------
        InputError
            A name is unknown or given twice.
        """
        rows = channels_named(self.channels, names, argument="names", of="Record.select")
        values = self.values[rows]
        values.flags.writeable = False
        orbit = None if self.orbit is None else self.orbit[rows]
        return replace(self, values=values, channels=tuple(self.channels[row] for row in rows), orbit=orbit)

    def with_clock(self, clock: Clock) -> Record:
        """The same record, tied to `clock`."""
        return replace(self, clock=clock)

    @classmethod
    def from_pandas(
        cls,
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

        Returns
        -------
        Record
            The record. Of what `to_pandas` gave it is the record that was, but for its provenance.

        Raises
        ------
        InputError
            pandas is not installed, the table has no times and no rate is given, times are uneven, or a column, a unit
            or a number is not possible.
        """
        from floquid.core._pandas import from_pandas

        return from_pandas(frame, rate=rate, units=units, period=period, origin=origin)

    def to_pandas(self) -> pd.DataFrame:
        """The record as a table: a row a sample, a column a channel headed `x [m]`, the times as index [s].

        What a table cannot say (the exact rate, a constant period, quantities, the orbit) is in `attrs["floquid"]`, in
        plain JSON. pandas forgets it in many operations: the times and the units in the headings are left.

        Returns
        -------
        pandas.DataFrame
            The table, whose values are a copy (samples, channels).

        Raises
        ------
        InputError
            pandas is not installed.
        """
        from floquid.core._pandas import to_pandas

        return to_pandas(self)

    @classmethod
    def from_xarray(
        cls,
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

        Parameters
        ----------
        data
            The DataArray, in whichever order of dimensions, or the Dataset: with the variable `response`, as
            `to_xarray` gives it, or with variables over time alone.
        time
            The name of the dimension of time.
        rate
            The sampling rate [Hz]; the times are then ignored, and the record starts at zero.
        units
            Units by the names of channels.
        period
            The period T of the system [s]; attaches `ConstantPeriod(period, origin)`. None takes `attrs["period"]`.
        origin
            The time of phase zero [s].

        Returns
        -------
        Record
            The record. Of what `to_xarray` gave it is the record that was, but for its provenance.

        Raises
        ------
        InputError
            xarray is not installed, there are no times and no rate is given, times are uneven, or a dimension, a unit
            or a number is not possible.
        """
        from floquid.core._xarray import from_xarray

        return from_xarray(data, time=time, rate=rate, units=units, period=period, origin=origin)

    def to_xarray(self) -> xr.Dataset:
        """The record as labelled arrays: `response` (channel, time), and `orbit` (channel, phase) where there is one.

        `time` is in seconds. Along `channel` there are the names, and `unit`, `quantity`, `location` and `direction`.
        The attributes of `response` are `sample_rate` [Hz] and, of a constant period, `period` and `origin` [s].

        Returns
        -------
        xarray.Dataset
            The arrays, whose values are copies.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        from floquid.core._xarray import to_xarray

        return to_xarray(self)

    @classmethod
    def from_sep005(
        cls,
        signals: Mapping[str, Any] | Sequence[Mapping[str, Any]],
        *,
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        period: float | None = None,
        origin: float = 0.0,
    ) -> Record:
        """A record from dictionaries by SEP005, in which SDyPy packages exchange time series.

        Each has `data` (samples,), `name`, `unit_str`, and `fs` [Hz] or `time` (samples,) [s]; of the optional keys
        `quantity`, `group` and `start_timestamp` are used. A sample that is NaN or None is missing.

        Parameters
        ----------
        signals
            One dictionary a channel; a single one will do.
        rate
            The sampling rate [Hz]; what the dictionaries say is then ignored.
        units
            Units by the names of channels, in place of `unit_str`.
        period
            The period T of the system [s]; attaches `ConstantPeriod(period, origin)`.
        origin
            The time of phase zero [s].

        Returns
        -------
        Record
            The record. Of what `to_sep005` gave it is the record that was, but for its provenance.

        Raises
        ------
        InputError
            A key is missing, the signals were not sampled together (the message says which), or a unit or a number is
            not possible.
        """
        from floquid.core._sep005 import from_sep005

        return from_sep005(signals, rate=rate, units=units, period=period, origin=origin)

    def to_sep005(self) -> list[dict[str, Any]]:
        """The record as dictionaries by SEP005, one a channel.

        Each has `data`, `name`, `unit_str`, `fs` [Hz] and `quantity`. Keys of our own, which SEP005 allows, are `start`
        [s] unless it is zero, `period` and `origin` [s] of a constant period, `location`, `direction` and `orbit`.

        Returns
        -------
        list of dict
            The dictionaries, whose values are copies.
        """
        from floquid.core._sep005 import to_sep005

        return to_sep005(self)


def as_channels(channels: Sequence[Channel | str], of: str) -> tuple[Channel, ...]:
    """Channels, or names of channels, as a tuple of channels with distinct names.

    Raises
    ------
    InputError
        There is none, one is neither a `Channel` nor a name, or two have one name.
    """
    if isinstance(channels, str) or not all(isinstance(c, (Channel, str)) for c in channels) or not len(channels):
        raise input_error("channels", of, "be a list of Channel or of names, at least one", f"is {channels!r}")
    named = tuple(c if isinstance(c, Channel) else Channel(name=str(c)) for c in channels)
    names = [c.name for c in named]
    doubled = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if doubled:
        raise input_error("channels", of, "have distinct names", f"has {doubled[0]!r} twice", "Rename one of them.")
    return named
