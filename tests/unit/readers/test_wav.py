"""WAV files against scipy, of every kind of sample, and what other programs make of ours."""

import struct
import wave

import numpy as np
import pytest
from scipy.io import wavfile
from tests.contracts.test_readers_bad_binary import DATA, fmt, wav
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import InputError
from floquid.readers import _wav, read, write

INTEGERS = {1: "uint8", 2: "int16", 4: "int32", 8: "int64"}


@pytest.mark.parametrize("dtype", ["uint8", "int16", "int32", "int64", "float32", "float64"])
@pytest.mark.parametrize("n_channels", [1, 2, 5])
def test_what_scipy_writes(dtype, n_channels, tmp_path):
    path, rng = tmp_path / "run.wav", np.random.default_rng(1)
    if dtype.startswith("float"):
        data, scale = rng.standard_normal((70, n_channels)).astype(dtype), 1.0
    else:
        limits = np.iinfo(dtype)
        data = rng.integers(limits.min, limits.max, (70, n_channels), dtype=dtype, endpoint=True)
        data[:2] = np.array([[limits.min], [limits.max]])
        scale = 2.0 ** (limits.bits - 1)
    wavfile.write(path, 51200, data)
    found = read(path)
    expected = (data.astype(float) - (128.0 if dtype == "uint8" else 0.0)) / scale
    np.testing.assert_array_equal(found.values, expected.T)
    assert found.sample_rate == 51200.0
    assert [channel.name for channel in found.channels] == [f"ch{k}" for k in range(1, n_channels + 1)]
    assert {(c.quantity, c.unit) for c in found.channels} == {("other", "-" if dtype.startswith("float") else "FS")}
    assert any("full scale is 1" in step for step in found.provenance.steps) == (not dtype.startswith("float"))
    assert np.abs(found.values).max() <= 1.0 or dtype.startswith("float")


def test_24_bits(tmp_path):
    path, numbers = tmp_path / "run.wav", [-(2**23), -1, 0, 1, 2**23 - 1, 123456]
    with wave.open(str(path), "wb") as stream:
        stream.setnchannels(2)
        stream.setsampwidth(3)
        stream.setframerate(48000)
        stream.writeframes(b"".join(number.to_bytes(3, "little", signed=True) for number in numbers))
    np.testing.assert_array_equal(read(path).values, np.array(numbers).reshape(3, 2).T / 2.0**23)


def test_extensible_and_unknown_chunks(tmp_path):
    tag, layout = fmt(bits=24, channels=1)[1], struct.pack("<HHI", 22, 20, 4)
    tag = struct.pack("<H", 0xFFFE) + tag[2:] + layout + bytes.fromhex("0100000000001000800000aa00389b71")
    data = (b"data", b"\0\0\x40\0\0\xc0", None)
    path = tmp_path / "run.wav"
    path.write_bytes(wav((b"bext", bytes(7), None), (b"fmt ", tag, None), (b"LIST", b"INFO", None), data))
    np.testing.assert_array_equal(read(path).values, [[0.5, -0.5]])


def test_big_endian(tmp_path):
    data = np.arange(12, dtype=">i2").tobytes()
    chunks = b"fmt " + struct.pack(">IHHIIHH", 16, 1, 2, 8000, 32000, 4, 16) + b"data" + struct.pack(">I", 24) + data
    path = tmp_path / "run.wav"
    path.write_bytes(b"RIFX" + struct.pack(">I", 4 + len(chunks)) + b"WAVE" + chunks)
    np.testing.assert_array_equal(read(path).values, np.arange(12).reshape(6, 2).T / 2.0**15)


def test_rf64(tmp_path):
    sizes = struct.pack("<QQQI", 100, 24, 6, 0)
    path = tmp_path / "run.wav"
    body = wav((b"ds64", sizes, None), fmt(), head=b"RF64", size=0xFFFFFFFF)
    path.write_bytes(body + b"data\xff\xff\xff\xff" + DATA[1])
    np.testing.assert_array_equal(read(path).values, np.arange(12).reshape(6, 2).T / 2.0**15)
    path.write_bytes(body + b"data\xff\xff\xff\xff" + DATA[1][:-2])
    assert_refused(path, ["declares 24 bytes, and 22 are left"])


