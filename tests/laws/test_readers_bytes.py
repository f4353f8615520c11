"""Files built byte by byte from right parts, one or two of which are wrong: what is promised of any bytes holds.

Each strategy lays a format out as its own description does, and draws lengths, counts, types, offsets, encodings and
byte orders that contradict each other. That the parts are right when nothing is changed is a test, too.
"""

import json
import struct
import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.fuzz import seeds
from tests.fuzz.promise import broken
from tests.fuzz.targets import TARGETS

from floquid.pipeline import Settings
from floquid.readers import read

COUNTS = st.sampled_from(
    [0, 1, 2, 3, 5, 7, 29, 31, 60, 255, 256, 65535, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1]
)
LONG_COUNTS = COUNTS | st.sampled_from([1 << 33, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1])
WORDS = st.sampled_from(
    [
        "",
        " ",
        "nan",
        "inf",
        "-1",
        "1e400",
        "1,5",
        "x",
        "٣",
        "\x1b[2J",
        '"',
        "1_0",
        "0x1",
        "9" * 50,
        "1.0-101",
        "***",
        "é",
    ]
)
VALUES = np.arange(12.0).reshape(2, 6)
EVERY = {}


def scenario(name):
    """Enter a strategy of files of one target."""

    def entered(strategy):
        EVERY.setdefault(name, []).append(strategy())
        return strategy

    return entered


class Draw:
    """Right values, but for one or two of them, which are drawn; which ones is drawn too."""

    def __init__(self, draw, n_parts):
        self.draw = draw
        self.wrong = draw(st.sets(st.integers(0, n_parts - 1), max_size=2))
        self.part = -1

    def __call__(self, right, strategy):
        self.part += 1
        return self.draw(strategy) if self.part in self.wrong else right


@scenario("csv")
@st.composite
def tables(draw):
    of = Draw(draw, 9)
    separator, decimal = of(",", st.sampled_from(",;\t| ")), of(".", st.just(","))
    head = of(["time [s]", "x [m]", "y"], st.lists(WORDS, max_size=4))
    rows = [[f"{k / 10}", f"{k}{decimal}5", str(-k)] for k in range(6)]
    row, cell = of(0, st.integers(0, 5)), of(0, st.integers(0, 2))
    rows[row][cell] = of(rows[row][cell], WORDS)
    rows[row] += of([], st.lists(WORDS, max_size=2))
    line = of(
        "", st.sampled_from(["# a\n", "# floquid record: {}\n", '# floquid record: {"sample_rate": [1]}\n', "\n\n"])
    )
    text = line + "\n".join(separator.join(words) for words in [head, *rows])
    return text.encode(of("utf-8", st.sampled_from(["utf-16", "utf-8-sig", "utf-32"])), "replace")


@scenario("uff")
@st.composite
def functions(draw):
    """A dataset 58, of which each field of the header is in its columns."""
    of = Draw(draw, 24)
    binary, order = draw(st.booleans()), draw(st.sampled_from([1, 2]))
    number = of("58", st.sampled_from(["55", "151", "164", "15", "-1", "5 8"]))
    data = VALUES[1].astype("<f8" if order == 1 else ">f8").tobytes()
    if not binary:
        data = (
            "".join(f"{value:20.12E}" for value in VALUES[1][:4]) + "\n" + "".join(f"{v:20.12E}" for v in VALUES[1][4:])
        ).encode() + b"\n"
    size = of(len(data), COUNTS)
    kind = f"{number:>6s}b{of(order, st.integers(0, 4)):6d}{of(2, st.integers(0, 4)):6d}{11:12d}{size:12d}{0:6d}{0:6d}"
    lines = [
        of("    -1", st.sampled_from(["", "-1", "    -2"])),
        kind + f"{0:12d}{0:12d}" if binary else f"{number:>6s}",
    ]
    lines += [of("NONE", WORDS) for _ in range(5)]
    lines.append(
        f"{of(1, st.integers(0, 30)):5d}{0:10d}{0:5d}{0:10d}"
        f" {of('NONE', WORDS):10s}{of(1, COUNTS):10d}{1:4d} NONE      {0:10d}{0:4d}"
    )
    step = of(" 1.00000e-03", st.sampled_from(["0", "nan", "-1.0", "1e-320", "1e400", ""]))
    lines.append(
        f"{of(4, st.integers(0, 8)):10d}{of(6, COUNTS):10d}{of(1, st.integers(0, 3)):10d}"
        f"{0.0:13.5e}{step:>13s}{0.0:13.5e}"
    )
    for code, label in ((17, "Time"), (12, "Acceleration"), (0, "NONE"), (0, "NONE")):
        lines.append(f"{of(code, st.integers(-9, 99)):10d}{0:5d}{0:5d}{0:5d} {of(label, WORDS):20s} {'NONE':20s}")
    return (
        "\n".join(lines).encode("utf-8", "replace")
        + b"\n"
        + data
        + of(b"    -1\n", st.sampled_from([b"", b"-1", b"    -1"]))
    )


