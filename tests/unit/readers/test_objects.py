"""Records to and from objects of other libraries: pandas, xarray, and the dictionaries of SEP005."""

import importlib
import json
import sys
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from floquid import from_pandas, from_sep005, from_xarray, to_pandas, to_sep005, to_xarray
from floquid.core import Channel, ConstantPeriod, PulseTimes, Record
from floquid.errors import InputError


class Late:
    """A library that is imported when it is used: the others that collect these tests need it not."""

    def __init__(self, name):
        self.name = name

    def __getattr__(self, name):
        if name.startswith("_"):  # which pytest asks of whatever a module of tests holds
            raise AttributeError(name)
        return getattr(importlib.import_module(self.name), name)


pd, xr = Late("pandas"), Late("xarray")

WAYS = {
    "pandas": lambda record: from_pandas(to_pandas(record)),
    "xarray": lambda record: from_xarray(to_xarray(record)),
    "sep005": lambda record: from_sep005(to_sep005(record)),
}
EVERY_WAY = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)

CHANNELS = (
    Channel(name="x", unit="mm", location="blade 3", direction="+X"),
    Channel(name="tach [odd] (name)", quantity="pulse", unit="V"),
    Channel(name="α", quantity="angle", unit="deg"),
    Channel(name="F", unit="N"),
)


def example(**changes):
    values = np.random.default_rng(0).normal(size=(4, 50))
    values[1, 7] = np.nan
    valid = {"values": values, "sample_rate": 51200 / 3, "channels": CHANNELS, "start": -0.7}
    return Record(**(valid | changes))


def assert_same(one, other):
    """Every number to its last bit."""
    np.testing.assert_array_equal(one.values, other.values)
    assert (one.sample_rate, one.start, one.clock) == (other.sample_rate, other.start, other.clock)
    assert one.channels == other.channels
    assert (one.orbit is None) == (other.orbit is None)
    if one.orbit is not None:
        np.testing.assert_array_equal(one.orbit, other.orbit)


@st.composite
def records(draw):
    numbers = st.floats(-1e6, 1e6)
    n_channels, n_samples = draw(st.integers(1, 4)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    period = draw(st.none() | st.floats(1e-3, 1e3))
    return Record(
        values=rng.normal(size=(n_channels, n_samples)) * 10.0 ** draw(st.integers(-200, 200)),
        sample_rate=draw(st.floats(1e-3, 1e7)),
        channels=draw(st.permutations(CHANNELS))[:n_channels],
        clock=None if period is None else ConstantPeriod(period=period, origin=draw(numbers)),
        start=draw(numbers),
        orbit=rng.normal(size=(n_channels, draw(st.integers(1, 5)))) if draw(st.booleans()) else None,
    )


@EVERY_WAY
@given(record=records())
def test_there_and_back_nothing_is_lost(way, record):
    assert_same(way(record), record)


@EVERY_WAY
def test_missing_samples_stay_missing(way):
    assert np.isnan(way(example()).values[1, 7])


@EVERY_WAY
def test_the_record_is_no_view_of_the_object_and_the_object_none_of_the_record(way):
    assert not np.shares_memory(way(example()).values, example().values)
    record = example()
    frame, data, signals = to_pandas(record), to_xarray(record), to_sep005(record)
    frame.iloc[0, 0] = data["response"][0, 0] = signals[0]["data"][0] = 99.0
    assert record.values[0, 0] != 99.0


@EVERY_WAY
def test_provenance_says_where_it_came_from(way):
    provenance = way(example()).provenance
    assert len(provenance.sources) == 1
    assert "4 channels of 50 samples" in provenance.steps[0]
    assert any("17066.6" in step for step in provenance.steps)


@EVERY_WAY
def test_a_clock_that_no_object_holds_is_given_again(way):
    clock = PulseTimes(times=np.array([0.0, 1.0]))
    assert way(example(clock=clock)).clock is None


MAKERS = {
    "pandas": lambda values, **options: from_pandas(pd.DataFrame(values.T, columns=["a", "b"]), **options),
    "xarray": lambda values, **options: from_xarray(
        xr.DataArray(values, dims=("channel", "time"), coords={"channel": ["a", "b"]}), **options
    ),
    "sep005": lambda values, **options: from_sep005(
        [{"data": row, "name": name, "unit_str": "-", "fs": 1.0} for name, row in zip("ab", values, strict=True)],
        **options,
    ),
}
EVERY_MAKER = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)


