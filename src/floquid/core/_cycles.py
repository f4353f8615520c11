"""A record cut into periods: the same phases in every cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import Rebuilt, finite, frozen_array, input_error
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
    first_phase: float
    channels: tuple[Channel, ...]
    provenance: Provenance = field(default_factory=Provenance)
    first_cycle: int = 0

    def __init__(
        self,
        *,
        values: ArrayLike,
        periods: ArrayLike,
        first_phase: float = 0.0,
        channels: Sequence[Channel | str],
        provenance: Provenance | None = None,
        first_cycle: int = 0,
    ) -> None:
        named = as_channels(channels, "Cycles")
        array = frozen_array(values, "values", "Cycles", axes=(len(named), "phases", "cycles"), missing=True)
        lengths = frozen_array(periods, "periods", "Cycles", axes=(array.shape[2],))
        if array.size == 0:
            raise input_error("values", "Cycles", "hold at least one phase and one cycle", f"has shape {array.shape}")
        if not (lengths > 0).all():
            raise input_error("periods", "Cycles", "be positive [s]", f"has {lengths.min():g}")
        phase = finite(first_phase, "first_phase", "Cycles")
        if not 0.0 <= phase < 1.0:
            raise input_error("first_phase", "Cycles", "lie in [0, 1), in periods", f"is {phase:g}")
        put = object.__setattr__
        put(self, "values", array)
        put(self, "periods", lengths)
        put(self, "first_phase", phase)
        put(self, "channels", named)
        put(self, "provenance", provenance if provenance is not None else Provenance())
        put(self, "first_cycle", first_cycle)

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
