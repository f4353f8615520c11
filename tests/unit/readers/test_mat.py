"""MATLAB files of version 5 to 7.3, as MATLAB and scipy write them: byte by byte where it matters."""

import re
import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import InputError
from floquid.io import load_variables
from floquid.readers import describe_file, read, write
from floquid.readers.variables._formats import _MatFile

VALUES = np.random.default_rng(5).standard_normal((2, 40))
TIME = np.arange(40) / 12.5
CELL, STRUCT, OBJECT, CHAR, SPARSE, DOUBLE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 6, 16, 17
FOUR_PARTS = r"Argument `\w+` of `\w+` must .+, but .+\.\n  \S.+\."


def refused(path, *words, **options):
    """`read` refuses the file with one message that names it and holds `words` in that order."""
    with pytest.raises(InputError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert str(path) in message
    assert re.fullmatch(FOUR_PARTS, message, re.DOTALL)
    assert re.search(".*".join(map(re.escape, words)), message, re.DOTALL), message


def cell(*texts):
    return np.array([*texts, None], dtype=object)[:-1]


GOOD = {"values": VALUES, "sample_rate": 12.5, "channels": cell("x", "y")}


def v5(folder, *, packed=True, **content):
    """A file as scipy writes it; what is None is left out."""
    path = folder / "run.mat"
    scipy.io.savemat(path, {key: value for key, value in content.items() if value is not None}, do_compression=packed)
    return path


# What MATLAB writes, byte by byte.


def element(kind, data, order="<"):
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def array(kind, shape, name, *content, flags=0, order="<"):
    """The element of an array: its flags, shape and name, and what follows."""
    head = element(6, struct.pack(f"{order}II", kind | flags << 8, 0), order)
    head += element(5, struct.pack(f"{order}{len(shape)}i", *shape), order) + element(1, name.encode(), order)
    return element(14, head + b"".join(content), order)


def doubles(values, name="", order="<"):
    values = np.atleast_2d(values)
    return array(DOUBLE, values.shape, name, element(9, values.T.astype(f"{order}f8").tobytes(), order), order=order)


def text(words, name="", order="<"):
    """Text as MATLAB has it: codes of UTF-16, column by column."""
    rows = [words] if isinstance(words, str) else words
    codes = np.array([list(row) for row in rows])
    data = "".join(codes.T.ravel()).encode("utf-16-le" if order == "<" else "utf-16-be")
    return array(CHAR, codes.shape, name, element(4, data, order), order=order)


def struct_array(name, order="<", shape=(1, 1), **fields):
    names = b"".join(field.encode().ljust(8, b"\0") for field in fields)
    small = struct.pack(f"{order}I", 4 << 16 | 5) + struct.pack(f"{order}i", 8)
    return array(STRUCT, shape, name, small, element(1, names, order), *fields.values(), order=order)


def packed(variable, order="<"):
    data = zlib.compress(variable)
    return struct.pack(f"{order}II", 15, len(data)) + data


def raw(folder, *variables, order="<"):
    path = folder / "run.mat"
    mark = struct.pack(f"{order}HH", 0x0100, 0x4D49)
    path.write_bytes(b"MATLAB 5.0 MAT-file, Platform: PCWIN64".ljust(116) + bytes(8) + mark + b"".join(variables))
    return path


def names(*words):
    return array(CELL, (1, len(words)), "channels", *map(text, words))


# Files with our names.


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize(
    "channels", [cell("x", "yy"), cell("x", "yy").reshape(2, 1), np.array(["x ", "yy"])], ids=["row", "column", "char"]
)
def test_saved_by_scipy(tmp_path, channels, packed):
    record = read(v5(tmp_path, packed=packed, **GOOD | {"channels": channels}))
    np.testing.assert_array_equal(record.values, VALUES)
    assert record.values.flags.c_contiguous
    assert record.sample_rate == 12.5
    assert [channel.name for channel in record.channels] == ["x", "yy"]


@pytest.mark.parametrize("kind", [bool, "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"])
def test_numbers_become_double_precision(tmp_path, kind):
    values = (VALUES * 100).astype(kind)
    record = read(v5(tmp_path, **GOOD | {"values": values}))
    assert record.values.dtype == np.float64
    np.testing.assert_array_equal(record.values, values.astype(float))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("pack", [packed, lambda variable, order: variable], ids=["packed", "plain"])
def test_saved_by_matlab_of_either_byte_order(tmp_path, order, pack):
    variables = [
        doubles(VALUES, "values", order),
        doubles([[12.5]], "sample_rate", order),
        array(CELL, (1, 2), "channels", text("µx", "", order), text("y", "", order), order=order),
        text(["m ", "µm"], "units", order),
    ]
    record = read(raw(tmp_path, *[pack(variable, order) for variable in variables], order=order))
    np.testing.assert_array_equal(record.values, VALUES)
    assert [channel.label for channel in record.channels] == ["µx [m]", "y [µm]"]


def test_one_channel(tmp_path):
    record = read(v5(tmp_path, **GOOD | {"values": VALUES[:1], "channels": "tip x"}))
    assert record.channels == (Channel(name="tip x"),)
    refused(v5(tmp_path, **GOOD | {"values": VALUES[:1].T, "channels": "x"}), "(40, 1)", "`values.'` for one channel")


@pytest.mark.parametrize("time", [TIME[:, None], TIME[None, :]], ids=["column", "row"])
def test_times_instead_of_a_rate(tmp_path, time):
    record = read(v5(tmp_path, **GOOD | {"sample_rate": None, "time": time + 3.0}))
    assert (record.sample_rate, record.start) == (12.5, 3.0)


def test_missing_samples_and_the_clock(tmp_path):
    values = VALUES.copy()
    values[1, 3] = np.nan
    record = read(v5(tmp_path, **GOOD | {"values": values}, period=0.5, origin=0.1, units=cell("m", "rad"), fs=3.0))
    np.testing.assert_array_equal(record.values, values)
    assert record.clock == ConstantPeriod(period=0.5, origin=0.1)
    assert [channel.unit for channel in record.channels] == ["m", "rad"]
    assert "The file also holds `fs`, which is not used." in record.provenance.steps


def test_what_is_written_is_read_by_scipy(tmp_path):
    channels = [Channel(name="tip µ", unit="m", direction="+x"), Channel(name="tacho", quantity="pulse", unit="V")]
    record = Record(values=VALUES, sample_rate=12.5, channels=channels, clock=ConstantPeriod(period=0.5), start=-2.0)
    write(record, tmp_path / "run.mat")
    found = scipy.io.loadmat(tmp_path / "run.mat", squeeze_me=True)
    np.testing.assert_array_equal(found["values"], VALUES)
    assert found["channels"].tolist() == ["tip µ", "tacho"]
    assert found["quantities"].tolist() == ["displacement", "pulse"]
    assert [found[key] for key in ("sample_rate", "start", "period", "origin")] == [12.5, -2.0, 0.5, 0.0]
    data = (tmp_path / "run.mat").read_bytes()
    write(record, tmp_path / "run.mat")
    assert (tmp_path / "run.mat").read_bytes() == data, "the same record makes the same file"


def test_what_does_not_fit_is_not_written(tmp_path, monkeypatch):
    from floquid.readers.variables import _formats

    write(Record(values=VALUES, sample_rate=1.0, channels=["x", "y"]), tmp_path / "fits.mat")
    monkeypatch.setattr(_formats, "_LARGEST", VALUES.nbytes - 1)
    with pytest.raises(InputError, match=r"`record` of `write` must have less than 2 GiB .*\n  Write it as \.h5"):
        write(Record(values=VALUES, sample_rate=1.0, channels=["x", "y"]), tmp_path / "run.mat")
    assert [file.name for file in tmp_path.iterdir()] == ["fits.mat"]


# Files with names of their own.

LAB = {
    "run": {"acc": {"x": VALUES[0], "y": VALUES[1][:, None]}, "time": TIME[:, None], "note": "calm"},
    "data": VALUES,
    "table": VALUES.T,
    "fs": 12.5,
    "T": {"T": VALUES},
}


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize(
    ("channels", "rows"),
    [
        (["run/acc/x", "run/acc/y"], [0, 1]),
        (["run.acc.y", "/run/acc/x"], [1, 0]),
        (["data[1]"], [1]),
        (["table.T[1]", "table.T[0]"], [1, 0]),
        (["T/T[1]", "run/acc/x"], [1, 0]),
        (["T.T[0]"], [0]),
    ],
)
def test_channels_by_path(tmp_path, channels, rows, packed):
    path = v5(tmp_path, packed=packed, **LAB)
    record = read(path, channels=channels, rate=3.0)
    np.testing.assert_array_equal(record.values, VALUES[rows])
    assert [channel.name for channel in record.channels] == channels
    assert record.sample_rate == 3.0


@pytest.mark.parametrize("word", ["data", "table.T", "T/T"])
def test_all_rows_of_a_matrix(tmp_path, word):
    record = read(v5(tmp_path, **LAB), channels=[word], rate=3.0)
    np.testing.assert_array_equal(record.values, VALUES)
    assert [channel.name for channel in record.channels] == [f"{word}[0]", f"{word}[1]"]
    assert "Rows and columns of a matrix are counted from 0." in record.provenance.steps


def test_times_beside_the_channels(tmp_path):
    path = v5(tmp_path, **LAB)
    record = read(path, channels=["run.acc.x"])
    assert record.sample_rate == 12.5
    assert "Times from `run/time`, beside the channels." in record.provenance.steps
    assert "The times in the file were ignored." in read(path, channels=["run.acc.x"], rate=2.0).provenance.steps
    bare = v5(tmp_path, data=VALUES)
    refused(bare, "neither a rate nor a column of times", "`rate=`", channels=["data[0]"])
    stated = v5(tmp_path, acc={"x": VALUES[0]}, sample_rate=7.0)
    assert read(stated, channels=["acc/x"]).sample_rate == 7.0
    torque = v5(tmp_path, x=VALUES[0], t=TIME, T=VALUES[1])
    assert read(torque, channels=["x", "T"]).sample_rate == read(torque, channels=["x"]).sample_rate == 12.5
    refused(torque, "leave out the times", "'t', which are the times", "pass `rate=`", channels=["x", "t"])
    assert read(torque, channels=["x", "t"], rate=2.0).n_channels == 2
    short = v5(tmp_path, x=VALUES[0], Time=TIME[1:])
    refused(short, "one time a sample", "39 in `Time` for 40 samples", "`rate=`", channels=["x"])
    assert read(short, channels=["x"], rate=2.0).sample_rate == 2.0
    others = v5(tmp_path, a={"x": VALUES[0], "t": TIME}, b={"x": VALUES[1], "t": 2 * TIME})
    refused(others, "one vector of times", "`b/t`", channels=["a/x", "b/x"])
    assert read(others, channels=["a/x", "b/x"], rate=1.0).n_channels == 2


@pytest.mark.parametrize(
    ("name", "value"), [("fs", 12.5), ("Fs", [[12.5]]), ("dt", 0.08), ("SampleRate", 12.5), ("Time_Sample_Rate", 12.5)]
)
def test_a_number_beside_the_channels_states_their_rate(tmp_path, name, value):
    record = read(v5(tmp_path, x=VALUES[0], y=VALUES[1], **{name: value}), channels=["x", "y"])
    assert record.sample_rate == 12.5
    assert f"Sampling rate 12.5 Hz: by `{name}` in the file." in record.provenance.steps
    assert read(v5(tmp_path, run={"x": VALUES[0]}, **{name: value}), channels=["run/x"]).sample_rate == 12.5
    ours = {"values": VALUES, "channels": np.array(["x", "y"], object), name: value}
    assert read(v5(tmp_path, **ours)).sample_rate == 12.5
    assert read(v5(tmp_path, **ours), rate=3.0).sample_rate == 3.0


def test_numbers_that_state_several_rates_or_none(tmp_path):
    several = v5(tmp_path, x=VALUES[0], fs=12.5, dt=0.01)
    refused(several, "state one rate", "12.5 Hz in `fs` and 100 Hz in `dt`", "`rate=`", channels=["x"])
    assert read(several, channels=["x"], rate=12.5).sample_rate == 12.5
    apart = v5(tmp_path, x=VALUES[0], t=TIME, fs=13.0)
    refused(apart, "the rate that its times have", "states 13 Hz", "make 12.5 Hz", channels=["x"])
    refused(v5(tmp_path, x=VALUES[0], fs=-1.0), "neither a rate", channels=["x"])
    refused(v5(tmp_path, x=VALUES[0], fs=VALUES[1]), "neither a rate", channels=["x"])


@pytest.mark.parametrize("name", ["gain", "Gains", "scale", "slopes", "offset", "x_scaling", "Sensitivity"])
def test_counts_beside_a_scale_are_refused(tmp_path, name):
    counts = np.arange(80, dtype=np.int16).reshape(2, 40)
    path = v5(tmp_path, counts=counts, fs=12.5, **{name: [0.5, 2.0]})
    refused(path, "quantities that were measured", f"counts in `counts`, and beside them `{name}`", channels=["counts"])
    ours = v5(tmp_path, values=counts, channels=np.array(["x", "y"], object), fs=12.5, **{name: [0.5, 2.0]})
    refused(ours, "quantities that were measured", "`values`", "counts * gain + offset")
    for harmless in ({"counts": 0.5 * counts}, {name: [0.0, 0.0] if name == "offset" else [1.0, 1.0]}, {name: "volts"}):
        plain = v5(tmp_path, **({"counts": counts, "fs": 12.5, name: [0.5, 2.0]} | harmless))
        assert read(plain, channels=["counts"]).n_channels == 2


def test_without_paths_the_variables_are_listed(tmp_path):
    path = v5(tmp_path, **LAB)
    for call in (read, describe_file):
        with pytest.raises(InputError) as caught:
            call(path)
        for words in (
            "    run/acc/x: 1 x 40\n",
            "    table: 40 x 2\n",
            "run/note: 1 x 4, text",
            "`channels=`",
        ):
            assert words in str(caught.value)
    refused(path, "has 'speed', which is not in", "run/acc/y: 40 x 1", "data.T[2]", channels=["speed"])
    refused(v5(tmp_path, table=VALUES.T), "as in table.T[0],table.T[1];")
    refused(v5(tmp_path, a=VALUES[0], b=VALUES[1], t=TIME), "as in a,b;")
    refused(v5(tmp_path, values=VALUES, sample_rate=1.0), "has no `channels`", "as in values[0],values[1];")
    refused(v5(tmp_path, cells=cell("a", "b")), "cells: 1 x 2, a cell array.\n  In MATLAB: values")  # nothing to name
    many = v5(tmp_path, **{f"x{n}": n for n in range(90)})
    refused(many, "x39: 1 x 1", "and 50 more")


PATHS = {
    "columns as rows": (["table[0]"], "name rows of samples", "a row of 2 samples among 40", "write 'table.T'"),
    "rows as columns": (["data.T"], "a row of 2 samples among 40", "write 'data', or 'data[0]'"),
    "a row beyond": (["data[2]"], "rows 0 to 1 (counted from 0)", "'data[2]'"),
    "a struct": (["run"], "has 'run', which is not in"),
    "a number": (["fs"], "vectors of samples", "'fs', which is 1 x 1"),
    "text": (["run/note"], "real numbers in `run/note`", "text"),
    "twice": (["run/acc/x", "run.acc.x"], "each variable once", "'run.acc.x', which are one"),
    "twice the same": (["data", "data[1]"], "each channel once", "'data[1]' twice"),
    "of two lengths": (["run/acc/x", "short"], "of one length", "'short' of 5"),
    "of three axes": (["cube"], "vectors of samples", "2 x 3 x 4", "save an array of more axes as matrices"),
    "the same word twice": (["run/acc/x", "run/acc/x"], "each channel once", "'run/acc/x' twice", "Leave one"),
    "no word": ([" "], "has ' ', which is not in"),
    "no text": ([3], "has 3, which is not in"),
    "brackets of nothing": (["[0]"], "has '[0]', which is not in"),
}


@pytest.mark.parametrize(("channels", "words"), [(v[0], v[1:]) for v in PATHS.values()], ids=PATHS)
def test_bad_paths(tmp_path, channels, words):
    path = v5(tmp_path, **LAB, short=np.arange(5.0), cube=np.ones((2, 3, 4)))
    refused(path, *words, channels=channels, rate=1.0)


def test_times_say_which_axis_is_theirs(tmp_path):
    wide = np.random.default_rng(0).standard_normal((40, 6))  # 40 channels of 6 samples
    refused(v5(tmp_path, wide=wide), "a row of 6 samples among 40", "vector `time`", channels=["wide[3]"], rate=1.0)
    record = read(v5(tmp_path, wide=wide, time=np.arange(6.0)), channels=["wide[3]"])
    np.testing.assert_array_equal(record.values, wide[3:4])
    square = v5(tmp_path, table=wide.T, time=np.arange(6.0))
    refused(square, "the times beside it are 6", "'table.T'", channels=["table[3]"])


# Against scipy, which reads whole files well.


def test_every_array_is_what_scipy_reads(tmp_path):
    rng = np.random.default_rng(1)
    kinds = ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", bool]
    arrays = {f"v{n}": (100 * rng.standard_normal((n % 4 + 1, 7))).astype(kind) for n, kind in enumerate(kinds)}
    inner = {"cube": rng.standard_normal((2, 3, 4)), "none": np.zeros((0, 3)), "words": np.array(["ab ", "c d"])}
    path = v5(tmp_path, **arrays, run={"deeper": inner, "names": cell("x", "", "z\u00b5")})
    file, found = _MatFile(load_variables(path)), scipy.io.loadmat(path)
    for name in arrays:
        np.testing.assert_array_equal(file.numbers(name), found[name])
    deeper = found["run"][0, 0]["deeper"][0, 0]
    for name in ("cube", "none"):
        np.testing.assert_array_equal(file.numbers(f"run/deeper/{name}"), deeper[name])
    assert file.texts("run/deeper/words") == ["ab", "c d"] == [word.rstrip() for word in deeper["words"]]
    assert file.texts("run/names") == ["x", "", "zµ"]
    assert len(file.variables) == len(arrays) + 4


# What is refused.

COMPLEX, SMALL = 0x08, struct.pack("<I", 4 << 16 | 5) + struct.pack("<i", 8)
RATE = doubles([[12.5]], "sample_rate")
GOOD_RAW = [doubles(VALUES, "values"), RATE, names("x", "y")]


def nested(depth):
    inner = doubles([[1.0, 2.0]])
    for _ in range(depth):
        inner = struct_array("", a=inner)
    return struct_array("a", a=inner)


def opaque(name, kind="string"):
    """An object of a class, as MATLAB has a string, a table or a datetime."""
    words = b"".join(element(1, word.encode()) for word in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<II", OPAQUE, 0)) + words + doubles([[1.0]]))


BAD = {
    "axes swapped": ([doubles(VALUES.T, "values"), RATE, names("x", "y")], "(40, 2)", "save `values.'`"),
    "three axes": ([array(DOUBLE, (2, 3, 2), "values", element(9, bytes(96))), names("x", "y")], "(2, 3, 2)"),
    "names missing": ([GOOD_RAW[0], names("x")], "1 channels", "(2, 40)", "Name every row"),
    "no samples": ([array(DOUBLE, (2, 0), "values", element(9, b"")), RATE, names("x", "y")], "holds none", "Export"),
    "text": ([text(["ab", "cd"], "values"), names("x", "y")], "real numbers in `values`", "has text"),
    "complex": (
        [array(DOUBLE, (2, 2), "values", element(9, bytes(32)), element(9, bytes(32)), flags=COMPLEX), names("x", "y")],
        "real numbers in `values`", "complex numbers", "real part",
    ),
    "sparse": (
        [array(SPARSE, (2, 9), "values", element(5, bytes(8)), element(5, bytes(40)), element(9, bytes(16))),
         names("x", "y")], "a sparse matrix", "`full(x)`",
    ),
    "infinite": ([doubles(np.full((2, 3), np.inf), "values"), RATE, names("x", "y")], "6 in `values`", "NaN"),
    "a string array of names": ([GOOD_RAW[0], RATE, opaque("channels")], "a MATLAB object", "cellstr(channels)"),
    "a table": ([opaque("values", "table"), RATE, names("x", "y")], "a MATLAB object", "table2array(values).'"),
    "a function handle": (
        [array(FUNCTION, (1, 1), "values", struct_array("", f=text("sin"))), names("x", "y")], "a function handle",
    ),
    "an object": (
        [array(OBJECT, (1, 1), "values", element(1, b"c"), SMALL, element(1, b"")), names("x", "y")], "a MATLAB object",
    ),
    "a struct array": ([struct_array("values", shape=(1, 2), a=2 * doubles([1.0])), names("x", "y")], "a struct array"),
    "a cell array": ([array(CELL, (1, 1), "values", doubles([1.0, 2.0])), names("x", "y")], "a cell array", "matrix"),
    "numbers as names": ([GOOD_RAW[0], doubles([1.0, 2.0], "channels")], "one text a channel in", "1 x 2", "cellstr"),
    "cells of numbers as names": (
        [GOOD_RAW[0], array(CELL, (1, 2), "channels", doubles([1.0]), doubles([2.0]))], "one text a channel", "1 x 2",
    ),
    "a rate of two": ([GOOD_RAW[0], doubles([1.0, 2.0], "sample_rate"), names("x", "y")], "`sample_rate`", "`rate=`"),
    "a negative rate": ([GOOD_RAW[0], doubles([-1.0], "sample_rate"), names("x", "y")], "positive number", "-1.0"),
    "times of another length": ([GOOD_RAW[0], doubles(TIME[:5], "time"), names("x", "y")], "`time` of shape", "(5,)"),
    "a variable twice": ([*GOOD_RAW, RATE], "sample_rate"),
    "a shape without data": ([array(DOUBLE, (2, 2**31 - 1), "values", element(9, bytes(96)))], "damaged or cut short"),
    "an unknown type of data": ([array(DOUBLE, (1, 2), "values", element(200, bytes(16))), names("x")], "damaged"),
    "no variable": ([element(200, bytes(16))], "no variable where one is due"),
    "numbers missing": ([array(DOUBLE, (1, 2), "values"), names("x")], "cut short", "could not read bytes"),
    "cells of a shape too large": ([array(CELL, (10**5, 10**5), "values", doubles([1.0]))], "Unable to allocate"),
    "packed noise": ([element(15, b"\x12\x34\x56\x78" * 10)], "damaged or cut short", "check"),
}  # fmt: skip


@pytest.mark.parametrize(("variables", "words"), [(v[0], v[1:]) for v in BAD.values()], ids=BAD)
def test_bad_variables(tmp_path, variables, words):
    refused(raw(tmp_path, *variables), *words)


@pytest.mark.slow
def test_what_keeps_the_decoder_busy_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("floquid.io._guard.SECONDS", 1)
    refused(raw(tmp_path, struct_array("values", shape=(1, 10**9), a=RATE)), "takes far longer than a whole file")


def test_a_type_of_data_that_there_is_not_is_refused(tmp_path):
    """scipy 1.17 looks for it beyond its table of them: it ends, or reads it as something."""
    for kind in range(19, 256, 4):
        path = raw(tmp_path, array(DOUBLE, (2, 40), "values", element(kind, bytes(640))), *GOOD_RAW[1:])
        refused(path, "MATLAB file", "damaged", "Copy it again")


def test_the_table_starts_from_a_good_file(tmp_path):
    assert read(raw(tmp_path, *GOOD_RAW)).n_samples == 40
    assert read(raw(tmp_path, *map(packed, GOOD_RAW))).n_samples == 40


def test_objects_beside_what_is_read_do_no_harm(tmp_path):
    others = [opaque("when", "datetime"), struct_array("s", o=opaque(""), f=doubles([1.0])), nested(9)]
    record = read(raw(tmp_path, *others, *GOOD_RAW, array(9, (1, 8), "", element(2, bytes(8)))))
    np.testing.assert_array_equal(record.values, VALUES)
    assert "The file also holds `when`, which is not used." in record.provenance.steps


def test_a_field_that_is_empty_without_a_word(tmp_path):
    path = raw(tmp_path, struct_array("run", x=doubles(TIME), y=element(14, b"")))
    assert read(path, channels=["run.x"], rate=1.0).n_samples == 40
    refused(path, "vectors of samples", "1 x 0", channels=["run.y"], rate=1.0)


def npz_bytes():
    import io

    stream = io.BytesIO()
    np.savez(stream, values=VALUES)
    return stream.getvalue()


FILES = {
    "text": (b"time,x\n0,1\n1,2\n" * 20, "seems to be text", "Name it by its format"),
    "short text": (b"time,x\n", "seems to be text", "Name it by its format"),
    "an archive": (npz_bytes(), "seems to be a ZIP archive", "Name it by its format"),
    "the head alone, cut": (b"MATLAB 5.0 MAT-file", "cut short", "Copy it again"),
    "version 7.3, cut": (b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(300), "cut short", "Copy it again"),
    "version 4, cut": (struct.pack("<5i", 0, 2, 40, 0, 2) + b"x\0" + VALUES.tobytes()[:-3], "cut short", "Copy it"),
    "version 4, no shape": (struct.pack("<5i", 0, -2, 40, 0, 2) + b"x\0" + VALUES.tobytes(), "is not one", "'-v7'"),
    "anything": (bytes(range(128, 256)) * 3, "is not one", "Copy it again"),
    "no variables": (b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM", "no `values`", "nothing", "In MATLAB"),
}


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in FILES.values()], ids=FILES)
def test_other_files_of_that_name(tmp_path, data, words):
    path = tmp_path / "run.mat"
    path.write_bytes(data)
    refused(path, *words)


@pytest.mark.first(1)
@pytest.mark.parametrize("pack", [packed, lambda variable: variable], ids=["packed", "plain"])
@pytest.mark.parametrize("channels", [None, ["run.acc.x", "run.acc.y"]], ids=["by name", "by path"])
def test_damage_is_refused_or_does_not_matter(tmp_path, pack, channels):
    acc = struct_array("", x=doubles(VALUES[0]), y=doubles(VALUES[1]))
    variables = GOOD_RAW if channels is None else [struct_array("run", acc=acc, t=doubles(TIME))]
    path = raw(tmp_path, *map(pack, variables))
    data, rng, count = path.read_bytes(), np.random.default_rng(3), 0
    for _ in range(300):
        damaged = bytearray(data)
        for place in rng.integers(128, len(data), 3):
            damaged[place] = rng.choice([0, 1, 127, 255, rng.integers(256)])
        path.write_bytes(bytes(damaged))
        try:
            record = read(path, channels=channels, rate=1.0)
        except InputError as error:
            count += 1
            assert str(path) in str(error)  # noqa: PT017
        else:
            if pack is packed:
                np.testing.assert_array_equal(record.values, VALUES)  # it has a checksum
    assert count > 100


def test_a_cell_of_labels_beside_the_data_names_its_channels(tmp_path):
    times = np.arange(len(VALUES.T)) / 8
    path = v5(tmp_path, data=VALUES.T, labels=cell("tip x", "acc"), units=cell("m", "V"), t=times)
    assert [(c.name, c.quantity) for c in read(path, channels=["data.T"]).channels] == [
        ("tip x", "displacement"),
        ("acc", "acceleration"),
    ]
    for words in (["acc"], ["data.T[1]"]):
        record = read(path, channels=words)
        assert [c.name for c in record.channels] == words
        np.testing.assert_array_equal(record.values, VALUES[1:])
    with pytest.raises(InputError, match="'nose', which is not in"):
        read(path, channels=["nose"])


@pytest.mark.parametrize(
    "texts", [{"a": cell("x", "y"), "b": cell("p", "q")}, {"labels": cell("x", "y", "z")}, {"labels": cell("x", "x")}]
)
def test_labels_that_may_be_of_something_else_name_nothing(tmp_path, texts):
    path = v5(tmp_path, data=VALUES, **texts)
    assert [c.name for c in read(path, channels=["data"], rate=8.0).channels] == ["data[0]", "data[1]"]


def elements(**fields):
    """A struct array, of an element for each entry of the lists of its fields."""
    made = np.empty((1, len(next(iter(fields.values())))), dtype=[(name, object) for name in fields])
    for name, entries in fields.items():
        for at, entry in enumerate(entries):
            made[name][0, at] = entry
    return made


def in_version_5(folder):
    """Signals of a test bench: those on the ordinate with names and units, and the times on the abscissa."""
    y = elements(Name=["accX", "tach"], Data=[VALUES[0], VALUES[1][:, None]], Unit=["m/s^2", "V"])
    return v5(folder, run={"X": {"Name": "Time", "Data": TIME}, "Y": y})


def in_version_73(folder):
    with V73(folder) as file:
        file.text("run/X/Name", "Time")
        file.numbers("run/X/Data", TIME)
        for name, entries in {"Name": ["accX", "tach"], "Unit": ["m/s^2", "V"], "Data": VALUES}.items():
            made = []
            for entry in entries:
                file.count += 1
                put = file.text if isinstance(entry, str) else file.numbers
                made.append(put(f"#refs#/{file.count}", entry).ref)
            file.file.create_dataset(f"run/Y/{name}", data=np.array(made, dtype=h5py.ref_dtype).reshape(2, 1))
        for path in ("run", "run/X", "run/Y"):
            file.mark(file.file[path], "struct")
    return file.path


@pytest.mark.parametrize("save", [in_version_5, in_version_73])
@pytest.mark.parametrize(
    ("channels", "names"),
    [
        (["run/Y"], ["accX", "tach"]),
        (["accX", "tach"], ["accX", "tach"]),
        (["run/Y[0]/Data", "run/Y[1]/Data"], ["run/Y[0]/Data", "run/Y[1]/Data"]),
        (["run.Y(1).Data", "run/Y(2)/Data"], ["run.Y(1).Data", "run/Y(2)/Data"]),
    ],
)
def test_elements_of_a_struct_array(tmp_path, save, channels, names):
    found = read(save(tmp_path), channels=channels)
    np.testing.assert_array_equal(found.values, VALUES)
    assert [channel.name for channel in found.channels] == names
    assert [channel.unit for channel in found.channels] == ["m/s^2", "V"]
    assert found.sample_rate == 12.5
    refused(save(tmp_path), "run/Y[1]/Data: ", "Name them by `channels=`, as in run/Y;")


def test_what_simulink_logs(tmp_path):
    log = {"time": TIME[:, None], "signals": elements(values=[VALUES[0][:, None], VALUES.T], label=["q", "two"])}
    path = v5(tmp_path, out=log, single={"time": TIME, "signals": {"values": VALUES[1], "label": "p"}})
    found = read(path, channels=["out/signals(1)/values", "out.signals(2).values.T", "single/signals(1)/values"])
    np.testing.assert_array_equal(found.values, VALUES[[0, 0, 1, 1]])
    assert found.sample_rate == 12.5
    assert [c.name for c in read(path, channels=["q", "p"]).channels] == ["q", "p"]


def test_names_are_given_or_of_a_variable_that_is_said(tmp_path):
    path = v5(tmp_path, data=VALUES.T, labels=cell("hip", "acc"), units=cell("m", "V"), fs=12.5, x=VALUES[0])

    def names(*given, channels=("data.T",)):
        return [c.name for c in read(path, channels=channels, names=given).channels]

    assert names("labels") == ["hip", "acc"]
    assert names("units") == ["m", "V"]
    assert names("left", "right") == ["left", "right"]
    assert names("left") == ["left", "acc"]  # the others stay as they are
    assert names("labels", channels=["data.T[1]", "x"]) == ["acc", "x"]
    assert read(path, channels=["data.T"], names=["labels"]).channels[1].quantity == "acceleration"
    many = {"channels": ["data.T"], "names": list("abc")}
    refused(path, "as many as the channels", "3 for 2 channels", "labels, units", **many)
    refused(path, "name each channel once", "'acc' twice", channels=["data.T"], names=["acc"])


@pytest.mark.parametrize("order", ["<", ">"])
def test_version_4(tmp_path, order):
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"data": VALUES, "t": TIME, "labels": ["x", "tip"], "fs": 12.5}, format="4")
    if order == ">":
        kind, names = 1000, {"data": VALUES.T, "t": TIME[:, None], "labels": None}
        path.write_bytes(
            b"".join(
                struct.pack(">5i", kind, *array.shape[::-1], 0, len(name) + 1) + name.encode() + b"\0"
                + array.astype(">f8").tobytes()
                for name, array in names.items() if array is not None
            )
        )  # fmt: skip
    found = read(path, channels=["data"])
    np.testing.assert_array_equal(found.values, VALUES)
    assert found.sample_rate == 12.5
    assert [c.name for c in found.channels] == (["x", "tip"] if order == "<" else ["data[0]", "data[1]"])
    ours = {"values": VALUES, "channels": ["x", "tip"], "sample_rate": 12.5}
    scipy.io.savemat(path, ours, format="4")
    assert [c.name for c in read(path).channels] == ["x", "tip"]


