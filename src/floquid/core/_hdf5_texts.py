"""Texts of variable length in an HDF5 file, which lie in its global heap, read without the library's own conversion.

On a damaged heap or a damaged length that conversion writes past its memory or never ends (HDF5 2.0). So the heap is
read here, where each length is held against the next. Texts of fixed length go through the library. Nor does opening a
virtual dataset end when what it is made of is damaged: whether one is virtual is read here, too, before it is opened.

Source: The HDF Group, "HDF5 File Format Specification", version 3.0: III.E (global heap), IV.A (object headers).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

_REFERENCE = struct.Struct("<IQI")
"""What stands for a text: its length, the address of the heap collection that it is in, and its number there."""

_LAYOUT, _ATTRIBUTE, _CONTINUATION = 0x08, 0x0C, 0x10
_VIRTUAL = 3
_LARGEST, _MOST_MESSAGES, _LONGEST_ATTRIBUTE = 1 << 26, 10_000, 4096
_UNPACKED, _GZIP = [], [1]


def address_of(thing: Any) -> int:
    """Where an object's header begins in its file.

    Not by `h5o.get_info`, which reads all there is to tell, and ends the process on damaged attributes (HDF5 2.0).
    """
    import h5py

    library: Any = h5py
    low, high = library.h5g.get_objinfo(thing.id).objno  # two words where a long has 32 bits
    return int(low) | int(high) << 32


class HeapError(Exception):
    """What is wrong with a text, in words."""


class HeapTexts:
    """The texts in the global heap of the file at `path`, whose addresses count from `base`."""

    def __init__(self, path: Path, base: int) -> None:
        self._path = path
        self._base = base
        self._collections: dict[int, dict[int, bytes]] = {}

    def of_dataset(self, dataset: Any) -> list[bytes]:
        """The texts of a dataset, in the order of its elements."""
        size = dataset.size * _REFERENCE.size
        raw = b""
        if dataset.chunks is None:
            offset = dataset.id.get_offset()
            raw = b"" if offset is None else self._read(offset, size, absolute=True)
        elif prod(dataset.chunks) >= dataset.size and dataset.id.get_num_chunks() == 1 and dataset.ndim == 1:
            mask, raw = dataset.id.read_direct_chunk((0,))
            properties = dataset.id.get_create_plist()
            filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
            if filters == _GZIP and not mask:
                raw = zlib.decompressobj().decompress(raw, size)
            elif filters != _UNPACKED:
                raw = b""
        if len(raw) < size:
            raise HeapError("its texts are kept in a way that is not read: save them as texts of fixed length")
        return [self._text(raw[at : at + _REFERENCE.size]) for at in range(0, size, _REFERENCE.size)]

    def attribute(self, thing: Any, name: str) -> str:
        """A short text that is an attribute of a dataset or a group; "" if there is none, or it is something else."""
        import h5py

        if name not in thing.attrs:
            return ""
        attribute = thing.attrs.get_id(name)
        kind = attribute.get_type()
        if attribute.get_storage_size() > _LONGEST_ATTRIBUTE or not isinstance(kind, h5py.h5t.TypeStringID):
            return ""
        value = self._of_attribute(thing, name) if kind.is_variable_str() else thing.attrs[name]
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        return text.strip() if isinstance(text, str) and text.isprintable() and len(text) < _LONGEST_ATTRIBUTE else ""

    def is_virtual(self, group: Any, name: str) -> bool:
        """Whether a hard link of a group leads to a dataset that is made of others."""
        return self._is_virtual(group.id.links.get_info(name.encode("utf-8", "surrogateescape")).u)

    def refer_to_virtual(self, dataset: Any) -> bool:
        """Whether one of the references in a dataset is to a dataset that is made of others."""
        import h5py

        library: Any = h5py
        raw = np.zeros(dataset.shape, "V8")
        dataset.id.read(library.h5s.ALL, library.h5s.ALL, raw, library.h5t.STD_REF_OBJ)
        return any(map(self._is_virtual, np.frombuffer(raw.tobytes(), "<u8").tolist()))

    def _is_virtual(self, address: int) -> bool:
        """By the message on the layout, whose second byte is its class since version 3."""
        layouts = (message for kind, message in self._messages(address) if kind == _LAYOUT and address)
        return any(len(one) > 1 and one[0] >= 3 and one[1] == _VIRTUAL for one in layouts)

    def _of_attribute(self, thing: Any, name: str) -> bytes:
        """The single text of an attribute in the object's header; "?" where it has so many that they are elsewhere."""
        for kind, message in self._messages(address_of(thing)):
            if kind != _ATTRIBUTE or len(message) < 9:
                continue
            version, flags, *sizes = struct.unpack_from("<BBHHH", message)
            if version not in (1, 2, 3) or (flags and version > 1):
                continue
            at = 9 if version == 3 else 8
            found = message[at : at + sizes[0]].rstrip(b"\0")
            at += sum(size + (-size % 8 if version == 1 else 0) for size in sizes)
            if found == name.encode() and len(message) >= at + _REFERENCE.size:
                return self._text(message[at : at + _REFERENCE.size])
        return b"?"

    def _text(self, reference: bytes) -> bytes:
        length, address, index = _REFERENCE.unpack(reference)
        if not length:
            return b""
        if address not in self._collections:
            self._collections[address] = self._collection(address)
        text = self._collections[address].get(index)
        if text is None or len(text) != length:
            raise HeapError("a text in it is not of the length declared")
        return text.split(b"\0")[0]

    def _collection(self, address: int) -> dict[int, bytes]:
        head = self._read(address, 16)
        size = struct.unpack_from("<Q", head, 8)[0]
        if head[:5] != b"GCOL\x01" or not 16 <= size <= _LARGEST:
            raise HeapError("there is no heap of texts where one is due")
        data, found, at = self._read(address, size), {}, 16
        while at + 16 <= size:
            index, _, length = struct.unpack_from("<HH4xQ", data, at)
            if not index:
                break  # what is free, to the end
            if at + 16 + length > size:
                raise HeapError("a text in it is not of the length declared")
            found[index] = data[at + 16 : at + 16 + length]
            at += 16 + length + (-length % 8)
        return found

    def _messages(self, address: int) -> Iterator[tuple[int, bytes]]:
        """The messages of an object's header: their type and their data."""
        head = self._read(address, 16)
        if head[:4] == b"OHDR":
            flags = head[5]
            at = 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
            width = 1 << (flags & 3)
            size = int.from_bytes(self._read(address + at, width), "little")
            blocks, prefix = [(address + at + width, size)], 6 if flags & 4 else 4
        elif head[:1] == b"\x01":
            blocks, prefix, flags = [(address + 16, struct.unpack_from("<I", head, 8)[0])], 8, -1
        else:
            return
        count = 0
        while blocks:
            start, size = blocks.pop()
            data, at = self._read(start, size), 0
            while at + prefix <= len(data) and count < _MOST_MESSAGES:
                count += 1
                kind, length = struct.unpack_from("<HH" if flags < 0 else "<BH", data, at)
                message = data[at + prefix : at + prefix + length]
                at += prefix + length
                if kind == _CONTINUATION and len(message) >= 16:
                    there, size = struct.unpack_from("<QQ", message)
                    if size < _LARGEST and count < _MOST_MESSAGES:
                        blocks.append((there, size) if flags < 0 else (there + 4, max(size - 8, 0)))  # less its marks
                else:
                    yield kind, message

    def _read(self, address: int, size: int, *, absolute: bool = False) -> bytes:
        if size > _LARGEST:
            raise HeapError("it declares more text than names ever are")
        with self._path.open("rb") as stream:
            start = address + (0 if absolute else self._base)
            if start >= 1 << 63:
                raise HeapError("it refers to a text beyond its end")
            stream.seek(start)
            data = stream.read(size)
        if len(data) < size:
            raise HeapError("it refers to a text beyond its end")
        return data
