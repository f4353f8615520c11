"""The records of a result file, read."""

from __future__ import annotations

from typing import Any

from floquid.core import AzimuthSignal, Channel, Clock, ConstantPeriod, Provenance, PulseTimes, Record, TachometerSignal
from floquid.store import _layout as layout
from floquid.store._get import get, get_fields
from floquid.sync import AngleSpline, ShaftAngle

_SIGNALS: dict[str, Any] = {kind.__name__: kind for kind in (TachometerSignal, AzimuthSignal, PulseTimes)}


def get_record(group: Any) -> Record:
    """One record, with its clock and its orbit."""
    return Record(
        **get_fields(group, layout.RECORD),
        channels=get_channels(group),
        clock=_clock(group),
        orbit=get(group, layout.ORBIT) if layout.ORBIT.name in group else None,
        provenance=get_provenance(group),
    )


def get_hits(group: Any, name: str, number: int) -> list[Any]:
    """The groups of each of so many hits."""
    return [group[f"{name}/hit{hit + 1}"] for hit in range(number)]


def _clock(group: Any) -> Clock | None:
    if "clock" not in group:
        constant = {item.name: get(group, item) for item in layout.CLOCK}
        return None if constant["period"] is None else ConstantPeriod(**constant)
    inner = group["clock"]
    kind = get(inner, layout.KIND)
    return _SIGNALS[kind](**get_fields(inner, layout.SIGNALS[kind]))


def get_shaft(group: Any) -> ShaftAngle:
    """The angle of a shaft."""
    inner, own = get_fields(group["spline"], layout.SPLINE), get_fields(group, layout.SHAFT)
    own |= {"kept": own["kept"] == 1, "steady": own["steady"] == 1}
    return ShaftAngle(**own, spline=AngleSpline(**inner))


def get_channels(group: Any) -> tuple[Channel, ...]:
    """The channels of a record or a model."""
    columns = get_fields(group["channels"], layout.CHANNELS)
    return tuple(Channel(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))


def get_provenance(group: Any) -> Provenance:
    """Where something comes from."""
    return Provenance(**get_fields(group["provenance"], layout.PROVENANCE))
