"""Clocks: what ties a record's time to the phase of the system's period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._checks import finite, input_error, positive


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantPeriod:
    """A period that does not change: the phase at time t is (t - origin)/period, in periods.

    Parameters
    ----------
    period
        The system's period T [s]. A shaft seen in the fixed frame may repeat itself every half revolution: this is
        the period of A(t) and C(t), not of the shaft.
    origin
        The time of phase zero [s], on the record's own time axis (`Record.start`).

    Raises
    ------
    InputError
        `period` is not a positive finite number, or `origin` is not finite or so far off that phases are rounded away.
    """

    period: float
    origin: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", positive(self.period, "period", "ConstantPeriod", unit="s"))
        object.__setattr__(self, "origin", finite(self.origin, "origin", "ConstantPeriod", unit="s"))
        if np.spacing(abs(self.origin)) > 1e-3 * self.period:
            raise input_error(
                "origin",
                "ConstantPeriod",
                "be near enough to zero for phases to be told",
                f"is {self.origin:g} s, with a period of {self.period:g} s",
                "Count time from a nearer start.",
            )

    @property
    def fundamental(self) -> float:
        """The fundamental angular frequency 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    def phase(self, time: float) -> float:
        """The phase at `time` [s], as a fraction of a period in [0, 1)."""
        fraction = ((time - self.origin) / self.period) % 1.0
        return 0.0 if fraction > 1.0 - 1e-9 else fraction
