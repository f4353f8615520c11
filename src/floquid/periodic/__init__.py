"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty.

`constrain` finishes it with residues held to their harmonics; `to_control` and `from_control` take it to python-control
and back.
"""

from floquid.periodic._assemble import assemble, physical_exponents
from floquid.periodic._constrain import Constrained, constrain
from floquid.periodic._control import from_control, to_control
from floquid.periodic._estimate_at import estimate_at
from floquid.periodic._evidence import combinations_of
from floquid.periodic._finish import CONFIDENT, MISFIT, Finished, finish
from floquid.periodic._fit import EndlessError, Fit, fit
from floquid.periodic._forced import ForcedResponse
from floquid.periodic._fse import FSE, Family, fse
from floquid.periodic._harmonics import participation, select_bands
from floquid.periodic._period import PeriodCandidate, PeriodEstimate, estimate_period
from floquid.periodic._periodicity import PartialTests, Periodicity, periodicity
from floquid.periodic._refit import instants, own_period, refit, unexplained
from floquid.periodic._synchrony import NEGLIGIBLE_SLIP, SIGNIFICANT, Synchrony, drift, spacing, synchrony

__all__ = [
    "CONFIDENT",
    "FSE",
    "MISFIT",
    "NEGLIGIBLE_SLIP",
    "SIGNIFICANT",
    "Constrained",
    "EndlessError",
    "Family",
    "Finished",
    "Fit",
    "ForcedResponse",
    "PartialTests",
    "PeriodCandidate",
    "PeriodEstimate",
    "Periodicity",
    "Synchrony",
    "assemble",
    "combinations_of",
    "constrain",
    "drift",
    "estimate_at",
    "estimate_period",
    "finish",
    "fit",
    "from_control",
    "fse",
    "instants",
    "own_period",
    "participation",
    "periodicity",
    "physical_exponents",
    "refit",
    "select_bands",
    "spacing",
    "synchrony",
    "to_control",
    "unexplained",
]
