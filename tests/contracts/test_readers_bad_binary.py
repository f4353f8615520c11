"""Damaged files of the binary formats, built byte by byte: each ends in one `InputError`, and no memory is taken."""

import io
import struct

import numpy as np
import pytest
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.core import Record
from floquid.readers import read, write

GOOD = Record(values=np.arange(12.0).reshape(2, 6), sample_rate=100.0, channels=["x", "y"])


def written(suffix, folder):
    path = folder / f"good{suffix}"
    write(GOOD, path)
    return path.read_bytes()


def outb(kind=3, channels=2, samples=6, first=0.0, second=0.01, scales=(2.0, 3.0, 1.0, -1.0), text=b"", **changes):
    """A binary output of OpenFAST, by the layout that its MATLAB reader states."""
    letters = changes.get("letters", 10)
    names = changes.get("names", ["Time", "x", "y"])
    units = changes.get("units", ["(s)", "(m)", "(deg)"])
    data = struct.pack("<h", kind) + (struct.pack("<h", letters) if kind == 4 else b"")
    data += struct.pack("<iidd", channels, samples, first, second)
    data += b"" if kind == 3 else struct.pack(f"<{len(scales)}f", *scales)
    data += struct.pack("<i", changes.get("length", len(text))) + text
    data += b"".join(word.encode().ljust(max(letters, 0)) for word in [*names, *units])
    data += struct.pack(f"<{samples}i", *range(samples)) if kind == 1 else b""
    return data + changes.get("body", np.arange(12, dtype="<f8" if kind == 3 else "<i2").tobytes())


OUTB = {
    "empty": (b"", "is empty", "Export"),
    "one byte": (b"\3", "cut short in its head", "Run OpenFAST again"),
    "a head cut short": (outb()[:9], "cut short in its head", "Run OpenFAST again"),
    "an unknown kind": (outb(kind=7), "begins with 7", "text output is called .out"),
    "a text output": (b"\nTime x\n(s) (m)\n0 1\n1 2\n", "numbers 1 to 4", "text output is called .out"),
    "no channels": (outb(channels=0), "declares 0 channels of 6 samples", "Run"),
    "fewer than no channels": (outb(channels=-2), "declares -2 channels", "Run"),
    "fewer than no samples": (outb(samples=-6, kind=2), "declares 2 channels of -6 samples", "Run"),
    "10^12 numbers": (outb(channels=1000, samples=10**9), "declares 1000 channels of 1000000000", "Run"),
    "10^9 letters": (outb(length=10**9), "hold what it declares", "a description of 1000000000 letters", "Run"),
    "fewer than no letters": (outb(length=-5), "a description of -5 letters", "Run"),
    "names of no letters": (outb(kind=4, letters=0), "names of 0 letters", "Run"),
    "names of -1 letters": (outb(kind=4, letters=-1), "names of -1 letters", "Run"),
    "cut short": (outb()[:-1], "declares 2 channels of 6 samples", "Run"),
    "a step of NaN": (outb(second=np.nan), "a positive step", "nan", "`rate=`"),
    "a step of zero": (outb(second=0.0), "a positive step", "0.0 s", "`rate=`"),
    "a step of 1e-320": (outb(second=1e-320), "a positive step", "`rate=`"),
    "a start of infinity": (outb(first=np.inf), "state a first time", "inf s", "`rate=`"),
    "a scale of zero": (outb(kind=2, scales=(0.0, 3.0, 1.0, -1.0)), "scale that is not zero", "0.0 and 1.0 for 'x'"),
    "a scale of NaN": (outb(kind=4, scales=(2.0, np.nan, 1.0, 0.0)), "scale that is not zero", "nan and 0.0 for 'y'"),
    "times of no scale": (outb(kind=1, first=0.0, second=0.0), "a positive scale of its times", "0.0 and 0.0"),
    "no name": (outb(names=["Time", "x", ""]), "be a word", "Give each channel a name"),
    "a control character": (outb(names=["Time", "x", "\7y"]), "plain letters", "'\\x07y'"),
    "one sample": (outb(samples=1, body=bytes(16)), "at least two samples", "holds 1"),
    "no samples": (outb(samples=0, body=b""), "hold samples", "holds none"),
    "an infinite sample": (outb(body=np.full(12, np.inf).tobytes()), "finite samples", "12 in `values`", "NaN"),
}  # fmt: skip


def wav(*chunks, head=b"RIFF", form=b"WAVE", size=None):
    body = form + b"".join(
        name + struct.pack("<I", len(data) if declared is None else declared) + data + b"\0" * (len(data) % 2)
        for name, data, declared in chunks
    )
    return head + struct.pack("<I", len(body) if size is None else size) + body


