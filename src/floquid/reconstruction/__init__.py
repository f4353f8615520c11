"""A `PeriodicModel` → the state transition matrix and the state matrix, in the coordinates of chosen channels.

`reconstruct` builds them from the shapes as they are, from `choices` of its own; `refine` fits a state matrix of given
structure to all that the record says.
"""

from floquid.core import MOST_TIMES, Form
from floquid.reconstruction._reconstruct import Refinement, StateModel, choices, reconstruct
from floquid.reconstruction._refine import refine
from floquid.reconstruction._states import Names, as_they_are, displacements
from floquid.reconstruction._structure import AbstractStructure, Block, FirstOrder, SecondOrder, structure_of, text_of

__all__ = [
    "MOST_TIMES", "AbstractStructure", "Block", "FirstOrder", "Form", "Refinement", "SecondOrder", "StateModel",
    "choices", "reconstruct", "refine", "structure_of", "text_of",
]  # fmt: skip
