"""Periodic matrices in all their forms, and the arithmetic on them."""

from floquid.floquet.matrices._arithmetic import (
    Operand,
    added,
    assembled,
    constant_of,
    operand,
    product,
    scaled,
    transposed,
)
from floquid.floquet.matrices._balancing import balance, balanced_units, binary_units
from floquid.floquet.matrices._conversion import after_jumps, to_harmonics, to_pieces, to_samples
from floquid.floquet.matrices._forms import FunctionMatrix, PiecewiseMatrix
from floquid.floquet.matrices._fourier import Reach, elements, fourier, of_function, reach
from floquid.floquet.matrices._given import as_array, checked_tolerance, named, probe_times, refuse_other_period
from floquid.floquet.matrices._matrix import SAME, AbstractPeriodicMatrix, Elements
from floquid.floquet.matrices._periods import (
    common_period,
    declared,
    joint_breaks,
    multiples,
    reduced,
    repeated,
)
from floquid.floquet.matrices._series import (
    HarmonicMatrix,
    Interpolation,
    SampledMatrix,
    constant_matrix,
    line_weights,
    real_series,
)
from floquid.floquet.matrices._state_matrix import Prepared, StateMatrix, periodic, prepare
