"""floquid: identification of linear time-periodic systems from measured responses.

The main path: `read` a `Record`, `identify` it, `reconstruct` A(t), write a
`report`, `save` the `Analysis`. Each stage is a room of its
own: `core`, `readers`, `sync`, `lifting`, `lti`, `periodic`, `reconstruction`, `store`; `floquet` is the analysis of a
known A(t), `systems` holds examples with known truth.

A name is imported when it is first asked for, so that a program waits for what it uses alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from floquid._version import __version__ as __version__

if TYPE_CHECKING:
    from floquid import floquet, systems
    from floquid.comparison import Comparison, Parameter, Updated, compare, update
    from floquid.core import AzimuthSignal, Channel, ConstantPeriod, PeriodicModel, PulseTimes, Record, TachometerSignal
    from floquid.errors import FloquidError, IdentificationError, InputError
    from floquid.exports import export_modes, to_xarray
    from floquid.fleets import Fleet, fleet
    from floquid.large import LargeResult, identify_large
    from floquid.monitoring import Monitor, monitor
    from floquid.pipeline import Analysis, Bootstrap, bootstrap, identify, measure_transfer
    from floquid.preparation import Settings
    from floquid.readers import from_pandas, from_sep005, from_xarray, read, to_pandas, to_sep005, write
    from floquid.reconstruction import Refinement, StateModel, reconstruct, refine
    from floquid.reporting import report
    from floquid.shapes import read_shapes
    from floquid.store import load, save
    from floquid.surveys import Survey, survey
    from floquid.transfer import fit_transfer, multisine

__all__ = [
    "Analysis", "AzimuthSignal", "Bootstrap", "Channel", "Comparison", "ConstantPeriod", "Fleet", "FloquidError",
    "IdentificationError", "InputError", "LargeResult", "Monitor", "Parameter", "PeriodicModel", "PulseTimes", "Record",
    "Refinement", "Settings", "StateModel", "Survey", "TachometerSignal", "Updated", "bootstrap", "compare",
    "export_modes", "fit_transfer", "fleet", "floquet", "from_pandas", "from_sep005", "from_xarray", "identify",
    "identify_large", "load", "measure_transfer", "monitor", "multisine", "read", "read_shapes",
    "reconstruct", "refine", "report", "save", "survey", "systems", "to_pandas", "to_sep005", "to_xarray", "update",
    "write",
]  # fmt: skip

_ROOMS = {
    "comparison": "Comparison Parameter Updated compare update",
    "core": "AzimuthSignal Channel ConstantPeriod PeriodicModel PulseTimes Record TachometerSignal",
    "errors": "FloquidError IdentificationError InputError",
    "exports": "export_modes to_xarray",
    "fleets": "Fleet fleet",
    "large": "LargeResult identify_large",
    "monitoring": "Monitor monitor",
    "pipeline": "Analysis Bootstrap bootstrap identify measure_transfer",
    "preparation": "Settings",
    "readers": "from_pandas from_sep005 from_xarray read to_pandas to_sep005 write",
    "reconstruction": "Refinement StateModel reconstruct refine",
    "reporting": "report",
    "shapes": "read_shapes",
    "store": "load save",
    "surveys": "Survey survey",
    "transfer": "fit_transfer multisine",
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names.split()}


def __getattr__(name: str) -> object:
    """A public name from its room, or a room."""
    if name in _ROOM_OF:
        value = getattr(import_module(f"floquid.{_ROOM_OF[name]}"), name)
        globals()[name] = value
        return value
    from importlib.util import find_spec

    if not name.startswith("_") and find_spec(f"floquid.{name}"):
        return import_module(f"floquid.{name}")
    raise AttributeError(f"module 'floquid' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
