"""Output files of OpenFAST, held against a reader by the published layout, and the azimuth found by its name."""

import struct

import numpy as np
import pytest
from tests.contracts.test_readers_bad_binary import outb
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.readers import describe_file, read


def as_published(data):
    """What ReadFASTbinary.m reads: names, units, description, and a matrix with the times in its first column."""
    place = 0

    def take(count, kind, size):
        nonlocal place
        found = struct.unpack_from(f"<{count}{kind}", data, place)
        place += count * size
        return found

    kind = take(1, "h", 2)[0]
    letters = take(1, "h", 2)[0] if kind == 4 else 10
    n_channels, n_samples = take(2, "i", 4)
    first, second = take(2, "d", 8)
    scales = take(n_channels, "f", 4) if kind != 3 else [1.0] * n_channels
    offsets = take(n_channels, "f", 4) if kind != 3 else [0.0] * n_channels
    text = bytes(take(take(1, "i", 4)[0], "B", 1)).decode("latin-1")
    words = [bytes(take(letters, "B", 1)).decode("latin-1").strip() for _ in range(2 * (n_channels + 1))]
    if kind == 1:
        times = [(tick - second) / first for tick in take(n_samples, "i", 4)]
    else:
        times = [first + n * second for n in range(n_samples)]
    numbers = take(n_samples * n_channels, *(("d", 8) if kind == 3 else ("h", 2)))
    assert place == len(data)
    table = np.array(numbers).reshape(n_samples, n_channels)
    table = (table - np.array(offsets)) / np.array(scales)
    return words[: n_channels + 1], words[n_channels + 1 :], text, np.column_stack([times, table])


def packed(kind, samples=((0, 1), (2, 3), (4, 5), (6, 7), (8, 9), (10, 11)), **changes):
    return outb(kind, body=np.asarray(samples, "<i2").tobytes(), samples=len(samples), **changes)


@pytest.mark.parametrize(
    "data",
    [
        outb(3),
        packed(2),
        packed(4),
        packed(4, letters=20),
        packed(1, first=1e6, second=0.0),
        packed(2, samples=[[32767, -32768], [-1, 1], [0, 2]], scales=(1e-3, 2e4, 0.5, -7.0)),
    ],
    ids=["3", "2", "4", "4 with long names", "1", "extremes"],
)
def test_each_kind_is_read_as_published(data, tmp_path):
    path = tmp_path / "run.outb"
    path.write_bytes(data)
    names, units, _, table = as_published(data)
    found = read(path, rate=None if data[:1] != b"\1" else 10.0)
    assert [channel.name for channel in found.channels] == names[1:]
    assert [f"({channel.unit})" for channel in found.channels] == units[1:]
    np.testing.assert_array_equal(found.values, table[:, 1:].T)
    if data[:1] != b"\1":
        np.testing.assert_allclose(found.times, table[:, 0], rtol=1e-15)


def test_packed_times_give_the_rate_behind_them(tmp_path):
    """32 bits over 600 s leave 1.4e-7 s: 80 Hz, and not a rate next to it."""
    path, n = tmp_path / "run.outb", 48001
    times = np.arange(n) / 80.0 + 30.0
    scale = (2.0**31 - 1 + 2.0**31) / (times[-1] - times[0])
    offset = -(2.0**31) - scale * times[0]
    ticks = np.clip(np.rint(scale * times + offset), -(2**31), 2**31 - 1).astype("<i4")
    data = struct.pack("<hiidd4fi", 1, 2, n, scale, offset, 1.0, 1.0, 0.0, 0.0, 0)
    data += b"".join(word.ljust(10) for word in (b"Time", b"x", b"y", b"(s)", b"(m)", b"(m)"))
    path.write_bytes(data + ticks.tobytes() + np.zeros((n, 2), "<i2").tobytes())
    found = read(path)
    assert found.sample_rate == 80.0
    assert abs(found.start - 30.0) < 1e-6
    assert any("nominal 80 Hz" in step for step in found.provenance.steps)
    assert any("16 bits" in step for step in found.provenance.steps)


def test_what_a_longer_run_left_behind_the_samples_is_said(tmp_path):
    path = tmp_path / "run.outb"
    path.write_bytes(outb() + bytes(118))
    found = read(path)
    np.testing.assert_array_equal(found.values, np.arange(12.0).reshape(6, 2).T)
    assert "The file has 118 bytes behind its 6 samples, which are not used." in found.provenance.steps


@pytest.mark.parametrize(("step", "rate"), [(0.02, 50.0), (0.0125, 80.0), (0.005, 200.0), (1 / 3, 3.0), (0.75, 4 / 3)])
def test_a_step_in_single_precision_means_a_round_one(step, rate, tmp_path):
    path = tmp_path / "run.outb"
    path.write_bytes(outb(second=float(np.float32(step))))
    assert read(path).sample_rate == rate


