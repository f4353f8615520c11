"""Search for modes with measured inputs: bands, kinds and numbers of modes by one objective."""

from floquid.inputs.search._near_axis import read_near_axis as read_near_axis
from floquid.inputs.search._scores import Scores as Scores
from floquid.inputs.search._scores import gain_of as gain_of
from floquid.inputs.search._scores import period_step as period_step
from floquid.inputs.search._scores import phase_step as phase_step
from floquid.inputs.search._search import nearly_one as nearly_one
from floquid.inputs.search._search import searched as searched
from floquid.inputs.search._structure import Limits as Limits
from floquid.inputs.search._unmeasured import driving as driving
from floquid.inputs.search._unmeasured import through as through
from floquid.inputs.search._unmeasured import unmeasured as unmeasured

__all__: list[str] = []
