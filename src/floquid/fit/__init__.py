"""Algebra, steps and tests that all fits share."""

from floquid.fit._algebra import (
    HALF_DIGITS,
    LAGS,
    NOT_WHITE,
    ROUNDING,
    covariance_root,
    directions,
    filter_gain,
    filtered,
    inverse_root,
    positive_part,
    sandwich,
    scaled_inverse,
    unit_scale,
    yule_walker,
)
from floquid.fit._near_axis import (
    OFF,
    AxisMode,
    begun_off,
    block_stands,
    correlation,
    couples,
    half_of,
    near_axis,
    off_axis,
    with_blocks,
)
from floquid.fit._solver import (
    AT_REST,
    CHUNK,
    FARTHEST,
    FEW_STEPS,
    LONGEST_STEP,
    REST,
    ROUNDS,
    STEPS,
    Ends,
    Normal,
    Steps,
    levenberg_marquardt,
)
from floquid.fit._tests import (
    DEVIATIONS,
    EVIDENT,
    IN_VAIN,
    MODES,
    QUIET,
    RARE,
    SIGNIFICANT,
    SLOW,
    SURE,
    WITHIN,
    chi2_limit,
    is_vague,
    schwarz,
    score_gain,
    wald_rise,
)

__all__: list[str] = []
