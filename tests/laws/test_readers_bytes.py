"""Files built byte by byte from right parts, one or two of which are wrong: what is promised of any bytes holds.

Each strategy lays a format out as its own description does, and draws lengths, counts, types, offsets, encodings and
byte orders that contradict each other. That the parts are right when nothing is changed is a test, too.
"""

import json
import struct
import tempfile
import zlib
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


def npy(of, values):
    kind = of(values.dtype.str, st.sampled_from(["<f8", ">f8", "<f4", "|O", "<c16", "<U9999999", "|V0", "<M8[s]", "x"]))
    shape = of(values.shape, st.sampled_from([(), (1 << 40, 2), (-1,), (2, 3, 4), (1.5,), "a", (True,), (6, 2)]))
    order = of(False, st.sampled_from([True, 1, None, "C"]))
    text = of(str({"descr": kind, "fortran_order": order, "shape": shape}), WORDS).encode() + b"\n"
    version = of(1, st.integers(0, 4))
    length = of(len(text), COUNTS)
    size = struct.pack("<H", length % 65536) if version == 1 else struct.pack("<I", length)
    return of(b"\x93NUMPY", st.just(b"\x93NUMPZ")) + bytes((version, 0)) + size + text + values.tobytes()


@scenario("npz")
@st.composite
def archives(draw):
    """A zip file: local headers with content, the directory, and its end."""
    of = Draw(draw, 45)
    members = {"values": VALUES, "sample_rate": np.array(100.0), "channels": np.array(["x", "y"])}
    whole, directory = b"", b""
    for name, values in members.items():
        data = npy(of, values)
        label = of(
            f"{name}.npy", st.sampled_from(["values.npy", "time.npy", "../x.npy", "orbit.npy", "é.npy"])
        ).encode()
        packing = of(0, st.sampled_from([8, 12, 14, 99]))
        packed = zlib.compress(data)[2:-4] if packing == 8 else data
        fields = (20, of(0, st.sampled_from([1, 8, 2048])), packing, 0, 33, of(zlib.crc32(data), st.just(0)))
        sizes = (of(len(packed), COUNTS), of(len(data), COUNTS))
        place = of(len(whole), COUNTS)
        head = struct.pack("<5H3I2H", *fields[:5], fields[5], *sizes, len(label), 0)
        whole += b"PK\3\4" + head + label + packed
        directory += b"PK\1\2\x14\0" + head + struct.pack("<3H2I", 0, 0, 0, 0, place) + label
    count, length = of(3, st.integers(0, 9)), of(len(directory), COUNTS)
    end = b"PK\5\6" + struct.pack("<4H2IH", 0, 0, count, count, length, of(len(whole), COUNTS), 0)
    return whole + directory + end


def element(of, order, kind, data):
    kind, length = of(kind, st.integers(0, 20)), of(len(data), COUNTS)
    return struct.pack(f"{order}II", kind, length) + data + bytes(-len(data) % 8)


def variable(of, order, name, kind, shape, content):
    flags = element(of, order, 6, struct.pack(f"{order}II", of(kind, st.integers(0, 0xFFF)), 0))
    axes = of(shape, st.sampled_from([(), (1,), (-1, 6), (1 << 30, 1 << 30), (2, 3, 2), (6, 2), (1,) * 33]))
    head = flags + element(of, order, 5, struct.pack(f"{order}{len(axes)}i", *axes))
    return element(of, order, 14, head + element(of, order, 1, name.encode()) + content)


@scenario("mat")
@st.composite
def variables(draw):
    of = Draw(draw, 50)
    order = draw(st.sampled_from("<>"))
    numbers = element(of, order, 9, VALUES.T.astype(f"{order}f8").tobytes())
    rate = element(of, order, 9, struct.pack(f"{order}d", 12.5))
    cells = b"".join(
        variable(of, order, "", 4, (1, 1), element(of, order, of(16, st.sampled_from([4, 17, 18])), text))
        for text in (b"x", b"y")
    )
    parts = [
        variable(of, order, "values", 6, (2, 6), numbers),
        variable(of, order, "sample_rate", 6, (1, 1), rate),
        variable(of, order, "channels", 1, (1, 2), cells),
    ]
    for index, part in enumerate(parts):
        if of(False, st.just(True)):
            small = zlib.compress(part)
            parts[index] = struct.pack(f"{order}II", 15, of(len(small), COUNTS)) + small
    mark = b"IM" if order == "<" else b"MI"
    return b"MATLAB 5.0".ljust(124) + b"\0\1" + of(mark, st.sampled_from([b"MI", b"IM", b"XX"])) + b"".join(parts)


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


