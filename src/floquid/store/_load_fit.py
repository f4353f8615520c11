"""The fit of records as they were sampled, read: what was measured, the angle of the shaft, the free response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.periodic import Fit, ForcedResponse
from floquid.store import _layout as layout
from floquid.store._get import DamagedError, get, get_fields, group_in
from floquid.store._load_records import get_hits, get_record, get_shaft
from floquid.sync import ShaftAngle

if TYPE_CHECKING:
    import h5py

Stored = tuple[Fit | None, tuple[Record, ...], tuple[ShaftAngle, ...]]


def get_fit(file: h5py.File, model: PeriodicModel, misfit: float | None) -> Stored:
    """The fit, the records as measured, and the angle of each shaft; nothing where records were lifted as they are."""
    n_hits = model.coefficients.shape[2]
    if "fit" not in file:
        return (None, *_measured(file, n_hits)) if "measured" in file else (None, (), ())
    group = group_in(file, "fit")
    if "measured" not in group:
        raise DamagedError("it is of an early floquid, which did not keep the record as it was measured")
    measured, shafts = _measured(group, n_hits)
    free = tuple(get_record(hit) for hit in get_hits(group, "free", n_hits))
    _check_records(measured, free, model)
    values = get_fields(group, layout.FIT)
    if values["noise"].shape != model.coefficients.shape[1:3]:
        raise DamagedError(f"fit/noise has the shape {values['noise'].shape}")
    own = get(group, layout.OWN_PERIOD)
    if own is not None and len(own) != 2:
        raise DamagedError(f"fit/own_period has the shape {own.shape}")
    found = Fit(
        model=model,
        forced=_forced(group, model),
        noise=values["noise"],
        free=free,
        period_std=values["period_std"],
        own_period=None if own is None else (float(own[0]), float(own[1])),
        misfit=1.0 if misfit is None else misfit,
        whitening=_whitening(group, model),
        **get_fields(group, layout.CHOICE),
    )
    return found, measured, shafts


def _whitening(group: h5py.Group, model: PeriodicModel) -> NDArray[np.float64] | None:
    """The whitening filters, if there are any and they can be those of the model's channels."""
    if layout.WHITENING.name not in group:
        return None
    taps = get(group, layout.WHITENING)
    if taps.shape[0] != len(model.channels) or taps.shape[1] < 2 or not np.isfinite(taps).all():
        raise DamagedError(f"fit/whitening is no filter of {len(model.channels)} channels")
    return taps


def _forced(group: h5py.Group, model: PeriodicModel) -> ForcedResponse | None:
    if "forced" not in group:
        return None
    found = get_fields(group_in(group, "forced"), layout.FORCED)
    follows = found.pop("speed_dependent") == 1
    forced = ForcedResponse(**found, channels=model.channels, speed_dependent=follows)
    if forced.coefficients.shape[:2] != model.coefficients.shape[1:3]:
        raise DamagedError(f"fit/forced/coefficients has the shape {forced.coefficients.shape}")
    return forced


def _measured(group: h5py.Group, n_hits: int) -> tuple[tuple[Record, ...], tuple[ShaftAngle, ...]]:
    """The records as they were read, and the angle of the shaft in each that has one."""
    measured = tuple(get_record(hit) for hit in get_hits(group, "measured", n_hits))
    shafts = tuple(get_shaft(hit) for hit in get_hits(group, "shafts", n_hits)) if "shafts" in group else ()
    for hit, was in enumerate(measured, start=1):
        if (was.clock is None) or (isinstance(was.clock, ConstantPeriod) == bool(shafts)):
            where = str(group.name).strip("/")
            name = f"{where}/measured/hit{hit}" if where else f"measured/hit{hit}"
            raise DamagedError(f"{name} has no clock that goes with the angle of a shaft in the file")
    return measured, shafts


def _check_records(measured: tuple[Record, ...], free: tuple[Record, ...], model: PeriodicModel) -> None:
    """Refuse records that are not those of one fit."""
    names = [channel.name for channel in model.channels]
    for hit, (was, own) in enumerate(zip(measured, free, strict=True), start=1):
        if [channel.name for channel in own.channels] != names or own.n_samples != was.n_samples:
            raise DamagedError(f"fit/free/hit{hit} is not the response that fit/measured/hit{hit} holds")
