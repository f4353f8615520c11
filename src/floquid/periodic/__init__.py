"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty.

`fit` holds the residues to their harmonics, and `refit` keeps them.
"""

from floquid.periodic._fit_records import Fit, OrderError, fit
from floquid.periodic._forced_part import ForcedResponse
from floquid.periodic._refit import instants, line_amplitudes, own_period, refit, unexplained, without_lines
from floquid.periodic._special_fits import estimate_at, fit_shapes, steady_period
from floquid.periodic._start import Known, distinct_multipliers, generous_poles, groups, held_shapes, without_known
from floquid.periodic.expansion import assemble, participation, physical_exponents, select_bands, strongest_branch
from floquid.periodic.least_squares import ModeParameters, followed
from floquid.periodic.period import FSE, Family, PeriodCandidate, PeriodEstimate, estimate_period, fse
from floquid.periodic.search import combinations_of
from floquid.periodic.significance import (
    TURNED,
    PartialTests,
    Periodicity,
    Synchrony,
    drift,
    on_a_mode,
    periodicity,
    spacing,
    synchrony,
)

CONFIDENT = 2e-3
"""A mode counts as well determined when both parts of its exponent have a deviation below this share of ω: one that is
not may stand for several."""

__all__ = [
    "CONFIDENT", "FSE", "TURNED", "Family", "Fit", "ForcedResponse", "Known", "ModeParameters", "OrderError",
    "PartialTests", "PeriodCandidate", "PeriodEstimate", "Periodicity", "Synchrony", "assemble", "combinations_of",
    "distinct_multipliers", "drift", "estimate_at", "estimate_period", "fit", "fit_shapes", "followed", "fse",
    "generous_poles", "groups", "held_shapes", "instants", "line_amplitudes", "on_a_mode", "own_period",
    "participation", "periodicity", "physical_exponents", "refit", "select_bands", "spacing", "steady_period",
    "synchrony", "unexplained", "without_known", "without_lines",
]  # fmt: skip
