"""NumPy archives as others save them, the example records beside the project, and the candidates for the clock."""

import re
from pathlib import Path

import numpy as np
import pytest

from floquid.core import Channel, Record
from floquid.errors import InputError
from floquid.readers import describe_file, read, write

VALUES = np.random.default_rng(5).standard_normal((2, 40))
DATA = Path(__file__).parents[4] / "shared" / "data"


def archive(tmp_path, save=np.savez, **arrays):
    good = {"values": np.arange(12.0).reshape(2, 6), "sample_rate": 100.0, "channels": ["x", "y"]}
    path = tmp_path / "run.npz"
    save(path, **{key: value for key, value in (good | arrays).items() if value is not None})
    return path


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.float16, np.int16, np.uint64, ">f8", bool])
def test_numbers_become_double_precision(tmp_path, save, dtype):
    values = np.arange(12).reshape(2, 6).astype(dtype)
    record = read(archive(tmp_path, save, values=values))
    assert record.values.dtype == np.float64
    assert record.values.dtype.isnative
    np.testing.assert_array_equal(record.values, values.astype(float))


def test_array_orders_and_kinds_of_text(tmp_path):
    values = np.asfortranarray(np.arange(12.0).reshape(2, 6))
    record = read(
        archive(tmp_path, values=values, channels=np.array([b"x", "µ".encode()]), units=np.array(["m", "rad"]))
    )
    np.testing.assert_array_equal(record.values, values)
    assert [c.label for c in record.channels] == ["x [m]", "µ [rad]"]
    assert read(archive(tmp_path, values=values[:1], channels="x")).channels == (Channel(name="x"),)


def test_sample_rate_is_taken_as_it_is(tmp_path):
    record = read(archive(tmp_path, sample_rate=np.array([2533.333333333334])))
    assert record.sample_rate == 2533.333333333334
    time = 5.0 + np.arange(6) / 100.001
    record = read(archive(tmp_path, time=time))
    assert (record.sample_rate, record.start) == (100.0, 5.0)


def test_times_instead_of_a_rate(tmp_path):
    time = np.delete(np.arange(7), 3) / 250.0
    for kind in (np.float64, np.float32):
        record = read(archive(tmp_path, sample_rate=None, time=time.astype(kind)))
        assert (record.sample_rate, record.n_samples) == (250.0, 7)
        np.testing.assert_array_equal(np.isnan(record.values).any(axis=0), np.arange(7) == 3)
    record = read(archive(tmp_path, sample_rate=None, time=np.arange(6)))
    assert record.sample_rate == 1.0
    record = read(archive(tmp_path, time=time[::-1]), rate=10.0)
    assert record.sample_rate == 10.0
    assert "The times in the file were ignored." in record.provenance.steps


def test_arrays_of_other_names_are_read_by_their_paths(tmp_path):
    path = tmp_path / "lab.npz"
    np.savez(path, data=np.arange(12.0).reshape(2, 6), time=np.arange(6) / 50, note="calm")
    record = read(path, channels=["data[1]", "data[0]"])
    assert record.sample_rate == 50.0
    np.testing.assert_array_equal(record.values, np.arange(12.0).reshape(2, 6)[::-1])


def test_names_in_an_array_of_objects_are_to_be_texts(tmp_path):
    path = archive(tmp_path, values=np.ones((2, 6)), sample_rate=5.0, channels=np.array(["x", "y"], dtype=object))
    with pytest.raises(InputError, match=r"hold one text a channel .*Python objects there\.\n.*dtype=str"):
        read(path)


def test_what_is_not_used_is_mentioned(tmp_path):
    found = describe_file(archive(tmp_path, path=np.ones((2, 4)), note=np.array([None], dtype=object)))
    assert "The file also holds `path`, which is not used." in found.notes
    assert "The file also holds `note`, which is not used." in found.notes


@pytest.mark.parametrize(
    ("name", "n_channels", "n_samples", "rate"),
    [
        ("rotor_1900rpm_hit1.npz", 6, 17720, 2533.333333333334),
        ("rotor_650rpm_hit2.npz", 6, 6080, 866.6666666666666),
        ("duffing_orbit.npz", 2, 16640, 19.353241079974474),
    ],
)
def test_example_records(name, n_channels, n_samples, rate):
    if not DATA.is_dir():
        pytest.skip(f"the example records are not beside the project ({DATA})")
    record = read(DATA / name)
    assert (record.n_channels, record.n_samples, record.sample_rate) == (n_channels, n_samples, rate)
    assert not describe_file(DATA / name).clock_candidates


