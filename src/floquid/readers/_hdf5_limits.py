"""What an HDF5 file declares, held against what is in it before memory is taken."""

from __future__ import annotations

import zlib
from math import prod
from typing import Any

from floquid.readers._npz import _LARGE, _PACKED, _impossible
from floquid.readers._table import Source
from floquid.readers._variables import printable

_MOST_PER_BYTE = 1032
"""What zlib makes of one byte at most."""


def check_size(source: Source, dataset: Any, path: str, n_bytes: int) -> None:
    """Refuse a dataset that declares more than the file of `n_bytes` can hold of it.

    Raises
    ------
    InputError
        There is nothing behind the shape, more is declared than any packing makes of what there is, or a packed part
        of it unpacks into more than its shape.
    """
    stored = dataset.id.get_storage_size()
    size = dataset.size * dataset.dtype.itemsize
    part = dataset.dtype.itemsize * prod(dataset.chunks or (1,))
    largest = max(size, part)
    if (size and not stored) or stored > n_bytes or (largest > _LARGE and largest > _PACKED * stored):
        declared = f"shape {dataset.shape} of {dataset.dtype}"
        raise _impossible(source, printable(path), declared, min(stored, n_bytes))
    if dataset.chunks is not None:
        _check_chunks(source, dataset, path, part)


def _check_chunks(source: Source, dataset: Any, path: str, part: int) -> None:
    """Refuse a chunk that zlib would make more of than a chunk is: HDF5 takes whatever memory that needs."""
    import h5py

    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
    packed = filters.count(h5py.h5z.FILTER_DEFLATE)
    if packed > 1:
        raise source.error(
            f"hold `{printable(path)}` packed once", "has it packed more than once", "Save it with one compression."
        )
    if not packed:
        return
    if dataset.id.get_storage_size() * _MOST_PER_BYTE <= _LARGE:
        return
    chunks: list[tuple[tuple[int, ...], int]] = []
    dataset.id.chunk_iter(lambda chunk: chunks.append((chunk.chunk_offset, chunk.size)))
    for offset, size in chunks:
        if size * _MOST_PER_BYTE > _LARGE:
            _, raw = dataset.id.read_direct_chunk(offset)
            if len(zlib.decompressobj().decompress(raw, part + 1024)) > part + 512:
                raise _impossible(source, printable(path), f"chunks of {part} bytes", size)
