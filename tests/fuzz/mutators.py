"""How a file is changed so that the change gets past its packing, its checksums and its syntax.

`Mutate` is the fuzzer's own change of some bytes, which follows the coverage; around it, each format is taken apart and
put together again.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random

from tests.fuzz import crafted

Mutate = Callable[[bytes], bytes]
Mutator = Callable[[bytes, Random, Mutate], bytes]

_NUMBERS = (0, 1, 2, 3, 7, 8, 127, 128, 255, 256, 1 << 15, (1 << 16) - 1, 1 << 20, 1 << 31, (1 << 32) - 1, 1 << 62)
_WORDS = (
    *("nan", "inf", "-inf", "1e400", "-0", "", " ", "1e-320", "9" * 40, "0x10", "1_0", "1,5", "٣", "é", "\t", '"', "'"),
    *(
        "[",
        "]",
        "{",
        "}",
        ":",
        ";",
        ",",
        "#",
        "=",
        "true",
        "null",
        "-1",
        "0",
        "1e308",
        "1d3",
        "***",
        "\x1b[2J",
        "\\u0000",
    ),
)
_MOST_UNPACKED = 1 << 20


def of(name: str) -> Mutator:
    """The mutator of one format: its own, or that of bytes, numbers and lines."""
    return {"npz": npz, "mat": mat, "h5": hdf5, "csv": text, "uff": uff, "out": text}.get(name, binary)


def binary(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Bytes, and numbers of one to eight bytes, at the ends of the file as often as anywhere in it."""
    if random.random() < 0.4 or len(data) < 16:
        return mutate(data)
    found = bytearray(data)
    for _ in range(random.randint(1, 3)):
        width = random.choice((1, 2, 4, 8))
        near = random.choice((len(found), min(512, len(found)), min(64, len(found))))
        at = random.randrange(max(near - width, 1))
        if random.random() < 0.3:
            at = max(len(found) - width - at, 0)
        old = int.from_bytes(found[at : at + width], "little")
        number = random.choice((*_NUMBERS, len(found), old + 1, old - 1, old * 2, 1 << random.randrange(64)))
        order = random.choice(("little", "little", "big"))
        found[at : at + width] = (number % (1 << (8 * width))).to_bytes(width, order)  # type: ignore[arg-type]
    return bytes(found)


