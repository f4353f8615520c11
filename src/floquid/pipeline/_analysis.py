"""What the chain gives: the result and every intermediate."""

from __future__ import annotations

from dataclasses import dataclass, field

from floquid.core import Cycles, PeriodicModel, Provenance, Record
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.order import Choice
from floquid.pipeline._settings import Settings
from floquid.reconstruction import StateModel


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
    choice
        What speaks for the order found and against it; None where the order was given.
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
    choice: Choice | None = None
    warnings: tuple[str, ...] = field(default=())

    @property
    def provenance(self) -> Provenance:
        """Where the result comes from."""
        return self.model.provenance
