"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty.

`constrain` finishes it with residues held to their harmonics.
"""

from floquid.periodic._assemble import assemble
from floquid.periodic._constrain import Constrained, constrain
from floquid.periodic._finish import Finished, finish
from floquid.periodic._fit import Fit, fit
from floquid.periodic._forced import ForcedResponse
from floquid.periodic._harmonics import participation, select_bands
from floquid.periodic._synchrony import NEGLIGIBLE_SLIP, SIGNIFICANT, Synchrony, drift, spacing, synchrony

__all__ = [
    "NEGLIGIBLE_SLIP",
    "SIGNIFICANT",
    "Constrained",
    "Finished",
    "Fit",
    "ForcedResponse",
    "Synchrony",
    "assemble",
    "constrain",
    "drift",
    "finish",
    "fit",
    "participation",
    "select_bands",
    "spacing",
    "synchrony",
]
