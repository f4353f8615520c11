"""Blocks of a record that is whole samples a period, some of whose cycles are left out: as cheap as lifted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from floquid.core import ConstantPeriod, Record
from floquid.lifting import Lifted
from floquid.lti import TimeResponses
from floquid.periodic._blocks import Columns
from floquid.periodic._lifted_block import LiftedBlock

LARGEST_SLIP = 1e-6
"""Samples by which the last cycle may have slipped: what is more is fitted sample by sample."""


@dataclass(frozen=True, slots=True)
class KeptCycles(LiftedBlock):
    """One hit, the samples of cycles left out set to zero, and so their columns."""

    kept: NDArray[np.bool_] = field(kw_only=True)
    """Which cycles are there (cycles,)."""

    @property
    def n_cycles(self) -> int:
        """Cycles, those left out too."""
        return len(self.kept)

    @property
    def n_samples(self) -> int:
        """Samples of each channel that are there."""
        return int(self.kept.sum()) * self.lifted.n_phases

    @staticmethod
    def of(record: Record, clock: object, period: float, hit: int) -> KeptCycles | None:
        """The block of a record; None where it is not whole cycles of whole samples that are left out."""
        exact = record.sample_rate * period
        phases = round(exact)
        cycles = record.n_samples // max(phases, 1)
        if not isinstance(clock, ConstantPeriod) or cycles < 1 or abs(exact - phases) * cycles > LARGEST_SLIP:
            return None
        whole, rest = np.split(record.values, [cycles * phases], axis=1)
        cut = whole.reshape(record.n_channels, cycles, phases)
        missing = np.isnan(cut)
        if not (np.isnan(rest).all() and (missing == missing[:1, :, :1]).all()) or missing.all():
            return None
        values = np.where(missing, 0.0, cut).transpose(0, 2, 1).reshape(-1, 1, cycles)
        values.flags.writeable = False
        lifted = Lifted(
            responses=TimeResponses(values=values, dt=period),
            channels=record.channels,
            n_phases=phases,
            first_phase=clock.phase(record.start) * clock.period / period,
            provenance=record.provenance,
        )
        rows = np.arange(record.n_channels)
        return KeptCycles(lifted, hit, rows, np.ones(len(rows)), kept=~missing[0, :, 0])

    def rest(self, columns: Columns, coefficients: NDArray[np.complex128]) -> tuple[NDArray, NDArray]:
        """Times (samples,) [s] and what the model leaves at each (rows, samples), in the cycles that are there."""
        times, left = LiftedBlock.rest(self, columns, coefficients)
        there = np.repeat(self.kept, self.lifted.n_phases)
        return times[there], left[:, there]

    def _values(self) -> NDArray[np.float64]:
        """(rows, phases, cycles)."""
        return self.lifted.responses.values[:, 0].reshape(len(self.rows), self.lifted.n_phases, self.n_cycles)

    def _factors(self, columns: Columns) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Those of all cycles, zero in the ones that are left out."""
        starts, cycles, parts, phases = LiftedBlock._factors(self, columns)  # noqa: SLF001  # super() is not to be had with slots
        return starts, cycles * self.kept[:, None], parts * self.kept[:, None], phases
