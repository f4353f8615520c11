"""The periodic model of some channels of a record larger than memory, from residues at each phase."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import Channel, PeriodicModel, Provenance
from floquid.large._modes import Modes
from floquid.lifting import Lifted
from floquid.lti import ModalModel, TimeResponses
from floquid.periodic import assemble


def modelled(
    modes: Modes,
    residues: Complexes,
    *,
    spread: Complexes,
    slope: Complexes,
    covariance: Floats,
    noise: Floats,
    period: float,
    phase: float,
    channels: tuple[Channel, ...],
    source: str,
) -> PeriodicModel:
    """The model that `assemble` makes of residues (channels, modes, phases) that begin at a phase of the clock.

    `spread` and `slope` are those of the residues of all multipliers (order, order), `covariance` that of decays and
    angular frequencies, mode by mode [1/s²].
    """
    count, _, phases = residues.shape
    all_of = np.repeat(residues.transpose(1, 0, 2).reshape(len(modes.logs), -1), [1 if r else 2 for r in modes.real], 0)
    conjugates = np.ones(modes.order, bool)
    conjugates[modes.places] = False
    all_of[conjugates] = all_of[conjugates].conj()
    by = modes.by_parameters
    by = np.concatenate([by.real, by.imag])
    modal = ModalModel(
        multipliers=modes.multipliers,
        residues=all_of[:, :, None],
        dt=period,
        covariance=by @ covariance @ by.T,
        residue_spread=spread[None],
        residue_slope=slope[None],
    )
    # The expansion asks the lifted responses for their noise and phases alone: the values stay on the disk.
    lifted = Lifted(
        responses=TimeResponses(
            values=np.zeros((count * phases, 1, 1)), dt=period, noise=np.repeat(noise, phases)[:, None]
        ),
        channels=channels,
        n_phases=phases,
        first_phase=phase,
        provenance=Provenance(sources=(source,)),
    )
    return assemble(modal, lifted)
