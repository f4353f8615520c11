"""Search for modes with measured inputs: bands, kinds and numbers of modes by one objective."""

from floquid.inputs.search._scores import Scores, gain_of, period_step, phase_step
from floquid.inputs.search._search import nearly_one, read_near_axis, searched
from floquid.inputs.search._structure import Limits
from floquid.inputs.search._unmeasured import Passed, passed, unmeasured

__all__: list[str] = []