def fmt(tag=1, channels=2, rate=8000, bits=16, frame=None, declared=None):
    frame = channels * -(-bits // 8) if frame is None else frame
    return b"fmt ", struct.pack("<HHIIHH", tag, channels, rate, rate * frame % 2**32, frame, bits), declared


DATA = (b"data", np.arange(12, dtype="<i2").tobytes(), None)
WAV = {
    "empty": (b"", "is empty", "Export"),
    "the mark alone": (b"RIFF", "is not one, or is damaged", "Copy"),
    "another form": (wav(fmt(), DATA, form=b"AVI "), "is not one, or is damaged", "RIFF and WAVE"),
    "no chunks": (wav(), "damaged", "Copy"),
    "no format": (wav(DATA), "damaged", "No fmt chunk", "Copy"),
    "no data": (wav(fmt()), "damaged", "Copy"),
    "data of 4 GB": (wav(fmt(), (*DATA[:2], 4_000_000_000)), "declares 4000000000 bytes, and 24 are left", "Copy"),
    "data of a byte more": (wav(fmt(), (*DATA[:2], 25)), "declares 25 bytes, and 24 are left", "Copy"),
    "no channels": (wav(fmt(channels=0), DATA), "be a whole WAV file", "Copy"),
    "no rate": (wav(fmt(rate=0), DATA), "whole WAV file", "states 0 Hz", "Copy"),
    "16-bit floats": (wav(fmt(tag=3), DATA), "whole WAV file", "16-bit floating-point", "Copy"),
    "A-law": (wav(fmt(tag=6, bits=8), DATA), "whole WAV file", "ALAW", "PCM"),
    "half a sample": (wav(fmt(), (b"data", bytes(22), None)), "be a whole WAV file", "Copy"),
    "no samples": (wav(fmt(), (b"data", b"", None)), "hold samples", "holds none", "Export"),
    "one sample": (wav(fmt(), (b"data", bytes(4), None)), "at least two samples", "holds 1", "Export"),
    "infinite": (
        wav(fmt(tag=3, bits=32), (b"data", np.full(8, np.inf, "<f4").tobytes(), None)), "finite samples", "'ch1'",
    ),
}  # fmt: skip


def segment(*objects, contents=0x0E, data=b"", order="<", **changes):
    """A segment of a TDMS file: objects as bytes, and raw data."""
    meta = b"" if not contents & 2 else struct.pack(f"{order}I", changes.get("count", len(objects))) + b"".join(objects)
    offset = changes.get("offset", len(meta))
    length = changes.get("length", len(meta) + len(data))
    return b"TDSm" + struct.pack("<I", contents) + struct.pack(f"{order}IQQ", 4713, length, offset) + meta + data


def thing(path, index=b"\xff\xff\xff\xff", properties=()):
    """An object: its path, the index of its data, and properties as bytes."""
    text = path.encode()
    return struct.pack("<I", len(text)) + text + index + struct.pack("<I", len(properties)) + b"".join(properties)


def index(count, kind=10, dimension=1):
    return struct.pack("<IIIQ", 20, kind, dimension, count)


def number(name, value):
    return struct.pack("<I", len(name)) + name.encode() + struct.pack("<Id", 10, value)


def scale(name, value):
    return struct.pack("<I", len(name)) + name.encode() + struct.pack("<II", 7, value)


def word(name, value):
    return struct.pack("<I", len(name)) + name.encode() + struct.pack("<II", 0x20, len(value)) + value.encode()


def daqmx(count, width, buffer=0, n_widths=1):
    return struct.pack("<IIIQI5II", 0x1269, 0xFFFFFFFF, 1, count, 1, 5, buffer, 0, 0, 0, n_widths) + struct.pack(
        "<I", width
    )


ROOT, STEP = thing("/"), number("wf_increment", 0.01)
VALUES = np.arange(6.0).tobytes()


def channel(count=6, kind=10, step=STEP, name="x", index_of=None):
    path = f"/'g'/'{name}'"
    return thing(path, index(count, kind) if index_of is None else index_of, [] if step is None else [step])


TDMS = {
    "empty": (b"", "is empty", "Export"),
    "another mark": (b"nothing of the kind" + segment(ROOT, channel(), data=VALUES), "whole TDMS file", "Copy"),
    "cut short": (segment(ROOT, channel(), data=VALUES)[:-1], "cut short", "Copy"),
    "values of no type": (segment(ROOT, channel(kind=0x77), data=VALUES), "whole TDMS file", "Copy"),
    "no channel": (segment(ROOT, contents=6), "holds no channel", "Export"),
    "text alone": (
        segment(ROOT, thing("/'g'/'x'", struct.pack("<IIIQQ", 28, 0x20, 1, 2, 10)),
                data=struct.pack("<II", 1, 2) + b"ab"), "1 channels of other kinds", "Export",
    ),
    "a step of NaN": (segment(ROOT, channel(step=number("wf_increment", np.nan)), data=VALUES), "positive step", "nan"),
    "a step below zero": (segment(ROOT, channel(step=number("wf_increment", -1.0)), data=VALUES), "step", "-1"),
    "no step": (segment(ROOT, channel(step=None), data=VALUES), "neither a rate nor a column of times", "`rate=`"),
    "one sample": (segment(ROOT, channel(1), data=VALUES[:8]), "at least two samples", "holds 1"),
    "two rates": (
        segment(ROOT, channel(3), channel(3, name="y", step=number("wf_increment", 0.02)), data=VALUES),
        "one step of time", "g/x has 0.01, g/y has 0.02", "`group/channel`",
    ),
    "two lengths": (segment(ROOT, channel(4), channel(2, name="y"), data=VALUES), "one length", "g/x has 4, g/y has 2"),
    "infinite": (segment(ROOT, channel(), data=np.full(6, np.inf).tobytes()), "finite samples", "channel 'x'", "NaN"),
}  # fmt: skip


def table(**columns):
    """A Parquet file of these columns."""
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    stream = io.BytesIO()
    found = columns.pop("table", None) or pa.table(columns)
    parquet.write_table(found, stream)
    return stream.getvalue()


def many_rows():
    pa = pytest.importorskip("pyarrow")
    return table(table=pa.table({"time": np.arange(6.0), "x": np.ones(6)}).replace_schema_metadata({"floquid": "{]"}))


TIME = np.arange(6.0)
PARQUET = {
    "empty": (lambda: b"", "is empty", "Export"),
    "the mark alone": (lambda: b"PAR1", "whole Parquet file", "Copy"),
    "another mark": (lambda: b"PARE" + table(time=TIME, x=TIME)[4:-4] + b"PARE", "whole Parquet file", "Copy"),
    "the first half": (lambda: table(time=TIME, x=TIME)[:300], "whole Parquet file", "Copy"),
    "a footer of 4 GB": (lambda: table(time=TIME, x=TIME)[:-8] + b"\xff\xff\xff\x7fPAR1", "whole Parquet", "Copy"),
    "a footer of zeros": (lambda: b"PAR1" + bytes(40) + struct.pack("<I", 40) + b"PAR1", "whole Parquet", "Copy"),
    "a footer of no end": (lambda: b"PAR1" + b"\x19\x9c" * 40 + struct.pack("<I", 80) + b"PAR1", "whole", "Copy"),
    "no columns": (table, "a column of numbers for each channel", "none", "Write"),
    "text alone": (lambda: table(x=["a", "b"]), "a column of numbers for each channel", "columns x", "Write"),
    "the time alone": (lambda: table(time=TIME), "a column of numbers for each channel", "columns time", "Write"),
    "nested": (lambda: table(time=TIME, x=[[1.0]] * 6), "a column of numbers for each channel", "columns time, x"),
    "no rows": (lambda: table(time=TIME[:0], x=TIME[:0]), "hold samples", "holds none"),
    "one row": (lambda: table(time=TIME[:1], x=TIME[:1]), "at least two samples", "holds one"),
    "no times": (lambda: table(x=TIME), "neither a rate nor a column of times", "`rate=`"),
    "a time of nothing": (lambda: table(time=[0.0, None, 2.0], x=[1.0, 2.0, 3.0]), "a finite time", "`rate=`"),
    "a date of nothing": (
        lambda: table(t=np.array(["2026-01-01", "NaT", "2026-01-03"], "M8[ns]"), x=[1.0, 2.0, 3.0]),
        "a finite time for every sample", "has 1 in `t`",
    ),
    "times that fall": (lambda: table(time=TIME[::-1], x=TIME), "times that increase", "Sort"),
    "an infinite sample": (lambda: table(time=TIME, x=np.full(6, -np.inf)), "finite samples", "channel 'x'", "NaN"),
    "an unknown unit of time": (lambda: table(**{"time [parsec]": TIME, "x": TIME}), "one of s, ms", "'parsec'"),
    "own metadata of no JSON": (many_rows, "`floquid` as floquid wrote it", "Delete them"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in OUTB.values()], ids=OUTB)
def test_bad_binary_output_of_openfast(data, words, tmp_path):
    refused(tmp_path / "run.outb", data, words)


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in WAV.values()], ids=WAV)
def test_bad_wav(data, words, tmp_path):
    refused(tmp_path / "run.wav", data, words)


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in TDMS.values()], ids=TDMS)
def test_bad_tdms(data, words, tmp_path):
    pytest.importorskip("nptdms")
    refused(tmp_path / "run.tdms", data, words)


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in PARQUET.values()], ids=PARQUET)
def test_bad_parquet(data, words, tmp_path):
    refused(tmp_path / "run.parquet", data(), words)


def refused(path, data, words):
    """One message with all its parts."""
    path.write_bytes(data)
    assert_refused(path, words)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("run.outb", outb()),
        ("run.outb", outb(kind=2)),
        ("run.outb", outb(kind=1, first=100.0, second=0.0)),
        ("run.outb", outb(kind=4)),
        ("run.wav", wav(fmt(), DATA)),
        ("run.tdms", segment(ROOT, channel(), data=VALUES)),
    ],
)
def test_the_tables_start_from_good_files(name, data, tmp_path):
    if name.endswith("tdms"):
        pytest.importorskip("nptdms")
    (tmp_path / name).write_bytes(data)
    assert read(tmp_path / name).n_samples == 6
