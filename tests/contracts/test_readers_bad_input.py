"""Every bad file ends in one `InputError` that names the file, the place in it and the way out."""

import io
import re
import struct
import zipfile

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.readers import FORMATS, describe_file, read, write

FOUR_PARTS = r"Argument `\w+` of `read` must .+, but .+\.\n  \S.+\."


def even(n=6, step=0.01):
    return "".join(f"{step * k:.4f},{k}.5,{-k}\n" for k in range(n)).encode()


CSV = {  # name: the bytes of the file, what the message must hold, in order
    "empty": (b"", "is empty", "Export"),
    "blank": (b"\n\n  \n", "nothing but comments", "Export"),
    "comments only": (b"# a\n# b\n", "nothing but comments", "Export"),
    "header only": (b"time [s],x [m]\n", "a header and no rows", "Export"),
    "header and bare delimiters": (b"time [s],x [m]\n,\n,\n", "a header and no rows", "Export"),
    "no header": (b"0.0,1.0\n0.1,2.0\n0.2,3.0\n", "header row", "numbers (line 1)", "Write a first line"),
    "time alone": (b"time [s]\n0\n1\n", "has the time alone", "Export the channels"),
    "text in a number column": (
        b"time [s],x [m],y\n0,1,2\n0.1,2,3\n# pause\n0.2,oops,4\n", "'oops' in line 5, column 'x [m]'", "`channels=`",
    ),
    "text for a time": (b"time,x\n12:00:01,1\n12:00:02,2\n", "'12:00:01' in line 2, column 'time'", "must be numbers"),
    "two rows of names": (
        b"time,x\nclock,tip\n0,1\n1,2\n", "one header, with a name for each column", "words in lines 1 to 2", "Delete",
    ),
    "metadata and no names": (
        b"Analyser 3000\nRate,1000\n0,1,2\n1,2,3\n", "one header", "words in lines 1 to 2", "put # before",
    ),
    "underscore": (b"time,x\n0,1\n1,1_0\n", "'1_0' in line 3, column 'x'", "Mend"),
    "complex": (b"time,x\n0,1+2j\n1,1\n", "'1+2j' in line 2", "Mend"),
    "infinite": (b"time,x\n0,1\n1,-inf\n2,3\n", "finite numbers", "'-inf' in line 3, column 'x'", "`nan`"),
    "too large": (b"time,x\n0,1\n1,1e400\n2,3\n", "finite numbers", "'1e400' in line 3, column 'x'", "`nan`"),
    "ragged, short": (b"time,x,y\n0,1,2\n1,2\n2,3,4\n", "3 cells in every row", "2 in line 3", "Mend that line"),
    "ragged, long": (b"time,x,y\n0,1,2\n1,2,3,4\n2,3,4\n", "3 cells in every row", "4 in line 3", "Mend that line"),
    "decimal comma with comma": (b"time,x\n0,1,5\n0,1,2,5\n", "2 cells in every row", "3 in line 2", "Mend"),
    "thousands": (b"time;x\n0;1.234,5\n1;2\n", "'1.234,5' in line 2", "Mend"),
    "doubled name": (b"time,x,x\n0,1,2\n1,2,3\n", "each channel once", "'x' twice", "Rename"),
    "no name": (b"time,,x\n0,1,2\n1,2,3\n", "no name for column 2", "Name it"),
    "unknown time unit": (b"time [hh:mm],x\n0,1\n1,2\n", "'time', in 'hh:mm'", "seconds"),
    "no time column": (b"x [m],y [m]\n1,2\n3,4\n", "neither a rate nor a column of times", "`rate=`"),
    "one sample": (b"time,x\n0,1\n", "holds one", "export more"),
    "NaN in the times": (b"time,x\n0,1\n,2\n2,3\n", "`time`", "nan at sample 2", "`rate=`"),
    "decreasing": (b"time,x\n0,1\n2,2\n1,3\n3,4\n", "goes back in `time`: 1 s after 2 s at sample 3", "Sort"),
    "repeated": (b"time,x\n0,1\n1,2\n1,3\n2,4\n", "repeats a time in `time`", "at sample 3", "`rate=`"),
    "constant time": (b"time,x\n1,1\n1,2\n1,3\n", "repeats a time", "more digits"),
    "uneven": (b"time,x\n0,1\n1,2\n1.62,3\n3,4\n4,5\n5.11,6\n", "evenly spaced", "Resample", "`rate=`"),
    "crafted gap": (b"time,x\n0,1\n1,2\n2,3\n3,4\n1e12,5\n", "gaps shorter together", "Cut the file", "`rate=`"),
    "huge time": (b"time,x\n0,1\n1e300,2\n", "1e+300 s", "`time [ms]`"),
    "tiny steps": (b"time,x\n0,1\n1e-320,2\n", "from 0 s to", "`time [ms]`"),
    "NUL": (b"time,x\n0,1\n1,\x002\n", "is binary (a NUL byte in line 3)", "Export it as text"),
    "binary": (bytes(range(1, 256)) * 9, "has a byte 0x80", "CSV UTF-8"),
    "half of UTF-16": ("time,x\n0,1\n1,2\n".encode("utf-16")[:-1], "UTF-16", "line 3", "CSV UTF-8"),
    "another file": (b"\x89HDF\r\n\x1a\n" + bytes(40), "seems to be an HDF5 file (.h5)", "Name it by its format"),
    "no dates": (b"time,x\n2024-05-01,1\n2024-05-02,2\n2024-05-32,3\n", "a date", "'2024-05-32' in line 4", "`rate=`"),
    "two decimal marks": (b"time;x\n0;1,5\n1;2.5\n", "'1,5' in line 2, column 'x'", "Mend"),
    "half a letter": ("time,x\n0,1\n1,2µ".encode()[:-1], "has a byte 0xc2 in line 3", "CSV UTF-8"),
    "JSON line": (b"# floquid record: {\ntime,x\n0,1\n1,2\n", "as floquid wrote it", "Delete that line"),
    "JSON list": (b"# floquid record: []\ntime,x\n0,1\n1,2\n", "as floquid wrote it", "Delete that line"),
    "JSON negative rate": (b'# floquid record: {"sample_rate": -1}\ntime,x\n0,1\n1,2\n', "-1.0", "Mend it"),
    "rate against times": (
        b'# floquid record: {"sample_rate": 120}\ntime,x,y\n' + even(), "states 120 Hz", "times make 100 Hz", "`rate=`",
    ),
}  # fmt: skip


