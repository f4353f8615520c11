"""Proposal of settings for a record, as the steps of the preparation judge it: its clock, hits, inputs, excitation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import tau
from typing import Any, Literal, TypeAlias

import numpy as np

from floquid._show import Brief
from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import FloquidError
from floquid.preparation._before import NO_RESPONSE
from floquid.preparation._clocks import clocked
from floquid.preparation._forces import goes_on, is_random, is_white
from floquid.preparation._refuse import refuse_few, refuse_period, refuse_short
from floquid.preparation._settings import Settings
from floquid.readers import ClockCandidate
from floquid.sync import Impact, ShaftAngle, find_impacts, rejoin, resample, shaft_angle, speed_verdict

Use: TypeAlias = Literal["clock", "hits", "input", "excitation", "none"]
"""Uses of a candidate; "none" of one that was judged and is none."""

MOTIONS = ("displacement", "velocity", "acceleration", "strain")

_ELECTRIC, _TORQUE = re.compile(r"[mkuµ]?[VA]"), re.compile(r"[mkM]?N[ .·*-]?m")
"""Units of what drives a system more often than it is its response: of a torque only where the name says so."""

_MOTOR = re.compile(r"(?<![a-z])(motor|drive|servo|actuator|generator|gen)(?![a-z])", re.I)
"""Words in the names of torques that drive: others are bending moments."""

_DRIVING = re.compile(
    r"(?<![a-z])(inputs?|shaker|excit(?:ation|er)|command|inject(?:ed|ion)|disturbance)(?![a-z])", re.I
)
"""Words in the names of channels that drive a system."""

_A_SECOND = {"rpm": 1 / 60, "hz": 1.0, "rad/s": 1 / tau, "deg/s": 1 / 360}
"""Revolutions a second in one of each unit of speed, in small letters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate(Brief):
    """A channel that may be more than a response, or a number of the file.

    Parameters
    ----------
    name
        The name of the channel; "period" for the period that the file states, "excitation" for what drives all along.
    use
        The use that it has, or "none".
    why
        The reasons, in words.
    settings
        The fields of `Settings` that take it; empty where none has to be given.
    impacts
        The impacts in it.
    """

    name: str
    use: Use
    why: str
    settings: dict[str, Any] = field(default_factory=dict)
    impacts: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal(Brief):
    """Settings to try first with a record, and the candidates for each part of them.

    Parameters
    ----------
    candidates
        The candidates, the better ones of a use first.
    settings
        The fields of `Settings` to give, without the clock where there is none.
    """

    candidates: tuple[Candidate, ...]
    settings: dict[str, Any]

    def of_use(self, use: Use) -> tuple[Candidate, ...]:
        """The candidates of one use."""
        return tuple(own for own in self.candidates if own.use == use)

    @property
    def clock(self) -> Candidate | None:
        """The best candidate for the clock; None where there is none."""
        return next(iter(self.of_use("clock")), None)


def propose(record: Record, clocks: Sequence[ClockCandidate] = ()) -> Proposal:
    """The settings to try first with a `record`; its clock may be one of `clocks` (`describe_file` names them).

    Each part is judged by the step of `identify` that uses it. A clock is one from which the angle of the shaft can be
    read, at a speed that is constant enough. A channel of impacts is one in which `find_impacts` finds them; one that
    is no force must also have the response begin anew at them. A force that goes on is an input. Where nothing was
    measured that drives the system and the response is random and lasts, its excitation is ambient.
    """
    hits = _hits(record, clocks)
    names = [own.name for own in hits]
    judged = [(own, *_clock(record, own)) for own in clocks if own.name not in names]
    # A speed is the last resort: a pulse says the phase, too.
    judged.sort(key=lambda one: (one[0].kind != "period", not one[0].is_sure, one[0].kind != "azimuth"))
    judged.sort(key=lambda one: (one[1].use != "clock", one[0].kind == "speed"))
    found = [own for _, own, _ in judged]
    first = next(((own, shaft) for _, own, shaft in judged if own.use == "clock"), None)
    blows = hits if _too_close(record, names, first) else []
    hits, names = ([], []) if blows else (hits, names)
    inputs = [*map(_as_input, blows), *_inputs(record, {*names, *(c.name for c in clocks), *(c.name for c in blows)})]
    lasts = not hits and _lasts(record, first)
    if lasts:  # then whatever may have been measured of the excitation is an input
        inputs = [replace(own, settings={"inputs": (own.name,)}) for own in inputs]
    lasting = tuple(own.name for own in inputs if own.settings)
    ambient = (_AMBIENT,) if lasts and not lasting else ()
    settings = _responses(record, {*names, *(own.name for own in found if own.use == "clock")}, names, first)
    if lasting:
        settings["inputs"] = lasting
    elif hits:
        settings["find_hits"] = True
    for own in (*ambient, *((first[0],) if first else ())):
        settings |= own.settings
    if lasting or ambient:
        settings.pop("estimate_period", None)  # what drives the system repeats with periods of its own
    return Proposal(candidates=(*found, *hits, *inputs, *ambient), settings=settings)


