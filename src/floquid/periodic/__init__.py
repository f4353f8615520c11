"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty.

`fit` holds the residues to their harmonics, and `refit` keeps them; `to_control` and `from_control` take the model to
python-control and back.
"""

from floquid.periodic._assemble import assemble, physical_exponents
from floquid.periodic._bands import Entries
from floquid.periodic._control import from_control, to_control
from floquid.periodic._estimate_at import estimate_at
from floquid.periodic._evidence import combinations_of
from floquid.periodic._fit import Fit, fit
from floquid.periodic._forced import ForcedResponse
from floquid.periodic._fse import FSE, Family, fse
from floquid.periodic._harmonics import participation, select_bands
from floquid.periodic._known import Known, generous_poles, without_known
from floquid.periodic._period import PeriodCandidate, PeriodEstimate, estimate_period
from floquid.periodic._periodicity import PartialTests, Periodicity, periodicity
from floquid.periodic._refit import instants, own_period, refit, unexplained
from floquid.periodic._single_lines import line_amplitudes, without_lines
from floquid.periodic._start import entries_of, equal_multipliers, groups
from floquid.periodic._synchrony import NEGLIGIBLE_SLIP, SIGNIFICANT, Synchrony, drift, spacing, synchrony

CONFIDENT = 2e-3
"""A mode counts as well determined when both parts of its exponent have a deviation below this share of ω: one that is
not may stand for several."""

__all__ = [
    "CONFIDENT",
    "FSE",
    "NEGLIGIBLE_SLIP",
    "SIGNIFICANT",
    "Entries",
    "Family",
    "Fit",
    "ForcedResponse",
    "Known",
    "PartialTests",
    "PeriodCandidate",
    "PeriodEstimate",
    "Periodicity",
    "Synchrony",
    "assemble",
    "combinations_of",
    "drift",
    "entries_of",
    "equal_multipliers",
    "estimate_at",
    "estimate_period",
    "fit",
    "from_control",
    "fse",
    "generous_poles",
    "groups",
    "instants",
    "line_amplitudes",
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
    "without_known",
    "without_lines",
]
