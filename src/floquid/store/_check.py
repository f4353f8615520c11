"""A result file held against what is in it, before anything of it is read.

A saved result is data. It is one file, and each thing in it is reached once: no link leads elsewhere or twice to one
thing, so that nothing is read that is not in the file, and no small file makes much memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from floquid._checks import input_error, printable
from floquid.core import Record
from floquid.core._hdf5_limits import check_size
from floquid.core._hdf5_texts import HeapError, HeapTexts, address_of
from floquid.core._limits import LARGE, PACKED
from floquid.errors import InputError
from floquid.store._get import DamagedError

if TYPE_CHECKING:
    import h5py

_MOST_THINGS, _DEEPEST, _LONGEST_ATTRIBUTE = 100_000, 10, 4096


class _Source:
    """The file that is loaded, as the checks of HDF5 name it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        return input_error("path", "load", must, f"{self.path} {got}", remedy)


def attributes_of(file: h5py.File, path: Path) -> dict[str, Any]:
    """What the file says of itself: texts of variable length are read without the library, which may never end.

    Raises
    ------
    DamagedError
        One is neither a number nor a text, is too long, or has a text that is not there.
    """
    import h5py

    heap, found = HeapTexts(path, file.userblock_size), {}
    plain = (h5py.h5t.TypeIntegerID, h5py.h5t.TypeFloatID)
    for name in ("format", "version", "floquid"):
        if name not in file.attrs:
            continue
        attribute = file.attrs.get_id(name)
        kind = attribute.get_type()
        if attribute.get_storage_size() > _LONGEST_ATTRIBUTE or not isinstance(kind, (*plain, h5py.h5t.TypeStringID)):
            raise DamagedError(f"its attribute {name!r} is no short text or number")
        if isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str():
            if attribute.get_space().get_simple_extent_type() != h5py.h5s.SCALAR:
                raise DamagedError(f"its attribute {name!r} is no single text")
            found[name] = _texts_are_whole(lambda name=name: heap.attribute(file, name), name)
        else:
            found[name] = file.attrs[name]
    return found


def check_content(file: h5py.File, path: Path) -> None:
    """Refuse a file that declares more than it holds, or that leads out of itself.

    Raises
    ------
    InputError, DamagedError
        There is a link, or two to one thing; data in another file; an array larger than its bytes can be; a text that
        is not there; more in all than so large a file can hold.
    """
    import h5py

    source, n_bytes, heap = _Source(path), path.stat().st_size, HeapTexts(path, file.userblock_size)
    waiting: list[tuple[str, Any]] = [("", file)]
    seen, total = {address_of(file)}, 0
    while waiting:
        stem, group = waiting.pop()
        for name in group:
            where = f"{stem}/{name}"
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise DamagedError(f"{printable(where)} is a link, which is not followed")
            if heap.is_virtual(group, name):
                raise DamagedError(f"{printable(where)} is kept in another file")
            thing = group[name]
            address = address_of(thing)
            if address in seen or len(seen) > _MOST_THINGS or where.count("/") > _DEEPEST:
                raise DamagedError(f"{printable(where)} is there twice, or is one thing too many")
            seen.add(address)
            if isinstance(thing, h5py.Group):
                waiting.append((where, thing))
            elif isinstance(thing, h5py.Dataset) and thing.shape is not None:
                total += _checked(thing, where, source, heap, n_bytes)
                if total > LARGE and total > PACKED * n_bytes:
                    raise DamagedError(f"its {n_bytes} bytes declare to unpack into {total} and more")


def check_padding(file: h5py.File, records: Sequence[Record]) -> None:
    """Refuse many short hits beside a long one, all of which are filled up to its length when they are lifted.

    Raises
    ------
    DamagedError
        That would take more than so large a file can hold.
    """
    longest = max((hit.n_samples for hit in records), default=0)
    filled = 8 * longest * sum(hit.n_channels for hit in records)
    if filled > LARGE and filled > PACKED * Path(file.filename).stat().st_size:
        raise DamagedError(f"its {len(records)} hits, filled up to {longest} samples, would take {filled} bytes")


def _checked(dataset: Any, where: str, source: _Source, heap: HeapTexts, n_bytes: int) -> int:
    """The bytes that a dataset unpacks into, if it can."""
    import h5py

    if dataset.external:
        raise DamagedError(f"{printable(where)} is kept in another file")
    check_size(source, dataset, where, n_bytes)
    if dataset.chunks is not None:
        _check_chunks(dataset, where)
    text = h5py.check_string_dtype(dataset.dtype)
    if text is not None and text.length is None:
        return _texts_are_whole(lambda: sum(map(len, heap.of_dataset(dataset))), where)
    if dataset.dtype.hasobject:
        raise DamagedError(f"{printable(where)} is neither numbers nor text")
    return dataset.size * dataset.dtype.itemsize


def _check_chunks(dataset: Any, where: str) -> None:
    """Refuse a damaged index, of which HDF5 tells nobody and reads zeros."""
    starts = (range(0, end, length) for end, length in zip(dataset.shape, dataset.chunks, strict=True))
    if dataset.id.get_num_chunks() != prod(map(len, starts := list(starts))):
        raise DamagedError(f"{printable(where)} has not all of its parts")
    for start in product(*starts):
        if dataset.id.get_chunk_info_by_coord(start).byte_offset is None:
            raise DamagedError(f"{printable(where)} has no data at {start}")


def _texts_are_whole(read: Any, where: str) -> Any:
    try:
        return read()
    except HeapError as error:
        raise DamagedError(f"{printable(where)}: {error}") from None
