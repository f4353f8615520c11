"""A record from an object in memory: what any such object says, and how it becomes a `Record`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from floquid._checks import describe, finite, input_error, positive
from floquid.core._channel import Channel
from floquid.core._clock import ConstantPeriod
from floquid.core._provenance import Provenance
from floquid.core._record import Record
from floquid.core._time_axis import Source, TimeAxis, TimeColumn, repair
from floquid.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """The object that the public callable named `of` was given as its `argument`."""

    argument: str
    of: str

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        """The message «Argument `frame` of `Record.from_pandas` must …, but it …»."""
        return input_error(self.argument, self.of, must, f"it {got}", remedy)

    def wrapped(self, error: InputError) -> InputError:
        """An error of a type that knows no object, with the argument named before it."""
        return self.error("hold a valid record", f"does not: {error}".removesuffix("."))


class Subject(Source, Protocol):
    """What a record is made of, an object or a file, as the public callable named `of` tells of it."""

    @property
    def of(self) -> str: ...

    def wrapped(self, error: InputError) -> InputError:
        """An error of a type that knows nothing of it, with its name before it."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Content:
    """What an object or a file says of a record: `values` (channels, samples), None for what it does not say.

    `orbit` is one period of the periodic orbit that the response was about (channels, phases). `rate_note` is the
    sentence on where `sample_rate` comes from, when "as stated" is not all of it.

    `binding`: the rate stated is as good as the times. Otherwise it is a remark that may be out of date, as attributes
    outlive the rows that they were written for, and only sharpens times that agree with it.
    """

    values: NDArray[np.float64]
    channels: tuple[Channel, ...]
    kind: str = "a file"
    time: TimeColumn | None = None
    sample_rate: float | None = None
    rate_note: str | None = None
    binding: bool = True
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    orbit: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()


def load_package(name: str, of: str) -> Any:
    """An optional package, which has the name of its extra.

    Raises
    ------
    InputError
        It cannot be imported.
    """
    try:
        return import_module(name)
    except ImportError as error:
        message = f"`{of}` works with the package {name}, which cannot be imported ({error})."
        raise InputError(f'{message}\n  Install it: pip install "floquid[{name}]"') from None


def record_of(content: Content, given: Given, *, rate: float | None, period: float | None, origin: float) -> Record:
    """The record that an object describes; `rate` [Hz], `period` and `origin` [s] take precedence over what it says.

    Raises
    ------
    InputError
        The object says no rate and none is given, its times are not those of evenly spaced samples, a value is
        infinite, or a number is not possible.
    """
    if content.values.shape[1] == 0:
        raise given.error("hold samples", "holds none", "Pass at least one.")
    if rate is not None:
        rate = positive(rate, "rate", given.of, unit="Hz", remedy="Pass the number of samples a second.")
    axis = settle_axis(content, given, rate)
    if axis is None:
        raise given.error(
            "say its sampling rate", "has no times", "Pass `rate` [Hz], or give it an index or coordinate of times."
        )
    clock = clock_of(content, given, period, origin)
    bad = np.argwhere(np.isinf(content.values))
    if len(bad):
        row, sample = (int(index) for index in bad[0])
        raise given.error(
            "hold finite samples (NaN alone marks a missing one)",
            f"has {len(bad)} that are not, the first in channel {content.channels[row].name!r}, sample {sample}",
            "Put NaN in their place.",
        )
    values = axis.place(content.values)
    step = f"Took {values.shape[0]} channels of {values.shape[1]} samples from {content.kind}."
    try:
        return Record(
            values=values,
            sample_rate=axis.sample_rate,
            channels=content.channels,
            clock=clock,
            start=axis.start,
            orbit=content.orbit,
            provenance=Provenance(sources=(content.kind,), steps=(step, *axis.notes, *content.notes)),
        )
    except InputError as error:
        raise given.wrapped(error) from None


def clock_of(content: Content, given: Subject, period: float | None, origin: float) -> ConstantPeriod | None:
    """The clock by the `period` and the `origin` given [s], or else by what is stated; None if there is no period.

    Raises
    ------
    InputError
        A number is not possible, or there is an origin and no period.
    """
    origin = finite(origin, "origin", given.of, unit="s")
    if period is not None:
        period = positive(period, "period", given.of, unit="s", remedy="Pass the length of a period in seconds.")
        return ConstantPeriod(period=period, origin=origin)
    if content.period is not None:
        try:
            return ConstantPeriod(period=content.period, origin=origin or content.origin or 0.0)
        except InputError as error:
            raise given.wrapped(error) from None
    if origin != 0.0:
        raise input_error(
            "origin", given.of, "come with a period", f"is {origin:g} without one", "Pass `period` [s] too."
        )
    return None


