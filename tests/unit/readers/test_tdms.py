"""TDMS files as LabVIEW writes them: waveforms, groups, scales and segments."""

import numpy as np
import pytest
from tests.contracts.test_readers_bad_binary import ROOT, daqmx, number, scale, segment, thing, word
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.readers import read

nptdms = pytest.importorskip("nptdms")

X = np.random.default_rng(0).standard_normal(60)
WAVE = {"wf_increment": 1 / 51200, "wf_start_offset": 0.5}


def saved(folder, *channels, properties=None, segments=1, **options):
    """A file of channels (group, name, data, properties)."""
    path = folder / "run.tdms"
    with nptdms.TdmsWriter(path, **options) as writer:
        for _ in range(segments):
            objects = [nptdms.ChannelObject(group, name, data, said) for group, name, data, said in channels]
            writer.write_segment([nptdms.RootObject(properties or {}), *objects])
    return path


def test_waveforms(tmp_path):
    path = saved(tmp_path, ("run", "x", X, WAVE | {"unit_string": "m/s^2"}), ("run", "tach [V]", -X, WAVE))
    found = read(path)
    assert [(c.name, c.unit) for c in found.channels] == [("x", "m/s^2"), ("tach", "V")]
    assert (found.sample_rate, found.start) == (51200.0, 0.5)
    np.testing.assert_array_equal(found.values, [X, -X])
    np.testing.assert_array_equal(read(path, channels=["run/tach"]).values, [-X])
    assert read(path, rate=100.0).sample_rate == 100.0


def test_the_date_of_a_waveform_is_kept_in_words(tmp_path):
    said = WAVE | {"wf_start_time": np.datetime64("2026-03-01T12:00:00", "us")}
    steps = read(saved(tmp_path, ("run", "x", X, said))).provenance.steps
    assert "The first sample was taken at 2026-03-01T12:00:00.000000." in steps


@pytest.mark.parametrize("kind", ["int8", "int16", "int32", "int64", "uint8", "uint32", "float32", "bool"])
def test_every_kind_of_number(kind, tmp_path):
    values = (10 * X).clip(0).astype(kind)
    np.testing.assert_array_equal(read(saved(tmp_path, ("g", "x", values, WAVE))).values[0], values.astype(float))


def test_segments_follow_one_another(tmp_path):
    path = saved(tmp_path, ("g", "x", X, WAVE), ("g", "y", -X, WAVE), segments=5)
    np.testing.assert_array_equal(read(path).values, [np.tile(X, 5), np.tile(-X, 5)])


def test_a_segment_of_properties_alone(tmp_path):
    """As LabVIEW writes those that are set when the samples are there: the list of objects goes on."""
    path = tmp_path / "run.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.RootObject({}), nptdms.ChannelObject("g", "x", X, WAVE)])
        writer.write_segment([nptdms.RootObject({"operator": "me"})])
    data = bytearray(path.read_bytes())
    first = data.index(b"TDSm", 4)
    data[first + 4 : first + 8] = (0x2).to_bytes(4, "little")
    path.write_bytes(data)
    assert len(nptdms.TdmsFile.read(path)["g"]["x"]) == 60
    np.testing.assert_array_equal(read(path).values, [X])


def test_groups_of_unlike_rates(tmp_path):
    slow = {"wf_increment": 0.1}
    path = saved(tmp_path, ("fast", "x", X, WAVE), ("slow", "x", X[:9], slow), ("slow", "y", -X[:9], slow))
    assert_refused(path, ["one length", "fast/x has 60, slow/x has 9", "`group/channel`"])
    found = read(path, channels=["slow/y", "slow/x"])
    assert [c.name for c in found.channels] == ["slow/y", "slow/x"]
    assert (found.sample_rate, found.n_samples) == (10.0, 9)


def test_starts_that_differ(tmp_path):
    path = saved(tmp_path, ("g", "x", X, WAVE), ("g", "y", X, WAVE | {"wf_start_offset": 0.6}))
    assert_refused(path, ["channels of one start", "g/x has", "g/y has", "`channels=`"])
    assert read(path, channels=["y"]).start == 0.6


def test_a_channel_of_times(tmp_path):
    path = saved(tmp_path, ("g", "Time", 1e3 * np.arange(60) / 64, {"unit_string": "ms"}), ("g", "x", X, {}))
    found = read(path)
    assert ([c.name for c in found.channels], found.sample_rate) == (["x"], 64.0)
    assert read(path, rate=5.0).start == 0.0