@EVERY_MAKER
def test_what_is_given_is_used(make):
    values = np.arange(6.0).reshape(2, 3)
    record = make(values, rate=8.0, units={"b": "mm/s"}, period=2.0, origin=0.5)
    np.testing.assert_array_equal(record.values, values)
    assert (record.sample_rate, record.start) == (8.0, 0.0)
    assert record.clock == ConstantPeriod(period=2.0, origin=0.5)
    assert [(c.name, c.unit, c.quantity) for c in record.channels] == [
        ("a", "-", "displacement"),
        ("b", "mm/s", "velocity"),
    ]


@EVERY_MAKER
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rate": 0.0}, "`rate` .* must be positive"),
        ({"rate": 1.0, "period": -1.0}, "`period` .* must be positive"),
        ({"rate": 1.0, "origin": 1.0}, "`origin` .* must come with a period"),
        ({"rate": 1.0, "period": 1e-9, "origin": 1e9}, "`origin` .* must be near enough"),
        ({"rate": 1.0, "units": {"c": "m"}}, "`units` .* must give units by the names of channels, but has"),
        ({"rate": 1.0, "units": "m"}, "`units` .* must give units by the names"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_an_impossible_argument_is_refused(make, options, words):
    with pytest.raises(InputError, match=words):
        make(np.arange(6.0).reshape(2, 3), **options)


@EVERY_MAKER
@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.array([[1.0, np.inf], [1.0, 2.0]]), "hold finite samples .* first in channel 'a', sample 1"),
        (np.array([[1j, 1.0], [1.0, 2.0]]), "hold real numbers, but it has complex128"),
        (np.zeros((2, 0)), "hold samples, but it holds none"),
    ],
    ids=["infinite", "complex", "empty"],
)
def test_samples_that_are_no_samples_are_refused(make, values, words):
    with pytest.raises(InputError, match=words):
        make(values, rate=1.0)


# pandas


def frame(index, **changes):
    return pd.DataFrame({"x [mm]": np.arange(len(index), dtype=float), "y": 1.0} | changes, index=index)


STEPS = np.arange(100) * 0.004
INDEXES = {
    "fractions": (lambda: pd.Index(STEPS + 3.0), 3.0),
    "milliseconds": (lambda: pd.Index(np.arange(100) * 4, name="time [ms]"), 0.0),
    "durations": (lambda: pd.to_timedelta(STEPS + 1.0, unit="s"), 1.0),
    "dates": (lambda: pd.date_range("2026-03-29T01:59:59.9", periods=100, freq="4ms"), 0.0),
    "dates across the change of the clocks": (
        lambda: pd.date_range("2026-03-29T01:59:59.9", periods=100, freq="4ms", tz="Europe/Berlin"),
        0.0,
    ),
    "whole microseconds": (lambda: pd.DatetimeIndex(np.arange(100) * 4000 + 10**15, dtype="datetime64[us]"), 0.0),
}


@pytest.mark.parametrize(("index", "start"), INDEXES.values(), ids=INDEXES)
def test_the_index_is_the_time(index, start):
    index = index()
    record = from_pandas(frame(index))
    assert (record.sample_rate, record.start) == (250.0, start)
    assert [c.label for c in record.channels] == ["x [mm]", "y [-]"]
    told = any("count from the first, " in step for step in record.provenance.steps)
    assert told == isinstance(index, pd.DatetimeIndex)


