"""Clocks that sensors carry, read: the one place that knows how each kind of them shows the angle of the shaft."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Literal

import numpy as np

from floquid._arrays import Floats, Indices, Integers
from floquid._checks import input_error
from floquid.core import AzimuthSignal, Channel, PulseTimes, Record, TachometerSignal, channels_named
from floquid.findings import Finding, note, warning
from floquid.sync._count_pulses import DOUBT, FEWEST_PHASES, SPAN, count
from floquid.sync._pulse_times import edges_between, pulse_times

OF = "shaft_angle"

TURNS = {"deg": 360.0, "rad": 2.0 * np.pi, "mrad": 2e3 * np.pi, "urad": 2e6 * np.pi}  # a revolution in each unit


@dataclass(frozen=True, slots=True)
class Evidence:
    """Instants [s] at which the angle [rad] is known up to the offset of a line, and what was done to get them."""

    times: Floats
    angles: Floats
    lines: Integers
    periods_per_revolution: float
    n_lines: int = 1
    missing: int = 0
    doubled: int = 0
    rejected: int = 0
    absent: tuple[int, ...] = ()
    each: int = 1
    """Samples behind each instant."""
    what: str = "pulses"
    unit: Literal["s", "rad"] = "s"
    """Unit in which these err: of instants, or of angles."""
    step: float = 0.0
    """Interval of the samples that the instants were found in [s]."""
    rounded: float = 0.0
    """The most that each instant is off [s], of edges known to a sample only; zero where that is not known."""
    said: tuple[Finding, ...] = ()


def of_azimuth(record: Record, clock: AzimuthSignal) -> Evidence:
    """The unwrapped angle of blocks of samples at their mean times: counted as positive, zero where the channel is."""
    (row,) = channels_named(record.channels, [clock.channel], argument="record", of=OF)
    values, channel = record.values[row], record.channels[row]
    index = np.flatnonzero(np.isfinite(values))
    if not len(index) or np.ptp(values[index]) == 0.0:
        got = f"{channel.name!r} is " + ("constant" if len(index) else "missing throughout")
        raise input_error("record", OF, "have a channel of azimuth that turns", got, "Choose another clock.")
    missing = len(values) - len(index)
    turns = values / _revolution(values, channel)
    good = index
    for _ in range(3):
        found, off = _unwrapped(turns, good)
        amiss = np.abs(off) > DOUBT  # one averaged over a wrap is
        if not amiss.any():
            break
        near = np.concatenate([[False], amiss]) | np.concatenate([amiss, [False]])
        if 2 * np.count_nonzero(~near) < len(index):
            must = "have a channel of azimuth that turns"
            got = f"{channel.name!r} jumps by more than {DOUBT:g} revolutions at {np.count_nonzero(near)} samples"
            raise input_error("record", OF, must, got, "Check the channel and its unit.")
        good = good[~near]
    found, _ = _unwrapped(turns, good)
    backwards = bool(found[-1] < found[0])
    found = -found if backwards else found
    found -= np.floor(found[0])
    # Resolution and noise of neighbours go together: they are averaged.
    block = max(int(len(found) / max(found[-1] - found[0], 1.0) / FEWEST_PHASES), 1)
    whole = len(good) // block * block
    places = good[:whole].reshape(-1, block)
    tight = np.ptp(places, axis=1) < 2 * block  # over a stretch without samples the speed may change
    tight |= not tight.any()
    angles = found[:whole].reshape(-1, block)[tight].mean(axis=1)
    path = float(np.abs(np.diff(angles)).sum())
    if not (np.diff(angles) > 0.0).all():
        got = f"{channel.name!r} gets on by {angles[-1] - angles[0]:.3g} revolutions on a path of {path:.3g}"
        remedy = "Cut the record to a part in which the shaft turns, or check the channel."
        raise input_error("record", OF, "be of a shaft that turns one way throughout", got, remedy)
    return Evidence(
        times=record.start + places[tight].mean(axis=1) / record.sample_rate,
        angles=2.0 * np.pi * angles,
        lines=np.zeros(len(angles), dtype=np.int64),
        periods_per_revolution=clock.periods_per_revolution,
        missing=missing,
        rejected=len(index) - len(good),
        each=block,
        what="samples",
        unit="rad",
        said=(note("backwards"),) if backwards else (),
    )


def _unwrapped(turns: Floats, good: Indices) -> tuple[Floats, Floats]:
    """The angle [revolutions] at the samples `good`, and what each step is off from the local one (steps,)."""
    from scipy.ndimage import median_filter

    steps, lengths = np.diff(turns[good]), np.diff(good)
    ones = lengths == 1
    typical = float(np.median(_nearest(steps[ones]))) if ones.any() else 0.0
    # About the typical step, so that up to half a revolution more or less is told.
    per_sample = typical + _nearest(steps - typical * lengths) / lengths
    size = min(SPAN, 2 * len(steps) - 1)
    local = median_filter(per_sample, size=size, mode="reflect") * lengths
    off = _nearest(steps - local)
    return turns[good[0]] + np.concatenate([[0.0], np.cumsum(local + off)]), off


def _nearest(turns: Floats) -> Floats:
    """The angle less whole turns, in [-1/2, 1/2]."""
    return turns - np.round(turns)


def _revolution(values: Floats, channel: Channel) -> float:
    """A revolution in the channel's unit, agreed with the size of its wraps."""
    if channel.unit not in (*TURNS, "-"):
        must = "have an azimuth in deg or rad"
        raise input_error("record", OF, must, f"{channel.name!r} has unit {channel.unit!r}", "Convert the channel.")
    size = _wrap(values)
    if channel.unit != "-":
        turn = TURNS[channel.unit]
        if size is not None and abs(size / turn - max(round(size / turn), 1)) > DOUBT:
            must = f"have an azimuth that wraps at {turn:.6g} {channel.unit}"
            remedy = "Correct the channel's unit, or scale the channel so that a revolution is 360 deg."
            raise input_error("record", OF, must, f"{channel.name!r} wraps at {size:.4g}", remedy)
        return turn
    if size is None:
        finite = values[np.isfinite(values)]
        if np.ptp(finite) > 1.05 * TURNS["rad"]:
            must = "have an azimuth with a unit, or one that wraps"
            got = f"{channel.name!r} has no unit and runs over {np.ptp(finite):.6g} without a wrap"
            raise input_error("record", OF, must, got, 'Give the channel its unit, "deg" or "rad".')
        return TURNS["rad"]
    for turn in (TURNS["deg"], TURNS["rad"]):
        if abs(size / turn - 1.0) < DOUBT:
            return turn
    must = "have an azimuth that wraps at 360 deg or 2π rad"
    remedy = "Scale the channel so that a revolution is 360 and give it the unit deg."
    raise input_error("record", OF, must, f"{channel.name!r}, without a unit, wraps at {size:.4g}", remedy)


