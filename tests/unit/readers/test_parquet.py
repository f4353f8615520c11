"""Parquet files as pandas and polars write them, and as others read ours."""

import numpy as np
import pytest
from tests.contracts.test_readers_bad_input import assert_refused

from floquid.core import Channel, ConstantPeriod, Record
from floquid.readers import describe_file, read, write

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

TIME = np.arange(40) / 64.0
X = np.random.default_rng(0).standard_normal(40)


def saved(folder, table, **options):
    path = folder / "run.parquet"
    parquet.write_table(table if isinstance(table, pa.Table) else pa.table(table), path, **options)
    return path


def test_columns_headed_as_in_a_text_table(tmp_path):
    path = saved(tmp_path, {"x [m/s^2]": X, "time [ms]": 1e3 * TIME, "tach (V)": X > 0, "who": ["a"] * 40})
    found = read(path)
    assert [(c.name, c.unit) for c in found.channels] == [("x", "m/s^2"), ("tach", "V")]
    assert found.sample_rate == 64.0
    np.testing.assert_array_equal(found.values, [X, X > 0])
    assert "Column 'who' is not of numbers, and is not used." in found.provenance.steps


@pytest.mark.parametrize("kind", ["int8", "uint16", "int32", "uint64", "float16", "float32", "float64", "bool"])
def test_every_kind_of_number(kind, tmp_path):
    values = (10 * X).clip(0).astype(kind)
    found = read(saved(tmp_path, {"time": TIME, "x": pa.array(values)}))
    np.testing.assert_array_equal(found.values[0], values.astype(float))


def test_a_null_is_a_missing_sample(tmp_path):
    for values in ([1, None, 3, 4], [1.0, None, 3.0, 4.0], [True, None, True, True]):
        found = read(saved(tmp_path, {"time": [0.0, 1.0, 2.0, 3.0], "x": values}))
        assert np.isnan(found.values[0]).tolist() == [False, True, False, False]


def test_decimals_and_dictionaries(tmp_path):
    from decimal import Decimal

    prices = pa.array([Decimal("1.25")] * 40)
    codes = pa.array(["a", "b"] * 20).dictionary_encode()
    found = read(saved(tmp_path, {"time": TIME, "x": prices, "code": codes}))
    assert [c.name for c in found.channels] == ["x"]
    np.testing.assert_array_equal(found.values[0], np.full(40, 1.25))


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_dates_count_from_the_first(unit, tmp_path):
    steps = np.arange(40) * {"s": 1, "ms": 10, "us": 10_000, "ns": 10_000_000}[unit]
    dates = np.datetime64("2026-03-01T12:00:00", unit) + steps.astype(f"m8[{unit}]")
    found = read(saved(tmp_path, {"when": dates, "x": X}))
    assert (found.sample_rate, found.start) == (1.0 if unit == "s" else 100.0, 0.0)
    assert any("dates: they count from the first" in step for step in found.provenance.steps)


def test_spans_are_times(tmp_path):
    found = read(saved(tmp_path, {"since": np.arange(40).astype("m8[ms]"), "x": X}))
    assert (found.sample_rate, [c.name for c in found.channels]) == (1000.0, ["x"])


def test_what_pandas_writes(tmp_path):
    pd = pytest.importorskip("pandas")
    path = tmp_path / "run.parquet"
    dates = pd.date_range("2026-03-01", periods=40, freq="10ms")
    pd.DataFrame({"x [m]": X}, index=dates).to_parquet(path)
    found = read(path)
    assert (found.sample_rate, [c.label for c in found.channels]) == (100.0, ["x [m]"])
    pd.DataFrame({"x [m]": X}, index=pd.Index(TIME, name="time [s]")).to_parquet(path)
    assert read(path).sample_rate == 64.0
    pd.DataFrame({"x [m]": X, "y": X})[::2].to_parquet(path)  # the numbers of the rows are no times
    assert_refused(path, ["neither a rate nor a column of times", "`rate=`"])
    assert read(path, rate=5.0).n_channels == 2