# Version 7.3: HDF5, arrays turned round, text as codes, cells as references.


class V73:
    """A file of version 7.3 as MATLAB writes it."""

    def __init__(self, folder):
        self.path = folder / "run.mat"
        self.file = h5py.File(self.path, "w", userblock_size=512)
        self.count = 0

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.file.close()
        with self.path.open("r+b") as stream:
            words = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 ."
            stream.write(words.ljust(116) + bytes(8) + b"\0\2IM")

    def put(self, name, data, kind="double", **attributes):
        packing = {"chunks": data.shape, "compression": "gzip"} if data.size > 50 else {}
        dataset = self.file.create_dataset(name, data=data, **packing)
        return self.mark(dataset, kind, **attributes)

    @staticmethod
    def mark(thing, kind, **attributes):
        thing.attrs["MATLAB_class"] = np.bytes_(kind)
        for key, value in attributes.items():
            thing.attrs[key] = value
        return thing

    def numbers(self, name, values):
        return self.put(name, np.atleast_2d(values).T)

    def empty(self, name, kind="double"):
        return self.put(name, np.zeros(2, dtype="u8"), kind, MATLAB_empty=np.uint8(1))

    def text(self, name, *rows):
        codes = np.array([np.frombuffer(row.encode("utf-16-le"), "<u2") for row in rows])
        return self.put(name, codes.T, "char", MATLAB_int_decode=np.int32(2))

    def cells(self, name, *texts):
        self.file.require_group("#refs#")
        made = []
        for words in texts:
            self.count += 1
            where = f"#refs#/{self.count}"
            made.append((self.text(where, words) if words else self.empty(where, "char")).ref)
        return self.put(name, np.array(made, dtype=h5py.ref_dtype).reshape(len(made), 1), "cell")


