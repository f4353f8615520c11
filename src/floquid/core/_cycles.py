"""A record cut into periods: the same phases in every cycle."""

from __future__ import annotations

from dataclasses import dataclass, field

from floquid._arrays import Floats
from floquid._checks import Rebuilt, finite, input_error
from floquid.core._channel import Channel
from floquid.core._provenance import Provenance
from floquid.core._record import as_channels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycles(Rebuilt):
    """Samples at P equally spaced phases of each of N periods.

    Raises InputError where a shape or a value is not possible.

    Parameters
    ----------
    values
        The samples (channels, phases, cycles). Held read-only.
    periods
        The length of each cycle (cycles,) [s].
    first_phase, first_cycle
        The phase of `values[:, 0, :]`, in periods, in [0, 1), and the whole periods before it since phase zero.
    channels, provenance
        One `Channel` a row of `values`, and where the cycles come from.
    """

    values: Floats
    periods: Floats
    first_phase: float = 0.0
    channels: tuple[Channel, ...]
    provenance: Provenance = field(default_factory=Provenance)
    first_cycle: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "channels", as_channels(self.channels, "Cycles"))
        put(self, "provenance", self.provenance or Provenance())
        self._freeze(missing=True, values=(len(self.channels), "phases", "cycles"))
        self._freeze(periods=(self.n_cycles,))
        if self.values.size == 0:
            got = f"has shape {self.values.shape}"
            raise input_error("values", "Cycles", "hold at least one phase and one cycle", got)
        if not (self.periods > 0).all():
            raise input_error("periods", "Cycles", "be positive [s]", f"has {self.periods.min():g}")
        put(self, "first_phase", finite(self.first_phase, "first_phase", "Cycles"))
        if not 0.0 <= self.first_phase < 1.0:
            raise input_error("first_phase", "Cycles", "lie in [0, 1), in periods", f"is {self.first_phase:g}")

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return self.values.shape[0]

    @property
    def n_phases(self) -> int:
        """The number of samples a period, P."""
        return self.values.shape[1]

    @property
    def n_cycles(self) -> int:
        """The number of periods, N."""
        return self.values.shape[2]

    @property
    def period(self) -> float:
        """The mean period [s]."""
        return float(self.periods.mean())
