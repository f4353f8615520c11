"""Records and periodic models as labelled arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._checks import describe, input_error
from floquid.core import PeriodicModel, Record
from floquid.io import load_package
from floquid.readers import record_to_xarray

if TYPE_CHECKING:
    import xarray as xr

_OF_MODES = {
    "exponents": "1/s",
    "exponent_std": "1/s",
    "multipliers": "1",
    "multiplier_std": "1",
    "frequencies_hz": "Hz",
    "frequency_std_hz": "Hz",
    "damping_ratios": "1",
    "damping_ratio_std": "1",
}
_AXES = ("mode", "channel", "hit", "harmonic")


def to_xarray(thing: Record | PeriodicModel) -> xr.Dataset:
    """A record or a periodic model as labelled arrays, whose values are copies.

    Of a record: `response` (channel, time), and `orbit` (channel, phase) where there is one. `time` is in seconds. The
    attributes of `response` are `sample_rate` [Hz] and, of a constant period, `period` and `origin` [s].

    Of a model: `exponents`, `multipliers`, `frequencies_hz` and `damping_ratios` (mode), `coefficients` (mode, channel,
    hit, harmonic), and where they were estimated `exponent_std`, `multiplier_std`, `frequency_std_hz`,
    `damping_ratio_std` (mode) and `coefficient_std`: of complex numbers, the deviation of the real part as the real
    part and that of the imaginary part as the imaginary part. Modes and hits count from 1, units are in the attributes,
    the period [s] is an attribute. The joint covariance is not in it: it is kept by `floquid.save`.

    Along `channel` there are the names, and `unit`, `quantity`, `location` and `direction`.

    Complex numbers stay complex. The `thing` is the record or the model. Raises InputError where xarray is not
    installed, or it is another thing.
    """
    if isinstance(thing, Record):
        return record_to_xarray(thing)
    if not isinstance(thing, PeriodicModel):
        raise input_error("thing", "to_xarray", "be a Record or a PeriodicModel", f"is {describe(thing)}")
    model, xarray = thing, load_package("xarray", "to_xarray")
    variables: dict[str, Any] = {}
    for name, unit in _OF_MODES.items():
        values = getattr(model, name)
        if values is not None:
            variables[name] = ("mode", np.array(values), {"units": unit})
    for name in ("coefficients", "coefficient_std"):
        values = getattr(model, name)
        if values is not None:
            variables[name] = (_AXES, np.array(values), {"units": "that of the channel"})
    coordinates: dict[str, Any] = {
        "mode": np.arange(1, model.order + 1),
        "channel": [channel.name for channel in model.channels],
        "hit": np.arange(1, model.n_hits + 1),
        "harmonic": np.array(model.harmonics),
    }
    for word in ("unit", "quantity", "location", "direction"):
        coordinates[word] = ("channel", [str(getattr(channel, word)) for channel in model.channels])
    return xarray.Dataset(variables, coords=coordinates, attrs={"period": model.period, "period_units": "s"})