def good(file, **changes):
    """What a test does not put there itself."""
    made = {
        "values": lambda: file.numbers("values", VALUES),
        "sample_rate": lambda: file.numbers("sample_rate", 12.5),
        "channels": lambda: file.cells("channels", "µx", "y"),
    }
    for key, make in (made | changes).items():
        if make is not None:
            make() if key not in changes else make(file)


def v73(folder, **changes):
    with V73(folder) as file:
        good(file, **changes)
    return file.path


def test_version_73_is_read(tmp_path):
    record = read(v73(tmp_path, units=lambda file: file.text("units", "m ", "mm")))
    np.testing.assert_array_equal(record.values, VALUES)
    assert record.values.flags.c_contiguous
    assert record.sample_rate == 12.5
    assert [channel.label for channel in record.channels] == ["µx [m]", "y [mm]"]
    assert read(v73(tmp_path).rename(tmp_path / "run.h5")).n_samples == 40


@pytest.mark.parametrize(
    "channels",
    [lambda file: file.text("channels", "x  ", "tip"), lambda file: file.cells("channels", "x", "tip")],
    ids=["char", "cell"],
)
@pytest.mark.parametrize("time", [TIME[:, None], TIME[None, :]], ids=["column", "row"])
def test_version_73_names_and_times(tmp_path, channels, time):
    record = read(
        v73(tmp_path, channels=channels, sample_rate=None, time=lambda file: file.numbers("time", time + 1.0))
    )
    assert [channel.name for channel in record.channels] == ["x", "tip"]
    assert (record.sample_rate, record.start) == (12.5, 1.0)


