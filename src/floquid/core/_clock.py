"""Clocks: what ties a record's time to the phase of the system's period."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, get_args, runtime_checkable

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, answers_slips, finite, frozen_array, input_error, integer, positive, wrong_value

_TURNS = {"ppr": "pulses_per_revolution=ppr", "name": 'channel="tach"', "signal": 'channel="tach"'}
_PERIOD = {"T": "period=T", "f": "period=1/f", "omega": "period=2*np.pi/omega", "rpm": "period=60/rpm"}


class _Measured:
    """A clock that states no period: sensors have to be read."""

    __slots__ = ()

    period = None
    origin = 0.0
    fitted = False


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
    fitted
        Whether `period` is a first value alone, and free responses tell the period itself.
    """

    channel = None
    option = "period"
    cycles = False
    pulses_per_revolution = 1
    measured = False
    periods_per_revolution = None
    wander = 0.0

    period: float
    origin: float = 0.0
    fitted: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", positive(self.period, "period", "ConstantPeriod", unit="s"))
        object.__setattr__(self, "origin", finite(self.origin, "origin", "ConstantPeriod", unit="s"))
        if np.spacing(abs(self.origin)) > 1e-3 * self.period:
            got, remedy = f"is {self.origin:g} s, with a period of {self.period:g} s", "Count time from a nearer start."
            raise input_error("origin", "ConstantPeriod", "be near enough to zero for phases to be told", got, remedy)

    @property
    def fundamental(self) -> float:
        """The fundamental angular frequency 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    def phase(self, time: float) -> float:
        """The phase at `time` [s], as a fraction of a period in [0, 1)."""
        fraction = ((time - self.origin) / self.period) % 1.0
        return 0.0 if fraction > 1.0 - 1e-9 else fraction

    def turns(self, times: Floats) -> Floats:
        """Periods from phase zero to `times` [s]."""
        return (times - self.origin) / self.period

    def times_at(self, turns: Floats) -> Floats:
        """The times [s] at which these periods, `turns`, have passed since phase zero."""
        return self.origin + turns * self.period

    def phase_zero(self, time: float) -> float:
        """The last instant of phase zero [s] up to `time` [s]."""
        return time - self.phase(time) * self.period

    def since_phase_zero(self, start: float, ticks: Floats) -> tuple[Floats, None]:
        """Times [s] since the last phase zero up to `start`, at `ticks` [s] after it; the angle is ω times these."""
        # Not from start + ticks: far from time zero, those have lost digits.
        return ticks + self.phase(start) * self.period, None

    def fluctuation(self, times: Floats) -> None:
        """Relative deviation of the speed at `times` [s] from its mean: none."""

    def angle_spread(self, times: Floats) -> float:  # noqa: ARG002  # as of any clock
        """The standard deviation of the angle over `times` [s]: zero."""
        return 0.0


@answers_slips('TachometerSignal(channel="tach", pulses_per_revolution=1)', _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True)
class TachometerSignal(_Measured):
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

    option = "tach"
    cycles = False

    channel: str
    pulses_per_revolution: int = 1
    periods_per_revolution: float = 1.0

    def __post_init__(self) -> None:
        _check_name(self.channel, "TachometerSignal")
        integer(self.pulses_per_revolution, "pulses_per_revolution", "TachometerSignal", at_least=1)
        _check_periods(self)


@answers_slips('AzimuthSignal(channel="azimuth")', _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True)
class AzimuthSignal(_Measured):
    """A channel that holds the angle of the shaft, in degrees or radians, whole or wrapped.

    Raises InputError where the name is empty, or the number is not possible.

    Parameters
    ----------
    channel
        The name of the channel.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    """

    option = "azimuth"
    cycles = False
    pulses_per_revolution = 1

    channel: str
    periods_per_revolution: float = 1.0

    def __post_init__(self) -> None:
        _check_name(self.channel, "AzimuthSignal")
        _check_periods(self)


@answers_slips("PulseTimes(times=t, pulses_per_revolution=1)", _TURNS)
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PulseTimes(Rebuilt, _Measured):
    """The times of pulses, told by another instrument; or of events between which the periods lie.

    Raises InputError where the times do not ascend, or a number is not possible.

    Parameters
    ----------
    times
        When each pulse came (pulses,) [s], on the record's own time axis, ascending.
    pulses_per_revolution
        Pulses in a revolution.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    cycles
        True of events that each begin a period, whatever its duration, as the strikes of a heel are: decays run
        in periods then, and not in seconds. Two events are enough, and there is no revolution.
    """

    channel = None
    option = "records"

    times: Floats = field(metadata={"stored": "pulses; s"})
    pulses_per_revolution: int = 1
    periods_per_revolution: float = 1.0
    cycles: bool = False

    def __post_init__(self) -> None:
        times = frozen_array(self.times, "times", "PulseTimes", axes=("pulses",))
        if len(times) < 2 or not (np.diff(times) > 0).all():
            got = f"has {len(times)}" if len(times) < 2 else "has a later one before an earlier one"
            raise input_error("times", "PulseTimes", "hold two ascending times or more [s]", got)
        object.__setattr__(self, "times", times)
        integer(self.pulses_per_revolution, "pulses_per_revolution", "PulseTimes", at_least=1)
        _check_periods(self)
        if not isinstance(self.cycles, (bool, np.bool_)):
            raise wrong_value("cycles", "PulseTimes", "be true or false", self.cycles)
        object.__setattr__(self, "cycles", bool(self.cycles))
        if self.cycles and (self.pulses_per_revolution, self.periods_per_revolution) != (1, 1.0):
            got = f"are {self.pulses_per_revolution} and {self.periods_per_revolution:g}"
            remedy = "Leave out `pulses_per_revolution` and `periods_per_revolution`, or `cycles`."
            raise input_error("cycles", "PulseTimes", "be false beside pulses and periods of a turn", got, remedy)


Clock = ConstantPeriod | TachometerSignal | AzimuthSignal | PulseTimes
"""Clocks that a record can have. Each has the `channel` that carries it, the `option` of `identify` that gives it, its
`pulses_per_revolution` (1 where it has none), the `period` and `origin` [s] that it states, None and 0 if measured, and
`cycles`: true of events that each begin a period. The period is a first value alone where it is `fitted`.
"""

CLOCKS: tuple[type[Clock], ...] = get_args(Clock)


def _check_name(channel: str, of: str) -> None:
    if not isinstance(channel, str) or not channel.strip():
        raise wrong_value("channel", of, "name a channel of the record", channel)


def _check_periods(clock: TachometerSignal | AzimuthSignal | PulseTimes) -> None:
    name, of = "periods_per_revolution", type(clock).__name__
    value = positive(clock.periods_per_revolution, name, of)
    whole = max(value, 1.0 / value)
    if abs(whole - round(whole)) > 1e-9 * whole:
        must = "be a whole number or one over a whole number"
        raise input_error(name, of, must, f"is {value:g}", "Pass 1, 2, 3 … or 1/2, 1/3 …")
    object.__setattr__(clock, name, float(round(whole)) if value >= 1.0 else 1.0 / round(whole))


@runtime_checkable
class PhaseClock(Protocol):
    """Interface of a clock that says the phase at any time: a `ConstantPeriod`, or the angle of a shaft."""

    @property
    def measured(self) -> bool:
        """True where the angle of a shaft was measured, false where the period is constant."""

    @property
    def fitted(self) -> bool:
        """True where the period is a first value, which is fitted to free responses."""

    @property
    def period(self) -> float:
        """The period, or its mean [s]."""

    @property
    def periods_per_revolution(self) -> float | None:
        """Periods of the system in a revolution of the shaft; None where it does not say that."""

    @property
    def wander(self) -> float:
        """The rms of the speed about its mean, over the mean."""

    def phase(self, time: float, /) -> float:
        """The phase at `time` [s], as a fraction of a period in [0, 1)."""

    def turns(self, times: Floats, /) -> Floats:
        """Periods from phase zero to `times` [s]."""

    def times_at(self, turns: Floats, /) -> Floats:
        """The times [s] at which these periods, `turns`, have passed since phase zero."""

    def phase_zero(self, time: float, /) -> float:
        """The last instant of phase zero [s] up to `time` [s]."""

    def since_phase_zero(self, start: float, ticks: Floats, /) -> tuple[Floats, Floats | None]:
        """Times [s] and angles [rad] since the last phase zero up to `start`, at `ticks` after it; None: ω times t."""

    def fluctuation(self, times: Floats, /) -> Floats | None:
        """Relative deviation of the speed at `times` [s] from its mean; None where it is constant."""

    def angle_spread(self, times: Floats, /) -> float:
        """The standard deviation of the angle of the shaft, rms over `times` [s], [rad]."""
