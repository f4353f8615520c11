"""Exponents, modes and stability by integration over a period: factors of the monodromy matrix."""

from floquid.floquet.monodromy_matrix._collocation import MOST, divided, factorise, gauss, inverse, stages
from floquid.floquet.monodromy_matrix._lyapunov import FloquetLyapunov, floquet_lyapunov
from floquid.floquet.monodromy_matrix._modes import FloquetModes, ModesOutcome, modes
from floquid.floquet.monodromy_matrix._periodic_schur import multipliers_of, product_logarithms, product_shapes
from floquid.floquet.monodromy_matrix._stability import (
    Stability,
    Verdict,
    compare,
    multiplier_is_real,
    stability,
    state_participation,
    upper_modes,
)
from floquid.floquet.monodromy_matrix._transition import (
    TOLERANCE,
    checked,
    exponents,
    factors,
    monodromy,
    multipliers,
    transition,
)
