"""How a file is changed so that the change gets past its packing, its checksums and its syntax.

`Mutate` is the fuzzer's own change of some bytes, which follows the coverage; around it, each format is taken apart and
put together again.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

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


def of(name: str) -> Mutator:
    """The mutator of one format: its own, or that of bytes, numbers and lines."""
    return {"csv": text, "uff": uff, "out": text}.get(name, binary)


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


def matrix(data: bytes, random: Random, mutate: Mutate) -> bytes:
    """Numbers and words of JSON."""
    return text(data.replace(b",", b",\n"), random, mutate)
