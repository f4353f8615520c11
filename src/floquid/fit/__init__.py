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
from floquid.fit._solver import Ends as Ends
from floquid.fit._solver import Normal as Normal
from floquid.fit._solver import Steps as Steps
from floquid.fit._solver import levenberg_marquardt as levenberg_marquardt
from floquid.fit._tests import DEVIATIONS as DEVIATIONS
from floquid.fit._tests import SURE as SURE
from floquid.fit._tests import chi2_limit as chi2_limit
from floquid.fit._tests import schwarz as schwarz
from floquid.fit._tests import score_gain as score_gain
from floquid.fit._tests import wald_rise as wald_rise

__all__: list[str] = []
