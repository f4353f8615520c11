"""Parquet files, which pyarrow takes apart.

They have a column a channel and one of times; pyarrow reads them with the checksums of pages where there are such.
Columns are headed as those of a text table, `x [m]`; the unit may also be in the metadata of the field, as `unit`. What
a record says beyond that is in the metadata of the schema, as `floquid` (see `_csv.Stated`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import Record
from floquid.io import Source, load_package
from floquid.readers._csv import stated_in, stated_text
from floquid.tables import (
    Table,
    check_distinct,
    find_time,
    make_channels,
    name_and_unit,
    refuse_blurred_times,
    rows_of,
    times_of,
)

_KEY = b"floquid"
_BLOCK = 1 << 16
_INDEX = "__index_level_"  # names that pandas gives an index without one: dates, or a mere count


def load_parquet(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a Parquet file; a null is a missing sample."""
    parquet = load_package("pyarrow.parquet", source.of, extra="parquet")
    again = source.taken_apart("Parquet file", "Copy or write it again.")
    with again, source.path.open("rb") as stream:
        file = parquet.ParquetFile(stream, page_checksum_verification=True)
        return _table(source, file, channels, ignore_time=ignore_time)


def _table(source: Source, file: Any, channels: Sequence[str] | None, *, ignore_time: bool) -> Table:
    schema = file.schema_arrow
    remedy = "Delete them: the table can be read without them."
    stated = stated_in(source, (schema.metadata or {}).get(_KEY), "the metadata `floquid`", remedy)
    check_distinct(source, schema.names)
    numbers, dates = _kinds(schema)
    parts = [_name_and_unit(schema.field(name)) for name in numbers]
    place, scale = find_time(source, parts)
    time = numbers[place] if place is not None else next(iter(dates), None)
    pairs = [pair for pair in zip(numbers, parts, strict=True) if pair[0] != time]
    if not pairs:
        got = f"has the columns {', '.join(schema.names[:20]) or 'none'}"
        raise source.error("have a column of numbers for each channel", got, "Write the channels too.")
    # As our own line states them, if it is of all of these, or by their headings.
    ours = {channel.label: channel for channel in stated.channels}
    if all(heading in ours for heading, _ in pairs):
        named = tuple(ours[heading] for heading, _ in pairs)
    else:
        named = make_channels(source, [name for _, (name, _) in pairs], [unit or "-" for _, (_, unit) in pairs])
    rows = rows_of(source, named, channels)
    others = [name for name in schema.names if name not in numbers and name != time]
    nameless = "The index of the table has no name, and is not used: name it `time [s]` if it is the time."
    notes = tuple(
        nameless if name.startswith(_INDEX) else f"Column {name!r} is not of numbers, and is not used."
        for name in others[:20]
    )
    values = np.empty((len(rows), file.metadata.num_rows))
    for place, row in enumerate(rows):  # one column at a time
        values[place] = _column(file, pairs[row][0])
    column = None
    if time is not None and ignore_time:
        notes += (f"The time column `{time}` was ignored.",)
    elif time is not None:
        column, remark = times_of(_column(file, time), scale=scale, label=time) or (None, ())
        notes += remark
    own = stated.of([named[row] for row in rows])
    return Table(values=values, time=column, sample_rate=stated.sample_rate, start=stated.start, notes=notes, **own)


def _kinds(schema: Any) -> tuple[list[str], list[str]]:
    """The names of the columns of numbers, and of those of dates or durations."""
    import pyarrow.types as kinds

    numbers = (kinds.is_integer, kinds.is_floating, kinds.is_boolean, kinds.is_decimal)
    dates = (kinds.is_timestamp, kinds.is_duration)
    plain = [field for field in schema if not field.name.startswith(_INDEX)]
    return (
        [field.name for field in plain if any(fits(field.type) for fits in numbers)],
        [field.name for field in schema if any(fits(field.type) for fits in dates)],
    )


def _name_and_unit(field: Any) -> tuple[str, str | None]:
    """The name and the unit in the heading of a column, or the unit in its metadata."""
    name, unit = name_and_unit(field.name)
    metadata = field.metadata or {}
    text = metadata.get(b"unit") or metadata.get(b"units")
    return name, text.decode("utf-8", "replace").strip() if unit is None and text else unit


def _column(file: Any, name: str) -> NDArray[Any]:
    """A column of numbers, NaN where one is missing, or of dates or durations."""
    import pyarrow as pa

    column = file.read(columns=[name])[name]
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        return column.to_numpy()
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    return column.cast(pa.float64(), safe=False).to_numpy()


def save_parquet(record: Record, path: Path) -> None:
    """Write `record` with a column of times, so that every number is read back as it is."""
    parquet = load_package("pyarrow.parquet", "write", extra="parquet")
    import pyarrow as pa

    refuse_blurred_times(record)
    times = record.times
    fields = [pa.field("time [s]", pa.float64(), metadata={b"unit": b"s"})]
    fields += [pa.field(c.label, pa.float64(), metadata={b"unit": c.unit.encode()}) for c in record.channels]
    schema = pa.schema(fields, metadata={_KEY: stated_text(record).encode()})
    options = {"compression": "zstd", "use_dictionary": False, "write_page_checksum": True}
    with path.open("wb") as stream, parquet.ParquetWriter(stream, schema, **options) as writer:
        for first in range(0, record.n_samples, _BLOCK):
            part = slice(first, first + _BLOCK)
            arrays = [pa.array(row) for row in (times[part], *record.values[:, part])]
            writer.write_batch(pa.record_batch(arrays, schema=schema))
