"""Channels of a universal file by the ID lines of its functions, and the time axis that they share.

The format keeps six digits of a step, and has no place for a period or for the words of a channel. It has five lines of
free text, which other programs show and keep:

    1   the name of the channel, or 80 letters of it
    2   floquid rate=2533.333333333334 Hz start=-0.25 s
    3   NONE (elsewhere the date)
    4   floquid period=0.015789473684210523 s origin=0.001 s, or NONE
    5   floquid {"quantity": "pulse", "unit": "V", "location": "disc", "direction": "+x"}

Line 5 is JSON in ASCII; it has a "name" where line 1 is not the whole of it, and may be longer than the 80 columns that
other programs read.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from floquid._checks import counted
from floquid.core import Channel, ConstantPeriod, Quantity, Record, channel_of
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._datasets import DIRECTIONS, FunctionHeader, Point
from floquid.tables import SECONDS, Printed, nominal_rate_of_step

KINDS: dict[str, int] = {
    "strain": 3,
    "displacement": 8,
    "velocity": 11,
    "acceleration": 12,
    "force": 13,
    "angle": 1,
    "pulse": 0,
    "other": 0,
}
"""The specific data type of an ordinate, by what is measured; 1 is "general", 0 "unknown"."""

_COLUMNS, _LABEL = 80, 20
_RATE = re.compile(r"floquid rate=(\S+) Hz start=(\S+) s")
_CLOCK = re.compile(r"floquid period=(\S+) s origin=(\S+) s")
_WORDS = "floquid {"


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnLines:
    """Content of ID lines of ours: numbers in Hz and s, `words` of the channel, and the `doubt` about them."""

    sample_rate: float
    start: float
    period: float | None = None
    origin: float | None = None
    words: dict[str, str] = field(default_factory=dict)
    doubt: str = ""


def id_lines(record: Record, channel: Channel) -> tuple[str, ...]:
    """The five ID lines of a channel."""
    line = " ".join(channel.name.split())[:_COLUMNS].strip()
    words = {} if line == channel.name != "NONE" else {"name": channel.name}
    words |= {"quantity": str(channel.quantity), "unit": channel.unit}
    words |= {key: getattr(channel, key) for key in ("location", "direction", "place") if getattr(channel, key)}
    return (
        line,
        f"floquid rate={record.sample_rate!r} Hz start={record.start!r} s",
        "NONE",
        "NONE" if record.period is None else f"floquid period={record.period!r} s origin={record.origin!r} s",
        f"floquid {json.dumps(words)}",
    )


def unit_label(unit: str) -> str:
    """A unit in the 20 columns of an axis, or "NONE"."""
    return "NONE" if unit == "-" else " ".join(unit.split())[:_LABEL].strip()


def own_lines(source: Source, header: FunctionHeader) -> OwnLines | None:
    """Statements of the ID lines if floquid wrote them, else None."""
    rate = _RATE.fullmatch(header.ids[1])
    if rate is None:
        return None
    clock = _CLOCK.fullmatch(header.ids[3])
    where = f"the function that begins at byte {header.first}"
    try:
        numbers = [float(text) for text in rate.groups()] + [float(text) for text in (clock.groups() if clock else ())]
        steps = [numbers[0], *numbers[2:3]]
        if not np.isfinite(numbers).all() or min(steps) <= 0.0:
            raise ValueError(numbers)
        if clock:
            ConstantPeriod(period=numbers[2], origin=numbers[3])  # refuses an origin that is too far off
    except ValueError:
        must = "have ID lines 2 and 4 as floquid wrote them"
        remedy = "Mend them, or let line 2 be `NONE`: the function can be read without it."
        raise source.error(must, f"has {header.ids[1]!r} and {header.ids[3]!r} in {where}", remedy) from None
    words, doubt = _words(header)
    return OwnLines(
        sample_rate=numbers[0],
        start=numbers[1],
        period=numbers[2] if clock else None,
        origin=numbers[3] if clock else None,
        words=words,
        doubt=doubt,
    )


def _words(header: FunctionHeader) -> tuple[dict[str, str], str]:
    """The words of line 5 and "", or none and the reason why they are not used."""
    name, line = header.ids[0], header.ids[4]
    if not line.startswith(_WORDS):
        return {}, ""
    try:
        words = json.loads(line.removeprefix("floquid "))
        if not all(isinstance(word, str) for word in words.values()) or words["quantity"] not in get_args(Quantity):
            raise ValueError(line)
        channel_of({"name": name} | words)
    except (ValueError, TypeError, KeyError, RecursionError):  # an `InputError` of `Channel` is a ValueError
        return {}, f"ID line 5 of {name!r} is not as floquid wrote it, and is passed over."
    axis = (header.ordinate.kind, header.ordinate.unit or "NONE")
    if (KINDS[words["quantity"]], unit_label(words["unit"])) != axis:
        stated = f"{words['quantity']} in {words['unit']!r}"
        return {}, f"ID line 5 of {name!r} states {stated}, but its axis was changed since: the line is passed over."
    return words, ""


_MEASURED: tuple[Quantity, ...] = ("strain", "displacement", "velocity", "acceleration", "force")
_QUANTITIES: dict[int, Quantity] = {KINDS[quantity]: quantity for quantity in _MEASURED}
_QUANTITIES[9] = "force"
for _code in (2, 5, 6, *range(15, 21)):
    _QUANTITIES[_code] = "other"
"""Quantity by the specific data type of an ordinate; 0 (unknown) and 1 (general) leave it to the unit."""

_SYSTEMS = {1: ("m", "N"), 2: ("ft", "lbf"), 5: ("mm", "mN"), 6: ("cm", "cN"), 7: ("in", "lbf")}
"""Units of length and force, by the code of dataset 164; others name none that could be taken over."""

_SPELLINGS = {
    **dict.fromkeys(("m/s**2", "m/s/s", "m/sec^2", "m/sec2", "M/S^2", "M/S2", "M/S**2"), "m/s^2"),
    **{unit.upper(): unit for unit in ("m", "mm", "m/s", "rad", "deg", "g")},
    "m/sec": "m/s",
    "mm/s**2": "mm/s^2",
    "rad/s**2": "rad/s^2",
}


def name_functions(headers: Sequence[FunctionHeader], own: Sequence[OwnLines | None]) -> list[str]:
    """A name for each function: ours, or else the shortest of the kinds of names below that tells all apart."""
    # The degree of freedom («12:+X»; without one the entity, or ID line 1), then the entity with it, ID line 1, and
    # both.
    entities = [header.response.entity for header in headers]
    points = [header.response.words or header.response.entity or header.ids[0] for header in headers]
    lines = [header.ids[0] for header in headers]
    listed: list[str] = []
    for parts in ((points,), (entities, points), (lines,), (points, lines), (entities, points, lines)):
        listed = [_joined(*words) for words in zip(*parts, strict=True)]
        for row, stated in enumerate(own):
            if stated is not None:
                listed[row] = stated.words.get("name") or lines[row] or listed[row]
        if all(listed) and len(set(listed)) == len(listed):
            return listed
    return [name or f"function {row}" for row, name in enumerate(listed, start=1)]


def _joined(*words: str) -> str:
    """The words that are there, each once."""
    return " ".join(dict.fromkeys(word for word in words if word))


def make_channel(
    header: FunctionHeader, own: OwnLines | None, name: str, unit_system: int | None
) -> tuple[Channel, tuple[str, ...]]:
    """The channel of a function, and notes on what was made of its header."""
    notes = (own.doubt,) if own and own.doubt else ()
    if own and own.words:
        return channel_of(own.words | {"name": name}), notes
    quantity = _QUANTITIES.get(header.ordinate.kind)
    unit = header.ordinate.unit.strip("[]() ")
    unit = _SPELLINGS.get(unit, unit) or _unit_of(quantity, header.response, unit_system)
    words = {
        "location": _joined(header.response.entity, str(header.response.node or "")),
        "direction": DIRECTIONS[header.response.direction],
    }
    try:
        return Channel(name=name, quantity=quantity, unit=unit or "-", **words), notes
    except InputError:
        doubt = f"The header of {name!r} says {quantity} and {unit!r}, which contradict each other: taken as other."
        return Channel(name=name, quantity="other", unit=unit, **words), (*notes, doubt)


def _unit_of(quantity: Quantity | None, point: Point, unit_system: int | None) -> str:
    """The unit that dataset 164 gives a quantity, "" if there is none."""
    if unit_system not in _SYSTEMS:
        return ""
    length, force = _SYSTEMS[unit_system]
    if abs(point.direction) > 3:
        length, force = "rad", ""
    units = {"displacement": length, "velocity": f"{length}/s", "acceleration": f"{length}/s^2", "force": force}
    return units.get(quantity or "", "")


def check_names(source: Source, headers: Sequence[FunctionHeader], names: Sequence[str]) -> None:
    """Refuse two functions that nothing tells apart."""
    first: dict[str, int] = {}
    for header, name in zip(headers, names, strict=True):
        if first.setdefault(name, header.first) != header.first:
            must = "tell its time responses apart by node, direction, entity or ID line 1"
            got = f"has {name!r} twice, at bytes {first[name]} and {header.first}"
            raise source.error(must, got, "Export one run a file, or name the functions in their ID lines.")


_TIME_KINDS = (0, 1, 17)  # specific data types of an abscissa that may be a time: unknown, general, time

_OVERRIDE = "Pass `rate=` [Hz] to say what it is."
_SEEN = 0.005  # samples of drift over the record from which a message says so


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Time axis of the headers: rate [Hz] (None for times), start [s], how it was found; `scale`, the unit [s]."""

    sample_rate: float | None
    rate_note: str | None
    start: float
    scale: float
    notes: tuple[str, ...]


