"""Floquet analysis of a known A(t): the truth that identification is held against, and shares no code with.

Exponents are on the principal branch, -ω/2 < Im λ ≤ ω/2 with ω = 2π/period, unless a function says otherwise.
"""

from floquid.floquet._exponents import exponents, multipliers
from floquid.floquet._lyapunov import FloquetLyapunov, lyapunov
from floquid.floquet._matrices import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    HarmonicMatrix,
    PiecewiseMatrix,
    SampledMatrix,
)
from floquid.floquet._modes import FloquetModes, ModesOutcome, modes
from floquid.floquet._system_matrix import StateMatrix
from floquid.floquet._transition import monodromy, transition

__all__ = [
    "AbstractPeriodicMatrix",
    "FloquetLyapunov",
    "FloquetModes",
    "FunctionMatrix",
    "HarmonicMatrix",
    "ModesOutcome",
    "PiecewiseMatrix",
    "SampledMatrix",
    "StateMatrix",
    "exponents",
    "lyapunov",
    "modes",
    "monodromy",
    "multipliers",
    "transition",
]
