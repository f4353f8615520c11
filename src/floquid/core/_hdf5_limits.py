"""What an HDF5 file declares, held against what is in it before memory is taken."""

from __future__ import annotations

import zlib
from itertools import product
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import printable
from floquid.core._limits import LARGE, PACKED, impossible
from floquid.core._time_axis import Source
from floquid.errors import InputError

_MOST_PER_BYTE = 1032
"""What zlib makes of one byte at most."""

_CHECKSUM = 4
"""Bytes of a checksum behind a chunk."""

_FILTERS = {1, 2, 3, 32000}
"""By their numbers: zlib (gzip), shuffle, Fletcher's checksum, lzf."""

_MOST_CHUNKS, _PER_CHUNK = 100_000, 4096
"""Bytes that HDF5 takes for each chunk that it reads, beside the data; so many of smaller ones are let through."""


def check_size(source: Source, dataset: Any, path: str, n_bytes: int) -> None:
    """Refuse a dataset that declares more than the file of `n_bytes` holds of it.

    Raises
    ------
    InputError
        There is nothing behind the shape or a part of it, more is declared than any packing makes of what there is, or
        a packed part unpacks into more than its shape.
    """
    stored = dataset.id.get_storage_size()
    size = dataset.size * dataset.dtype.itemsize
    part = dataset.dtype.itemsize * prod(dataset.chunks or (1,))
    largest = max(size, part)
    if (size and not stored) or stored > n_bytes or (largest > LARGE and largest > PACKED * stored):
        declared = f"shape {dataset.shape} of {dataset.dtype}"
        raise impossible(source, printable(path), declared, min(stored, n_bytes))
    if dataset.chunks is not None and size:
        _check_number(source, dataset, path, part)
        _check_packing(source, dataset, path, part)


def _check_number(source: Source, dataset: Any, path: str, part: int) -> None:
    """Refuse more small chunks than HDF5 has memory for, and chunks that are not there."""
    declared = prod(-(-end // length) for end, length in zip(dataset.shape, dataset.chunks, strict=True))
    if declared > _MOST_CHUNKS and part < _PER_CHUNK:
        raise source.error(
            f"hold `{printable(path)}` in fewer chunks",
            f"has {declared} of {part} bytes each",
            "Save it whole, or in chunks of 10000 samples.",
        )
    there = dataset.id.get_num_chunks()
    if there < declared and not _missing_is_nan(dataset):
        raise _unwritten(source, path, f"{there} of its {declared} chunks")


def check_found(source: Source, dataset: Any, path: str, array: NDArray[Any]) -> None:
    """Refuse the `array` that was read if any of it is zero for want of data: on a damaged index HDF5 tells nobody.

    Raises
    ------
    InputError
        A chunk that is nothing but the fill value is not in the file.
    """
    if dataset.chunks is None or _missing_is_nan(dataset):
        return
    starts = (range(0, end, length) for end, length in zip(dataset.shape, dataset.chunks, strict=True))
    for start in product(*starts):
        block = array[tuple(slice(at, at + length) for at, length in zip(start, dataset.chunks, strict=True))]
        if (block == dataset.fillvalue).all():
            try:
                dataset.id.read_direct_chunk(start)
            except (OSError, RuntimeError, ValueError):
                raise _unwritten(source, path, f"no data at {start}") from None


def _missing_is_nan(dataset: Any) -> bool:
    return dataset.dtype.kind == "f" and bool(np.isnan(dataset.fillvalue))


def _unwritten(source: Source, path: str, there: str) -> InputError:
    return source.error(
        f"hold `{printable(path)}` whole",
        f"has {there}: the rest was never written, or is lost, and would be read as zeros",
        "Cut it to what was recorded, save NaN in the rest, or copy the file again.",
    )


def _check_packing(source: Source, dataset: Any, path: str, part: int) -> None:
    """Refuse chunks on which HDF5's own filters run beyond their memory.

    That of zlib takes whatever memory a chunk unpacks into, that of checksums crashes on one shorter than its sum, and
    that of scales and offsets on damaged parameters (HDF5 2.0).
    """
    import h5py

    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
    packed = filters.count(h5py.h5z.FILTER_DEFLATE)
    if not set(filters) <= _FILTERS:
        raise source.error(
            f"hold `{printable(path)}` packed by gzip or lzf, or not packed", "has another filter there", "Save it so."
        )
    if packed > 1:
        raise source.error(
            f"hold `{printable(path)}` packed once", "has it packed more than once", "Save it with one compression."
        )
    least = _CHECKSUM if h5py.h5z.FILTER_FLETCHER32 in filters else 0
    chunks: list[tuple[tuple[int, ...], int]] = []
    dataset.id.chunk_iter(lambda chunk: chunks.append((chunk.chunk_offset, chunk.size)))
    for offset, size in chunks:
        bad = size <= least
        if packed and size * _MOST_PER_BYTE > LARGE:
            _, raw = dataset.id.read_direct_chunk(offset)
            bad = len(zlib.decompressobj().decompress(raw, part + 1024)) > part + 512
        if bad:
            raise impossible(source, printable(path), f"chunks of {part} bytes", size)
