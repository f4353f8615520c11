"""Periodic matrices in all their forms, and the arithmetic on them."""

from floquid.floquet.matrices._arithmetic import (
    Operand,
    added,
    assembled,
    constant_of,
    declared,
    joint_breaks,
    multiples,
    operand,
    product,
    repetitions,
    scaled,
)
from floquid.floquet.matrices._conversion import Reach, after_jumps, elements, fourier, of_function, reach, to_harmonics
from floquid.floquet.matrices._forms import (
    LAST,
    FunctionMatrix,
    PiecewiseMatrix,
    Prepared,
    StateMatrix,
    periodic,
    prepare,
)
from floquid.floquet.matrices._matrix import (
    SAME,
    AbstractPeriodicMatrix,
    Elements,
    as_array,
    balance,
    balanced_units,
    binary_units,
    checked_tolerance,
    named,
    probe_times,
    refuse_other_period,
)
from floquid.floquet.matrices._series import HarmonicMatrix, Interpolation, SampledMatrix, constant_matrix, line_weights
