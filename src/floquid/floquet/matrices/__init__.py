"""Periodic matrices in all their forms, and the arithmetic on them."""

from floquid.floquet.matrices._arithmetic import (
    Operand,
    Reach,
    added,
    after_jumps,
    assembled,
    common_period,
    constant_of,
    elements,
    fourier,
    joint_breaks,
    of_function,
    operand,
    product,
    reach,
    scaled,
)
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