@pytest.mark.parametrize(("second", "names"), [(np.arange(6.0), ["x"]), (-np.arange(6.0), ["x", "x_2"])])
def test_a_name_that_comes_again_is_numbered_or_read_once(second, names, tmp_path):
    path = tmp_path / "run.outb"
    values = np.array([np.arange(6.0), second])
    path.write_bytes(outb(names=["Time", "x", "x"], body=values.T.astype("<f8").tobytes()))
    found = read(path)
    assert [channel.name for channel in found.channels] == names
    np.testing.assert_array_equal(found.values, values[: len(names)])
    assert any("'x' is there again" in step for step in found.provenance.steps)
    np.testing.assert_array_equal(read(path, channels=["x_2"]).values, values[1:])
    path = tmp_path / "run.out"
    table = np.column_stack([0.1 * np.arange(6), values.T])
    path.write_text("Time x x\n(s) (m) (deg)\n" + "\n".join(" ".join(map(str, row)) for row in table.tolist()))
    found = read(path)
    assert [channel.name for channel in found.channels] == names
    np.testing.assert_array_equal(found.values, values[: len(names)])


def text(rows, units="(s) (deg) (m/sec^2) (kN-m) (INVALID)", above="\nPredictions were made\n\n\nA turbine\n\n"):
    head = f"{above}Time  Azimuth  YawBrTAxp  RootMyc1  Wave1Elev\n{units}\n"
    return head + "".join("\t".join(row) + "\n" for row in rows)


def rows(n=50, form="{:10.3E}"):
    for k in range(n):
        yield [f"{30 + 0.0125 * k:10.4f}", *(form.format(value) for value in (4.5 * k % 360, 0.1 * k, -1e5, 0.0))]


def test_a_text_of_openfast(tmp_path):
    path = tmp_path / "run.out"
    path.write_text(text(rows()))
    found = read(path)
    assert (found.sample_rate, found.start) == (80.0, 30.0)
    assert [(c.name, c.quantity, c.unit) for c in found.channels] == [
        ("Azimuth", "angle", "deg"),
        ("YawBrTAxp", "acceleration", "m/s^2"),
        ("RootMyc1", "other", "kN-m"),
        ("Wave1Elev", "other", "INVALID"),
    ]
    assert any("fills with zeros: Wave1Elev" in step for step in found.provenance.steps)
    np.testing.assert_allclose(found.values[1], 0.1 * np.arange(50), atol=5e-3)
    few = read(path, channels=["RootMyc1", "Azimuth"], rate=100.0)
    assert [c.name for c in few.channels] == ["RootMyc1", "Azimuth"]
    assert few.start == 0.0


def test_the_azimuth_is_a_candidate_by_name_and_by_its_turns(tmp_path):
    path = tmp_path / "run.out"
    path.write_text(text(rows(200)))
    (found,) = describe_file(path).clock_candidates
    assert (found.name, found.kind, found.is_sure) == ("Azimuth", "azimuth", True)
    assert "jumps back by a turn of 360 deg, 2 times" in found.why


def test_exponents_of_three_digits_and_no_letter(tmp_path):
    path = tmp_path / "run.out"
    path.write_text(text([*rows(3), ["30.0375", "1.0D+01", "1.234-103", "-1.5+101", "nan"]]))
    np.testing.assert_array_equal(read(path).values[:, 3], [10.0, 1.234e-103, -1.5e101, np.nan])


BAD = {
    "empty": ("", "is empty", "Export"),
    "no names": ("a\nb\n1 2\n", "begins with `Time`", "none among its first 60 lines", ".csv"),
    "binary": (outb().decode("latin-1"), "be text", "is binary", ".outb"),
    "the time alone": ("Time\n(s)\n0\n1\n", "a column for each channel", "the time alone (line 1)", "Export"),
    "a unit too few": (text(rows(), units="(s) (deg)"), "a unit for each name", "5 names and 2 units", "blanks"),
    "no rows": (text([]), "hold samples", "names and no rows", "Run OpenFAST"),
    "one row": (text(rows(1)), "at least two samples", "holds one", "export more"),
    "a row cut short": (text([*rows(4), ["30.05", "1"]]), "5 numbers in every row", "2 in line 13", "stopped"),
    "a row too long": (text([*rows(4), ["0"] * 6]), "5 numbers in every row", "6 in line 13", "Mend"),
    "every row too long": (text([row * 2 for row in rows()]), "5 numbers in every row", "10 in line 9", "Mend"),
    "stars": (text([*rows(4), ["30.05", "1", "2", "****", "3"]]), "'****' in line 13, column 'RootMyc1'", "OutFmt"),
    "a cell as it is": (text([*rows(4), ["30.05", "1", "2", "1.0D+x", "3"]]), "'1.0D+x'", "run OpenFAST again"),
    "infinite": (text([*rows(4), ["30.05", "1", "2", "-Inf", "3"]]), "finite samples", "channel 'RootMyc1', sample 4"),
    "a time that falls": (text([*rows(4), *rows(2)]), "goes back in `Time`", "sample 5", "Sort"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "words"), [(v[0], v[1:]) for v in BAD.values()], ids=BAD)
def test_bad_text(data, words, tmp_path):
    path = tmp_path / "run.out"
    path.write_bytes(data.encode("latin-1"))
    assert_refused(path, words)