def test_dates_rounded_by_the_clock_that_took_them():
    """To whole microseconds, which are more than a hundredth of a step."""
    dates = pd.DatetimeIndex(np.round(np.arange(4000) / 51200 * 1e6).astype("int64") + 10**15, dtype="datetime64[us]")
    assert from_pandas(frame(dates.astype("datetime64[ns]"))).sample_rate == 51200.0


def test_a_column_is_the_time_where_the_index_is_not():
    table = pd.DataFrame({"time [ms]": np.arange(20) * 2.0, "x": np.arange(20.0)})
    record = from_pandas(table)
    assert (record.sample_rate, [c.name for c in record.channels]) == (500.0, ["x"])
    given = from_pandas(table, rate=7.0)
    assert (given.sample_rate, [c.name for c in given.channels]) == (7.0, ["x"])
    dates = table.assign(**{"time [ms]": pd.date_range("2026-01-01", periods=20, freq="1s")})
    assert from_pandas(dates.rename(columns={"time [ms]": "timestamp"})).sample_rate == 1.0


def test_a_table_read_from_our_csv_is_the_record(tmp_path):
    record = example(
        sample_rate=1000.0, channels=[Channel(name=n, unit=u) for n, u in zip("abcd", "m- N", strict=True)]
    )
    to_pandas(record).to_csv(tmp_path / "run.csv")
    back = from_pandas(pd.read_csv(tmp_path / "run.csv"))
    # pandas before 3 reads a decimal to its last digit but one
    np.testing.assert_allclose(back.values, record.values, rtol=1e-14)
    assert (back.sample_rate, back.start) == (1000.0, -0.7)
    assert [c.unit for c in back.channels] == ["m", "-", "-", "N"]


def test_rows_left_out_are_missing_samples():
    table = to_pandas(example(sample_rate=1000.0, clock=ConstantPeriod(period=0.3))).drop(index=[-0.7 + 0.005])
    record = from_pandas(table)
    assert record.n_samples == 50
    assert np.flatnonzero(np.isnan(record.values[0])).tolist() == [5]
    assert (record.sample_rate, record.clock) == (1000.0, ConstantPeriod(period=0.3))


def test_attributes_that_are_out_of_date_do_not_count():
    """pandas keeps them when every second row is taken, and the rate in them is then wrong."""
    half = from_pandas(to_pandas(example(sample_rate=1000.0)).iloc[::2])
    assert half.sample_rate == 500.0
    assert any("1000 Hz is stated" in step for step in half.provenance.steps)
    tail = from_pandas(to_pandas(example(sample_rate=1000 / 3)).iloc[10:])
    assert (tail.sample_rate, tail.start) == (1000 / 3, pytest.approx(-0.7 + 0.03, abs=1e-12))
    with pytest.raises(InputError, match="say its sampling rate"):
        from_pandas(to_pandas(example()).reset_index(drop=True))


def test_columns_chosen_and_renamed():
    record = example(orbit=np.arange(8.0).reshape(4, 2))
    chosen = from_pandas(to_pandas(record)[["F [N]", "x [mm]"]])
    assert [c.name for c in chosen.channels] == ["F", "x"]
    assert chosen.orbit.tolist() == [[6.0, 7.0], [0.0, 1.0]]
    renamed = from_pandas(to_pandas(record).rename(columns={"F [N]": "thrust [kN]"}))
    assert renamed.channels[3] == Channel(name="thrust", unit="kN")
    assert renamed.orbit is None
    assert any("orbit" in step for step in renamed.provenance.steps)


def test_units_by_the_attributes_of_a_table():
    table = frame(pd.Index(STEPS))
    table.attrs["units"] = {"y": "m/s"}
    assert [c.unit for c in from_pandas(table).channels] == ["mm", "m/s"]


def test_a_series_is_one_channel():
    series = pd.Series(np.arange(100.0), index=STEPS, name="x [m/s^2]")
    record = from_pandas(series)
    assert record.channels == (Channel(name="x", unit="m/s^2"),)