def shared_axis(
    source: Source,
    headers: Sequence[FunctionHeader],
    own: Sequence[OwnLines | None],
    names: Sequence[str],
    *,
    ignore_time: bool,
) -> Axis:
    """The axis of all functions named."""
    _check_alike(source, headers, own, names)
    header, name = headers[0], names[0]
    scale = SECONDS.get(header.abscissa.unit.strip("[]()- ").lower() or "s")
    if header.abscissa.kind not in _TIME_KINDS or (scale is None and not ignore_time):
        unit = f" in {header.abscissa.unit!r}" if header.abscissa.unit else ""
        must = "have times in seconds for its abscissas (specific data type 17)"
        remedy = "Export the time histories, in seconds; or pass `rate=` [Hz] if only the unit's name is unknown."
        raise source.error(must, f"has the type {header.abscissa.kind}{unit} for {name!r}", remedy)
    scale = scale or 1.0
    start, step = (
        replace(number, value=number.value * scale, quantum=number.quantum * scale)
        for number in (header.start, header.step)
    )
    if not header.is_even:
        note = ("The times in the file were ignored.",) if ignore_time else ()
        return Axis(sample_rate=None, rate_note=None, start=0.0, scale=scale, notes=note)
    if step.value <= 0.0 or not 1.0 / step.value < float("inf"):
        if not ignore_time:
            raise source.error("have a positive step of time", f"has {step.text} s for {name!r}", _OVERRIDE)
        return Axis(sample_rate=None, rate_note=None, start=start.value, scale=scale, notes=())
    stated = next((lines for lines in own if lines is not None), None)
    agrees = (
        stated is not None
        and abs(1.0 / stated.sample_rate - step.value) <= 0.6 * step.quantum
        and abs(stated.start - start.value) <= 0.6 * start.quantum
    )
    if stated is not None and agrees:
        rate = f"Sampling rate {stated.sample_rate:.12g} Hz: as ID line 2 states; the header's {step.text} s agrees."
        return Axis(sample_rate=stated.sample_rate, rate_note=rate, start=stated.start, scale=scale, notes=())
    if stated is not None and not ignore_time:
        there = f"a step of {step.text} s from {start.text} s in the header of {name!r}"
        got = f"states {stated.sample_rate:.12g} Hz and {stated.start:.12g} s there, and {there}"
        remedy = "The samples were changed since, or one of the two. " + _OVERRIDE
        raise source.error("have an ID line 2 that agrees with its header", got, remedy)
    rate, note = _rate_of(step, header.n_points)
    notes: tuple[str, ...] = ()
    if start.value != 0.0 and 0.5 * start.quantum > 0.01 * step.value:
        known = f"to {counted(start.digits, 'digit')} only, or {0.5 * start.quantum / step.value:.3g} samples"
        notes = (f"The start {start.text} s is known {known}: so is the phase at it.",)
    return Axis(sample_rate=rate, rate_note=note, start=start.value, scale=scale, notes=notes)


