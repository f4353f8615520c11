"""Periodic models as labelled arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.core._given import load_package
from floquid.core._periodic_model import PeriodicModel

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


def model_to_xarray(model: PeriodicModel) -> xr.Dataset:
    """See `PeriodicModel.to_xarray`."""
    xarray = load_package("xarray", "PeriodicModel.to_xarray")
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