def test_numbers_that_may_be_missing():
    columns = {"a": pd.array([1, None, 3], dtype="Int64"), "b": pd.array([True, False, None], dtype="boolean")}
    record = from_pandas(pd.DataFrame(columns), rate=1.0)
    np.testing.assert_array_equal(record.values, [[1.0, np.nan, 3.0], [1.0, 0.0, np.nan]])


def test_columns_of_several_levels():
    columns = pd.MultiIndex.from_tuples([("blade 1", "x"), ("blade 1", "y")])
    record = from_pandas(pd.DataFrame(np.zeros((3, 2)), columns=columns), rate=1.0)
    assert [c.name for c in record.channels] == ["blade 1/x", "blade 1/y"]


def test_the_attributes_survive_parquet(tmp_path):
    pytest.importorskip("pyarrow")
    record = example(clock=ConstantPeriod(period=0.3, origin=0.1), orbit=np.ones((4, 3)))
    assert json.loads(json.dumps(to_pandas(record).attrs)) == to_pandas(record).attrs
    to_pandas(record).to_parquet(tmp_path / "run.parquet")
    assert_same(from_pandas(pd.read_parquet(tmp_path / "run.parquet")), record)


REFUSED_FRAMES = {
    "text": (lambda: frame(pd.Index(STEPS), note="ok"), "hold real numbers, but it has .* in 'note'"),
    "no times": (
        lambda: pd.DataFrame({"x": [1.0, 2.0]}),
        "say its sampling rate, but it has neither a rate nor a column of times",
    ),
    "whole numbers": (lambda: frame(pd.Index([3, 5, 7])), "say its sampling rate"),
    "another name": (lambda: frame(pd.Index(STEPS, name="depth [m]")), "say its sampling rate"),
    "uneven": (lambda: frame(pd.Index(STEPS**1.5)), "evenly spaced"),
    "backwards": (lambda: frame(pd.Index(STEPS[::-1])), "times that increase"),
    "not a time": (lambda: frame(pd.DatetimeIndex(["2026-01-01", None, "2026-01-03"])), "finite time"),
    "time alone": (lambda: pd.DataFrame({"t": STEPS}), "a column for each channel"),
    "text as times": (lambda: pd.DataFrame({"time": ["a", "b"], "x": [1.0, 2.0]}), "numbers, durations or dates"),
    "doubled": (lambda: pd.DataFrame(np.zeros((3, 2)), columns=["x", "x"], index=[0.1, 0.2, 0.3]), "distinct names"),
    "no frame": (lambda: np.zeros((3, 2)), "be a DataFrame or a Series"),
    "unit": (lambda: frame(pd.Index(STEPS, name="time [furlong]")), "in one of s, ms"),
}


@pytest.mark.parametrize(("table", "words"), REFUSED_FRAMES.values(), ids=REFUSED_FRAMES)
def test_a_table_that_is_no_record_is_refused(table, words):
    table = table()
    with pytest.raises(InputError, match=rf"^Argument `frame` of `from_pandas` must .*{words}"):
        from_pandas(table)


@pytest.mark.parametrize(
    "own", [3, {"channels": 3}, {"sample_rate": "x"}, {"period": -1.0}, {"orbit": {"x [mm]": [1.0], "y": "?"}}], ids=str
)
def test_attributes_that_are_damaged_are_refused(own):
    table = frame(pd.Index(STEPS))
    table.attrs["floquid"] = own
    with pytest.raises(InputError, match=r"`frame` of `from_pandas`"):
        from_pandas(table)


# xarray


def array(time=STEPS, dims=("time",), **coordinates):
    return xr.DataArray(np.arange(100.0), dims=dims, coords={"time": time} | coordinates, name="x")


