"""The records of a result file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from floquid.core import Channel, ConstantPeriod, Provenance, Record
from floquid.store import _layout as layout
from floquid.store._get import DamagedError, get, get_fields, group_in

if TYPE_CHECKING:
    import h5py


def get_record(group: h5py.Group) -> Record:
    clock = {item.name: get(group, item) for item in layout.CLOCK}
    return Record(
        **get_fields(group, layout.RECORD),
        channels=get_channels(group),
        clock=None if clock["period"] is None else ConstantPeriod(**clock),
        provenance=get_provenance(group),
    )


def get_channels(group: h5py.Group) -> tuple[Channel, ...]:
    columns = get_fields(group_in(group, "channels"), layout.CHANNELS)
    if len({len(column) for column in columns.values()}) > 1:
        raise DamagedError(f"the columns of {group.name}/channels differ in length")
    return tuple(Channel(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))


def get_provenance(group: h5py.Group) -> Provenance:
    return Provenance(**get_fields(group_in(group, "provenance"), layout.PROVENANCE))
