"""Every file format that is written through the same laws, from the one table of formats."""

import os
import re
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import InputError
from floquid.io import GUARD
from floquid.readers import FORMATS, describe_file, read, write

NEEDS = {
    "comtrade": "comtrade", "excel": "python_calamine", "mdf": "asammdf", "parquet": "pyarrow", "tdms": "nptdms",
}  # fmt: skip
"""The module behind each extra."""


WRITTEN = [kind for kind in FORMATS if kind.save]


def of_every_format(kinds=WRITTEN):
    """Each format, skipped with its reason where the library that it needs is not there."""
    return pytest.mark.parametrize(
        "kind",
        [
            pytest.param(
                kind,
                id=kind.suffix,
                marks=pytest.mark.skipif(
                    bool(kind.needs) and find_spec(NEEDS[kind.needs]) is None,
                    reason=f'{kind.suffix} needs pip install "floquid[{kind.needs}]"',
                ),
            )
            for kind in kinds
        ],
    )


EVERY_FORMAT = of_every_format()
EVERY_WAY = of_every_format({kind.name: kind for kind in reversed(WRITTEN)}.values())
"""One suffix of each format: others are read and written alike, as the tests of all suffixes see."""

NO_CHECKSUMS = {".csv"}
"""Formats that cannot tell a changed sample from another one."""


def record(**changes):
    values = np.random.default_rng(3).standard_normal((3, 50))
    values[1, 7] = np.nan
    valid = {
        "values": values,
        "sample_rate": 2533.333333333334,
        "channels": [
            Channel(name="disc tip x (fixed frame)", unit="m", location="disc", direction="+x"),
            Channel(name='tacho, "A"; pulse', quantity="pulse", unit="V"),
            Channel(name="a [raw]", quantity="acceleration"),
        ],
        "clock": ConstantPeriod(period=0.015789473684210523, origin=0.001),
        "start": -0.25,
    }
    return Record(**(valid | changes))


def assert_same(found, expected):
    np.testing.assert_array_equal(found.values, expected.values)
    assert found.sample_rate == expected.sample_rate
    assert found.start == expected.start
    assert found.channels == expected.channels
    assert found.clock == expected.clock


