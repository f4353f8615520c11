"""Floquet analysis of a known A(t): the truth that identification is held against, and shares no code with.

Exponents are on the principal branch, -ω/2 < Im λ ≤ ω/2 with ω = 2π/period, unless a function says otherwise.
"""

from floquid.floquet._discrete import DiscretePeriodicSystem, discretise
from floquid.floquet._exponents import exponents, multipliers
from floquid.floquet._file import MatrixFile, read_matrix
from floquid.floquet._gain import PeakGain, linf_norm
from floquid.floquet._gramians import gramian
from floquid.floquet._harmonic_system import HarmonicSystem, HarmonicTransfer, harmonic_transfer
from floquid.floquet._hill import hill
from floquid.floquet._hill_modes import HillModes, HillOutcome
from floquid.floquet._lifted_system import LiftedSystem
from floquid.floquet._lin_file import LinFile, LinSignals, read_lin
from floquid.floquet._linearisation import AzimuthResolution, OpenFastLinearisation
from floquid.floquet._lyapunov import FloquetLyapunov, lyapunov
from floquid.floquet._matrices import FunctionMatrix, HarmonicMatrix, PiecewiseMatrix, SampledMatrix
from floquid.floquet._matrix import AbstractPeriodicMatrix
from floquid.floquet._modes import FloquetModes, ModesOutcome, modes
from floquid.floquet._norms import h2_norm, hankel_norm
from floquid.floquet._openfast import AzimuthRole, read_openfast
from floquid.floquet._periods import common_period
from floquid.floquet._simulate import simulate
from floquid.floquet._sine_response import SineResponse, sine_response
from floquid.floquet._stability_map import Instability, StabilityMap, stability_map
from floquid.floquet._system import PeriodicSystem
from floquid.floquet._system_matrix import StateMatrix
from floquid.floquet._transition import monodromy, transition
from floquid.floquet._transitions import transitions
from floquid.floquet._verdict import (
    Stability,
    Verdict,
    compare,
    multiplier_is_real,
    stability,
    state_participation,
    upper_modes,
)
from floquid.floquet._zeros import zeros

__all__ = [
    "AbstractPeriodicMatrix",
    "AzimuthResolution",
    "AzimuthRole",
    "DiscretePeriodicSystem",
    "FloquetLyapunov",
    "FloquetModes",
    "FunctionMatrix",
    "HarmonicMatrix",
    "HarmonicSystem",
    "HarmonicTransfer",
    "HillModes",
    "HillOutcome",
    "Instability",
    "LiftedSystem",
    "LinFile",
    "LinSignals",
    "MatrixFile",
    "ModesOutcome",
    "OpenFastLinearisation",
    "PeakGain",
    "PeriodicSystem",
    "PiecewiseMatrix",
    "SampledMatrix",
    "SineResponse",
    "Stability",
    "StabilityMap",
    "StateMatrix",
    "Verdict",
    "common_period",
    "compare",
    "discretise",
    "exponents",
    "gramian",
    "h2_norm",
    "hankel_norm",
    "harmonic_transfer",
    "hill",
    "linf_norm",
    "lyapunov",
    "modes",
    "monodromy",
    "multiplier_is_real",
    "multipliers",
    "read_lin",
    "read_matrix",
    "read_openfast",
    "simulate",
    "sine_response",
    "stability",
    "stability_map",
    "state_participation",
    "transition",
    "transitions",
    "upper_modes",
    "zeros",
]
