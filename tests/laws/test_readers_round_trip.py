"""What is written is read back, number for number; and a rounded time column gives its rate back."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from floquid.core import Channel, ConstantPeriod, Record
from floquid.io import Source
from floquid.readers import FORMATS, read, write
from floquid.tables import TimeColumn, repair

WORDS = st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=12)
UNITS = st.sampled_from(["-", "m", "µm", "rad", "V", "m/s^2", "°", "a]b", "[x", "s", 'in"', "a,b", "; "])
CHANNELS = st.builds(
    lambda name, unit, quantity, place: Channel(
        name=name, unit=unit, quantity=quantity, location=place, direction=place
    ),
    WORDS.filter(lambda text: text.strip()),
    UNITS,
    st.sampled_from([None, "other"]),
    WORDS,
)
WRITTEN = list({kind.name: kind for kind in reversed(FORMATS) if kind.save}.values())
"""One suffix of each format."""
NUMBERS = st.floats(allow_infinity=False, width=64)


@st.composite
def records(draw):
    channels = draw(st.lists(CHANNELS, min_size=1, max_size=4, unique_by=lambda channel: channel.name))
    values = draw(hnp.arrays(np.float64, (len(channels), draw(st.integers(2, 12))), elements=NUMBERS))
    rate = draw(st.floats(1e-3, 1e6))
    clock = None
    if draw(st.booleans()):
        clock = ConstantPeriod(period=draw(st.floats(1e-6, 1e6)), origin=draw(st.floats(-1e6, 1e6)))
    return Record(values=values, sample_rate=rate, channels=channels, clock=clock, start=draw(st.floats(-1e3, 1e3)))


@pytest.mark.parametrize("kind", WRITTEN, ids=[kind.suffix for kind in WRITTEN])
@given(record=records())
def test_round_trip(kind, record):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{kind.suffix}"
        write(record, path)
        found = read(path)
    assert found.values.tobytes() == record.values.tobytes() or (
        np.array_equal(found.values, record.values, equal_nan=True)
        and np.array_equal(np.signbit(found.values), np.signbit(record.values) & ~np.isnan(record.values))
    )
    assert found.sample_rate == record.sample_rate
    assert found.start == record.start
    assert found.channels == record.channels
    assert found.clock == record.clock


def repaired(times):
    return repair(TimeColumn(values=times, scale=1.0, label="time"), Source(name="run.csv", of="read"))


@given(
    rate=st.floats(1e-2, 1e5),
    start=st.floats(-100, 100),
    n=st.integers(3, 400),
    fineness=st.floats(4.0, 1e4),
    cut=st.booleans(),
)
def test_the_rate_is_right_to_the_rounding_of_the_column(rate, start, n, fineness, cut):
    decimals = int(np.ceil(np.log10(rate * fineness)))
    assume(0 <= decimals <= 9)
    quantum = 10.0**-decimals
    exact = start + np.arange(n) / rate
    times = np.floor(exact * 10.0**decimals) / 10.0**decimals if cut else np.round(exact, decimals)
    axis = repaired(times)
    assert axis.positions is None
    drift = abs(1.0 / axis.sample_rate - 1.0 / rate) * n
    assert drift <= 2.0 * quantum + 1e-12 * abs(exact).max()
    assert abs(axis.start - start) <= 2.0 * quantum + 1e-12 * abs(exact).max()


@given(
    rate=st.one_of(
        st.integers(1, 200).map(float),
        st.sampled_from([256.0, 1024.0, 51200.0, 44100.0, 48000.0, 65536.0, 12800.0, 2500.0, 1e6, 12.5, 0.5]),
    ),
    extra=st.integers(1, 4),
    phase=st.floats(0, 1),
)
def test_a_round_rate_is_found_exactly(rate, extra, phase):
    decimals = max(int(np.ceil(np.log10(rate))), 0) + extra
    exact = (np.arange(5000) + phase) / rate
    ties = np.abs(exact * 10.0**decimals % 1.0 - 0.5) < 1e-3
    assume(not ties.any())  # a tie goes up or down by the last bit of the product, and the fit bends
    times = np.round(exact, decimals)
    assert repaired(times).sample_rate == rate


@given(
    rate=st.floats(10.0, 1e5),
    n=st.integers(60, 300),
    data=st.data(),
)
def test_gaps_are_found_and_filled(rate, n, data):
    lost = data.draw(st.sets(st.integers(1, n - 2), min_size=1, max_size=n // 20))
    kept = np.setdiff1d(np.arange(n), sorted(lost))
    axis = repaired(np.round(kept / rate, 9))
    np.testing.assert_array_equal(axis.positions, kept)
    values = axis.place(kept[None, :].astype(float))
    assert values.shape == (1, n)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values[0])), sorted(lost))
    np.testing.assert_array_equal(values[0, kept], kept)