def text(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Lines and words: dropped, doubled, moved, and exchanged for others."""
    if random.random() < 0.3:
        return mutate(data)
    lines = data.split(b"\n")
    for _ in range(random.randint(1, 3)):
        at, other = random.randrange(len(lines)), random.randrange(len(lines))
        deed = random.randrange(7)
        if deed == 0 and len(lines) > 1:
            del lines[at]
        elif deed == 1:
            lines.insert(at, lines[other])
        elif deed == 2:
            lines[at], lines[other] = lines[other], lines[at]
        elif deed == 3:
            lines[at] = mutate(lines[at])
        else:
            lines[at] = _other_word(lines[at], random)
    return b"\n".join(lines)


def _other_word(line: bytes, random: Random) -> bytes:
    separator = random.choice((b",", b" ", b";", b"\t", b"=", b":"))
    words = line.split(separator)
    words[random.randrange(len(words))] = random.choice(_WORDS).encode()
    return separator.join(words)


def uff(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Lines, and the fixed columns of a header."""
    if random.random() < 0.5:
        return text(data, random, mutate)
    lines = data.split(b"\n")
    at = random.randrange(min(len(lines), 14))
    line, column = lines[at], random.choice((0, 5, 6, 10, 20, 33, 46, 56, 60, 70))
    width = random.choice((5, 6, 10, 13))
    number = random.choice((*map(str, _NUMBERS), *_WORDS, str(len(data))))[:width]
    lines[at] = line[:column] + number.rjust(width).encode() + line[column + width :]
    return b"\n".join(lines)


def npz(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """The arrays inside an archive, which is packed again with right checksums."""
    if random.random() < 0.1:
        return binary(data, random, mutate)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(info.filename, archive.read(info)[:_MOST_UNPACKED]) for info in archive.infolist()]
    except Exception:  # noqa: BLE001  # what is no archive any more is changed as bytes
        return mutate(data)
    deed = random.randrange(5)
    if deed == 0 or not members:
        members.append(crafted.npy_member(random))
    at = random.randrange(len(members))
    name, content = members[at]
    if deed == 1:
        del members[at]
    elif deed == 2:
        members[at] = (name, crafted.npy_member(random)[1])
    elif deed == 3:
        members[at] = (name, crafted.other_header(content, random))
    else:
        members[at] = (name, binary(content, random, mutate))
    return zipped(members, zipfile.ZIP_DEFLATED if random.random() < 0.3 else zipfile.ZIP_STORED)


def zipped(members: list[tuple[str, bytes]], packing: int = zipfile.ZIP_STORED) -> bytes:
    """An archive of members, two of one name among them."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", packing) as archive:
        for name, content in members:
            info = zipfile.ZipInfo(name)
            info.compress_type = packing
            archive.filelist, archive.NameToInfo = archive.filelist, {}  # two of one name are no warning
            archive.writestr(info, content)
    return stream.getvalue()


def mat(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """The variables of a MATLAB file, unpacked, changed, and packed again with right lengths and checksums."""
    if data[128:132] == b"" or data.startswith(b"\x89HDF") or data[512:516] == b"\x89HDF":
        return hdf5(data, random, mutate)
    if random.random() < 0.2:
        return binary(data, random, mutate)
    order = ">" if data[126:128] == b"MI" else "<"
    variables, at = [], 128
    while at + 8 <= len(data):
        kind, length = struct.unpack_from(f"{order}II", data, at)
        content = data[at + 8 : at + 8 + length]
        if kind == 15:
            try:
                content = zlib.decompressobj().decompress(content, _MOST_UNPACKED)[8:]
            except zlib.error:
                return binary(data, random, mutate)
        variables.append(content)
        at += 8 + length + (-length % 8 if kind != 15 else 0)
    if not variables:
        return binary(data, random, mutate)
    where = random.randrange(len(variables))
    deed = random.randrange(6)
    if deed == 0:
        del variables[where]
    elif deed == 1:
        variables.append(variables[where])
    elif deed == 2:
        variables[where] = crafted.mat_array(random, order)
    else:
        variables[where] = _words(variables[where], random, mutate, order)
    return data[:128] + b"".join(_top(content, random.random() < 0.4, order) for content in variables)


def _words(content: bytes, random: Random, mutate: Mutate, order: str) -> bytes:
    """A word of four bytes among the tags at the head, or any bytes."""
    if random.random() < 0.4 or len(content) < 16:
        return mutate(content)
    found = bytearray(content)
    at = 4 * random.randrange(min(len(found) // 4, 24))
    old = struct.unpack_from(f"{order}I", found, at)[0]
    number = random.choice((*_NUMBERS, *range(1, 20), old + 4, old + 8, old - 8, old << 16, old | 0x800, old ^ 0x0F))
    struct.pack_into(f"{order}I", found, at, number % (1 << 32))
    return bytes(found)


def _top(content: bytes, packed: bool, order: str) -> bytes:
    whole = struct.pack(f"{order}II", 14, len(content)) + content + bytes(-len(content) % 8)
    if not packed:
        return whole
    small = zlib.compress(whole, 1)
    return struct.pack(f"{order}II", 15, len(small)) + small


def hdf5(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Bytes of the file, or another file built through the library: shapes, types, filters, links, attributes."""
    if random.random() < 0.25:
        return crafted.hdf5_file(random)
    return binary(data, random, mutate)


def result(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Bytes of a result, or a whole one with some of its datasets and groups exchanged through the library."""
    if random.random() < 0.5:
        return crafted.other_result(random)
    return binary(data, random, mutate)


def matrix(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """By what the file is."""
    if data.startswith(b"PK"):
        return npz(data, random, mutate)
    if data.startswith(b"MATLAB"):
        return mat(data, random, mutate)
    if data.startswith(b"\x89HDF"):
        return binary(data, random, mutate) if random.random() < 0.7 else crafted.hdf5_matrix(random)
    return text(data.replace(b",", b",\n"), random, mutate)
