"""The types that several rooms share: what goes in (`Record`), what it is cut into (`Cycles`), what comes out."""

from floquid.core._branches import Branch, on_branch, turning_point, unevenness
from floquid.core._channel import Channel, Quantity, channel_of, channels_named
from floquid.core._clock import CLOCKS, AzimuthSignal, Clock, ConstantPeriod, PhaseClock, PulseTimes, TachometerSignal
from floquid.core._estimates import Estimates, Gains
from floquid.core._lazy_record import LazyRecord
from floquid.core._model_inputs import MOST_TIMES, Form, Hold, ModelInputs
from floquid.core._modelled import (
    Driven,
    NearAxis,
    kind_open,
    modelled,
    read_axis,
    read_blocks,
    readings,
    with_deviations,
)
from floquid.core._periodic_model import Identified, PeriodicModel
from floquid.core._record import (
    BRIDGED,
    Cycles,
    Provenance,
    Record,
    as_point,
    common_point,
    longest_run,
    over_gaps,
    point_of,
    runs_of,
)
from floquid.core._shape import Couple, PeriodicModes, Shape, couples_of

__all__ = [
    "AzimuthSignal", "Branch", "Channel", "Clock", "ConstantPeriod", "Couple", "Cycles", "Estimates", "Identified",
    "LazyRecord", "ModelInputs", "PeriodicModel", "PeriodicModes", "PhaseClock", "Provenance", "PulseTimes", "Quantity",
    "Record", "Shape", "TachometerSignal", "channels_named", "couples_of", "on_branch", "readings", "turning_point",
]  # fmt: skip