def test_version_73_texts_that_are_empty(tmp_path):
    record = read(v73(tmp_path, locations=lambda file: file.cells("locations", "", "disc")))
    assert [channel.location for channel in record.channels] == ["", "disc"]


def test_version_73_by_path(tmp_path):
    with V73(tmp_path) as file:
        for name, row in zip("xy", VALUES, strict=True):
            file.numbers(f"run/acc/{name}", row if name == "x" else row[:, None])
        for path in ("run", "run/acc"):
            file.mark(file.file[path], "struct")
        file.numbers("run/time", TIME[:, None])
        file.numbers("table", VALUES.T)
        file.cells("notes", "a", "b")
    record = read(file.path, channels=["run.acc.y", "run/acc/x"])
    np.testing.assert_array_equal(record.values, VALUES[::-1])
    assert record.sample_rate == 12.5
    np.testing.assert_array_equal(read(file.path, channels=["table.T"], rate=1.0).values, VALUES)
    refused(file.path, "has no `values`", "table: 40 x 2", "run/acc/x: 1 x 40", "notes: 1 x 2, a cell array", "MATLAB")
    refused(file.path, "a row of 2 samples among 40", "'table.T'", channels=["table"], rate=1.0)


def complex_numbers(file):
    data = np.zeros((40, 2), dtype=[("real", float), ("imag", float)])
    file.mark(file.file.create_dataset("values", data=data), "double")