def test_text_and_dates_are_no_signals(tmp_path):
    dates = np.datetime64("2026-03-01", "us") + np.arange(60).astype("m8[s]")
    path = saved(tmp_path, ("g", "note", ["a"] * 60, {}), ("g", "when", dates, {}), ("g", "x", X, WAVE))
    found = read(path)
    assert [c.name for c in found.channels] == ["x"]
    assert "Channel 'g/note' is not of numbers, and is not used." in found.provenance.steps
    assert "Channel 'g/when' is not of numbers, and is not used." in found.provenance.steps


@pytest.mark.parametrize("name", ["Timestamp", "when"])
def test_time_stamps_of_labview_are_the_times(name, tmp_path):
    stamps = np.datetime64("2026-03-01T12:00:00", "us") + (20000 * np.arange(60)).astype("m8[us]")
    path = saved(tmp_path, ("g", name, stamps, {}), ("g", "x", X, {}))
    found = read(path)
    assert ([c.name for c in found.channels], found.sample_rate, found.start) == (["x"], 50.0, 0.0)
    assert any("dates: they count from the first, 2026-03-01T12:00:00" in step for step in found.provenance.steps)
    assert read(path, rate=7.0).sample_rate == 7.0


def test_dates_in_words_are_the_times(tmp_path):
    stamps = [str(np.datetime64("2026-03-01T12:00:00", "ms") + np.timedelta64(20 * k, "ms")) for k in range(60)]
    assert read(saved(tmp_path, ("g", "Time", stamps, {}), ("g", "x", X, {}))).sample_rate == 50.0
    path = saved(tmp_path, ("g", "Time", ["noon"] * 60, {}), ("g", "x", X, {}))
    assert_refused(path, ["times as numbers, as time stamps", "'noon' first in 'g/Time'", "`rate=`"])
    assert read(path, rate=7.0).n_samples == 60


SCALED = {
    "NI_Number_Of_Scales": 1,
    "NI_Scaling_Status": "unscaled",
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 2.5,
    "NI_Scale[0]_Linear_Y_Intercept": -1.0,
    "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}


def test_scales_are_applied(tmp_path):
    raw = np.arange(60, dtype=np.int16)
    found = read(saved(tmp_path, ("g", "x", raw, WAVE | SCALED)))
    np.testing.assert_array_equal(found.values[0], 2.5 * raw - 1.0)


def test_daqmx(tmp_path):
    """Two channels of 16 bits that lie in one another in a buffer, the first scaled by the second of its two scales."""
    raw = np.arange(12, dtype="<i2").reshape(6, 2)
    scales = [
        number("wf_increment", 0.01),
        scale("NI_Number_Of_Scales", 2),
        word("NI_Scale[1]_Scale_Type", "Linear"),
        number("NI_Scale[1]_Linear_Slope", 10.0),
        number("NI_Scale[1]_Linear_Y_Intercept", 3.0),
        scale("NI_Scale[1]_Linear_Input_Source", 0),
    ]
    one = daqmx(6, 4)
    two = bytearray(one)
    two[32:36] = (2).to_bytes(4, "little")  # the second channel begins two bytes on
    kind = (3).to_bytes(4, "little")  # 16 bits, signed
    indices = [bytes(found[:24]) + kind + bytes(found[28:]) for found in (bytearray(one), two)]
    path = tmp_path / "run.tdms"
    path.write_bytes(
        segment(
            ROOT, thing("/'g'"), *(thing(f"/'g'/'{n}'", index, scales) for n, index in zip("xy", indices, strict=True)),
            contents=0x8E, data=raw.tobytes(),
        )
    )  # fmt: skip
    np.testing.assert_array_equal(read(path).values, 10.0 * raw.T + 3.0)


def test_an_index_file_beside_it_is_not_read(tmp_path):
    path = saved(tmp_path, ("g", "x", X, WAVE))
    index = tmp_path / "run.tdms_index"
    index.write_bytes(b"TDSh, and nothing that makes sense")
    np.testing.assert_array_equal(read(path).values[0], X)
    assert index.read_bytes() == b"TDSh, and nothing that makes sense"
    assert len(list(tmp_path.iterdir())) == 2


def test_a_run_that_ended_early_is_read_where_its_chunks_are_whole(tmp_path):
    path = saved(tmp_path, ("g", "x", X, WAVE))
    data = bytearray(path.read_bytes())
    data[12:20] = b"\xff" * 8
    path.write_bytes(data)
    found = read(path)
    np.testing.assert_array_equal(found.values[0], X)
    assert any("never closed" in step for step in found.provenance.steps)
    path.write_bytes(data[:-4])
    assert_refused(path, ["cut short: its last segment has not all samples of /'g'/'x'", "Copy"])