@scenario("wav")
@st.composite
def waves(draw):
    of = Draw(draw, 18)
    kind, bits, channels = of(3, st.sampled_from([0, 1, 2, 6, 0xFFFE])), of(64, st.integers(0, 80)), of(2, COUNTS)
    frame = of(16, COUNTS)
    body = struct.pack("<HHIIHH", kind, channels % 65536, of(100, COUNTS), of(1600, COUNTS), frame % 65536, bits)
    body += of(b"", st.binary(max_size=30))
    data = VALUES.T.tobytes()
    chunks = [(of(b"fmt ", st.just(b"fmtx")), body), (of(b"data", st.just(b"LIST")), data)]
    chunks += of(
        [],
        st.lists(
            st.tuples(st.sampled_from([b"fmt ", b"data", b"ds64", b"fact", b"\0\0\0\0"]), st.binary(max_size=40)),
            max_size=2,
        ),
    )
    if of(False, st.just(True)):
        chunks.reverse()
    packed = b"".join(
        name + struct.pack("<I", of(len(part), COUNTS)) + part + bytes(len(part) % 2) for name, part in chunks
    )
    mark = of(b"RIFF", st.sampled_from([b"RF64", b"BW64", b"RIFX"]))
    return mark + struct.pack("<I", of(len(packed) + 4, COUNTS)) + of(b"WAVE", st.just(b"AVI ")) + packed


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


@scenario("tdms")
@st.composite
def measurement_streams(draw):
    """A segment: its lead, its objects with their properties, and raw data."""
    of = Draw(draw, 26)
    order = draw(st.sampled_from("<>"))

    def text(words):
        return struct.pack(f"{order}I", of(len(words), COUNTS)) + words

    def double(name, value):
        return (
            text(name)
            + struct.pack(f"{order}I", of(10, st.sampled_from([0, 5, 0x20, 0x44, 99])))
            + struct.pack(f"{order}d", value)
        )

    data = [VALUES[0].astype(f"{order}f8").tobytes(), VALUES[1].astype(f"{order}f8").tobytes()]
    objects = []
    for name in (b"/'g'/'x'", of(b"/'g'/'y'", st.sampled_from([b"/", b"/'g'", b"x", b"/'g'/'x'", b"\xff"]))):
        index = struct.pack(
            f"{order}IIIQ",
            of(20, COUNTS),
            of(10, st.sampled_from([0, 3, 0x20, 0x44, 99])),
            of(1, COUNTS),
            of(6, LONG_COUNTS),
        )
        properties = double(
            of(b"wf_increment", st.just(b"wf_start_offset")), of(0.01, st.sampled_from([0.0, np.nan, -1.0]))
        )
        objects.append(text(name) + index + struct.pack(f"{order}I", of(1, COUNTS)) + properties)
    meta = struct.pack(f"{order}I", of(2, COUNTS)) + b"".join(objects)
    contents = of(2 | 4 | 8 | (64 if order == ">" else 0), st.integers(0, 255))
    raw = b"".join(data)
    lead = b"TDSm" + struct.pack("<I", contents) + struct.pack(f"{order}I", of(4713, COUNTS))
    lead += struct.pack(f"{order}QQ", of(len(meta) + len(raw), LONG_COUNTS), of(len(meta), LONG_COUNTS))
    return lead + meta + raw + of(b"", st.just(b"TDSm"))


def overwritten(name, marks):
    """A whole file with numbers of one to eight bytes written over, near one of the `marks` of the format."""

    @st.composite
    def files(draw):
        data = bytearray(draw(st.sampled_from(whole(name))))
        for _ in range(draw(st.integers(1, 2))):
            mark = draw(st.sampled_from(marks))
            near = data.rfind(mark) if draw(st.booleans()) else data.find(mark)
            at = max(near, 0) + draw(st.integers(-64, 160))
            width = draw(st.sampled_from([1, 2, 4, 8]))
            number = draw(LONG_COUNTS | st.integers(0, (1 << 64) - 1)) % (1 << 8 * width)
            if 0 <= at <= len(data) - width:
                data[at : at + width] = number.to_bytes(width, draw(st.sampled_from(["little", "big"])))
        return bytes(data[: draw(st.just(len(data)) | st.integers(1, len(data)))])

    return files


_WHOLE = {}


def whole(name):
    if name not in _WHOLE:
        _WHOLE[name] = TARGETS[name].seeds()
    return _WHOLE[name]


HDF5_MARKS = [b"\x89HDF", b"TREE", b"HEAP", b"SNOD", b"GCOL", b"OHDR", b"values", b"channels", b"MATLAB_class"]
for reader, places in {
    "h5": HDF5_MARKS,
    "result": [*HDF5_MARKS, b"exponents", b"outcome", b"floquid-result"],
    "parquet": [b"PAR1", b"schema", b"x", b"floquid"],
    "tdms": [b"TDSm", b"/'", b"wf_"],
    "matrix": [*HDF5_MARKS, b"PK\1\2", b"PK\3\4", b"NUMPY", b"MATLAB", b"states", b"period"],
}.items():
    scenario(reader)(overwritten(reader, places))


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
    content = json.loads(next(data for data in whole("matrix") if data.startswith(b"{")))
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
@settings(max_examples=40)
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
        "npz": archives,
        "mat": variables,
        "uff": functions,
        "wav": waves,
        "outb": binary_outputs,
        "out": text_outputs,
        "tdms": measurement_streams,
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