@EVERY_FORMAT
def test_what_is_written_is_read(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    found = read(path)
    assert_same(found, record())
    assert found.provenance.sources == (str(path),)
    assert any("Sampling rate 2533.33333333 Hz" in step for step in found.provenance.steps)


@EVERY_FORMAT
def test_the_suffix_may_be_in_capitals_and_the_path_a_text(kind, tmp_path):
    path = str(tmp_path / f"RUN{kind.suffix.upper()}")
    write(record(), path)
    assert_same(read(path), record())


@EVERY_FORMAT
def test_values_are_read_only(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    assert not read(path).values.flags.writeable
    assert not read(path, channels=["a [raw]"]).values.flags.writeable


@EVERY_FORMAT
def test_channels_are_chosen_by_name_in_the_order_asked(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    names = ["a [raw]", "disc tip x (fixed frame)"]
    assert_same(read(path, channels=names), record().select(names))


@EVERY_FORMAT
def test_period_and_rate_of_the_caller_come_first(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    assert read(path, period=0.5).clock == ConstantPeriod(period=0.5)
    assert read(path, period=0.5, origin=0.1).clock == ConstantPeriod(period=0.5, origin=0.1)
    assert read(path, origin=0.1).clock == ConstantPeriod(period=0.015789473684210523, origin=0.1)
    found = read(path, rate=100.0)
    assert found.sample_rate == 100.0
    assert "Sampling rate 100 Hz: as given; the file states 2533.33333333 Hz." in found.provenance.steps


@EVERY_WAY
def test_a_single_channel_and_a_constant_channel_are_read(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    flat = Record(values=np.full((1, 9), 2.5), sample_rate=10.0, channels=["x"])
    write(flat, path)
    assert_same(read(path), flat)
    assert "Channel 'x' is constant (2.5 -): nothing moves it." in describe_file(path).notes


@EVERY_FORMAT
def test_the_summary_says_what_is_there(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    found, values = describe_file(path), record().values
    assert found.format == f"{kind.name} ({kind.suffix})"
    assert (found.n_samples, found.sample_rate, found.start) == (50, 2533.333333333334, -0.25)
    assert found.duration == 50 / 2533.333333333334
    assert any(channel.n_missing for channel in found.channels)
    assert [channel.n_missing for channel in found.channels] == [0, 1, 0]
    assert [channel.unit for channel in found.channels] == ["m", "V", "-"]
    assert [channel.quantity for channel in found.channels] == ["displacement", "pulse", "acceleration"]
    for channel, row in zip(found.channels, values, strict=True):
        np.testing.assert_allclose(channel.minimum, np.nanmin(row))
        np.testing.assert_allclose(channel.maximum, np.nanmax(row))
        np.testing.assert_allclose(channel.std, np.nanstd(row))
    why = {candidate.name: candidate.why for candidate in found.clock_candidates}
    assert why == {
        "period": "the file states a period of 0.0157894737 s, 40 samples",
        'tacho, "A"; pulse': "its quantity is pulse; its name has the word 'tacho'",
    }


@EVERY_WAY
def test_a_channel_without_samples_is_summarised(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(Record(values=[[np.nan] * 4, [1.0, 2.0, 3.0, 4.0]], sample_rate=10.0, channels=["x", "y"]), path)
    found = describe_file(path)
    assert found.channels[0].minimum is found.channels[0].std is None
    assert "Channel 'x' has no sample at all." in found.notes


@EVERY_WAY
def test_an_existing_file_outlives_a_failed_write(kind, tmp_path, monkeypatch):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    before = path.read_bytes()

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"run.*cannot be \(No space left on device\)"):
        write(record(start=5.0), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@EVERY_WAY
def test_an_existing_file_is_replaced(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    path.write_text("before")
    path.chmod(0o640)
    write(record(), path)
    assert_same(read(path), record())
    assert path.stat().st_mode & 0o777 == 0o640


@EVERY_WAY
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"values": np.ones((3, 1))}, "hold at least two samples, but holds 1"),
        ({"channels": ["x", "y\n", "z"]}, None),
        ({"channels": ["x", "a\nb", "z"]}, "plain words, but has 'a\\nb'"),
        ({"channels": ["x", "\ud800", "z"]}, "plain words, but has '\\ud800'"),
    ],
)
def test_a_record_that_could_not_be_read_back_is_not_written(kind, tmp_path, changes, words):
    path = tmp_path / f"run{kind.suffix}"
    if words is None:  # the name is stripped by `Channel` itself
        write(record(**changes), path)
        assert read(path).channels[1].name == "y"
        return
    with pytest.raises(InputError, match=re.escape(words)):
        write(record(**changes), path)
    assert not list(tmp_path.iterdir())


@EVERY_WAY
@pytest.mark.parametrize("cut", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_file_cut_short_is_refused_or_whole_rows_are_read(kind, tmp_path, cut):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(cut * len(data))])
    try:
        found = read(path)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
    else:
        assert kind.suffix == ".csv"  # a text table has no end mark; all but the last row must be right
        n = found.n_samples - 1
        np.testing.assert_array_equal(found.values[:, :n], record().values[:, :n])


@EVERY_WAY
def test_random_damage_never_raises_anything_else(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    write(record(), path)
    data, rng, refused = path.read_bytes(), np.random.default_rng(11), 0
    for _ in range(30):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 6)):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(bytes(damaged))
        for call in (read, describe_file):
            try:
                call(path)
            except InputError as error:
                refused += 1
                assert str(path) in str(error)  # noqa: PT017
    assert refused > (4 if kind.suffix in NO_CHECKSUMS else 20)


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if not kind.save], ids=lambda kind: kind.suffix)
def test_a_format_that_is_only_read_is_refused_with_those_that_are_written(kind, tmp_path):
    with pytest.raises(InputError, match=r"`path` of `write` must end in one of \.npz, .*\.parquet, but "):
        write(record(), tmp_path / f"run{kind.suffix}")
    assert not list(tmp_path.iterdir())


@of_every_format([kind for kind in FORMATS if kind.needs])
@pytest.mark.parametrize("call", [read, describe_file, lambda path: write(record(), path)])
def test_a_missing_library_is_named_with_what_to_install(kind, call, tmp_path, monkeypatch):
    path = tmp_path / f"run{kind.suffix}"
    path.write_bytes(b"whatever it is")
    if call not in (read, describe_file) and not kind.save:
        return
    before = path.read_bytes()
    for module in [name for name in sys.modules if name.partition(".")[0] == NEEDS[kind.needs]]:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, NEEDS[kind.needs], None)
    monkeypatch.setattr(GUARD, "_serving", True)  # else a child looks for it, which has it
    with pytest.raises(InputError, match=re.escape(f'pip install "floquid[{kind.needs}]"')) as caught:
        call(path)
    assert f"works with the package {NEEDS[kind.needs]}" in str(caught.value)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@EVERY_WAY
def test_the_orbit_is_kept(kind, tmp_path):
    path, orbit = tmp_path / f"run{kind.suffix}", np.random.default_rng(4).standard_normal((3, 7))
    write(record(orbit=orbit), path)
    found = read(path, channels=["a [raw]", "disc tip x (fixed frame)"]).orbit
    if kind.suffix in (".uff", ".unv"):
        assert found is None
        return
    np.testing.assert_array_equal(found, orbit[[2, 0]])


@EVERY_WAY
def test_a_long_record_is_written_and_read_in_blocks(kind, tmp_path):
    path = tmp_path / f"run{kind.suffix}"
    long = Record(values=np.random.default_rng(5).standard_normal((2, 70001)), sample_rate=51200.0, channels=["x", "y"])
    write(long, path)
    assert_same(read(path), long)