def sparse(file):
    group = file.mark(file.file.create_group("values"), "double", MATLAB_sparse=np.uint64(2))
    group["data"], group["ir"], group["jc"] = np.ones(1), np.zeros(1, "u8"), np.zeros(41, "u8")


def loop(file):
    file.numbers("#refs#/n", 1.0)
    file.put("channels", np.array([file.file["#refs#/n"].ref] * 2, dtype=h5py.ref_dtype).reshape(2, 1), "cell")


BAD_73 = {
    "axes swapped": ({"values": lambda f: f.numbers("values", VALUES.T)}, "shape (40, 2)", "save `values.'`"),
    "complex": ({"values": complex_numbers}, "complex numbers", "real part"),
    "sparse": ({"values": sparse}, "a sparse matrix", "`full(x)`"),
    "empty": ({"values": lambda f: f.empty("values")}, "shape (0, 0)"),
    "a string array": (
        {"channels": lambda f: f.put("channels", np.zeros((1, 6), "u4"), "string", MATLAB_object_decode=np.int32(3))},
        "a MATLAB object", "cellstr(channels)",
    ),
    "a function handle": (
        {"values": lambda f: f.mark(f.file.create_group("values"), "function_handle")}, "a function handle",
    ),
    "cells of numbers": ({"channels": loop}, "one text a channel in `channels`", "1 x 2, a cell array"),
    "numbers as names": ({"channels": lambda f: f.numbers("channels", [1.0, 2.0])}, "one text a channel", "1 x 2"),
    "a null reference": (
        {"channels": lambda f: f.put("channels", np.array([h5py.Reference()] * 2, dtype=h5py.ref_dtype), "cell")},
        "one text a channel",
    ),
    "no names": ({"channels": None}, "has no `channels`"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "words"), [(v[0], v[1:]) for v in BAD_73.values()], ids=BAD_73)
def test_bad_variables_of_version_73(tmp_path, changes, words):
    refused(v73(tmp_path, **changes), *words)


def test_version_73_cut_short(tmp_path):
    path = v73(tmp_path)
    data = path.read_bytes()
    for share in (0.01, 0.05, 0.5, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        refused(path, "cut short")
