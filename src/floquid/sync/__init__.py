"""Records to `Cycles`: what ties samples to the phase of the system, before any pole is known."""

from floquid.sync._angle_spline import AngleSpline
from floquid.sync._faults import clipped, dropouts, gaps, wrapped
from floquid.sync._hits import Impact, find_hits, find_impacts, split_hits
from floquid.sync._interpolation import half_width, interpolate, interpolation_error
from floquid.sync._pulse_times import pulse_times
from floquid.sync._read_clock import divisible
from floquid.sync._resample import bandwidth, between_events, resample
from floquid.sync._segment import LARGEST_DRIFT, refuse_unlike, rejoin, samples_per_period, segment
from floquid.sync._shaft_angle import STEADY, ShaftAngle, shaft_angle, speed_verdict, tied

__all__ = [
    "AngleSpline", "Impact", "ShaftAngle", "bandwidth", "between_events", "clipped", "dropouts",
    "find_hits", "find_impacts", "gaps", "half_width", "interpolate", "interpolation_error", "pulse_times", "rejoin",
    "resample", "samples_per_period", "segment", "shaft_angle", "split_hits", "wrapped",
]  # fmt: skip
