"""COMTRADE, MDF and HAWC2's .sel: as their own libraries read them, or as their formats are published."""

import struct

import numpy as np
import pytest
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.errors import InputError
from floquid.readers import read

N = 60
COUNTS = np.random.default_rng(2).integers(-30000, 30000, (2, N))
BITS = np.arange(N) % 3 == 0


def comtrade(folder, kind="BINARY", rates=((50.0, N),), names=("I1", "U1"), stem="run", cff=False):
    """A COMTRADE file of two channels, 0.5 n - 1 and 0.25 n, and one signal of a bit."""
    lines = [
        "station,relay,1999" if kind in ("ASCII", "BINARY") else "station,relay,2013", "3,2A,1D",
        f"1,{names[0]},A,,A,0.5,-1.0,0,-32767,32767,1,1,P", f"2,{names[1]},B,,kV,0.25,0,0,-32767,32767,1,1,P",
        "1,trip,,,0", "60", str(len(rates) * (rates[0][0] > 0)), *(f"{rate},{last}" for rate, last in rates),
        "01/03/2026,12:00:00.000000", "01/03/2026,12:00:01.000000", kind, "1",
    ]  # fmt: skip
    lines += ["0,0", "0,0"] if kind not in ("ASCII", "BINARY") else []
    stamps = np.arange(N) * 20000
    if kind == "ASCII":
        body = "".join(
            f"{n + 1},{stamps[n]},{COUNTS[0, n]},{COUNTS[1, n]},{int(BITS[n])}\r\n" for n in range(N)
        ).encode()
    else:
        layout = {"BINARY": "<II2hH", "BINARY32": "<II2iH", "FLOAT32": "<II2fH"}[kind]
        body = b"".join(struct.pack(layout, n + 1, stamps[n], *COUNTS[:, n].tolist(), int(BITS[n])) for n in range(N))
    head = "\r\n".join(lines) + "\r\n"
    if cff:
        marks = [f"--- file type: {name} ---\r\n" for name in ("CFG", "INF", "HDR")]
        size = f": {len(body)}" if kind != "ASCII" else ""
        path = folder / f"{stem}.cff"
        text = f"{marks[0]}{head}{marks[1]}{marks[2]}--- file type: DAT {kind}{size} ---\r\n"
        path.write_bytes(text.encode() + body)
        return path
    (folder / f"{stem}.cfg").write_text(head, newline="")
    (folder / f"{stem}.dat").write_bytes(body)
    return folder / f"{stem}.cfg"


@pytest.mark.parametrize("kind", ["ASCII", "BINARY", "BINARY32", "FLOAT32"])
@pytest.mark.parametrize("cff", [False, True], ids=["pair", "one file"])
def test_comtrade(kind, cff, tmp_path):
    pytest.importorskip("comtrade")
    path = comtrade(tmp_path, kind, cff=cff)
    found = read(path)
    assert [(c.name, c.unit) for c in found.channels] == [("I1", "A"), ("U1", "kV")]
    np.testing.assert_allclose(found.values, [0.5 * COUNTS[0] - 1.0, 0.25 * COUNTS[1]], rtol=1e-12)
    assert found.sample_rate == 50.0
    assert "1 signals of one bit are not read: name those you need by `channels`." in found.provenance.steps
    np.testing.assert_array_equal(read(path, channels=["trip", "U1"]).values[0], BITS)
    assert read(path, rate=60.0).sample_rate == 60.0


def test_comtrade_by_its_time_stamps_or_with_names_that_come_again(tmp_path):
    pytest.importorskip("comtrade")
    found = read(comtrade(tmp_path, rates=((0.0, N),), names=("I", "I")))
    assert (found.sample_rate, [c.name for c in found.channels]) == (50.0, ["I", "I_2"])


