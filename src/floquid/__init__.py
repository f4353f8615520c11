"""floquid: identification of linear time-periodic systems from measured responses.

The main path: `read` a `Record`, `identify` it, `reconstruct` A(t), write a
`report`, `save` the `Analysis`. Each stage is a room of its
own: `core`, `readers`, `sync`, `lifting`, `lti`, `periodic`, `reconstruction`, `store`; `floquet` is the analysis of a
known A(t), `systems` holds examples with known truth.
"""

from floquid import floquet, systems
from floquid._version import __version__ as __version__
from floquid.core import AzimuthSignal, Channel, ConstantPeriod, PeriodicModel, PulseTimes, Record, TachometerSignal
from floquid.errors import FloquidError, IdentificationError, InputError
from floquid.exports import export_modes, to_xarray
from floquid.pipeline import Analysis, Bootstrap, Settings, bootstrap, identify
from floquid.readers import from_pandas, from_sep005, from_xarray, read, to_pandas, to_sep005, write
from floquid.reconstruction import Refinement, StateModel, reconstruct, refine
from floquid.reporting import report
from floquid.store import load, save

__all__ = [
    "Analysis",
    "AzimuthSignal",
    "Bootstrap",
    "Channel",
    "ConstantPeriod",
    "FloquidError",
    "IdentificationError",
    "InputError",
    "PeriodicModel",
    "PulseTimes",
    "Record",
    "Refinement",
    "Settings",
    "StateModel",
    "TachometerSignal",
    "bootstrap",
    "export_modes",
    "floquet",
    "from_pandas",
    "from_sep005",
    "from_xarray",
    "identify",
    "load",
    "read",
    "reconstruct",
    "refine",
    "report",
    "save",
    "systems",
    "to_pandas",
    "to_sep005",
    "to_xarray",
    "write",
]