@scenario("outb")
@st.composite
def binary_outputs(draw):
    of = Draw(draw, 22)
    kind = draw(st.integers(1, 4))
    letters, channels, samples = of(10, COUNTS), 2, 6
    head = struct.pack("<h", of(kind, st.integers(-2, 9)))
    head += struct.pack("<H", letters % 65536) if kind == 4 else b""
    head += struct.pack("<II", of(channels, COUNTS), of(samples, COUNTS))
    odd = st.sampled_from([0.0, -1.0, np.nan, np.inf, 1e308, 1e-320])
    head += struct.pack("<dd", of(10.0 if kind == 1 else 0.0, odd), of(0.0 if kind == 1 else 0.1, odd))
    if kind != 3:
        small = st.sampled_from([0.0, -1.0, float("nan"), float("inf"), 1e38, 1e-45])
        head += struct.pack("<4f", of(1.0, small), 1.0, of(0.0, small), 0.0)
    words = b"A rotor. " + of(b"", st.sampled_from([b"floquid record: {}", b"floquid record: {", b"\xff", b"\0\n"]))
    head += struct.pack("<I", of(len(words), COUNTS)) + words
    names = [
        b"Time",
        of(b"Azimuth", st.binary(max_size=10)),
        of(b"Flap", st.sampled_from([b"Time", b"Azimuth", b"", b" "])),
    ]
    units = [of(b"(s)", st.sampled_from([b"(min)", b"", b"(", b"(-)"])), b"(deg)", of(b"(m)", st.binary(max_size=10))]
    head += b"".join(word.ljust(10)[:10] for word in names + units)
    times = np.arange(6, dtype="<i4").tobytes() if kind == 1 else b""
    data = VALUES.T.astype("<f8" if kind == 3 else "<i2").tobytes()
    return head + times + data[: of(len(data), st.integers(0, len(data)))] + of(b"", st.binary(max_size=9))


@scenario("out")
@st.composite
def text_outputs(draw):
    of = Draw(draw, 9)
    names = of(["Time", "Azimuth", "Flap"], st.lists(WORDS, max_size=4))
    units = of(["(s)", "(deg)", "(m)"], st.lists(WORDS | st.just("(s)"), max_size=4))
    rows = [[f"{k / 10:10.4f}", f"{30 * k:10.3E}", f"{k:10.3E}"] for k in range(6)]
    row, cell = of(0, st.integers(0, 5)), of(0, st.integers(0, 2))
    rows[row][cell] = of(rows[row][cell], WORDS)
    head = of(["", "These predictions were generated by OpenFAST", "", "", "A rotor", ""], st.lists(WORDS, max_size=9))
    lines = [*head, *(of("\t", st.sampled_from([" ", ",", ";"])).join(words) for words in [names, units, *rows])]
    return "\n".join(lines).encode(of("utf-8", st.sampled_from(["utf-16", "latin-1"])), "replace")


_WHOLE = {}


def whole(name):
    if name not in _WHOLE:
        _WHOLE[name] = TARGETS[name].seeds()
    return _WHOLE[name]


@scenario("lin")
@st.composite
def linearisations(draw):
    lines = draw(st.sampled_from(seeds.lin())).decode().split("\n")
    for _ in range(draw(st.integers(1, 2))):
        at = draw(st.integers(0, len(lines) - 1))
        words = lines[at].split(" ")
        words[draw(st.integers(0, len(words) - 1))] = draw(WORDS | COUNTS.map(str))
        lines[at] = " ".join(words)
    return "\n".join(lines[: draw(st.just(len(lines)) | st.integers(1, len(lines)))]).encode("utf-8", "replace")


VALUES_OF_SETTINGS = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["auto", "ami", "x"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


@scenario("settings")
@st.composite
def settings_files(draw):
    names = [field.name for field in fields(Settings)] + ["rate", "origin", "identifier", "nonsense"]
    content = draw(st.dictionaries(st.sampled_from(names), VALUES_OF_SETTINGS, min_size=1, max_size=3))
    try:
        return tomli_w.dumps(content).encode()
    except TypeError:  # TOML has no null
        return json.dumps(content).encode("utf-8", "replace")


@scenario("matrix")
@st.composite
def objects_of_json(draw):
    content = json.loads(whole("matrix")[0])
    for _ in range(draw(st.integers(1, 2))):
        content[draw(st.sampled_from([*content, "times", "edges", "harmonics", "format", "system"]))] = draw(
            VALUES_OF_SETTINGS
        )
    return json.dumps(content).encode("utf-8", "replace")


def promised(name, data):
    if not data:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"input{TARGETS[name].suffix(data)}"
        path.write_bytes(data)
        assert broken(TARGETS[name].calls, path) == []
        assert [one.name for one in Path(folder).iterdir()] == [path.name]


def test_every_target_has_a_scenario():
    assert set(EVERY) == set(TARGETS)


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=20)
@given(data=st.data())
def test_any_bytes(name, data):
    promised(name, data.draw(st.one_of(EVERY[name])))


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=3000)
@given(data=st.data())
def test_any_bytes_at_length(name, data):
    promised(name, data.draw(st.one_of(EVERY[name])))


class Right:
    """In the place of `Draw`: every part is right."""

    def __init__(self, draw, n_parts):
        self.draw = draw

    def __call__(self, right, strategy):
        return right


@pytest.mark.parametrize(
    ("suffix", "strategy"),
    {
        "csv": tables,
        "uff": functions,
        "outb": binary_outputs,
        "out": text_outputs,
    }.items(),
)
@settings(max_examples=8)
@given(data=st.data())
def test_the_parts_are_right(suffix, strategy, data):
    """Else every file would be refused at the first of them, and the law above would say nothing."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setitem(globals(), "Draw", Right)
        path = Path(folder) / f"input.{suffix}"
        path.write_bytes(data.draw(strategy()))
        assert read(path).values.shape[1] == 6
