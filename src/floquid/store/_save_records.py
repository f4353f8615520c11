"""The records of a result file, written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from floquid.core import Channel, ConstantPeriod, Provenance, Record
from floquid.store import _layout as layout
from floquid.store._put import put, put_fields
from floquid.sync import ShaftAngle

if TYPE_CHECKING:
    import h5py


def put_record(group: h5py.Group, record: Record) -> None:
    """One record, with its clock of whatever kind and its orbit if it has one."""
    put_fields(group, layout.RECORD, record)
    for item in layout.CLOCK:
        put(group, item, getattr(record.clock, item.name) if isinstance(record.clock, ConstantPeriod) else None)
    if record.clock is not None and not isinstance(record.clock, ConstantPeriod):
        kind = type(record.clock).__name__
        inner = group.create_group("clock")
        put(inner, layout.KIND, kind)
        put_fields(inner, layout.SIGNALS[kind], record.clock)
    if record.orbit is not None:
        put(group, layout.ORBIT, record.orbit)
    put_channels(group, record.channels)
    put_provenance(group, record.provenance)


def put_shaft(group: h5py.Group, shaft: ShaftAngle) -> None:
    """The angle of a shaft."""
    put_fields(group, layout.SHAFT, shaft)
    put_fields(group.create_group("spline"), layout.SPLINE, shaft.spline)


def put_channels(group: h5py.Group, channels: Sequence[Channel]) -> None:
    inner = group.create_group("channels")
    for item in layout.CHANNELS:
        put(inner, item, [getattr(channel, item.name) for channel in channels])


def put_provenance(group: h5py.Group, provenance: Provenance) -> None:
    put_fields(group.create_group("provenance"), layout.PROVENANCE, provenance)
