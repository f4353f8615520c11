"""Every option of the chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._checks import input_error, integer, positive
from floquid.lti import AbstractIdentifier


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Every option of `identify`.

    Parameters
    ----------
    period
        The period [s]; None takes that of each record's clock.
    channels
        Names of the channels to use; empty for all.
    order
        The number of complex poles, conjugates one by one; None finds it.
    harmonics
        Keep the harmonics -harmonics … harmonics of each mode; None keeps those that rise above the noise.
    states
        Names of the channels that are the displacement states of A(t); empty to leave A(t) out.
    system_times
        The number of instants of a period at which A(t) is given.
    identifier
        The algorithm that finds the poles, with its options; None for maximum likelihood at `mode_false_alarm`.
    mode_false_alarm
        The probability at which noise may pass for a mode; the `identifier` given has its own.
    harmonic_false_alarm
        The probability at which noise may pass for a harmonic.
    noise_floor
        The least share of a channel's largest value that the noise is taken to be: the level down to which the record
        can be believed.
    constrained
        Finish with residues held to their harmonics (`floquid.periodic.constrain`).
    trust_period
        Warn instead of refusing when the response seems to repeat with another period than the one given.

    Raises
    ------
    InputError
        A value is not possible.
    """

    period: float | None = None
    channels: tuple[str, ...] = ()
    order: int | None = None
    harmonics: int | None = None
    states: tuple[str, ...] = ()
    system_times: int = 50
    identifier: AbstractIdentifier | None = None
    mode_false_alarm: float = 1e-9
    harmonic_false_alarm: float = 1e-8
    noise_floor: float = 1e-10
    constrained: bool = False
    trust_period: bool = False

    def __post_init__(self) -> None:
        of = "Settings"
        if self.period is not None:
            object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        for name in ("channels", "states"):
            value = getattr(self, name)
            listed = isinstance(value, (tuple, list))
            if not listed or not all(isinstance(entry, str) for entry in value):
                raise input_error(name, of, "be a list of channel names", f"is {value!r}", 'Pass e.g. ["x", "y"].')
            object.__setattr__(self, name, tuple(value))
        if self.order is not None:
            integer(self.order, "order", of, at_least=1)
        if self.harmonics is not None:
            integer(self.harmonics, "harmonics", of, at_least=0)
        integer(self.system_times, "system_times", of, at_least=1)
        if not isinstance(self.identifier, (AbstractIdentifier, type(None))):
            must, remedy = "be an identifier of `floquid.lti`, or None", "Pass an object, such as AMI()."
            raise input_error("identifier", of, must, f"is {self.identifier!r:.60}", remedy)
        for name in ("constrained", "trust_period"):
            value = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise input_error(name, of, "be true or false", f"is {value!r}")
            object.__setattr__(self, name, bool(value))
        for name in ("mode_false_alarm", "harmonic_false_alarm", "noise_floor"):
            if not 0.0 < positive(getattr(self, name), name, of) < 1.0:
                raise input_error(name, of, "lie between 0 and 1", f"is {getattr(self, name)}")