def test_comtrade_that_is_not_whole(tmp_path):
    pytest.importorskip("comtrade")
    path = comtrade(tmp_path)
    data = (tmp_path / "run.dat").read_bytes()
    (tmp_path / "run.dat").write_bytes(data[: len(data) // 2 + 3])
    found = read(path)
    np.testing.assert_allclose(found.values, [0.5 * COUNTS[0, :30] - 1.0, 0.25 * COUNTS[1, :30]], rtol=1e-12)
    assert f"The file is cut short: it declares {N} samples, and 30 are there." in found.provenance.steps
    (tmp_path / "run.dat").unlink()
    assert_refused(path, ["its samples beside it", "has no run.dat", "Copy both files"])
    data = (comtrade(tmp_path, "ASCII").with_suffix(".dat")).read_bytes()
    line = data.index(b"\r\n31,")
    for cut in range(line + 10, line + 20):  # in the middle of a number, which may be whole without its last digits
        (tmp_path / "run.dat").write_bytes(data[:cut])
        try:
            found = read(path)
        except InputError:
            continue
        np.testing.assert_allclose(found.values[0], 0.5 * COUNTS[0, : found.n_samples] - 1.0, rtol=1e-12)
        assert found.n_samples <= 30
    two = comtrade(tmp_path, rates=((50.0, 20), (25.0, N)))
    assert_refused(two, ["have one rate", "50 Hz and then 25 Hz", "`rate=`"])
    path.write_text("not a head\n")
    assert_refused(path, ["whole COMTRADE file", "Copy or export it again"])


def test_the_time_that_comtrade_may_take_grows_with_its_samples(tmp_path, monkeypatch):
    seen = []

    def call(path, function):
        seen.append(path)
        return function()

    monkeypatch.setattr("floquid.readers._read.GUARD.call", call)
    read(comtrade(tmp_path, "ASCII"))
    read(comtrade(tmp_path, "ASCII", cff=True))
    assert [path.suffix for path in seen] == [".dat", ".cff"]


TIMES = np.arange(N) / 50
WAVES = np.random.default_rng(3).standard_normal((2, N))


def mdf(folder, version, *groups):
    """An MDF file of groups (name, times, signals (name, samples, unit))."""
    asammdf = pytest.importorskip("asammdf")
    path = folder / f"run.{'mf4' if version.startswith('4') else 'mdf'}"
    with asammdf.MDF(version=version) as file:
        for name, times, signals in groups:
            made = [
                asammdf.Signal(row, times, name=own, unit=unit, encoding="utf-8" if row.dtype.kind == "S" else None)
                for own, row, unit in signals
            ]
            file.append(made, acq_name=name)
        file.save(path, overwrite=True)
    return path


FAST = ("fast", TIMES, [("x", WAVES[0], "m/s^2"), ("y", (100 * WAVES[1]).astype("i2"), "V")])
SLOW = ("slow", TIMES[:9] * 10, [("x", WAVES[0, :9], "m"), ("z", WAVES[1, :9], "")])


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_mdf(version, tmp_path):
    notes = ("note", TIMES, [("state", np.array([b"on"] * N), "")])
    found = read(mdf(tmp_path, version, FAST, notes))
    assert [(c.name, c.unit) for c in found.channels] == [("x", "m/s^2"), ("y", "V")]
    np.testing.assert_array_equal(found.values, [WAVES[0], (100 * WAVES[1]).astype("i2")])
    assert found.sample_rate == 50.0
    assert "Channel 'state' is not of numbers, and is not used." in found.provenance.steps


def test_groups_of_mdf_with_times_of_their_own(tmp_path):
    path = mdf(tmp_path, "4.10", FAST, SLOW)
    assert_refused(path, ["sampled together", "fast/x has 60, y has 60, slow/x has 9", "`channels=`"])
    found = read(path, channels=["slow/x", "z"])
    assert (found.sample_rate, [c.unit for c in found.channels]) == (5.0, ["m", "-"])
    np.testing.assert_array_equal(found.values, WAVES[:, :9])


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_mdf_cut_short(share, tmp_path):
    path = mdf(tmp_path, "4.10", FAST)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert_refused(path, ["whole MDF file", "Copy or export it again"])


def hawc2(folder, kind="BINARY", start=0.0, names=("Time", "bea1 angle", "bea1 angle"), units=("s", "rad", "-")):
    """HAWC2's output of two channels, in its fixed columns, and what it holds."""
    table = np.vstack([start + 0.02 * np.arange(1, N + 1), WAVES])
    heads = enumerate(zip(names, units, strict=True), 1)
    rows = [f"{row:7d}     {name:<31}{unit:<11}what it is" for row, (name, unit) in heads]
    head = ["_" * 40, "  Version ID : HAWC2MB 13", *[""] * 6, f"{N:9d} {3:9d} {0.02 * N:12.3f}  {kind}", *["_"] * 3]
    scales = np.abs(table).max(axis=1) / 32000
    below = [] if kind == "ASCII" else ["", "Scale factors:", *(f"  {scale:.5E}" for scale in scales)]
    lines = [*head, *rows, *below]
    (folder / "run.sel").write_text("\n".join(lines) + "\n")
    if kind == "ASCII":
        np.savetxt(folder / "run.dat", table.T, fmt="%.9e")
        return folder / "run.sel", table
    scales = np.array([float(f"{scale:.5E}") for scale in scales])
    counts = np.rint(table / scales[:, None]).astype("<i2")
    (folder / "run.dat").write_bytes(counts.tobytes())
    return folder / "run.sel", counts * scales[:, None]


@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
@pytest.mark.parametrize("start", [0.0, 100.0])
def test_hawc2(kind, start, tmp_path):
    path, table = hawc2(tmp_path, kind, start)
    found = read(path)
    assert [(c.name, c.unit) for c in found.channels] == [("bea1 angle", "rad"), ("bea1 angle_2", "-")]
    np.testing.assert_allclose(found.values, table[1:], rtol=1e-9)
    assert found.sample_rate == 50.0
    assert found.start == pytest.approx(start + 0.02, abs=1e-9)
    np.testing.assert_array_equal(read(path, channels=["bea1 angle_2"], rate=2.0).values[0], found.values[1])


def test_hawc2_that_is_not_whole(tmp_path):
    path, _ = hawc2(tmp_path)
    data = (tmp_path / "run.dat").read_bytes()
    (tmp_path / "run.dat").write_bytes(data[:-1])
    assert_refused(path, ["all its samples beside it", "359 of 360 bytes", "Run HAWC2"])
    (tmp_path / "run.dat").write_bytes(data + bytes(7))
    assert "run.dat has 7 bytes behind its samples, which are not used." in read(path).provenance.steps
    (tmp_path / "run.dat").unlink()
    assert_refused(path, ["its samples beside it", "has no run.dat"])
    path.write_text("a head\n" * 20)
    assert_refused(path, ["whole head of HAWC2's output", "Run HAWC2 again"])
    path, _ = hawc2(tmp_path, "ASCII")
    lines = (tmp_path / "run.dat").read_text().splitlines()
    (tmp_path / "run.dat").write_text("\n".join(lines[:40]))
    found = read(path)
    assert f"The file is cut short: it declares {N} samples, and 40 are there." in found.provenance.steps
    (tmp_path / "run.dat").write_text("\n".join([*lines[:40], lines[40][:30]]))
    found = read(path)
    assert {"Line 41 has no line end and may be cut short: the file was read up to there."} <= set(
        found.provenance.steps
    )
    assert found.n_samples == 40
    (tmp_path / "run.dat").write_text("\n".join([*lines[:40], lines[40][:30], ""]))
    assert_refused(path, ["whole text output of HAWC2", "columns", "Mend that line"])