_AMBIENT = Candidate(
    name="excitation",
    use="excitation",
    why="the response does not decay, and its energy is spread over many frequencies",
    settings={"excitation": "ambient"},
)


def _clock(record: Record, own: ClockCandidate) -> tuple[Candidate, ShaftAngle | None]:
    """The candidate for a clock as `identify` would read it, and the angle that it shows."""
    if own.kind == "period":
        return Candidate(name=own.name, use="clock", why=own.why), None
    if own.kind == "speed":
        return _speed(record, own), None
    given: dict[str, Any] = {"azimuth" if own.kind == "azimuth" else "tach": own.name}
    try:
        shaft = shaft_angle(*clocked(record, Settings(**given), "identify"))
        refuse_short([record], [shaft])
    except FloquidError as error:
        return Candidate(name=own.name, use="none", why=f"{own.why}. {_first(error)}"), None
    if not shaft.steady:
        return Candidate(name=own.name, use="none", why=f"{own.why}. {shaft.reasons[0]}", settings=given), None
    words = own.why if own.kind == "azimuth" else f"{_named(own.why)}{_evenly(shaft)}: a clock"
    return Candidate(name=own.name, use="clock", why=words, settings=given), shaft


def _first(error: Exception) -> str:
    """The reason of a refusal: what must be and what is, without the argument and the remedy."""
    line = str(error).splitlines()[0]
    return re.sub(r"^Argument `[^`]*` of `[^`]*` ", "It ", line).rstrip(".")


def _named(why: str) -> str:
    """The reasons by quantity and name; the count of pulses is said by what was read."""
    parts = [part for part in why.split("; ") if not part.startswith("it has two levels")]
    return "".join(f"{part}; " for part in parts)


def _evenly(shaft: ShaftAngle) -> str:
    """The number of pulses and their spacing, in words."""
    gaps = np.diff(shaft.times[shaft.kept])
    gaps = gaps / np.maximum(np.rint(gaps / np.median(gaps)), 1.0)
    uneven = f"{100.0 * gaps.std() / gaps.mean():.1g} %"
    return f"it rises once a revolution, {len(shaft.times)} times, every {gaps.mean():.4g} s, evenly to {uneven}"


def _speed(record: Record, own: ClockCandidate) -> Candidate:
    """A channel of the speed: a first value of the period where it is steady."""
    (row,) = (row for row, channel in enumerate(record.channels) if channel.name == own.name)
    unit = record.channels[row].unit
    hertz = np.abs(record.values[row][np.isfinite(record.values[row])]) * _A_SECOND.get(unit.lower(), np.nan)
    mean = float(hertz.mean()) if hertz.size else 0.0
    none = Candidate(name=own.name, use="none", why=f"{own.why}: a speed, and no phase")
    if not mean > 0.0:
        return none
    wander = float(hertz.std()) / mean
    steady, why = speed_verdict(wander, 0.0, tau * mean)
    period = float(f"{1.0 / mean:.9g}")
    try:
        refuse_period([record.with_clock(ConstantPeriod(period=period))], "propose")
    except FloquidError:
        return none
    if not steady:
        return Candidate(name=own.name, use="none", why=f"{own.why}. {why}")
    mean_words = f"its mean is {mean / _A_SECOND[unit.lower()]:.6g} {unit}, a revolution in {period:.6g} s"
    settings = {"period": period} | ({"estimate_period": True} if wander > 0.0 else {})
    return Candidate(name=own.name, use="clock", why=f"{own.why}; {mean_words}", settings=settings)


def _hits(record: Record, clocks: Sequence[ClockCandidate]) -> list[Candidate]:
    """Channels in which impacts were measured."""
    angles, pulses = ([own.name for own in clocks if own.kind == kind] for kind in ("azimuth", "pulses"))
    forces, others = [], []
    for channel, values in zip(record.channels, record.values, strict=True):
        if (
            channel.name in angles
            or channel.quantity in ("angle", "pulse")
            or not np.isfinite(values).any()
            or goes_on(values)
        ):
            continue
        blows = find_impacts(record, force=channel.name)
        if not blows:
            continue
        if channel.quantity == "force":
            forces.append(_hit(record, channel, blows))
        elif not any(blow.double for blow in blows):  # else a response, or pulses that come close
            others.append((channel, blows))
    if not others:
        return forces
    left = {*pulses, *(own.name for own in forces), *(channel.name for channel, _ in others)}
    rows = [c.name for c in record.channels if c.name not in left and c.quantity not in NO_RESPONSE]
    struck: tuple[Impact, ...] = ()
    with suppress(FloquidError):  # too short a record, or no response
        struck = find_impacts(record.select(rows), channels=rows) if rows else ()
    return [*forces, *(_hit(record, channel, blows) for channel, blows in others if _answered(record, blows, struck))]