def settle_axis(content: Content, given: Subject, rate: float | None, *, option: str = "`rate`") -> TimeAxis | None:
    """The time axis by the `rate` given [Hz], by the rate stated, or by the times; None if there is nothing to go by.

    Raises
    ------
    InputError
        The times are not those of evenly spaced samples, or contradict the rate that is stated.
    """
    stated, who = content.sample_rate, "the file" if content.kind == "a file" else "it"
    if rate is not None:
        was = "" if stated in (None, rate) else f"; {who} states {stated:.12g} Hz"
        return TimeAxis(
            sample_rate=rate, start=content.start or 0.0, notes=(f"Sampling rate {rate:.12g} Hz: as given{was}.",)
        )
    note = content.rate_note or f"Sampling rate {stated:.12g} Hz: as {who} states." if stated is not None else ""
    if content.time is None:
        even = TimeAxis(sample_rate=stated or 0.0, start=content.start or 0.0, notes=(note,))
        return even if stated is not None and content.binding else None
    if stated is None:
        return repair(content.time, given)
    times = content.time.values * content.time.scale
    if np.array_equal(times, times[0] + np.arange(len(times)) / stated):
        return TimeAxis(sample_rate=stated, start=float(times[0]), notes=(note,))
    fitted = repair(content.time, given)
    drift = abs(stated / fitted.sample_rate - 1.0) * (content.values.shape[1] - 1)
    if drift > 0.5 and content.binding:
        times_say = f"its times make {fitted.sample_rate:.12g} Hz: {drift:.3g} samples apart at its end"
        raise given.error(
            "state the rate that its times have",
            f"states {stated:.12g} Hz, while {times_say}",
            f"Pass {option} [Hz] to say which is right.",
        )
    if drift > 0.5:
        note = f"A rate of {stated:.12g} Hz is stated, which is not that of the times: the times are believed."
        return replace(fitted, notes=(*fitted.notes, note))
    return replace(fitted, sample_rate=stated, notes=(note, *fitted.notes[1:]))


def times_of(values: NDArray[Any], *, scale: float, label: str) -> tuple[TimeColumn, tuple[str, ...]] | None:
    """Times as an index or a coordinate has them (samples,), and notes; None if they are of no such type.

    Numbers are in units of `scale` seconds, durations are as they are, and dates count from the first of them.
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


def stated_number(stated: Mapping[Any, Any], key: str, given: Given, *, above_zero: bool) -> float | None:
    """The number that the object states as `key`; None if it states none.

    Raises
    ------
    InputError
        It is no finite number, or not above zero where it must be.
    """
    value = stated.get(key)
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or (above_zero and number <= 0.0):
        must = f"state a {'positive' if above_zero else 'finite'} number as `{key}`"
        raise given.error(must, f"states {describe(value)}", "Correct it, or delete it.")
    return number


def make_channel(given: Given, **words: Any) -> Channel:
    """A channel by what the object says of it.

    Raises
    ------
    InputError
        The name is empty, or unit and quantity contradict each other.
    """
    try:
        return Channel(**{key: value for key, value in words.items() if value is not None})
    except InputError as error:
        raise given.wrapped(error) from None


def with_units(channels: Sequence[Channel], units: Mapping[str, str] | None, given: Given) -> tuple[Channel, ...]:
    """The channels, some with another unit by their names.

    Raises
    ------
    InputError
        `units` is no mapping, or names what is no channel.
    """
    if units is None:
        return tuple(channels)
    names = [channel.name for channel in channels]
    if not isinstance(units, Mapping) or (set(units) - set(names)):
        got = f"is {describe(units)}" if not isinstance(units, Mapping) else f"has {sorted(set(units) - set(names))}"
        listing = "The channels are: " + ", ".join(names) + "."
        raise input_error("units", given.of, "give units by the names of channels", got, listing)
    try:
        return tuple(
            replace(channel, unit=units[channel.name], quantity=None) if channel.name in units else channel
            for channel in channels
        )
    except InputError as error:
        raise given.wrapped(error) from None


def real_row(values: NDArray[Any], name: object, given: Given) -> NDArray[np.float64]:
    """One channel (samples,) as numbers.

    Raises
    ------
    InputError
        It holds something else than real numbers.
    """
    if values.dtype.kind not in "biuf":
        remedy = "Pass its real part." if values.dtype.kind == "c" else "Leave it out, or turn it into numbers."
        raise given.error("hold real numbers", f"has {values.dtype} in {name!r}", remedy)
    return values.astype(np.float64)
