"""Clocks that say the phase of the system at any time."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from floquid._arrays import Floats


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
