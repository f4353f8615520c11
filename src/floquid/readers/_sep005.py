"""Records to and from the dictionaries of SEP005, the exchange format of time series among SDyPy packages.

Source: SDyPy Enhancement Proposal 5. Each channel is a dictionary with `data`, `name`, `unit_str`, and `fs` [Hz] or
`time` [s]; `quantity`, `group`, `start_timestamp` and others are optional, and further keys are allowed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import numpy as np

from floquid._arrays import Floats
from floquid._checks import describe
from floquid.core import Channel, Quantity, Record
from floquid.io import Source
from floquid.tables import (
    Table,
    TimeColumn,
    clock_numbers,
    make_channel,
    real_row,
    record_of,
    stated_number,
    with_units,
)

_CODES: dict[str, Quantity] = {
    "f": "force",
    "a": "acceleration",
    "v": "velocity",
    "d": "displacement",
    "e": "strain",
    "s": "other",
}
_PLACES = ("location", "direction", "place")
_NUMBERS = {"fs": True, "start": False, "period": True, "origin": False}
"""The keys of numbers, and whether they are above zero; the last three are ours."""


def to_sep005(record: Record) -> list[dict[str, Any]]:
    """The record as dictionaries by SEP005, one a channel.

    Each has `data`, `name`, `unit_str`, `fs` [Hz] and `quantity`. Keys of our own, which SEP005 allows, are `start` [s]
    unless it is zero, `period` and `origin` [s] of a constant period, `location`, `direction`, `place`, `orbit` and
    `point`. Values are copies.
    """
    codes: dict[str, str] = {quantity: code for code, quantity in _CODES.items() if code != "s"}
    numbers: dict[str, Any] = {"fs": record.sample_rate}
    if record.start != 0.0:
        numbers["start"] = record.start
    numbers |= clock_numbers(record)
    signals = []
    for row, channel in enumerate(record.channels):
        quantity = str(channel.quantity)
        signal = {"data": record.values[row].copy(), "name": channel.name, "unit_str": channel.unit, **numbers}
        signal["quantity"] = codes.get(quantity, quantity)
        signal |= {key: getattr(channel, key) for key in _PLACES if getattr(channel, key)}
        if record.point:
            signal["point"] = dict(record.point)
        if record.orbit is not None:
            signal["orbit"] = record.orbit[row].copy()
        signals.append(signal)
    return signals


def from_sep005(
    signals: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    units: Mapping[str, str] | None = None,
    rate: float | None = None,
    period: float | None = None,
    origin: float = 0.0,
) -> Record:
    """A record from dictionaries by SEP005, in which SDyPy packages exchange time series.

    Each has `data` (samples,), `name`, `unit_str`, and `fs` [Hz] or `time` (samples,) [s]; of the optional keys
    `quantity`, `group` and `start_timestamp` are used. A sample that is NaN or None is missing.

    Of what `to_sep005` gave it is the record that was, except for its provenance. Raises InputError where a key is
    missing or the signals were not sampled together (the message says which). So it does where a unit or a number is
    not possible.

    `signals` has one dictionary a channel; a single one will do. `rate`, `units`, by the names of channels in place of
    `unit_str`, `period` and `origin` are those of `from_pandas`.
    """
    source = Source(argument="signals", of="from_sep005")
    listed = [signals] if isinstance(signals, Mapping) else signals
    if isinstance(listed, str) or not isinstance(listed, Sequence) or not len(listed):
        raise source.error("be a list of dictionaries, one a channel", f"is {describe(signals)}")
    names = _names(listed, source)
    rows = [_row(signal, name, source) for signal, name in zip(listed, names, strict=True)]
    numbers = [{key: stated_number(s, key, source, above_zero=up) for key, up in _NUMBERS.items()} for s in listed]
    times = [None if s.get("time") is None else real_row(np.asarray(s["time"]), "time", source) for s in listed]
    _check_alike(names, [len(row) for row in rows], "samples", source)
    for key in _NUMBERS:
        _check_alike(names, [stated[key] for stated in numbers], f"`{key}`", source)
    stamps = [signal.get("start_timestamp") for signal in listed]
    _check_alike(names, stamps, "`start_timestamp`", source)
    _check_alike(names, [None if t is None else t.tobytes() for t in times], "`time`", source)
    _check_alike(names, [signal.get("point") for signal in listed], "`point`", source)
    orbit = _orbit(listed, source)
    channels = [_channel(signal, name, source) for signal, name in zip(listed, names, strict=True)]
    stated = numbers[0]
    column = None if times[0] is None or rate is not None else TimeColumn(values=times[0], scale=1.0, label="time")
    if column is not None and len(column.values) != len(rows[0]):
        got = f"has {len(column.values)} times for {len(rows[0])} samples in {names[0]!r}"
        raise source.error("have a time for each sample", got, "Give `fs` [Hz] instead.")
    table = Table(
        kind="SEP005 dictionaries",
        values=np.stack(rows),
        channels=with_units(channels, units, source),
        time=column,
        sample_rate=stated["fs"],
        start=stated["start"],
        period=stated["period"],
        origin=stated["origin"],
        orbit=orbit,
        point=listed[0].get("point") or {},
        notes=() if stamps[0] is None else (f"The first sample was taken at {stamps[0]}.",),
    )
    return record_of(table, source, rate=rate, period=period, origin=origin)


def _names(signals: Sequence[Any], source: Source) -> list[str]:
    """The names of the channels, with the group before those that are there twice."""
    for position, signal in enumerate(signals):
        missing = [key for key in ("data", "name", "unit_str") if not isinstance(signal, Mapping) or key not in signal]
        if missing:
            words = f"`{missing[0]}`" if isinstance(signal, Mapping) else "any, being no dictionary"
            must = "be dictionaries that have `data`, `name` and `unit_str`"
            raise source.error(must, f"has number {position} without {words}")
    names = [str(signal["name"]) for signal in signals]
    groups = [str(signal.get("group") or "") for signal in signals]
    return [
        f"{group}/{name}" if group and names.count(name) > 1 else name
        for name, group in zip(names, groups, strict=True)
    ]


def _row(signal: Mapping[str, Any], name: str, source: Source) -> Floats:
    """The samples of a channel; one that is None is missing."""
    data = signal["data"]
    if isinstance(data, Sequence) and not isinstance(data, str):
        data = [np.nan if value is None else value for value in data]
    values = np.asarray(data)
    if values.ndim != 1:
        must = "hold samples in one dimension"
        raise source.error(must, f"has shape {values.shape} in {name!r}", "Pass one a channel.")
    return real_row(values, name, source)


def _check_alike(names: Sequence[str], stated: Sequence[Any], what: str, source: Source) -> None:
    """Refuse channels that were not sampled together."""
    for name, value in zip(names, stated, strict=True):
        if value != stated[0]:
            words = "" if isinstance(value, bytes) else f": {value} and {stated[0]}"
            got = f"has {what} of {name!r} other than of {names[0]!r}{words}"
            raise source.error("be sampled together", got, "Choose signals that go together, or resample them.")


def _channel(signal: Mapping[str, Any], name: str, source: Source) -> Channel:
    stated = signal.get("quantity")
    quantity = _CODES.get(str(stated), stated)
    return make_channel(
        source,
        name=name,
        unit=str(signal["unit_str"]),
        quantity=quantity if quantity in get_args(Quantity) else None,
        location=str(signal.get("location") or signal.get("group") or ""),
        direction=str(signal.get("direction") or ""),
        place=str(signal.get("place") or ""),
    )


def _orbit(signals: Sequence[Mapping[str, Any]], source: Source) -> Floats | None:
    rows = [np.asarray(signal["orbit"]) for signal in signals if signal.get("orbit") is not None]
    if not rows:
        return None
    if len(rows) < len(signals) or any(row.shape != rows[0].shape or row.ndim != 1 for row in rows):
        raise source.error("have an `orbit` of as many phases in each channel, or in none", "has not", "Delete it.")
    return np.stack([real_row(row, "orbit", source) for row in rows])