def _answered(record: Record, blows: Sequence[Impact], struck: Sequence[Impact]) -> bool:
    """True where the response begins anew at most blows, the one at the beginning of a record left out."""
    step = 1.0 / record.sample_rate
    inside = [blow for blow in blows if blow.start > record.start + step]
    near = [
        any(own.start - step <= blow.end + step and blow.start - step <= own.end for own in struck) for blow in inside
    ]
    return 2 * sum(near) > len(near)


def _hit(record: Record, channel: Channel, blows: Sequence[Impact]) -> Candidate:
    times = "once" if len(blows) == 1 else f"{len(blows)} times"
    why = f"rises {times} in {record.duration:.3g} s and rests between: hits"
    if channel.quantity != "force":
        why += ", and the response begins anew at them"
    return Candidate(name=channel.name, use="hits", why=why, settings={"find_hits": True}, impacts=len(blows))


def _too_close(record: Record, names: Sequence[str], clock: tuple[Candidate, ShaftAngle | None] | None) -> bool:
    """True where most free responses between impacts have fewer periods than are needed, or impacts of others."""
    shaft = None if clock is None else clock[1]
    period = shaft.period if shaft is not None else record.period
    each = sorted((find_impacts(record, force=name) for name in names), key=len)
    if not all(_answered(record, blows, each[-1]) for blows in each[:-1]):
        return True
    starts = [blow.start for blow in each[-1]] if each else []
    if period is None or len(starts) < 2:
        return False
    try:
        refuse_few(float(np.median(np.diff(starts))) / period)
    except FloquidError:
        return True
    return False


def _as_input(own: Candidate) -> Candidate:
    """Impacts that were measured and come too close for free responses between them, as an input."""
    why = f"it {own.why.removesuffix(': hits')}, too often for free responses between"
    return replace(own, use="input", why=why, settings={"inputs": (own.name,)}, impacts=0)


def _inputs(record: Record, taken: set[str]) -> list[Candidate]:
    """Channels that seem to drive the system; only forces that go on are proposed as inputs."""
    moving = any(channel.quantity in MOTIONS for channel in record.channels)
    flat = [
        c.name
        for c, own in zip(record.channels, record.values, strict=True)
        if np.isfinite(own).any() and is_white(own)
    ]
    found = []
    for channel, values in zip(record.channels, record.values, strict=True):
        there = values[np.isfinite(values)]
        if channel.name in taken or channel.quantity in ("pulse", "angle") or not there.size or not np.ptp(there):
            continue
        if channel.quantity == "force":
            given = {"inputs": (channel.name,)} if goes_on(values) else {}
            found.append(Candidate(name=channel.name, use="input", why="its quantity is force", settings=given))
        elif named := _DRIVING.search(channel.name.replace("_", " ")):
            found.append(Candidate(name=channel.name, use="input", why=f"its name has the word {named[0]!r}"))
        elif moving and _drives(channel):
            found.append(Candidate(name=channel.name, use="input", why=f"its unit is {channel.unit}, beside motions"))
        elif channel.quantity == "other" and channel.name in flat and len(flat) < record.n_channels:
            words, given = "its spectrum is flat, as that of injected noise", {"inputs": (channel.name,)}
            found.append(Candidate(name=channel.name, use="input", why=words, settings=given))
    return found


def _drives(channel: Channel) -> bool:
    """True for a voltage, a current or the torque of a motor, beside motions."""
    if channel.quantity != "other":
        return False
    turning = _TORQUE.fullmatch(channel.unit) and _MOTOR.search(channel.name.replace("_", " "))
    return bool(turning or _ELECTRIC.fullmatch(channel.unit))


def _responses(
    record: Record, taken: set[str], hits: Sequence[str], clock: tuple[Candidate, ShaftAngle | None] | None
) -> dict[str, Any]:
    """The channels to name: voltages and torques beside motions, impacts that are no force, a speed are left out."""
    free = [c for c in record.channels if c.name not in taken and c.quantity not in NO_RESPONSE]
    moving = any(c.quantity in MOTIONS for c in free)
    kept = [c for c in free if c.quantity in MOTIONS or not (moving and _drives(c))]
    aside = [*hits, *([clock[0].name] if clock and "period" in clock[0].settings else [])]
    unread = [c for c in record.channels if c.name in aside and c.quantity not in NO_RESPONSE]
    return {} if len(kept) == len(free) and not unread else {"channels": tuple(c.name for c in kept)}


def _lasts(record: Record, clock: tuple[Candidate, ShaftAngle | None] | None) -> bool:
    """True where the response is random and does not decay, harmonics of the clock left out."""
    with suppress(FloquidError):
        if clock is None or record.period is not None:
            return is_random(record, record.period)
        own, shaft = clock
        if shaft is None:
            return is_random(record, own.settings["period"])
        # At instants of equal angle the speed is constant.
        names = [c.name for c in record.channels if c.name != own.name and c.quantity not in NO_RESPONSE]
        (cycles,) = resample(record.select(names), shaft)
        even = rejoin(replace(cycles, periods=np.full(cycles.n_cycles, cycles.period)))
        return is_random(even, even.period)
    return False
