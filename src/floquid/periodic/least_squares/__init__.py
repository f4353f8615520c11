"""The constrained fit: parameters, blocks of samples, the solver, and what its solution says."""

from floquid.periodic.least_squares._blocks_of_records import record_blocks
from floquid.periodic.least_squares._estimates import chosen_bands, estimates_of, model_of, parts_of, shapes
from floquid.periodic.least_squares._lifted_block import KeptCycles, LiftedBlock
from floquid.periodic.least_squares._one_shape import OneShape
from floquid.periodic.least_squares._parameters import ModeParameters, forced_entries
from floquid.periodic.least_squares._record_block import GappyBlock, RecordBlock
from floquid.periodic.least_squares._reduced import real_parts
from floquid.periodic.least_squares._residual import (
    Residual,
    least_noise,
    noise_left,
    noise_of,
    residuals_of,
    squared,
)
from floquid.periodic.least_squares._sample_block import (
    EVEN,
    ODD,
    PLAIN,
    SPEED,
    SPEED_RATE,
    SPEED_SQUARED,
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
    linearise,
    normal,
    solve,
    weighted,
)
from floquid.periodic.least_squares._whitening import filtered_blocks, residual_filter, through
