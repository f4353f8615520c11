"""The types that several rooms share: what goes in (`Record`), what it is cut into (`Cycles`), what comes out."""

from floquid.core._axis import NearAxis as NearAxis
from floquid.core._axis import kind_open as kind_open
from floquid.core._axis import read_axis as read_axis
from floquid.core._axis import read_blocks as read_blocks
from floquid.core._axis import readings
from floquid.core._axis import with_deviations as with_deviations
from floquid.core._channel import Channel, Quantity, channels_named
from floquid.core._channel import channel_of as channel_of
from floquid.core._clock import CLOCKS as CLOCKS
from floquid.core._clock import AzimuthSignal, Clock, ConstantPeriod, PulseTimes, TachometerSignal
from floquid.core._cycles import Cycles
from floquid.core._estimates import Estimates
from floquid.core._estimates import Gains as Gains
from floquid.core._gaps import BRIDGED as BRIDGED
from floquid.core._gaps import longest_run as longest_run
from floquid.core._gaps import over_gaps as over_gaps
from floquid.core._gaps import runs_of as runs_of
from floquid.core._model_inputs import ModelInputs
from floquid.core._modelled import Driven as Driven
from floquid.core._modelled import modelled as modelled
from floquid.core._periodic_model import PeriodicModel
from floquid.core._periodic_modes import Couple, PeriodicModes, couples_of
from floquid.core._phase_clock import PhaseClock
from floquid.core._point import as_point as as_point
from floquid.core._point import common_point as common_point
from floquid.core._point import point_of as point_of
from floquid.core._provenance import Provenance
from floquid.core._record import Record
from floquid.core._shape import Shape

__all__ = [
    "AzimuthSignal", "Channel", "Clock", "ConstantPeriod", "Couple", "Cycles", "Estimates", "ModelInputs",
    "PeriodicModel", "PeriodicModes", "PhaseClock", "Provenance", "PulseTimes", "Quantity", "Record", "Shape",
    "TachometerSignal", "channels_named", "couples_of", "readings",
]  # fmt: skip
