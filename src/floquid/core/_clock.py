"""Clocks: what ties a record's time to the phase of the system's period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, answers_slips, finite, frozen_array, input_error, integer, positive

_TURNS = {"ppr": "pulses_per_revolution=ppr", "name": 'channel="tach"', "signal": 'channel="tach"'}
_PERIOD = {"T": "period=T", "f": "period=1/f", "omega": "period=2*np.pi/omega", "rpm": "period=60/rpm"}


@answers_slips("ConstantPeriod(period=6.28)", _PERIOD)
@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantPeriod:
    """A period that does not change: the phase at time t is (t - origin)/period, in periods.

    Raises InputError where `period` is not a positive finite number, or `origin` is not finite or so far off that
    phases are rounded away.

    Parameters
    ----------
    period
        The system's period T [s]. A shaft seen in the fixed frame may repeat itself every half revolution: this is
        the period of A(t) and C(t), not of the shaft.
    origin
        The time of phase zero [s], on the record's own time axis (`Record.start`).
    """

    period: float
    origin: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", positive(self.period, "period", "ConstantPeriod", unit="s"))
        object.__setattr__(self, "origin", finite(self.origin, "origin", "ConstantPeriod", unit="s"))
        if np.spacing(abs(self.origin)) > 1e-3 * self.period:
            must = "be near enough to zero for phases to be told"
            got = f"is {self.origin:g} s, with a period of {self.period:g} s"
            raise input_error("origin", "ConstantPeriod", must, got, "Count time from a nearer start.")

    @property
    def fundamental(self) -> float:
        """The fundamental angular frequency 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    def phase(self, time: float) -> float:
        """The phase at `time` [s], as a fraction of a period in [0, 1)."""
        fraction = ((time - self.origin) / self.period) % 1.0
        return 0.0 if fraction > 1.0 - 1e-9 else fraction


@answers_slips('TachometerSignal(channel="tach", pulses_per_revolution=1)', _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True)
class TachometerSignal:
    """A channel of pulses: the shaft turns by a revolution in `pulses_per_revolution` of them.

    Raises InputError where the name is empty, or a number is not possible.

    Parameters
    ----------
    channel
        The name of the channel that holds the pulses.
    pulses_per_revolution
        Pulses that the sensor gives in a revolution.
    periods_per_revolution
        Periods of the system in a revolution of the shaft: 2 for a two-fold symmetric shaft seen from the ground, 1/2
        where everything repeats itself after two revolutions.
    """

    channel: str
    pulses_per_revolution: int = 1
    periods_per_revolution: float = 1.0

    def __post_init__(self) -> None:
        _check_name(self.channel, "TachometerSignal")
        integer(self.pulses_per_revolution, "pulses_per_revolution", "TachometerSignal", at_least=1)
        _check_periods(self)


@answers_slips('AzimuthSignal(channel="azimuth")', _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True)
class AzimuthSignal:
    """A channel that holds the angle of the shaft, in degrees or radians, whole or wrapped.

    Raises InputError where the name is empty, or the number is not possible.

    Parameters
    ----------
    channel
        The name of the channel.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    """

    channel: str
    periods_per_revolution: float = 1.0

    def __post_init__(self) -> None:
        _check_name(self.channel, "AzimuthSignal")
        _check_periods(self)


@answers_slips("PulseTimes(times=t, pulses_per_revolution=1)", _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PulseTimes(Rebuilt):
    """The times of pulses, told by another instrument.

    Raises InputError where the times do not ascend, or a number is not possible.

    Parameters
    ----------
    times
        When each pulse came (pulses,) [s], on the record's own time axis, ascending.
    pulses_per_revolution
        Pulses in a revolution.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    """

    times: Floats
    pulses_per_revolution: int = 1
    periods_per_revolution: float = 1.0

    def __post_init__(self) -> None:
        times = frozen_array(self.times, "times", "PulseTimes", axes=("pulses",))
        if len(times) < 2 or not (np.diff(times) > 0).all():
            got = f"has {len(times)}" if len(times) < 2 else "has a later one before an earlier one"
            raise input_error("times", "PulseTimes", "hold two ascending times or more [s]", got)
        object.__setattr__(self, "times", times)
        integer(self.pulses_per_revolution, "pulses_per_revolution", "PulseTimes", at_least=1)
        _check_periods(self)


Clock = ConstantPeriod | TachometerSignal | AzimuthSignal | PulseTimes
"""Relation of the time of a record to the phase of the system's period."""


def _check_name(channel: str, of: str) -> None:
    if not isinstance(channel, str) or not channel.strip():
        raise input_error("channel", of, "name a channel of the record", f"is {channel!r}")


def _check_periods(clock: TachometerSignal | AzimuthSignal | PulseTimes) -> None:
    name, of = "periods_per_revolution", type(clock).__name__
    value = positive(clock.periods_per_revolution, name, of)
    whole = max(value, 1.0 / value)
    if abs(whole - round(whole)) > 1e-9 * whole:
        must = "be a whole number or one over a whole number"
        raise input_error(name, of, must, f"is {value:g}", "Pass 1, 2, 3 … or 1/2, 1/3 …")
    object.__setattr__(clock, name, float(round(whole)) if value >= 1.0 else 1.0 / round(whole))