def test_a_user_finds_what_is_expected():
    data = to_xarray(example(clock=ConstantPeriod(period=0.3, origin=0.1)))
    assert data["response"].dims == ("channel", "time")
    assert data["time"].attrs["units"] == "s"
    assert data["unit"].sel(channel="F").item() == "N"
    assert data["response"].attrs == {"sample_rate": 51200 / 3, "period": 0.3, "origin": 0.1}
    one = from_xarray(data["response"].sel(channel="x"))
    assert one.channels == (CHANNELS[0],)


def test_the_array_alone_is_enough_and_its_order_does_not_matter():
    record = example(clock=ConstantPeriod(period=0.3, origin=0.1))
    assert_same(from_xarray(to_xarray(record)["response"].transpose("time", "channel")), record)


def test_a_variable_a_channel():
    data = xr.Dataset(
        {"u": ("time", STEPS, {"units": "m/s"}), "v": ("time", -STEPS)}, coords={"time": STEPS}, attrs={"period": 0.1}
    )
    record = from_xarray(data)
    assert record.channels == (Channel(name="u", unit="m/s"), Channel(name="v"))
    assert record.clock == ConstantPeriod(period=0.1)


def test_coordinates_of_time():
    assert from_xarray(array(pd.date_range("2026-01-01", periods=100, freq="4ms"))).sample_rate == 250.0
    assert from_xarray(array((STEPS * 1e9).astype("timedelta64[ns]"))).sample_rate == 250.0
    milliseconds = array(STEPS * 1e3)
    milliseconds["time"].attrs["units"] = "ms"
    assert from_xarray(milliseconds).sample_rate == 250.0
    other = array().rename(time="t")
    assert from_xarray(other, time="t").sample_rate == 250.0


