"""The fit of free responses, and what is seen of them when they are lifted."""

from __future__ import annotations

from dataclasses import dataclass

from floquid._show import Brief
from floquid.checks import FAILED
from floquid.core import Cycles
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.order import Choice
from floquid.periodic import Fit, Periodicity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decay(Brief):
    """The fit of free responses, and what is seen of them when they are lifted.

    Parameters
    ----------
    fit
        The fit: its model, the forced response beside it, and the free response that is left.
    cycles, lifted, modal
        The free response cut into periods, resampled to whole samples a period where it has none; lifted (and whitened
        along the record where the noise is coloured); and the modal model of the lifted responses.
    choice
        What speaks for the order found and against it; None where the order was given.
    periodicity
        Whether the response is that of a periodic system at all; None where it could not be tested.
    """

    fit: Fit
    cycles: tuple[Cycles, ...]
    lifted: Lifted
    modal: ModalModel
    choice: Choice | None = None
    periodicity: Periodicity | None = None


def fails(found: Fit) -> bool:
    """True where the residual is too many times the noise for a model of the record."""
    return found.misfit is not None and found.misfit >= FAILED
