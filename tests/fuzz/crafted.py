"""Files built on purpose: right in their syntax, wrong in what they declare."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from functools import cache
from random import Random
from typing import Any

import h5py
import numpy as np
from tests.fuzz import seeds

_NAMES = ("values", "sample_rate", "time", "channels", "units", "quantities", "locations", "start", "period", "origin")
_NAMES = (*_NAMES, "orbit", "run/a", "run/b", "run/time", "data", "x", "a.T", "run", "z" * 300, "e\u0301", "#refs#/a")
_MATRIX_NAMES = ("A", "coefficients", "harmonics", "period", "times", "edges", "states", "state", "model", "format")
_SHAPES = ((), (0,), (1,), (2,), (30,), (2, 30), (30, 2), (0, 5), (1, 1), (2, 2, 5), (1, 30), (3, 1, 3))
_DTYPES = ("<f8", ">f8", "<f4", "<f2", "<i8", "<i2", ">u4", "|u1", "|b1", "<c16", "<U3", "|S4", "<M8[s]", "<m8[ms]")


def npy_member(random: Random) -> tuple[str, bytes]:
    """An array under one of our names, of any type and shape."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array(random), allow_pickle=False)
    return f"{random.choice((*_NAMES, *_MATRIX_NAMES))}.npy", stream.getvalue()


def array(random: Random) -> np.ndarray:
    """Numbers, texts or times, most of them ordinary."""
    shape, dtype = random.choice(_SHAPES), np.dtype(random.choice(_DTYPES))
    generator = np.random.default_rng(random.randrange(1 << 32))
    if random.random() < 0.2:
        count = int(np.prod(shape)) * dtype.itemsize
        return np.frombuffer(generator.bytes(count), dtype if dtype.kind != "U" else "|S12", -1 if count else 0)[
            : int(np.prod(shape))
        ]
    with np.errstate(all="ignore"):
        return np.array(np.round(100 * generator.standard_normal(shape))).astype(dtype)


def other_header(content: bytes, random: Random) -> bytes:
    """An array whose head declares another type, shape or order than it has, or is written oddly."""
    shape = random.choice(("(2, 30)", "(60,)", "()", "(-1,)", "(2**40,)", "(1e3,)", "(True,)", "(0, 99999999999)", "3"))
    kind = random.choice(
        (*map(repr, _DTYPES), "'|O'", "[('a','<f8')]", "'<f8,<i4'", "None", "'<V0'", "'|S0'", "'<f16'")
    )
    order = random.choice(("False", "True", "1", "'x'"))
    entries = [f"'descr': {kind}", f"'fortran_order': {order}", f"'shape': {shape}"]
    entries += random.choice(([], ["'a': 1"], ["'shape': (1,)"]))
    random.shuffle(entries)
    head = "{" + ", ".join(entries) + "}"
    head = random.choice((head, head[:-3], head + " " * 20_000, "[" * 2000, f"__import__('os').getcwd() or {head}"))
    text = head.encode() + b"\n"
    body = content[content.find(b"\n") + 1 :]
    if random.random() < 0.5:
        return b"\x93NUMPY\x01\x00" + struct.pack("<H", min(len(text), 65535)) + text + body
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", random.choice((len(text), 1 << 31))) + text + body