@pytest.mark.slow
def test_netcdf_in_between(tmp_path):
    pytest.importorskip("scipy")
    record = example(clock=ConstantPeriod(period=0.3, origin=0.1), orbit=np.ones((4, 3)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        to_xarray(record).to_netcdf(tmp_path / "run.nc", engine="scipy")
        with xr.open_dataset(tmp_path / "run.nc", engine="scipy") as data:
            assert_same(from_xarray(data.load()), record)


REFUSED_ARRAYS = {
    "no time": (lambda: xr.DataArray(np.zeros((2, 3)), dims=("a", "b")), "have the dimension `time`"),
    "three": (lambda: xr.DataArray(np.zeros((2, 3, 4)), dims=("a", "b", "time")), "have the dimension `time`"),
    "no times": (lambda: xr.DataArray(np.zeros((2, 3)), dims=("a", "time")), "say its sampling rate"),
    "mixed": (
        lambda: xr.Dataset({"u": ("time", STEPS), "v": ("z", STEPS)}),
        "variables over `time` alone",
    ),
    "empty": (lambda: xr.Dataset({}), "has no variable"),
    "unit": (lambda: array().assign_coords(time=("time", STEPS, {"units": "furlong"})), "in one of s, ms"),
    "text": (lambda: array().astype(str), "hold real numbers"),
    "number": (lambda: array().assign_attrs(sample_rate="fast"), "positive number as `sample_rate`"),
    "no array": (lambda: np.zeros(3), "be a DataArray or a Dataset"),
    "orbit": (
        lambda: to_xarray(example(orbit=np.ones((4, 3)))).isel(channel=0),
        "have `orbit` over `channel` and phases",
    ),
}


@pytest.mark.parametrize(("data", "words"), REFUSED_ARRAYS.values(), ids=REFUSED_ARRAYS)
def test_an_array_that_is_no_record_is_refused(data, words):
    data = data()
    with pytest.raises(InputError, match=rf"^Argument `data` of `from_xarray` must .*{words}"):
        from_xarray(data)


# SEP005


def signal(**changes):
    return {"data": np.arange(10.0), "name": "x", "unit_str": "m/s²", "fs": 50.0} | changes


def test_what_we_give_is_sep005_by_its_own_assertion():
    from sdypy_sep005.sep005 import assert_sep005

    assert_sep005(to_sep005(example(clock=ConstantPeriod(period=0.3), orbit=np.ones((4, 3)))))


def test_a_single_dictionary_is_one_channel():
    record = from_sep005(signal(quantity="a", group="tower"))
    assert record.channels == (Channel(name="x", unit="m/s²", location="tower"),)
    assert record.sample_rate == 50.0


def test_times_and_a_date():
    times = [0.5 + 0.02 * n for n in range(10)]
    record = from_sep005([signal(fs=None, time=times, start_timestamp="2026-08-16T01:00:00")])
    assert (record.sample_rate, record.start) == (50.0, 0.5)
    assert any("2026-08-16T01:00:00" in step for step in record.provenance.steps)
    assert from_sep005(signal(time=times)).start == 0.5


def test_samples_that_are_none_are_missing():
    assert np.isnan(from_sep005(signal(data=[1, None, 3])).values[0, 1])


def test_groups_tell_equal_names_apart():
    record = from_sep005([signal(group="a"), signal(group="b")])
    assert [c.name for c in record.channels] == ["a/x", "b/x"]


REFUSED_SIGNALS = {
    "rates": ([signal(), signal(name="y", fs=51.0)], "has `fs` of 'y' other than of 'x': 51.0 and 50.0"),
    "lengths": ([signal(), signal(name="y", data=np.zeros(9))], "has samples of 'y' other than of 'x': 9 and 10"),
    "dates": ([signal(), signal(name="y", start_timestamp="2026-01-01")], "`start_timestamp` of 'y'"),
    "times": (
        [signal(time=np.arange(10.0)), signal(name="y", time=np.arange(10.0) + 1)],
        "has `time` of 'y' other than of 'x'",
    ),
    "key": ([signal(), {"data": [1.0], "name": "y"}], "has number 1 without `unit_str`"),
    "no dictionary": ([signal(), 3], "number 1 without any, being no dictionary"),
    "no rate": ([signal(fs=None)], "say its sampling rate"),
    "contradiction": (
        [signal(time=np.arange(10) * 0.04)],
        "states 50 Hz, while its times make 25 Hz: 9 samples apart",
    ),
    "times and samples": ([signal(fs=None, time=[0.0, 0.1])], "a time for each sample"),
    "two dimensions": ([signal(data=np.zeros((2, 3)))], "one dimension"),
    "negative": ([signal(fs=-50.0)], "positive number as `fs`"),
    "quantity": ([signal(quantity="d")], "hold a valid record, but it does not: .*a unit of acceleration"),
    "doubled": ([signal(), signal()], "distinct names"),
    "none": ([], "be a list of dictionaries"),
    "text": ("x", "be a list of dictionaries"),
    "orbit": ([signal(orbit=[1.0]), signal(name="y")], "`orbit` of as many phases"),
}


@pytest.mark.parametrize(("signals", "words"), REFUSED_SIGNALS.values(), ids=REFUSED_SIGNALS)
def test_signals_that_are_no_record_are_refused(signals, words):
    with pytest.raises(InputError, match=rf"^Argument `signals` of `from_sep005` must .*{words}"):
        from_sep005(signals)


# What is not installed


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("pandas", lambda: from_pandas(None)),
        ("pandas", lambda: to_pandas(example())),
        ("xarray", lambda: from_xarray(None)),
        ("xarray", lambda: to_xarray(example())),
    ],
)
def test_a_library_that_is_not_installed_is_named(monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        InputError, match=rf'the package {package}, .*\n  Install it: pip install "floquid\[{package}\]"'
    ):
        call()


def test_a_column_of_times_comes_before_rows_numbered_in_fractions():
    """As a merge leaves them."""
    times = np.arange(50) / 500.0
    frame = pd.DataFrame({"time [s]": times, "x [m]": np.sin(times)}, index=np.arange(50.0))
    found = from_pandas(frame)
    assert found.sample_rate == 500.0
    assert [channel.name for channel in found.channels] == ["x"]
    assert from_pandas(frame.drop(columns="time [s]")).sample_rate == 1.0
