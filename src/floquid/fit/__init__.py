"""Algebra, steps and tests that all fits share."""

from floquid.fit._algebra import ROUNDING as ROUNDING
from floquid.fit._algebra import covariance_root as covariance_root
from floquid.fit._algebra import directions as directions
from floquid.fit._algebra import inverse_root as inverse_root
from floquid.fit._algebra import positive_part as positive_part
from floquid.fit._algebra import sandwich as sandwich
from floquid.fit._algebra import scaled_inverse as scaled_inverse
from floquid.fit._algebra import unit_scale as unit_scale
from floquid.fit._filters import filter_gain as filter_gain
from floquid.fit._filters import filtered as filtered
from floquid.fit._filters import yule_walker as yule_walker
from floquid.fit._near_axis import AxisFit as AxisFit
from floquid.fit._near_axis import AxisMode as AxisMode
from floquid.fit._near_axis import begun_off as begun_off
from floquid.fit._near_axis import block_stands as block_stands
from floquid.fit._near_axis import correlation as correlation
from floquid.fit._near_axis import couples as couples
from floquid.fit._near_axis import half_of as half_of
from floquid.fit._near_axis import near_axis as near_axis
from floquid.fit._near_axis import off_axis as off_axis
from floquid.fit._near_axis import with_blocks as with_blocks
from floquid.fit._solver import Ends as Ends
from floquid.fit._solver import Normal as Normal
from floquid.fit._solver import Steps as Steps
from floquid.fit._solver import levenberg_marquardt as levenberg_marquardt
from floquid.fit._tests import DEVIATIONS as DEVIATIONS
from floquid.fit._tests import SURE as SURE
from floquid.fit._tests import WITHIN as WITHIN
from floquid.fit._tests import chi2_limit as chi2_limit
from floquid.fit._tests import schwarz as schwarz
from floquid.fit._tests import score_gain as score_gain
from floquid.fit._tests import wald_rise as wald_rise

__all__: list[str] = []