def mat_array(random: Random, order: str) -> bytes:
    """A variable of a MATLAB file, of any class and shape, right or not."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)

    kind = random.choice((*range(1, 19), 6, 6, 6))
    shape = random.choice(_SHAPES) or (1, 1)
    shape = random.choice((shape, (1 << 30, 1 << 30), (-1, 2), (0, 1 << 31 - 1)))
    name = random.choice(_NAMES).replace("/", "_").encode()
    count = min(int(np.prod([max(n, 0) for n in shape], dtype=float)), 64)
    flags = kind | random.choice((0, 0, 0, 0x800, 0x200, 0x400))
    head = element(6, struct.pack(f"{order}II", flags, random.choice((0, 0, 5, 1 << 31))))
    head += element(5, struct.pack(f"{order}{len(shape)}i", *(max(min(n, (1 << 31) - 1), -1) for n in shape)))
    head += element(1, name)
    if kind == 1:
        inner = [element(14, b"" if random.random() < 0.3 else mat_array(random, order)) for _ in range(min(count, 4))]
        return head + b"".join(inner)
    if kind == 2:
        fields = b"".join(letter.ljust(8, b"\0") for letter in (b"a", b"b", random.choice((b"a", b"time", b""))))
        width = random.choice((8, 8, 8, 0, -1, 5, 24))
        inner = [element(14, mat_array(random, order)) for _ in range(random.randint(0, 3))]
        return head + struct.pack(f"{order}HHi", 5, 4, width)[:8] + element(1, fields) + b"".join(inner)
    data = random.randbytes(count * random.choice((1, 2, 4, 8)))
    return head + element(random.choice((9, 9, 7, 2, 4, 16, 17, 5, 12, 99)), data)


def hdf5_file(random: Random) -> bytes:
    """A file of our names whose datasets, links and attributes are drawn."""
    return _hdf5(random, _NAMES, {"values": lambda: np.ones((2, 30)), "channels": lambda: ["x", "y"]})


def hdf5_matrix(random: Random) -> bytes:
    """A(t) in a file whose datasets, links and attributes are drawn."""
    return _hdf5(random, _MATRIX_NAMES, {"A": lambda: np.ones((2, 2, 5)), "period": lambda: 1.7})


def _hdf5(random: Random, names: tuple[str, ...], usual: dict[str, Callable[[], Any]]) -> bytes:
    stream = io.BytesIO()
    libver = random.choice(("earliest", "v108", "latest"))
    with h5py.File(stream, "w", libver=libver, userblock_size=random.choice((0, 0, 512))) as file:
        for name, make in usual.items():
            if random.random() < 0.8:
                file[name] = make()
        for _ in range(random.randint(1, 4)):
            name = random.choice(names)
            try:
                if name in file and random.random() < 0.9:
                    del file[name]
                put(file, name, random)
            except (ValueError, TypeError, OSError, KeyError, RuntimeError, AttributeError):
                continue  # the library does not write such a thing
    return stream.getvalue()


def put(file: Any, name: str, random: Random) -> None:
    """One thing under `name`: a dataset of any kind, a link, a group, an attribute."""
    deeds: tuple[Callable[[Any, str, Random], None], ...] = (
        _put_array,
        _put_array,
        _put_packed,
        _put_huge,
        _put_odd,
        _put_link,
    )
    random.choice(deeds)(file, name, random)
    if name in file and random.random() < 0.3:
        _put_attribute(file[name], random)


def _put_array(file: Any, name: str, random: Random) -> None:
    data = array(random)
    file[name] = data if data.dtype.kind not in "UMm" else data.astype("|S20")


def _put_packed(file: Any, name: str, random: Random) -> None:
    data = np.zeros(random.choice(((30,), (2, 30), (2, 2, 5), (100_000,))), random.choice(("f8", "i2", "f4")))
    packing = random.choice(
        (
            {"compression": "gzip"},
            {"compression": "gzip", "compression_opts": 9, "shuffle": True, "fletcher32": True},
            {"compression": "lzf"},
            {"compression": "szip"},
            {"scaleoffset": 3},
            {"fletcher32": True},
            {"chunks": tuple(1 for _ in data.shape)} if data.size < 100 else {"chunks": (10_000,)},
            {"maxshape": tuple(None for _ in data.shape)},
        )
    )
    file.create_dataset(name, data=data, **packing)


def _put_huge(file: Any, name: str, random: Random) -> None:
    shape = random.choice(((1 << 40,), (1 << 20, 1 << 20), (2, 1 << 33), (1 << 30,)))
    chunks = random.choice((None, tuple(min(n, 1 << 16) if at == len(shape) - 1 else 1 for at, n in enumerate(shape))))
    made = file.create_dataset(name, shape, random.choice(("f8", "i1", "c16")), chunks=chunks)
    if chunks and random.random() < 0.5:
        made[tuple(slice(0, min(length, 2)) for length in shape)] = 1.0


def _put_odd(file: Any, name: str, random: Random) -> None:
    text = h5py.string_dtype()
    odd: tuple[Callable[[], Any], ...] = (
        lambda: file.create_dataset(name, data=h5py.Empty("f8")),
        lambda: file.create_dataset(name, data=["x" * random.choice((1, 300, 100_000)), "y"], dtype=text),
        lambda: file.create_dataset(name, (5,), dtype=text),
        lambda: file.create_dataset(name, (3,), dtype=h5py.vlen_dtype("f8")),
        lambda: file.create_dataset(name, data=[file.ref] * 2, dtype=h5py.ref_dtype),
        lambda: file.create_dataset(name, data=np.zeros(3, [("real", "f8"), ("imag", "f8")])),
        lambda: file.create_dataset(name, data=np.zeros(3, [("r", "f8"), ("i", "f4")])),
        lambda: file.create_dataset(name, (3,), dtype=h5py.enum_dtype({"a": 1, "b": 2}, "i1")),
        lambda: file.create_dataset(name, (2,), dtype=np.dtype(("f8", (1000, 1000)))),
        lambda: file.create_dataset(name, (10,), "f8", external=[("/etc/hostname", 0, 80)]),
        lambda: file.create_virtual_dataset(name, _virtual(random)),
        lambda: file.create_group(name),
        lambda: file.__setitem__(name, np.dtype("f8")),
    )
    random.choice(odd)()


def _virtual(random: Random) -> Any:
    layout = h5py.VirtualLayout(shape=(30,), dtype="f8")
    layout[:] = h5py.VirtualSource(random.choice((".", "/etc/hostname", "other.h5")), "values", shape=(30,))
    return layout


def _put_link(file: Any, name: str, random: Random) -> None:
    file[name] = random.choice(
        (
            h5py.SoftLink("/values"),
            h5py.SoftLink(f"/{name}"),
            h5py.SoftLink("/nowhere"),
            h5py.ExternalLink("other.h5", "/values"),
            h5py.ExternalLink("/etc/hostname", "/"),
            file["/"],
        )
    )


def _put_attribute(thing: Any, random: Random) -> None:
    name = random.choice(("MATLAB_class", "MATLAB_empty", "MATLAB_sparse", "unit", "units", "scale_factor", "format"))
    value = random.choice(
        (
            *(np.bytes_(word) for word in ("double", "char", "cell", "struct", "function_handle", "single")),
            *(
                "mm",
                "x" * 5000,
                "\x1b[2J",
                np.zeros(3),
                1,
                np.array(["a", "b"], dtype=h5py.string_dtype()),
                h5py.Empty("f8"),
            ),
        )
    )
    thing.attrs[name] = value


@cache
def _whole_results() -> tuple[bytes, ...]:
    return tuple(seeds.results())


@cache
def _places() -> tuple[str, ...]:
    found: list[str] = []
    with h5py.File(io.BytesIO(_whole_results()[1])) as file:
        file.visit(found.append)
    return tuple(found)


def other_result(random: Random) -> bytes:
    """A whole result in which some datasets or groups are exchanged, dropped, linked, or given other numbers."""
    stream = io.BytesIO(random.choice(_whole_results()))
    with h5py.File(stream, "r+") as file:
        for _ in range(random.choice((1, 1, 1, 2, 3))):
            name = random.choice(_places())
            if name not in file:
                continue
            try:
                _change(file, name, random)
            except (ValueError, TypeError, OSError, KeyError, RuntimeError, AttributeError, OverflowError):
                continue  # the library does not write such a thing
    return stream.getvalue()


def _change(file: Any, name: str, random: Random) -> None:
    old = file[name]
    deed = random.randrange(6)
    if deed < 3 and isinstance(old, h5py.Dataset) and old.shape is not None:
        value = _other_value(old, random)
        del file[name]
        file.create_dataset(
            name, data=value, **({"dtype": h5py.string_dtype()} if isinstance(value, (list, str)) else {})
        )
        return
    if deed == 3:
        source = random.choice(_places())
        del file[name]
        file[name] = file[source] if source in file else h5py.SoftLink("/model")
        return
    del file[name]
    if deed > 3:
        put(file, name, random)


_TEXTS = (
    "",
    "x",
    "AMI",
    "displacement",
    "auto",
    "stiffness 9; damping 0",
    '{"name": "AMI", "options": {}}',
    "a" * 10_000,
)
_TEXTS = (
    *_TEXTS,
    '{"name": "ERA", "options": {"__class__": 1}}',
    '{"name": "os.system", "options": {"command": "id"}}',
)
_TEXTS = (
    *_TEXTS,
    '{"name": "ERA", "options": [1]}',
    "[" * 5000,
    '{"name": {}, "options": {}}',
    '{"name": "AMI"}',
    "NaN",
)


def _other_value(old: Any, random: Random) -> Any:
    """Like what was there, with other numbers, another length, or another text."""
    if h5py.check_string_dtype(old.dtype) is not None:
        texts = [random.choice(_TEXTS) for _ in range(random.choice((old.size, old.size, 0, 1, 3)))]
        return random.choice(_TEXTS) if old.ndim == 0 else texts
    value = np.array(old[()])
    numbers = (0, 1, -1, 2, 7, 1 << 31, -(1 << 40), (1 << 62), np.nan, np.inf, 1e-320, 1e300, -1e308, 1e9)
    number = random.choice(numbers)
    if value.dtype.kind == "i":
        number = random.choice((0, 1, -1, 2, 7, 100, 1 << 20, 1 << 31, -(1 << 40), (1 << 62)))
    if not value.ndim:
        return np.array(number, value.dtype)
    deed = random.randrange(4)
    if deed == 0 and value.size:
        value.flat[random.randrange(value.size)] = number
        return value
    if deed == 1:
        return np.full(value.shape, number, value.dtype)
    axis = random.randrange(value.ndim)
    index = random.choice((slice(0, 0), slice(0, 1), slice(0, -1), np.r_[0 : value.shape[axis], 0 : value.shape[axis]]))
    return value[(slice(None),) * axis + (index,)]