def assert_refused(path, words, **options):
    with pytest.raises(InputError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert str(path) in message
    assert re.fullmatch(FOUR_PARTS, message, re.DOTALL)
    place = 0
    for word in words:
        assert word in message[place:], f"{word!r} is not in {message!r}"
        place = message.index(word, place)


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in CSV.values()], ids=CSV)
def test_bad_table(data, words, tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(data)
    assert_refused(path, words)


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **{key: value for key, value in (GOOD | arrays).items() if value is not None})
    return stream.getvalue()


def packed(**members):
    """An archive of raw members, over those of a good one."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(npz())) as good, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        names = {info.filename: good.read(info) for info in good.infolist()}
        for name, data in (names | {f"{key}.npy": data for key, data in members.items()}).items():
            archive.writestr(name, data)
    return stream.getvalue()


def npy(header, data=b"", version=b"\x01\x00"):
    text = header.encode() + b"\n"
    return b"\x93NUMPY" + version + struct.pack("<H" if version[0] == 1 else "<I", len(text)) + text + data


def flipped():
    data = bytearray(npz())
    data[data.index(np.float64(1.0).tobytes())] ^= 1
    return bytes(data)


def another_checksum():
    data = packed(values=npy(SHAPE.format("(2, 6)"), bytes(96)))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        checksum = struct.pack("<I", archive.getinfo("values.npy").CRC)
    assert data.count(checksum) == 2
    return data.replace(checksum, b"\1\2\3\4")


GOOD = {"values": np.arange(12.0).reshape(2, 6), "sample_rate": 100.0, "channels": ["x", "y"]}
SHAPE = "{{'descr': '<f8', 'fortran_order': False, 'shape': {}}}"
NPZ = {
    "empty": (b"", "is empty", "Export"),
    "not an archive": (b"hello, world" * 20, "seems to be text", "Name it by its format"),
    "a single array": (npy(SHAPE.format("(2, 1)"), bytes(16)), "be a whole NumPy archive", "np.savez"),
    "an empty archive": (b"PK\x05\x06" + bytes(18), "has no `values`", "nothing", "np.savez"),
    "cut short": (npz()[:-40], "damaged or cut short", "Copy it again"),
    "a flipped bit": (flipped(), "whole NumPy archive", "CRC", "Copy"),
    "another checksum": (another_checksum(), "whole NumPy archive", "CRC", "Copy"),
    "no values": (npz(values=None, y=np.ones(3)), "has no `values`", "y: 3", "np.savez"),
    "no channels": (npz(channels=None), "has no `channels`", "np.savez"),
    "no rate": (npz(sample_rate=None), "neither a rate nor a column of times", "`rate=`"),
    "axes swapped": (npz(values=np.ones((6, 2))), "2 channels", "shape (6, 2)", "last axis: save `values.T`"),
    "one axis": (npz(values=np.ones(6), channels=["x"]), "shape (6,)", "`values[None, :]`"),
    "three axes": (npz(values=np.ones((2, 3, 4))), "shape (2, 3, 4)", "one record a file"),
    "names missing": (npz(channels=["x"]), "1 channels", "shape (2, 6)", "Name every row"),
    "no samples": (npz(values=np.ones((2, 0))), "holds none", "Export"),
    "one sample": (npz(values=np.ones((2, 1))), "at least two samples", "holds 1", "Export more"),
    "text": (npz(values=np.full((2, 6), "a")), "real numbers in `values`", "has text there", "matrix of numbers"),
    "complex": (npz(values=np.ones((2, 6)) * 1j), "real numbers in `values`", "complex numbers", "Save its real part"),
    "infinite": (
        npz(values=np.r_[GOOD["values"][:1], np.full((1, 6), np.inf)]), "6 in `values`", "channel 'y', sample 0", "NaN",
    ),
    "too large": (npz(values=np.full((2, 6), np.longdouble("1e400"))), "12 in `values`", "channel 'x'", "NaN"),
    "dates": (npz(time=np.arange(6).astype("datetime64[s]")), "real numbers in `time`", "dates", "dtype=float"),
    "objects": (npz(values=np.array([[1.0, None]] * 2, dtype=object)), "Python objects", "never unpickled"),
    "object names": (npz(channels=np.array(["x", None], dtype=object)), "`channels`", "never unpickled"),
    "numbers as names": (npz(channels=[1, 2]), "one text a channel in `channels`", "2, numbers", "Save"),
    "bytes as names": (npz(channels=np.array([b"\xff", b"y"])), "UTF-8 in `channels`", "Save"),
    "empty name": (npz(channels=["x", " "]), "be a word", "Give each channel a name"),
    "doubled name": (npz(channels=["x", "x"]), "'x' twice", "Rename"),
    "units missing": (npz(units=["m"]), "one text a channel (2) in `units`", "Save"),
    "unit against quantity": (npz(units=["m", "N"], quantities=["displacement", "velocity"]), "valid record", "'N'"),
    "negative rate": (npz(sample_rate=-5.0), "positive number in `sample_rate`", "-5.0", "`rate=`"),
    "zero rate": (npz(sample_rate=0), "positive number in `sample_rate`", "has 0", "`rate=`"),
    "NaN rate": (npz(sample_rate=np.nan), "`sample_rate`", "nan", "`rate=`"),
    "text rate": (npz(sample_rate="fast"), "real numbers in `sample_rate`", "has text there"),
    "rates": (npz(sample_rate=np.ones(2)), "one finite positive number in `sample_rate`", "shape (2,)", "`rate=`"),
    "period": (npz(period=-1.0), "`period`", "-1.0", "Mend"),
    "start": (npz(start=np.inf), "`start`", "inf", "Mend"),
    "time of a wrong length": (npz(time=np.arange(5.0)), "`time` of shape (samples,) with 6", "shape (5,)", "Save"),
    "time against rate": (npz(time=np.arange(6) / 50), "states 100 Hz, while its times make 50 Hz", "`rate=`"),
    "time going back": (npz(sample_rate=None, time=np.arange(6)[::-1] / 50), "goes back in `time`", "Sort"),
    "a crafted shape": (packed(values=npy(SHAPE.format("(2, 10**12)"), bytes(96))), "whole NumPy archive", "Copy"),
    "a crafted size": (packed(values=npy(SHAPE.format("(2, 100000000000)"), bytes(96))), "readable to its end", "Copy"),
    "a negative shape": (packed(values=npy(SHAPE.format("(-2, -6)"), bytes(96))), "whole NumPy archive", "Copy"),
    "too few bytes": (packed(values=npy(SHAPE.format("(2, 6)"), bytes(95))), "whole NumPy archive", "Copy"),
    "a garbled header": (packed(values=npy("{'descr': '<f8", bytes(96))), "whole NumPy archive", "Copy"),
    "an unknown version": (packed(values=npy("{}", version=b"\x09\x00")), "whole NumPy archive", "Copy"),
    "no array at all": (packed(values=b"1, 2, 3"), "real numbers in `values`", "text"),
    "records": (npz(values=np.zeros((2, 6), dtype=[("a", float)])), "numbers in `values`", "records", "matrix of"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in NPZ.values()], ids=NPZ)
def test_bad_archive(data, words, tmp_path):
    path = tmp_path / "run.npz"
    path.write_bytes(data)
    assert_refused(path, words)


def test_the_tables_start_from_good_files(tmp_path):
    (tmp_path / "a.npz").write_bytes(npz())
    (tmp_path / "b.npz").write_bytes(packed())
    (tmp_path / "c.csv").write_bytes(b"time,x,y\n" + even())
    for name in ("a.npz", "b.npz", "c.csv"):
        assert read(tmp_path / name).n_samples == 6


class Bomb:
    """Its pickle writes a file when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_nothing_is_unpickled(tmp_path):
    path, trace = tmp_path / "run.npz", tmp_path / "trace"
    path.write_bytes(npz(channels=np.array([Bomb(trace), "y"], dtype=object)))
    assert_refused(path, ["never unpickled"])
    assert not trace.exists()
    np.load(path, allow_pickle=True)["channels"][0].close()
    assert trace.exists(), "the bomb does not work, so the test above shows nothing"


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.parametrize("call", [read, describe_file])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.csv", "there is no file"),
        ("none.npz", "there is no file"),
        ("folder.csv", "is a folder"),
        ("run.xyz", "ends in '.xyz'"),
        ("run", "has no suffix"),
        ("x" * 300 + ".csv", "cannot be opened"),
    ],
)
def test_bad_path(call, name, words, tmp_path):
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        call(tmp_path / name)
    assert name in str(caught.value)
    assert call.__name__ in str(caught.value)