def test_the_tachometer_of_the_example_is_found():
    if not DATA.is_dir():
        pytest.skip(f"the example records are not beside the project ({DATA})")
    (candidate,) = describe_file(DATA / "rotor_650rpm_tach.npz").clock_candidates
    assert candidate.name == "tach"
    assert "its name has the word 'tach'" in candidate.why
    assert "every 0.09231 s" in candidate.why  # a revolution at 650 rpm is 0.092308 s


def test_candidates_for_the_clock(tmp_path):
    t = np.arange(4000) / 1000.0
    rng = np.random.default_rng(2)
    rows = {
        Channel(name="probe 7", unit="V"): (t * 11.0 % 1.0 < 0.1) * 5.0 + 0.05 * rng.standard_normal(4000),
        Channel(name="shaft", unit="deg"): 360.0 * (t * 11.0 % 1.0),
        Channel(name="back", unit="rad"): np.pi - 2 * np.pi * (t * 3.0 % 1.0),
        Channel(name="Rotor_Azimuth"): np.sin(t),
        Channel(name="tilt about x", unit="rad"): 0.9 * np.pi * np.sin(60 * t),
        Channel(name="reverse detachment pulseless"): np.sin(20 * t) + rng.standard_normal(4000),
        Channel(name="noise", unit="V"): rng.standard_normal(4000),
        Channel(name="flat", unit="V"): np.zeros(4000),
        Channel(name="step", unit="V"): (t > 1.0) * 1.0,
        Channel(name="telegraph", unit="V"): np.repeat(rng.integers(0, 2, 400), 10) * 1.0,
    }
    path = tmp_path / "run.npz"
    write(Record(values=list(rows.values()), sample_rate=1000.0, channels=list(rows)), path)
    why = {candidate.name: candidate.why for candidate in describe_file(path).clock_candidates}
    assert set(why) == {"probe 7", "shaft", "back", "Rotor_Azimuth"}
    assert why["probe 7"] == "it has two levels and rises 43 times, every 0.09093 s on average"
    assert why["shaft"] == "it runs round and jumps back by a turn of 360 deg, 43 times"
    assert why["back"] == "it runs round and jumps back by a turn of 6.28319 rad, 11 times"
    assert why["Rotor_Azimuth"] == "its quantity is angle; its name has the word 'Azimuth'"


@pytest.mark.parametrize(
    ("data", "channels", "names"),
    [
        (VALUES, None, ["data[0]", "data[1]"]),
        (VALUES[0], None, ["data"]),
        (VALUES.T, ["data.T"], ["data.T[0]", "data.T[1]"]),
        (np.asfortranarray(VALUES), ["data[1]", "data[0]"], ["data[1]", "data[0]"]),
    ],
)
def test_one_array(tmp_path, data, channels, names):
    path = tmp_path / "run.npy"
    np.save(path, data)
    found = read(path, channels=channels, rate=12.5)
    assert [channel.name for channel in found.channels] == names
    rows = [1, 0] if names == ["data[1]", "data[0]"] else list(range(len(names)))
    np.testing.assert_array_equal(found.values, VALUES[rows])


def test_an_array_of_records(tmp_path):
    path, n = tmp_path / "run.npy", VALUES.shape[1]
    table = np.zeros(n, dtype=[("time", float), ("x", "f4"), ("note", "U3"), ("y", "i2")])
    table["time"], table["x"], table["y"] = np.arange(n) / 12.5, np.arange(n), -np.arange(n)
    np.save(path, table)
    found = read(path)
    assert ([channel.name for channel in found.channels], found.sample_rate) == (["x", "y"], 12.5)
    np.testing.assert_array_equal(found.values, [np.arange(n), -np.arange(n)])


@pytest.mark.parametrize(
    ("save", "words"),
    [
        (lambda path: np.save(path, VALUES.T), r"data: \d+ x 2.*data\.T\[0\],data\.T\[1\]"),
        (lambda path: np.save(path, VALUES), "neither a rate nor a column of times"),
        (lambda path: np.save(path, 1j * VALUES), "complex numbers"),
        (lambda path: np.save(path, np.array([{}, {}]), allow_pickle=True), "Object arrays cannot be loaded"),
        (lambda path: path.write_bytes(b"PK\3\4" + bytes(50)), "seems to be a ZIP archive"),
    ],
)
def test_arrays_that_are_refused(tmp_path, save, words):
    path = tmp_path / "run.npy"
    save(path)
    with pytest.raises(InputError, match=re.compile(words, re.DOTALL)) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n  " in str(caught.value)


def test_an_array_cut_short(tmp_path):
    path = tmp_path / "run.npy"
    np.save(path, VALUES)
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(InputError, match="damaged or cut short"):
        read(path, rate=1.0)
