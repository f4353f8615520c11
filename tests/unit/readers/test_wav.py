"""WAV files against scipy, of every kind of sample."""

import struct
import wave

import numpy as np
import pytest
from scipy.io import wavfile
from tests.contracts.test_readers_bad_binary import DATA, fmt, wav
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.readers import read

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


def test_what_fills_the_last_sector_up_is_passed_over(tmp_path):
    path = tmp_path / "run.wav"
    path.write_bytes(wav(fmt(), DATA))
    with path.open("ab") as stream:
        stream.write(bytes(512))
    assert read(path).n_samples == 6


@pytest.mark.parametrize("off", [-12, -30, 12, 10**6])
def test_a_wrong_size_of_the_whole_does_no_harm(off, tmp_path):
    path, body = tmp_path / "run.wav", bytearray(wav(fmt(), DATA))
    body[4:8] = struct.pack("<I", len(body) - 8 + off)
    path.write_bytes(body)
    np.testing.assert_array_equal(read(path).values, np.arange(12).reshape(6, 2).T / 2.0**15)


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF, 0xFFFFFFFF - 36, 0x7FFFFFFF, 0x7FFFF000])
@pytest.mark.parametrize("rest", [0, 3])
def test_a_stream_goes_to_the_end_of_the_file(size, rest, tmp_path):
    path, body = tmp_path / "run.wav", bytearray(wav(fmt(), DATA))
    body[4:8] = struct.pack("<I", size)
    at = body.index(b"data") + 4
    body[at : at + 4] = struct.pack("<I", size)
    path.write_bytes(body + bytes(rest))
    found = read(path)
    np.testing.assert_array_equal(found.values, np.arange(12).reshape(6, 2).T / 2.0**15)
    assert "The file does not state its length: its samples go to its end." in found.provenance.steps