def _rate_of(step: Printed, n_points: int) -> tuple[float, str]:
    """The rate that a printed step means, and the sentence on how it was found."""
    # As in 1.95313e-05 s, which is 51200 Hz: one over it would drift by 79 samples in 600 s.
    nominal = nominal_rate_of_step(step)
    rate = 1.0 / step.value if nominal is None else nominal
    if nominal is not None:
        drift = abs(nominal * step.value - 1.0) * n_points
        loss = f"and would drift by {drift:.3g} samples over the record" if drift > _SEEN else "and agrees"
        few = float(f"{nominal:.7g}") == nominal
        why = "nominal" if few else f"a nominal step of {1.0 / nominal:.6g} s"
        return rate, (
            f"Sampling rate {rate:.12g} Hz: {why}; the header's {step.text} s is rounded to "
            f"{counted(step.digits, 'digit')}, {loss}. `rate=` overrides it."
        )
    drift = 0.5 * step.quantum / step.value * n_points
    if drift <= _SEEN:
        return rate, f"Sampling rate {rate:.12g} Hz: one over the header's {step.text} s."
    return rate, (
        f"Sampling rate {rate:.12g} Hz: one over the header's {step.text} s, known to "
        f"{counted(step.digits, 'digit')} only. The true one may drift by up to {drift:.3g} samples over the record. "
        "No round rate is clearly meant; `rate=` overrides it."
    )