def test_an_unknown_suffix_lists_the_formats(tmp_path):
    listing = ", ".join(f"{kind.suffix} ({kind.name})" for kind in FORMATS)
    assert listing.startswith(".npz (NumPy archive), .csv (text table)")
    with pytest.raises(InputError, match=re.escape(f"formats are: {listing}.") + "$"):
        read(tmp_path / "run.xyz")


@pytest.mark.parametrize("path", [None, 3, "", "a\0b.csv", b"a.csv"])
def test_a_path_that_is_none(path):
    with pytest.raises(InputError, match="`path` of `read` must be the path of a file"):
        read(path)


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    path.write_bytes(b"time,x\n0,1\n1,2\n")

    def denied(self, *_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", denied)
    assert_refused(path, ["cannot be opened (Permission denied)", "permissions"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rate": -1.0}, "`rate` of `read` must be positive [Hz], but is -1."),
        ({"rate": np.nan}, "`rate` of `read` must be a finite number [Hz]"),
        ({"rate": "10"}, "`rate` of `read` must be a finite number [Hz]"),
        ({"period": 0.0}, "`period` of `read` must be positive [s], but is 0."),
        ({"origin": np.inf}, "`origin` of `read` must be a finite number [s]"),
        ({"origin": 1.0}, "`origin` of `read` must come with a period"),
        ({"channels": []}, "`channels` of `read` must be a list of names"),
        ({"channels": "x"}, "`channels` of `read` must be a list of names"),
        ({"channels": ["q"]}, "`channels` of `read` must name channels of the record, but has 'q'"),
        ({"channels": ["x", "x"]}, "`channels` of `read` must name each channel once"),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_bad_options(options, words, suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(npz() if suffix == ".npz" else b"time,x,y\n" + even())
    with pytest.raises(InputError, match=re.escape(words)):
        read(path, **options)


def test_bad_writes(tmp_path):
    (tmp_path / "good.npz").write_bytes(npz())
    record = read(tmp_path / "good.npz")
    (tmp_path / "file").touch()
    (tmp_path / "folder.npz").mkdir()
    for path, words in [
        (tmp_path / "run.xyz", "ends in '.xyz'"),
        (tmp_path / "none" / "run.npz", "there is no folder"),
        (tmp_path / "file" / "run.csv", "there is no folder"),
        (tmp_path / "folder.npz", "is a folder"),
        (tmp_path / ("x" * 300 + ".npz"), "cannot be"),
    ]:
        with pytest.raises(InputError, match=words):
            write(record, path)
    with pytest.raises(InputError, match="`record` of `write` must be a Record"):
        write(record.values, tmp_path / "run.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.npz", "good.npz"]
