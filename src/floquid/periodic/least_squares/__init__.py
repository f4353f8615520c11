"""The constrained fit: parameters, blocks of samples, the solver, and what its solution says."""

from floquid.periodic.least_squares._estimates import chosen_bands, estimates_of, model_of, parts_of, shapes
from floquid.periodic.least_squares._lifted_block import KeptCycles, LiftedBlock
from floquid.periodic.least_squares._one_shape import OneShape
from floquid.periodic.least_squares._parameters import ModeParameters, forced_entries
from floquid.periodic.least_squares._record_block import GappyBlock, RecordBlock, followed, record_blocks
from floquid.periodic.least_squares._residual import (
    Residual,
    filtered_blocks,
    least_noise,
    noise_left,
    noise_of,
    residual_filter,
    residuals_of,
    squared,
    through,
)
from floquid.periodic.least_squares._sample_block import (
    EVEN,
    FOLLOWS,
    ODD,
    PLAIN,
    TREND,
    Block,
    complex_of,
    reals_of,
)
from floquid.periodic.least_squares._solver import (
    ASUNDER,
    AT_REST,
    Linear,
    Solution,
    eliminated,
    folded,
    linearise,
    normal,
    real_parts,
    solve,
    weighted,
)
