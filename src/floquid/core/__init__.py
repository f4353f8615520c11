"""The types that several rooms share: what goes in (`Record`), what it is cut into (`Cycles`), what comes out."""

from floquid.core._channel import Channel, Quantity, channels_named
from floquid.core._clock import ConstantPeriod
from floquid.core._cycles import Cycles
from floquid.core._periodic_model import PeriodicModel
from floquid.core._provenance import Provenance
from floquid.core._record import Record

__all__ = [
    "Channel",
    "ConstantPeriod",
    "Cycles",
    "PeriodicModel",
    "Provenance",
    "Quantity",
    "Record",
    "channels_named",
]
