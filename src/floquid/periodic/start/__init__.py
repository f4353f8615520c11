"""Start of a fit: the forced response of known multipliers, one mode a multiplier and group of harmonics."""

from floquid.periodic.start._groups import distinct_multipliers, groups
from floquid.periodic.start._held_shapes import held_shapes
from floquid.periodic.start._known_multipliers import Known, generous_poles, without_known
