"""What the chain gives: the result and every intermediate."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from floquid.core import Cycles, PeriodicModel, Provenance, Record
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.order import Choice
from floquid.periodic import Fit, Periodicity
from floquid.pipeline._settings import Settings
from floquid.reconstruction import Refinement, StateModel
from floquid.sync import ShaftAngle
from floquid.validation import Validation

FAILED = 3.0
"""Times the noise that a fit leaves from which on it is no model of the record: then it has no deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysis:
    """What `identify` found, with every intermediate.

    Parameters
    ----------
    settings
        The options used.
    records, cycles, lifted, modal
        The stages: records as used, cut into periods, lifted (and whitened along the record where the noise is
        coloured), and the modal model of the lifted responses.
    model
        The periodic model: exponents and shapes.
    state
        Φ and A(t), when states were asked for.
    refinement
        The fit of A(t) with a structure, when one was asked for; its `state` is this one.
    choice
        What speaks for the order found and against it; None where the order was given.
    fit
        The fit of the records as they were sampled, with the forced response; None where lifting was enough. Then
        `records` are the free response alone, resampled to whole samples a period.
    measured
        The records as they were read, where `records` are resampled.
    shafts
        The angle of the shaft in each record that has a tachometer or an azimuth.
    held
        Whether the residues were held to their harmonics in the end.
    misfit
        The rms of what the fit leaves over the level of its noise, the largest of all channels and hits: 1 where only
        noise is left. A little more has made the deviations of the model as much wider. None without such a fit.
    periodicity
        Whether the response is that of a periodic system at all; None where it could not be tested.
    validation
        Whether the model can be believed; None where that was not asked for.
    synchronisation
        How well the records are synchronised, and what was done to them, a sentence each.
    warnings
        What a reader of the result must know.
    """

    settings: Settings
    records: tuple[Record, ...]
    cycles: tuple[Cycles, ...]
    lifted: Lifted
    modal: ModalModel
    model: PeriodicModel
    state: StateModel | None = None
    refinement: Refinement | None = None
    choice: Choice | None = None
    fit: Fit | None = None
    measured: tuple[Record, ...] = ()
    shafts: tuple[ShaftAngle, ...] = ()
    held: bool = False
    misfit: float | None = None
    periodicity: Periodicity | None = None
    validation: Validation | None = None
    synchronisation: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=())

    @property
    def failed(self) -> bool:
        """Whether the fit leaves so many times the noise that the model is none of the record: no deviations then."""
        return self.misfit is not None and self.misfit >= FAILED

    @property
    def noise(self) -> NDArray[np.float64]:
        """The deviation of the noise (channels, hits) [units of the channels]."""
        return self.lifted.noise if self.fit is None else self.fit.noise

    @property
    def whitening(self) -> NDArray[np.float64] | None:
        """The filter of each channel along the record that made its noise white (channels, taps); None without one."""
        return self.lifted.whitening if self.fit is None else self.fit.whitening

    @property
    def provenance(self) -> Provenance:
        """Where the result comes from."""
        return self.model.provenance