def _check_alike(
    source: Source, headers: Sequence[FunctionHeader], own: Sequence[OwnLines | None], names: Sequence[str]
) -> None:
    """Check that all headers agree, and our ID lines where there are such."""
    facts = []
    for header in headers:
        steps = f"of {header.step.value!r} from {header.start.value!r}" if header.is_even else "at uneven times"
        facts.append(f"{header.n_points} points {steps} {header.abscissa.unit}".rstrip())
    for row, words in enumerate(facts):
        if words != facts[0]:
            raise _differ(source, names, facts, 0, row)
    stated = [_stated(lines) if lines else "" for lines in own]
    first = next((row for row, words in enumerate(stated) if words), 0)
    for row, words in enumerate(stated):
        if words not in ("", stated[first]):
            raise _differ(source, names, stated, first, row)


def _stated(own: OwnLines) -> str:
    clock = "no period" if own.period is None else f"a period of {own.period!r} s from {own.origin!r} s"
    return f"{own.sample_rate!r} Hz from {own.start!r} s and {clock} in its ID lines"


def _differ(source: Source, names: Sequence[str], facts: Sequence[str], one: int, other: int) -> InputError:
    groups: dict[str, list[str]] = {}
    for name, words in zip(names, facts, strict=True):
        groups.setdefault(words, []).append(name)
    listing = " | ".join(", ".join(group[:12]) + (", ..." if len(group) > 12 else "") for group in groups.values())
    must = "hold channels of one step, start, length and period"
    got = f"has {names[one]!r} with {facts[one]} and {names[other]!r} with {facts[other]}"
    return source.error(must, got, f"Choose channels that go together with `channels=`: {listing}.")
