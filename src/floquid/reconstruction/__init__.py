"""A `PeriodicModel` → the state transition matrix and the state matrix, in the coordinates of chosen channels."""

from floquid.reconstruction._second_order import reconstruct
from floquid.reconstruction._state_model import StateModel

__all__ = ["StateModel", "reconstruct"]