def _wrap(values: Floats) -> float | None:
    """The size of a wrap: of the jumps between two steps like the others. None where there are none."""
    finite = values[np.isfinite(values)]
    span = float(np.ptp(np.quantile(finite, [0.001, 0.999])))
    steps = np.diff(values)
    off = steps - np.nanmedian(steps)
    large, small = np.abs(off) > 0.3 * span, np.abs(off) < 0.1 * span
    alone = large[1:-1] & small[:-2] & small[2:]
    return float(np.median(np.abs(off[1:-1][alone]))) if alone.any() else None


TURN = 2.0 * np.pi


@singledispatch
def evidence(clock: object, record: Record) -> Evidence:  # noqa: ARG001  # a clock that is read has a function below
    """Instants at which the angle of the shaft is known, by the `clock` of a `record`."""
    got = "has none" if clock is None else f"has a {type(clock).__name__}, which says the angle already"
    must = "have a clock of pulses or azimuth"
    raise input_error("record", OF, must, got, "Pass record.with_clock(TachometerSignal(channel=...)).")


@singledispatch
def divisible(clock: object, record: Record) -> Record:  # noqa: ARG001  # most can be read in any part of a record
    """Record whose `clock` can be read in each part of it."""
    return record


@evidence.register
def _(clock: AzimuthSignal, record: Record) -> Evidence:
    return of_azimuth(record, clock)


@evidence.register
def _(clock: TachometerSignal, record: Record) -> Evidence:
    times, step = pulse_times(record, clock.channel), 1.0 / record.sample_rate
    rounded = 0.5 * (1.0 + DOUBT) * step if edges_between(record, clock.channel) else 0.0  # more by the noise
    return replace(_of_pulses(times, clock, step), rounded=rounded)


@evidence.register
def _(clock: PulseTimes, record: Record) -> Evidence:  # noqa: ARG001  # told by another instrument
    return _of_pulses(clock.times, clock, 0.0)


@divisible.register
def _(clock: TachometerSignal, record: Record) -> Record:
    # A part alone would count the lines of an encoder from its own first.
    pulses = PulseTimes(
        times=pulse_times(record, clock.channel),
        pulses_per_revolution=clock.pulses_per_revolution,
        periods_per_revolution=clock.periods_per_revolution,
    )
    return record.select([c.name for c in record.channels if c.name != clock.channel]).with_clock(pulses)


def _of_pulses(times: Floats, clock: TachometerSignal | PulseTimes, step: float) -> Evidence:
    """Lines of pulses at these times [s], found to within a `step` of the samples [s]."""
    lines = clock.pulses_per_revolution
    if len(times) < 3:
        must = "have three pulses or more, for the speed and how well it is known"
        remedy = "Use a longer record, or pass ConstantPeriod(period=..., origin=...) from these two."
        raise input_error("record", OF, must, f"has {len(times)}, at {times[0]:.6g} and {times[-1]:.6g} s", remedy)
    found = count(times, lines)
    said = [warning("pulses_guessed", first=first, last=last) for first, last in found.doubtful]
    seen = len(np.unique(found.numbers % lines))
    known = lines > 1 and found.numbers[-1] - found.numbers[0] >= 3 * lines and len(found.kept) >= 2 * seen
    if lines > 1 and not known:
        said.append(note("few_revolutions", lines=lines))
    if lines > 1 and not found.absent:
        said.append(note("no_mark"))
    # Zero at the first pulse of line 0.
    origin = -(-int(found.numbers[0]) // lines) * lines
    return Evidence(
        times=times[found.kept],
        angles=TURN * (found.numbers - origin) / lines,
        lines=found.numbers % lines if known else np.zeros(len(found.kept), dtype=np.int64),
        periods_per_revolution=clock.periods_per_revolution,
        n_lines=lines if known else 1,
        missing=found.missing,
        doubled=found.doubled,
        absent=found.absent,
        step=step,
        said=tuple(said),
    )