def record(**changes):
    channels = [Channel(name="x", unit="m/s^2", location="top"), Channel(name="tach", quantity="pulse", unit="V")]
    given = {"values": np.random.default_rng(2).standard_normal((2, 30)), "sample_rate": 2533.3, "channels": channels}
    return Record(**(given | {"start": 5.0, "clock": ConstantPeriod(period=0.1, origin=0.02)} | changes))


def test_scipy_reads_what_is_written(tmp_path):
    path = tmp_path / "run.wav"
    write(record(), path)
    with pytest.warns(wavfile.WavFileWarning, match="not understood"):
        rate, data = wavfile.read(path)
    assert rate == 2533
    np.testing.assert_array_equal(data.T, record().values)


def test_a_file_saved_by_another_program_loses_what_it_does_not_know(tmp_path):
    path = tmp_path / "run.wav"
    write(record(sample_rate=2533.0), path)
    with pytest.warns(wavfile.WavFileWarning):
        rate, data = wavfile.read(path)
    wavfile.write(path, rate, data)
    found = read(path)
    np.testing.assert_array_equal(found.values, record().values)
    assert ([c.name for c in found.channels], found.start, found.clock) == (["ch1", "ch2"], 0.0, None)


def test_own_chunk_against_the_header(tmp_path):
    path = tmp_path / "run.wav"
    write(record(), path)
    data = path.read_bytes()
    path.write_bytes(data.replace(struct.pack("<I", 2533), struct.pack("<I", 2544), 1))
    assert_refused(path, ["agrees with its header", "2533.3 Hz there and 2544 Hz", "`rate`"])
    assert read(path, rate=2544.0).sample_rate == 2544.0
    own = data[data.index(b"flqd") + 8 :]
    path.write_bytes(wav(fmt(channels=3, rate=2533), (b"flqd", own, None), DATA))
    found = read(path)
    assert len(found.channels) == 3
    assert any("other channels, and is passed over" in step for step in found.provenance.steps)


def test_samples_that_were_converted_have_no_unit_any_more(tmp_path):
    """By a program that normalises them and keeps chunks that it does not know."""
    path = tmp_path / "run.wav"
    write(record(sample_rate=2533.0), path)
    data = path.read_bytes()
    own = data[data.index(b"flqd") + 8 :]
    samples = struct.pack("<4h", 32767, -32768, 100, 0)
    path.write_bytes(wav(fmt(channels=2, rate=2533, bits=16), (b"flqd", own, None), (b"data", samples, None)))
    found = read(path)
    assert {channel.unit for channel in found.channels} == {"FS"}
    assert any("were converted since" in step for step in found.provenance.steps)
    assert any("full scale is 1" in step for step in found.provenance.steps)


def test_what_fills_the_last_sector_up_is_passed_over(tmp_path):
    path = tmp_path / "run.wav"
    write(record(), path)
    with path.open("ab") as stream:
        stream.write(bytes(512))
    np.testing.assert_array_equal(read(path).values, record().values)


@pytest.mark.parametrize("rate", [1e-3, 0.4, 5e9, 44100.49])
def test_rates_that_a_header_cannot_state(rate, tmp_path):
    path = tmp_path / "run.wav"
    write(record(sample_rate=rate), path)
    assert read(path).sample_rate == rate


def test_more_than_4_gigabytes_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(_wav, "_LARGEST", 500)
    with pytest.raises(InputError, match="have less than 4 GiB of samples"):
        write(record(), tmp_path / "run.wav")
    assert not list(tmp_path.iterdir())


def test_more_channels_than_a_header_can_count_are_refused(tmp_path):
    many = Record(values=np.zeros((8192, 2)), sample_rate=1.0, channels=[f"x{k}" for k in range(8192)])
    with pytest.raises(InputError, match="at most 8191 channels in a WAV file, but has 8192"):
        write(many, tmp_path / "run.wav")
