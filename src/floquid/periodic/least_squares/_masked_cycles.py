"""Blocks of a record that is whole samples a period, some of whose cycles are left out: as cheap as lifted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Mask
from floquid.core import ConstantPeriod, Record
from floquid.lifting import Lifted
from floquid.lti import TimeResponses
from floquid.periodic.least_squares._lifted_block import LiftedBlock
from floquid.periodic.least_squares._sample_block import Columns

LARGEST_SLIP = 1e-6  # samples by which the last cycle may have slipped: what is more is fitted sample by sample


@dataclass(frozen=True, slots=True)
class KeptCycles(LiftedBlock):
    """One hit, without the cycles that are left out."""

    kept: Mask = field(kw_only=True)  # mask of the cycles that are there (cycles,)

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
        whole, residual = np.split(record.values, [cycles * phases], axis=1)
        cut = whole.reshape(record.n_channels, cycles, phases)
        missing = np.isnan(cut)
        if not (np.isnan(residual).all() and (missing == missing[:1, :, :1]).all()) or missing.all():
            return None
        kept = ~missing[0, :, 0]
        values = cut[:, kept].transpose(0, 2, 1).reshape(-1, 1, int(kept.sum()))
        values.flags.writeable = False
        lifted = Lifted(
            responses=TimeResponses(values=values, dt=period),
            channels=record.channels,
            n_phases=phases,
            first_phase=clock.phase(record.start) * clock.period / period,
            provenance=record.provenance,
        )
        rows = np.arange(record.n_channels)
        return KeptCycles(lifted, hit, rows, np.ones(len(rows)), kept=kept)

    def _values(self) -> Floats:
        """Those of the cycles that are there (rows, phases, cycles)."""
        return self.lifted.responses.values[:, 0].reshape(len(self.rows), self.lifted.n_phases, -1)

    def _factors(self, columns: Columns) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Those of the cycles that are there."""
        starts, cycles, parts, phases = LiftedBlock._factors(self, columns)  # noqa: SLF001  # super() is not to be had with slots
        return starts[self.kept], cycles[self.kept], parts[self.kept], phases
