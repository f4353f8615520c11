"""Parquet files, as pandas, polars and others write them: a column a channel, and one of times.

pyarrow reads them, with the checksums of pages where there are such. Columns are headed as those of a text table,
`x [m]`; the unit may also be in the metadata of the field, as `unit`. What a record says beyond that is in the metadata
of the schema, as `floquid` (see `_stated`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel, Record
from floquid.errors import InputError
from floquid.io import Source, load_package
from floquid.readers.columns._stated import Stated, stated_in, stated_text
from floquid.tables import (
    Table,
    TimeColumn,
    check_distinct,
    find_time,
    make_channels,
    name_and_unit,
    refuse_blurred_times,
    rows_of,
)

_KEY = b"floquid"
_BLOCK = 1 << 16
_INDEX = "__index_level_"
"""What pandas calls an index without a name: dates, or a mere count."""
_AGAIN = "Copy or write it again."
_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Columns:
    """Which columns of the file are what: the channels at `places`, the times at `time` in units of `scale` seconds."""

    names: tuple[str, ...]
    channels: tuple[Channel, ...]
    places: tuple[int, ...]
    time: int | None
    scale: float
    is_date: bool
    others: tuple[str, ...]


def load_parquet(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a Parquet file; a null is a missing sample.

    Raises
    ------
    InputError
        pyarrow is not installed; the file is damaged, holds no column of numbers, or declares what it cannot hold.
    """
    parquet = load_package("pyarrow.parquet", source.of, extra="parquet")
    with source.path.open("rb") as stream:
        file = _guarded(source, lambda: parquet.ParquetFile(stream, page_checksum_verification=True))
        schema = _guarded(source, lambda: file.schema_arrow)
        remedy = "Delete them: the table can be read without them."
        stated = stated_in(source, (schema.metadata or {}).get(_KEY), "the metadata `floquid`", remedy)
        columns = _columns(source, schema, stated)
        rows = rows_of(source, columns.channels, channels)
        wanted = [columns.places[row] for row in rows]
        use_time = columns.time is not None and not ignore_time
        values, ticks = _guarded(source, lambda: _values(source, file, columns, wanted, use_time=use_time))
    notes = tuple(map(_passed_over, columns.others[:20]))
    if columns.time is not None and ignore_time:
        notes += (f"The time column `{columns.names[columns.time]}` was ignored.",)
    time, start_note = _time(columns, ticks)
    return Table(
        values=values,
        time=time,
        sample_rate=stated.sample_rate,
        start=stated.start,
        notes=notes + start_note,
        **stated.of([columns.channels[row] for row in rows]),
    )


def _guarded(source: Source, call: Callable[[], Any]) -> Any:
    """What `call` gives; damage makes pyarrow raise errors of many types."""
    try:
        return call()
    except (InputError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  # ArrowInvalid, OSError, UnicodeDecodeError, KeyError, ...
        words = " ".join(str(error).split())[:200].removesuffix(".")
        raise source.error("be a readable Parquet file", f"is not ({words})", _AGAIN) from None


def _columns(source: Source, schema: Any, stated: Stated) -> _Columns:
    """The channels among the columns, and the column of times."""
    import pyarrow.types as kinds

    names, kept, parts, dates, others = [], [], [], [], []
    for place, field in enumerate(schema):
        names.append(field.name)
        is_date = kinds.is_timestamp(field.type) or kinds.is_duration(field.type)
        index = field.name.startswith(_INDEX)
        if is_date:
            dates.append(place)
        elif index or not (
            kinds.is_integer(field.type)
            or kinds.is_floating(field.type)
            or kinds.is_boolean(field.type)
            or kinds.is_decimal(field.type)
        ):
            others.append(field.name)
        else:
            kept.append(place)
            name, unit = name_and_unit(field.name)
            parts.append((name, unit if unit is not None else _unit(field)))
    time, scale = find_time(source, parts)
    at = None if time is None else kept[time]
    if at is None and dates:
        at = dates[0]
        scale = _TICKS[schema.field(at).type.unit]
    others += [names[place] for place in dates if place != at]
    places = tuple(place for place in kept if place != at)
    if not places:
        got = f"has the columns {', '.join(names[:20]) or 'none'}"
        raise source.error("have a column of numbers for each channel", got, "Write the channels too.")
    plain = [pair for place, pair in zip(kept, parts, strict=True) if place != at]
    own = {channel.label: channel for channel in stated.channels}
    check_distinct(source, names)
    if all(names[place] in own for place in places):
        channels = tuple(own[names[place]] for place in places)
    else:
        channels = make_channels(source, [name for name, _ in plain], [unit or "-" for _, unit in plain])
    return _Columns(
        names=tuple(names),
        channels=channels,
        places=places,
        time=at,
        scale=scale,
        is_date=at in dates,
        others=tuple(others),
    )


def _passed_over(name: str) -> str:
    if name.startswith(_INDEX):
        return "The index of the table has no name, and is not used: name it `time [s]` if it is the time."
    return f"Column {name!r} is not of numbers, and is not used."


def _unit(field: Any) -> str | None:
    """The unit in the metadata of a field."""
    metadata = field.metadata or {}
    text = metadata.get(b"unit") or metadata.get(b"units")
    return None if text is None else text.decode("utf-8", "replace").strip()


def _values(
    source: Source, file: Any, columns: _Columns, wanted: Sequence[int], *, use_time: bool
) -> tuple[NDArray[np.float64], NDArray[Any] | None]:
    """The samples (channels, samples) and the times or dates (samples,), read one column at a time."""
    import pyarrow as pa

    def column(place: int) -> Any:
        return file.read(columns=[columns.names[place]])[columns.names[place]]

    values = np.empty((len(wanted), file.metadata.num_rows))
    for row, place in enumerate(wanted):
        values[row] = _numbers(column(place), pa)
    if columns.time is None or not use_time:
        return values, None
    times = column(columns.time)
    return values, _dates(source, times, pa) if columns.is_date else _numbers(times, pa, keep_single=True)


def _numbers(column: Any, pa: Any, *, keep_single: bool = False) -> NDArray[Any]:
    if keep_single and pa.types.is_float32(column.type) and not column.null_count:
        return column.to_numpy()
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.uint8())
    whole = column.cast(pa.float64(), safe=False)
    return whole.to_numpy()


def _dates(source: Source, column: Any, pa: Any) -> NDArray[np.int64]:
    """Dates or spans as the whole numbers that they are kept as."""
    if column.null_count:
        got = f"lacks {column.null_count} of its dates"
        raise source.error("have a date for every sample", got, "Leave such rows out, or pass `rate` (`--rate`) [Hz].")
    return column.cast(pa.int64()).to_numpy()


def _time(columns: _Columns, ticks: NDArray[Any] | None) -> tuple[TimeColumn | None, tuple[str, ...]]:
    """The times [s], of dates those since the first, and a note on that."""
    if ticks is None or columns.time is None:
        return None, ()
    label = columns.names[columns.time]
    if not columns.is_date:
        return TimeColumn(values=ticks, scale=columns.scale, label=label), ()
    with np.errstate(over="ignore"):
        since = (ticks - ticks[:1]).astype(np.float64)
    return TimeColumn(values=since, scale=columns.scale, label=label), (f"Times count from the first of `{label}`.",)


def save_parquet(record: Record, path: Path) -> None:
    """Write `record` with a column of times, so that every number is read back as it is.

    Raises
    ------
    InputError
        pyarrow is not installed, or the record starts so late that its times cannot be told apart.
    """
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