def test_a_unit_in_the_metadata_of_a_field(tmp_path):
    schema = pa.schema([pa.field("t", pa.float64(), metadata={"unit": "ms"}), pa.field("a", pa.float64())])
    schema = schema.append(pa.field("b", pa.float64(), metadata={"units": "m/s"}))
    found = read(saved(tmp_path, pa.table([1e3 * TIME, X, X], schema=schema)))
    assert found.sample_rate == 64.0
    assert [c.unit for c in found.channels] == ["-", "m/s"]


def test_several_groups_and_codecs_and_versions(tmp_path):
    for options in ({"row_group_size": 7}, {"compression": "gzip"}, {"data_page_version": "2.0"}, {"version": "1.0"}):
        np.testing.assert_array_equal(read(saved(tmp_path, {"time": TIME, "x": X}, **options)).values[0], X)


def test_names_with_points_and_names_that_begin_alike(tmp_path):
    found = read(saved(tmp_path, {"time": TIME, "a": X, "a.b": 2 * X, "a.b.c": 3 * X}), channels=["a.b", "a"])
    np.testing.assert_array_equal(found.values, [2 * X, X])


def record():
    channels = [Channel(name="x", unit="m"), Channel(name="tach", quantity="pulse", unit="V")]
    return Record(values=[X, -X], sample_rate=64.0, channels=channels, start=2.0, clock=ConstantPeriod(period=0.5))


def test_others_read_what_is_written(tmp_path):
    path = tmp_path / "run.parquet"
    write(record(), path)
    table = parquet.read_table(path)
    assert table.column_names == ["time [s]", "x [m]", "tach [V]"]
    np.testing.assert_array_equal(table["time [s]"].to_numpy(), record().times)
    np.testing.assert_array_equal(table["tach [V]"].to_numpy(), -X)
    assert table.schema.field("x [m]").metadata == {b"unit": b"m"}


def test_rows_cut_off_move_the_start(tmp_path):
    path = tmp_path / "run.parquet"
    write(record(), path)
    parquet.write_table(parquet.read_table(path).slice(10), path)
    found = read(path)
    assert (found.start, found.sample_rate, found.clock) == (2.0 + 10 / 64, 64.0, ConstantPeriod(period=0.5))


def test_rows_left_out_contradict_the_rate_that_is_stated(tmp_path):
    path = tmp_path / "run.parquet"
    write(record(), path)
    parquet.write_table(parquet.read_table(path).take(list(range(0, 40, 2))), path)
    assert_refused(path, ["states 64 Hz", "its times make 32 Hz", "`rate=`"])


def test_a_changed_sample_is_found(tmp_path):
    path = tmp_path / "run.parquet"
    many = Record(values=np.random.default_rng(1).standard_normal((1, 5000)), sample_rate=1.0, channels=["x"])
    write(many, path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert_refused(path, ["whole Parquet file", "Copy"])


def test_the_summary(tmp_path):
    path = saved(tmp_path, {"time": TIME, "azimuth [deg]": 90.0 * np.arange(40) % 360.0, "x": X})
    found = describe_file(path)
    assert [c.quantity for c in found.channels] == ["angle", "displacement"]
    assert [(c.name, c.kind) for c in found.clock_candidates] == [("azimuth", "azimuth")]


def test_the_count_of_rows_that_pandas_writes_is_named_for_what_it_is(tmp_path):
    pd = pytest.importorskip("pandas")
    path = tmp_path / "run.parquet"
    pd.DataFrame({"x": X}, index=np.arange(7, 47)).to_parquet(path)
    steps = read(path, rate=64.0).provenance.steps
    assert any(step.startswith("The index of the table has no name, and is not used") for step in steps)
    assert not any("not of numbers" in step for step in steps)
