"""The records of a result file, read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floquid.core import AzimuthSignal, Channel, Clock, ConstantPeriod, Provenance, PulseTimes, Record, TachometerSignal
from floquid.store import _layout as layout
from floquid.store._get import DamagedError, get, get_fields, group_in
from floquid.sync import AngleSpline, ShaftAngle

if TYPE_CHECKING:
    import h5py

_SIGNALS: dict[str, Any] = {kind.__name__: kind for kind in (TachometerSignal, AzimuthSignal, PulseTimes)}


def get_record(group: h5py.Group) -> Record:
    """One record, with its clock and its orbit."""
    return Record(
        **get_fields(group, layout.RECORD),
        channels=get_channels(group),
        clock=_clock(group),
        orbit=get(group, layout.ORBIT) if layout.ORBIT.name in group else None,
        provenance=get_provenance(group),
    )


def get_hits(group: h5py.Group, name: str, number: int) -> list[h5py.Group]:
    """The groups of each of so many hits."""
    return [group_in(group, f"{name}/hit{hit + 1}") for hit in range(number)]


def _clock(group: h5py.Group) -> Clock | None:
    if "clock" not in group:
        constant = {item.name: get(group, item) for item in layout.CLOCK}
        return None if constant["period"] is None else ConstantPeriod(**constant)
    inner = group_in(group, "clock")
    kind = get(inner, layout.KIND)
    if kind not in _SIGNALS:
        raise DamagedError(f"{inner.name}/kind is {kind!r}")
    return _SIGNALS[kind](**get_fields(inner, layout.SIGNALS[kind]))


def get_shaft(group: h5py.Group) -> ShaftAngle:
    """The angle of a shaft."""
    inner = get_fields(group_in(group, "spline"), layout.SPLINE)
    knots, n, degree = inner["knots"], len(inner["coefficients"]), inner["degree"]
    numbers = [np.ravel(value) for value in inner.values()]
    if (
        not 1 <= degree <= 5
        or n <= degree
        or len(knots) != n + degree + 1
        or inner["covariance"].shape != (n, n)
        or not inner["first"] < inner["last"]
        or not all(np.isfinite(value).all() for value in numbers)
        or not (np.diff(knots) >= 0.0).all()
    ):
        raise DamagedError(f"{group.name}/spline is no spline of an angle")
    own = get_fields(group, layout.SHAFT)
    if len({len(own[name]) for name in ("times", "residuals", "lines", "kept")}) > 1:
        raise DamagedError(f"the columns of {group.name} differ in length")
    own |= {"kept": own["kept"] == 1, "steady": own["steady"] == 1}
    return ShaftAngle(**own, spline=AngleSpline(**inner))


def get_channels(group: h5py.Group) -> tuple[Channel, ...]:
    """The channels of a record or a model."""
    columns = get_fields(group_in(group, "channels"), layout.CHANNELS)
    if len({len(column) for column in columns.values()}) > 1:
        raise DamagedError(f"the columns of {group.name}/channels differ in length")
    return tuple(Channel(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))


def get_provenance(group: h5py.Group) -> Provenance:
    """Where something comes from."""
    return Provenance(**get_fields(group_in(group, "provenance"), layout.PROVENANCE))
