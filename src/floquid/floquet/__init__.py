"""Floquet analysis of a known A(t): the truth that identification is held against, and shares no code with.

Exponents are on the principal branch, -ω/2 < Im λ ≤ ω/2 with ω = 2π/period, unless a function says otherwise.
"""

from floquid.floquet.control import (
    DiscretePeriodicSystem,
    HarmonicTransfer,
    LiftedSystem,
    PeriodicSystem,
    discretise,
    harmonic_transfer,
    lift,
    realise,
    simulate,
)
from floquid.floquet.files import (
    AzimuthResolution,
    AzimuthRole,
    LinFile,
    LinSignals,
    MatrixFile,
    OpenFastLinearisation,
    read_lin,
    read_matrix,
    read_openfast,
)
from floquid.floquet.hill_method import HillModes, HillOutcome, hill
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    HarmonicMatrix,
    PiecewiseMatrix,
    SampledMatrix,
    StateMatrix,
)
from floquid.floquet.monodromy_matrix import (
    FloquetLyapunov,
    FloquetModes,
    ModesOutcome,
    Stability,
    Verdict,
    compare,
    exponents,
    floquet_lyapunov,
    modes,
    monodromy,
    multiplier_is_real,
    multipliers,
    stability,
    state_participation,
    transition,
    upper_modes,
)
from floquid.floquet.stability_maps import Instability, StabilityMap, stability_map

__all__ = [
    "AbstractPeriodicMatrix", "AzimuthResolution", "AzimuthRole", "DiscretePeriodicSystem", "FloquetLyapunov",
    "FloquetModes", "FunctionMatrix", "HarmonicMatrix", "HarmonicTransfer", "HillModes", "HillOutcome", "Instability",
    "LiftedSystem", "LinFile", "LinSignals", "MatrixFile", "ModesOutcome", "OpenFastLinearisation", "PeriodicSystem",
    "PiecewiseMatrix", "SampledMatrix", "Stability", "StabilityMap", "StateMatrix", "Verdict", "compare", "discretise",
    "exponents", "floquet_lyapunov", "harmonic_transfer", "hill", "lift", "modes", "monodromy", "multiplier_is_real",
    "multipliers", "read_lin", "read_matrix", "read_openfast", "realise", "simulate", "stability", "stability_map",
    "state_participation", "transition", "upper_modes",
]  # fmt: skip
