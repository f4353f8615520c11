"""HDF5 files as h5py and others write them, and those that hold something else or not all of it."""

import re
import struct

import h5py
import numpy as np
import pytest

from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import InputError
from floquid.readers import describe_file, read, write

VALUES = np.random.default_rng(5).standard_normal((2, 40))
TIME = np.arange(40) / 12.5
FOUR_PARTS = r"Argument `\w+` of `\w+` must .+, but .+\.\n  \S.+\."
TEXT = h5py.string_dtype()


def refused(path, *words, **options):
    """`read` refuses the file with one message that names it and holds `words` in that order."""
    with pytest.raises(InputError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert str(path) in message
    assert re.fullmatch(FOUR_PARTS, message, re.DOTALL)
    assert re.search(".*".join(map(re.escape, words)), message, re.DOTALL), message


def saved(folder, *, libver="earliest", userblock_size=0, **content):
    """A file of datasets by their names (two underscores are a slash), over those of a good one; None leaves one out.

    What is not data is called with the file and the path.
    """
    path = folder / "run.h5"
    with h5py.File(path, "w", libver=libver, userblock_size=userblock_size) as file:
        for key, value in ({"values": VALUES, "sample_rate": 12.5, "channels": ["x", "y"]} | content).items():
            where = key.replace("__", "/")
            if callable(value):
                value(file, where)
            elif value is not None:
                file[where] = value
    return path


def lab(folder, **content):
    """A file with names of its own."""
    return saved(folder, **{"values": None, "sample_rate": None, "channels": None} | content)


# Files with our names.


@pytest.mark.parametrize("libver", ["earliest", ("v108", "v108"), "latest"])
@pytest.mark.parametrize("userblock_size", [0, 512])
@pytest.mark.parametrize(
    "channels",
    [
        ["µx", "y2"],
        np.array(["µx".encode(), b"y2"]),
        lambda file, path: file.create_dataset(path, data=["µx", "y2"], dtype=TEXT, compression="gzip"),
        lambda file, path: file.create_dataset(path, data=["µx", "y2"], dtype=TEXT, maxshape=(None,)),
        np.array([["µx".encode()], [b"y2"]]),
    ],
    ids=["variable", "fixed", "packed", "growing", "column"],
)
def test_saved_by_h5py(tmp_path, channels, libver, userblock_size):
    path = saved(tmp_path, libver=libver, userblock_size=userblock_size, channels=channels, units=["m", ""])
    record = read(path)
    np.testing.assert_array_equal(record.values, VALUES)
    assert record.sample_rate == 12.5
    assert [channel.label for channel in record.channels] == ["µx [m]", "y2 [-]"]


@pytest.mark.parametrize("dtype", [bool, "i1", "u2", ">i4", "u8", "f2", "f4", ">f8"])
@pytest.mark.parametrize("packing", [{}, {"compression": "gzip", "shuffle": True}, {"compression": "lzf"}])
def test_numbers_become_double_precision(tmp_path, dtype, packing):
    values = (10 * VALUES).astype(dtype)
    record = read(saved(tmp_path, values=lambda file, path: file.create_dataset(path, data=values, **packing)))
    assert record.values.dtype == np.float64
    assert record.values.flags.c_contiguous
    np.testing.assert_array_equal(record.values, values.astype(float))


def test_times_missing_samples_and_one_channel(tmp_path):
    values = VALUES[:1].copy()
    values[0, 3] = np.nan
    record = read(saved(tmp_path, values=values, channels="tip", sample_rate=None, time=TIME + 2.0))
    np.testing.assert_array_equal(record.values, values)
    assert (record.sample_rate, record.start, record.channels) == (12.5, 2.0, (Channel(name="tip"),))
    record = read(saved(tmp_path, sample_rate=np.array([12.5]), time=TIME[:, None], notes="calm"))
    assert record.sample_rate == 12.5
    assert "The file also holds `notes`, which is not used." in record.provenance.steps


def test_what_is_written_is_read_by_h5py(tmp_path):
    channels = [Channel(name="tip µ", unit="m", direction="+x"), Channel(name="tacho", quantity="pulse", unit="V")]
    record = Record(values=VALUES, sample_rate=12.5, channels=channels, clock=ConstantPeriod(period=0.5), start=-2.0)
    write(record, tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        np.testing.assert_array_equal(file["values"], VALUES)
        assert file["channels"].asstr()[:].tolist() == ["tip µ", "tacho"]
        assert [file[key][()] for key in ("sample_rate", "start", "period", "origin")] == [12.5, -2.0, 0.5, 0.0]
    data = (tmp_path / "run.h5").read_bytes()
    write(record, tmp_path / "run.hdf5")
    assert (tmp_path / "run.hdf5").read_bytes() == data, "the same record makes the same file"


@pytest.mark.slow
def test_every_byte_that_matters_has_a_checksum(tmp_path):
    path = tmp_path / "run.h5"
    record = Record(values=VALUES, sample_rate=12.5, channels=["x", "y"], clock=ConstantPeriod(period=0.5))
    write(record, path)
    data, rng, refusals = path.read_bytes(), np.random.default_rng(3), 0
    for _ in range(400):
        damaged = bytearray(data)
        damaged[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(damaged))
        try:
            found = read(path)
        except InputError:
            refusals += 1
            continue
        np.testing.assert_array_equal(found.values, VALUES)
        assert (found.sample_rate, found.clock, found.channels) == (12.5, record.clock, record.channels)
    assert refusals > 60


# Files with names of their own.


@pytest.mark.parametrize("unit", ["m/s^2", np.bytes_("m/s^2")], ids=["variable", "fixed"])
@pytest.mark.parametrize("libver", ["earliest", "latest"])
@pytest.mark.parametrize("userblock_size", [0, 1024])
def test_channels_by_path_with_their_units(tmp_path, unit, libver, userblock_size):
    path = lab(
        tmp_path, libver=libver, userblock_size=userblock_size, daq__a=VALUES[0], daq__b=VALUES[1], daq__time=TIME
    )
    with h5py.File(path, "r+", libver=libver) as file:
        file["daq/a"].attrs["units"] = unit
        file["daq/b"].attrs["unit"] = unit
    record = read(path, channels=["daq/b", "/daq/a"])
    np.testing.assert_array_equal(record.values, VALUES[::-1])
    assert [channel.label for channel in record.channels] == ["daq/b [m/s^2]", "/daq/a [m/s^2]"]
    assert [channel.quantity for channel in record.channels] == ["acceleration"] * 2
    assert record.sample_rate == 12.5


def test_samples_that_were_never_written_are_missing_where_they_are_nan(tmp_path):
    def put(file, path):
        file.create_dataset(path, (2, 40), dtype="f8", chunks=(1, 10), fillvalue=np.nan)[:, :15] = 1.0

    record = read(saved(tmp_path, values=put))
    np.testing.assert_array_equal(np.isnan(record.values), [[False] * 15 + [True] * 25] * 2)


def test_zeros_that_were_written_are_zeros(tmp_path):
    zeros = np.zeros((2, 40))
    path = saved(tmp_path, values=lambda file, path: file.create_dataset(path, data=zeros, chunks=(1, 10)))
    np.testing.assert_array_equal(read(path).values, zeros)


@pytest.mark.parametrize("key", range(3))
def test_a_damaged_index_of_chunks_makes_no_zeros(tmp_path, key):
    """HDF5 finds nothing under a key that was changed, and says nothing."""
    path = saved(tmp_path, values=lambda file, path: file.create_dataset(path, data=VALUES, chunks=(1, 20)))
    data = bytearray(path.read_bytes())
    first = data.rindex(b"TREE\x01") + 24  # a key of 32 bytes (size, mask, offsets), an address of 8, and so on
    data[first + 40 * key + 8 + 1] ^= 1  # the row, and 256 more
    path.write_bytes(data)
    refused(path, "parts of `values`", "never written, or are lost", "Cut it to what was recorded")


def test_a_chunk_shorter_than_its_checksum(tmp_path):
    """HDF5 2.0 crashes on it; two channels of one letter are six bytes with theirs."""
    path = tmp_path / "run.h5"
    write(Record(values=VALUES, sample_rate=12.5, channels=["x", "y"]), path)
    data = bytearray(path.read_bytes())
    damaged = []
    at = -1
    while (at := data.find(b"TREE\x01", at + 1)) >= 0:
        if data[at + 24 : at + 28] == struct.pack("<I", 6):
            data[at + 24] ^= 4
            damaged.append(at)
    assert damaged
    path.write_bytes(data)
    refused(path, "parts of `channels`")


@pytest.mark.parametrize(("unit", "quantity"), [("m/s^2", "acceleration"), ("", "displacement")])
def test_the_unit_of_all_values(tmp_path, unit, quantity):
    channels = read(saved(tmp_path, values=attached(VALUES, units=unit))).channels
    assert [(channel.unit, channel.quantity) for channel in channels] == [(unit or "-", quantity)] * 2
    stated = saved(tmp_path, values=attached(VALUES, units="m"), units=["N", "N"])
    assert read(stated).channels[0].unit == "N"


def test_units_among_many_attributes(tmp_path):
    path = lab(tmp_path, libver="latest", a=VALUES[0])
    with h5py.File(path, "r+", libver="latest") as file:
        for number in range(30):
            file["a"].attrs[f"note {number}"] = "v" * number
        file["a"].attrs["units"] = "m"
    assert read(path, channels=["a"], rate=1.0).channels[0].unit == "m"


@pytest.mark.parametrize(("unit", "rate"), [("s", 12.5), ("ms", 12500.0), ("", 12.5), ("furlong", None)])
def test_times_have_a_unit_too(tmp_path, unit, rate):
    path = lab(tmp_path, a=VALUES[0], t=TIME)
    with h5py.File(path, "r+") as file:
        file["t"].attrs["units"] = unit
    if rate is None:
        refused(path, "times in one of s, ms", "`t` in 'furlong'", "`rate=`", channels=["a"])
        return
    assert read(path, channels=["a"]).sample_rate == pytest.approx(rate, rel=1e-12)
    path = saved(tmp_path, sample_rate=None, time=attached(TIME, units=unit))
    assert read(path).sample_rate == pytest.approx(rate, rel=1e-12)


def test_rows_of_a_matrix(tmp_path):
    path = lab(tmp_path, data=VALUES, table=VALUES.T, **{"odd[0]": VALUES[0]}, sample_rate=7.0)
    np.testing.assert_array_equal(read(path, channels=["data[1]", "odd[0]"]).values, VALUES[::-1])
    np.testing.assert_array_equal(read(path, channels=["table.T"]).values, VALUES)
    assert read(path, channels=["table.T[1]"]).sample_rate == 7.0
    refused(path, "a row of 2 samples among 40", "'table.T'", channels=["table[1]"])
    refused(path, "vectors of samples", "Leave out the [ ]", channels=["odd[0][0]"])


def test_without_paths_the_datasets_are_listed(tmp_path):
    path = lab(tmp_path, daq__a=VALUES[0], daq__b=VALUES[1], daq__t=TIME, notes=["calm", "dry"])
    for call in (read, describe_file):
        with pytest.raises(InputError) as caught:
            call(path)
        for words in (
            "has no `values`",
            "    daq/a: 40\n",
            "    notes: 2, text.\n",
            "as in daq/a,daq/b;",
            "`values` (ch",
        ):
            assert words in str(caught.value)


def test_rates_of_several_groups(tmp_path):
    path = lab(tmp_path, a__x=VALUES[0], b__x=VALUES[1], a__sample_rate=5.0, b__sample_rate=6.0)
    refused(path, "one rate", "5 Hz in `a/sample_rate` and 6 Hz in `b/sample_rate`", channels=["a/x", "b/x"])
    assert read(path, channels=["a/x", "b/x"], rate=5.0).sample_rate == 5.0
    assert read(path, channels=["b/x"]).sample_rate == 6.0


def test_a_name_that_would_act_on_a_terminal_is_not_printed(tmp_path):
    path = lab(tmp_path, **{"a\x1b[2J\nb": VALUES[0]})
    refused(path, "a?[2J?b: 40")


# What is refused.


def link(target):
    return lambda file, path: file.__setitem__(path, target)


def attached(value, **attributes):
    def put(file, path):
        file[path] = value
        file[path].attrs.update(attributes)

    return put


def unwritten(file, path):
    file.create_dataset(path, (2, 2**39), dtype="f8")


def unwritten_chunks(file, path):
    file.create_dataset(path, (2, 2**39), dtype="f8", chunks=(1, 2**16))


def half_written(file, path):
    file.create_dataset(path, (2, 40), dtype="f8", chunks=(1, 10))[:, :15] = 1.0


def external(file, path):
    file.create_dataset(path, (2, 40), dtype="f8", external=[(str(file.filename), 0, 640)])


def virtual(file, path):
    layout = h5py.VirtualLayout(shape=(2, 40), dtype="f8")
    layout[:] = h5py.VirtualSource(str(file.filename), "elsewhere", shape=(2, 40))
    file["elsewhere"] = VALUES
    file.create_virtual_dataset(path, layout)


def ragged(file, path):
    file.create_dataset(path, data=np.array([np.ones(2), np.ones(3)], dtype=object), dtype=h5py.vlen_dtype(float))


BAD = {
    "axes swapped": ({"values": VALUES.T}, "shape (40, 2)", "save `values.T`", "h5write"),
    "one axis": ({"values": VALUES[0], "channels": ["x"]}, "shape (40,)", "`values[None, :]`"),
    "three axes": ({"values": np.ones((2, 3, 4))}, "shape (2, 3, 4)", "one record a file"),
    "names missing": ({"channels": ["x"]}, "1 channels", "Name every row"),
    "no channels": ({"channels": None}, "has no `channels`", "values: 2 x 40", "values[0],values[1]"),
    "no values": ({"values": None}, "has no `values`", "channels: 2, text"),
    "no rate": ({"sample_rate": None}, "neither a rate nor a column of times", "`rate=`"),
    "complex": ({"values": VALUES * 1j}, "real numbers in `values`", "complex numbers", "real part"),
    "text": ({"values": [["a", "b"], ["c", "d"]]}, "real numbers in `values`", "has text"),
    "records": ({"values": np.zeros((2, 4), dtype=[("a", float)])}, "real numbers in `values`", "records"),
    "ragged": ({"values": ragged}, "real numbers in `values`", "records"),
    "infinite": ({"values": np.full((2, 40), np.inf)}, "80 in `values`", "channel 'x', sample 0"),
    "empty": ({"values": np.ones((2, 0))}, "holds none"),
    "nothing": ({"values": lambda file, path: file.__setitem__(path, h5py.Empty("f8"))}, "shape (0,)"),
    "a group for values": ({"values": None, "values__x": VALUES}, "has no `values`", "values/x: 2 x 40"),
    "a negative rate": ({"sample_rate": -5.0}, "positive number in `sample_rate`", "-5.0"),
    "a rate in words": ({"sample_rate": "fast"}, "real numbers in `sample_rate`", "text"),
    "numbers as names": ({"channels": [1, 2]}, "one text a channel in `channels`", "has 2, numbers there"),
    "names of other bytes": ({"channels": np.array([b"\xff", b"y"])}, "`channels` holds text that is not in UTF-8"),
    "names in references": ({"channels": lambda f, p: f.create_dataset(p, (2,), dtype=h5py.ref_dtype)}, "struct array"),
    "an external link": ({"values": link(h5py.ExternalLink("other.h5", "values"))}, "a link", "not followed"),
    "a link to itself": ({"values": link(h5py.SoftLink("/values"))}, "a link", "not followed"),
    "a link to nothing": ({"channels": link(h5py.SoftLink("/none"))}, "a link", "name the path"),
    "data of another file": ({"values": external}, "data of another file", "one file"),
    "data put together": ({"values": virtual}, "data of another file", "one file"),
    "eight terabytes, unwritten": ({"values": unwritten}, "parts of `values`", "never written"),
    "eight terabytes of chunks, unwritten": ({"values": unwritten_chunks}, "parts of `values`", "never written"),
    "an acquisition that stopped": ({"values": half_written}, "read as zeros", "NaN in the rest"),
    "counts with a gain of their own": (
        {"values": attached(np.ones((2, 40), "i2"), gain=0.5)}, "the quantities", "`values`", "`values/gain`", "offset",
    ),
    "a rate in kilohertz": ({"sample_rate": attached(0.0125, units="kHz")}, "`sample_rate` in Hz", "'kHz'", "`rate=`"),
    "a period in milliseconds": ({"period": attached(80.0, unit="ms")}, "`period` in s", "'ms'", "Save it in s"),
    "a signalling NaN among the times": (
        {"time": np.full(40, 0x7FF0000000000001).view("f8"), "sample_rate": None}, "finite time", "`time`", "`rate=`",
    ),
    "a MATLAB object": (
        {"values": attached(np.zeros((1, 6), "u4"), MATLAB_class=np.bytes_("table"), MATLAB_object_decode=3)},
        "a MATLAB object", "table2array",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "words"), [(v[0], v[1:]) for v in BAD.values()], ids=BAD)
def test_bad_datasets(tmp_path, content, words):
    refused(saved(tmp_path, **content), *words)


def test_numbers_that_netcdf_packs_are_the_quantities(tmp_path):
    raw = np.array([[0, 1, 2, -9], [7, -9, 3, 4]], "i2")
    said = {"scale_factor": 0.5, "add_offset": 10.0, "_FillValue": np.int16(-9)}
    found = read(saved(tmp_path, values=attached(raw, **said)))
    np.testing.assert_array_equal(found.values, np.where(raw == -9, np.nan, 0.5 * raw + 10.0))
    found = read(saved(tmp_path, values=attached(raw.astype("f4"), missing_value=np.float32(-9))))
    np.testing.assert_array_equal(found.values, np.where(raw == -9, np.nan, raw))


@pytest.mark.parametrize(
    ("where", "name", "value"), [("x", "Fs", 12.5), ("run", "dt", 0.08), ("", "sample_rate", 12.5)]
)
def test_an_attribute_states_the_rate(tmp_path, where, name, value):
    path = lab(tmp_path, run__x=VALUES[0])
    with h5py.File(path, "r+") as file:
        (file["run/x"] if where == "x" else file[where or "/"]).attrs[name] = value
    assert read(path, channels=["run/x"]).sample_rate == 12.5


def gtsdf(folder, *blocks, names=("x", "y"), units=("m", "rad"), **attributes):
    """A file of blocks (samples (samples, channels), content), as DTU's Wind Energy Toolbox writes them."""
    path = folder / "run.hdf5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"type": "General time series data format", "no_blocks": len(blocks), **attributes})
        for key, texts in (("attribute_names", names), ("attribute_units", units)):
            if texts is not None:
                file[key] = np.array([text.encode() for text in texts])
        for number, (data, content, attributes) in enumerate(blocks):
            block = file.create_group(f"block{number:04d}")
            block["data"] = data
            block.attrs.update(attributes)
            for key, value in content.items():
                block[key] = value
    return path


def test_counts_of_hawc2_are_quantities(tmp_path):
    raw = np.array([[0, 65535], [65534, 2], [10, 3]], "u2")
    content = {"gains": [0.5, 2.0], "offsets": [-1.0, 100.0]}
    path = gtsdf(tmp_path, (raw, content, {"time_step": np.float32(0.02), "time_start": 30.0}))
    found = read(path)
    np.testing.assert_array_equal(found.values, [[-1.0, 32766.0, 4.0], [np.nan, 104.0, 106.0]])
    assert [(c.name, c.unit) for c in found.channels] == [("x", "m"), ("y", "rad")]
    assert (found.sample_rate, found.start) == (50.0, 30.0)
    np.testing.assert_array_equal(read(path, channels=["y"]).values, found.values[1:])
    np.testing.assert_array_equal(read(path, channels=["block0000/data.T[1]"]).values, found.values[1:])
    np.testing.assert_array_equal(read(path, channels=["block0000/data.T"], rate=50.0).values, found.values)
    with pytest.raises(InputError, match=r"has 'block0000/data.T\[2\]'.\n  The channels are: x, y"):
        read(path, channels=["block0000/data.T[2]"])


def test_blocks_of_hawc2_follow_one_another(tmp_path):
    part = np.arange(8.0).reshape(4, 2)
    steps = {"time_step": 0.25}
    blocks = ((part, {}, {**steps, "time_start": 0.0}), (-part, {}, {**steps, "time_start": 1.0}))
    found = read(gtsdf(tmp_path, *blocks, names=("Shaft", "Shaft"), units=None))
    np.testing.assert_array_equal(found.values, np.concatenate([part, -part]).T)
    assert [c.name for c in found.channels] == ["Shaft", "Shaft_2"]
    assert found.sample_rate == 4.0
    timed = read(gtsdf(tmp_path, (part, {"time": [0, 1, 2, 3]}, {"time_step": 0.5, "time_start": 2.0}), names=None))
    assert (timed.sample_rate, timed.start, timed.channels[1].name) == (2.0, 2.0, "ch2")
    refused(gtsdf(tmp_path), "hold samples", "no `block0000/data`")
    refused(gtsdf(tmp_path, (part, {}, {})), "neither a rate", "`rate=`")


def test_links_beside_what_is_read_do_no_harm(tmp_path):
    def knot(file, path):
        group = file.create_group(path)
        group["itself"], group["root"], group["again"] = group, file["/"], h5py.SoftLink("/knot/again")

    path = saved(
        tmp_path, knot=knot, away=link(h5py.ExternalLink("none.h5", "/")), twice=link(h5py.SoftLink("/values"))
    )
    assert read(path).n_samples == 40
    with h5py.File(path, "r+") as file:
        file["a name that comes before"] = file["values"]  # a second hard link to it
    assert read(path).n_samples == 40


OTHERS = {
    "text": (b"time,x\n0,1\n" * 99, "seems to be text", "Name it by its format"),
    "an archive": (b"PK\x03\x04" + bytes(99), "seems to be a ZIP archive", "Name it by its format"),
    "a MATLAB file": (
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM",
        "seems to be a MATLAB file",
        "Name it by its format",
    ),
    "the first bytes alone": (b"\x89HDF\r\n\x1a\n" + bytes(99), "damaged or cut short"),
}


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in OTHERS.values()], ids=OTHERS)
def test_other_files_of_that_name(tmp_path, data, words):
    path = tmp_path / "run.h5"
    path.write_bytes(data)
    refused(path, *words)


def test_hdf5_may_be_called_mat(tmp_path):
    path = saved(tmp_path).rename(tmp_path / "run.mat")
    np.testing.assert_array_equal(read(path).values, VALUES)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99])
def test_a_file_cut_short(tmp_path, share):
    path = saved(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refused(path, "damaged or cut short")


def test_numbers_whose_squares_overflow_are_summarised(tmp_path):
    values = VALUES.copy()
    values[0, :2] = 1.5e308, -1.5e308
    found = describe_file(saved(tmp_path, values=values))
    assert found.channels[0].maximum == 1.5e308
    assert found.channels[0].std == pytest.approx(1.5e308 * np.sqrt(2.0 / 40.0))
    assert found.channels[1].std == pytest.approx(VALUES[1].std())
