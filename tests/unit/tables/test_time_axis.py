"""The time column: what is snapped and what is not, and what the user is told."""

import re

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.io import Source
from floquid.tables import TimeColumn, fit_line, repair

SOURCE = Source(name="run.csv", of="read")


def repaired(times, scale=1.0):
    values = times if isinstance(times, np.ndarray) else np.array(times, dtype=float)
    return repair(TimeColumn(values=values, scale=scale, label="time [s]"), SOURCE)


def printed(times, form):
    return np.array([float(form % time) for time in times])


@pytest.mark.parametrize(
    ("rate", "n", "form"),
    [
        (51200.0, 10000, "%.6f"),
        (51200.0, 100000, "%.6f"),
        (1024.0, 5000, "%.4f"),
        (1024.0, 5000, "%.6g"),
        (44100.0, 3000, "%.6f"),
        (65536.0, 3000, "%.6f"),
        (300.0, 3000, "%.3f"),
        (999.0, 2500, "%.6f"),
        (80.0, 1000, "%.2f"),
        (5000.0, 30000, "%.4e"),
        (1000.0, 5, "%.3f"),
        (1000.0, 10003, "%.3f"),
        (0.1, 50, "%.0f"),
        (1.0 / 0.003, 500, "%.4f"),
        (1e6, 2000, "%.18e"),
    ],
)
def test_a_nominal_rate_is_found(rate, n, form):
    axis = repaired(printed(np.arange(n) / rate, form))
    assert axis.sample_rate == rate
    assert axis.start == 0.0
    assert "snapped" in axis.notes[0]
    assert len(axis.notes) == 1


@pytest.mark.parametrize(
    ("rate", "n", "form"),
    [
        (51200.01, 200000, "%.6f"),
        (51200.5, 100000, "%.6f"),
        (2533.333333333334, 17720, "%.6f"),
        (2533.333333333334, 17720, "%.5f"),
        (2533.333333333334, 17720, "%.17g"),
        (866.6666666666666, 6080, "%.3f"),
        (866.6666666666666, 6080, "%.17g"),
        (19.353241079974474, 16640, "%.6g"),
        (81.3217, 1000, "%.2f"),
        (1000.37, 5000, "%.6f"),
    ],
)
def test_a_rate_that_is_not_round_is_not_snapped(rate, n, form):
    times = printed(np.arange(n) / rate, form)
    axis = repaired(times)
    assert "snapped" not in axis.notes[0]
    assert "no round rate is clearly meant" in axis.notes[0]
    last = 10.0 ** -max(len(f"{time:.12g}".partition(".")[2]) for time in times[-20:])
    assert abs(n / axis.sample_rate - n / rate) <= last
    # the two ends alone, as a naive reader takes them, are no better than this; the first step alone is hopeless
    assert abs(axis.sample_rate - rate) <= abs(1.0 / (times[1] - times[0]) - rate) + 1e-9


def test_a_nominal_rate_that_the_fit_excludes_is_not_taken():
    """Two parts in a billion are within the rounding of four seconds in microseconds, two in ten million are not."""
    steps = np.arange(200000) / 51200.0
    found = [repaired(np.round(steps / (1.0 + off), 6)).sample_rate for off in (0.0, 2e-9, 2e-7, 2e-6)]
    snapped = [rate == 51200.0 for rate in found]
    assert snapped == [True, True, False, False]


def test_what_the_column_cannot_tell_apart_is_not_called_nominal():
    axis = repaired(printed(np.arange(60) / 9999.0, "%.6f"))
    assert axis.sample_rate not in (9999.0, 10000.0)
    assert abs(axis.sample_rate - 9999.0) < 2.0


def test_the_user_is_told():
    axis = repaired(printed(np.arange(20000) / 51200.0, "%.6f"))
    (note,) = axis.notes
    assert re.fullmatch(
        r"Sampling rate 51200 Hz: taken from the whole time column \(rounded to 1e-06 s\) and snapped to the nominal "
        r"51200 Hz \(fit: 51200\.000\d* ± 0\.00\d+ Hz\)\.",
        note,
    )
    axis = repaired(printed(np.arange(6000) / 866.6666666666666, "%.4f"))
    (note,) = axis.notes
    assert re.fullmatch(
        r"Sampling rate 866\.666\d ± 0\.000\d Hz: fitted to the whole time column \(rounded to 0\.0001 s\); "
        r"no round rate is clearly meant\.",
        note,
    )
    axis = repaired(np.arange(3000) * 0.003)
    assert "snapped to the nominal step of 0.003 s" in axis.notes[0]


@pytest.mark.parametrize(
    ("low", "high", "n", "decimals"), [(900, 1000, 4000, 4), (10, 1000, 1000, 4), (2000, 50000, 3000, 6)]
)
def test_the_standard_error_holds(low, high, n, decimals):
    """Rounding is no noise: at some rates its pattern hides a whole ramp. Still no fit is four standard errors off."""
    rng, z = np.random.default_rng(5), []
    for rate in rng.uniform(low, high, 300):
        line = fit_line(np.arange(float(n)), np.round(rng.uniform() + np.arange(n) / rate, decimals))
        z.append((1.0 / line.step - rate) / line.rate_std(10.0**-decimals))
    assert np.abs(z).max() < 4.0
    assert np.std(z) > 0.1, "an error so wide says nothing"


def test_what_no_residual_shows_is_in_the_standard_error():
    """400 samples at 200.04 Hz in whole milliseconds are those of 200 Hz to the last digit."""
    times = np.round(np.arange(400) / 200.04, 3)
    line = fit_line(np.arange(400.0), times)
    assert np.abs(line.residuals).max() < 1e-12
    assert 0.02 < line.rate_std(1e-3) < 0.04


def test_single_precision_and_summed_steps():
    single = (np.arange(30000) / 1000.0).astype(np.float32)
    assert repaired(single).sample_rate == 1000.0
    assert "single precision" in repaired(single).notes[0]
    assert repaired(single.astype(float)).sample_rate == 1000.0
    assert repaired(np.cumsum(np.full(300000, 1e-3))).sample_rate == 1000.0


def test_units_of_time():
    assert repaired(np.arange(500) * 20.0, scale=1e-6).sample_rate == 50000.0
    assert "rounded to 1e-06 s" in repaired(np.arange(500) * 20.0, scale=1e-6).notes[0]
    assert repaired(np.arange(500) * 0.5, scale=60.0).sample_rate == 1.0 / 30.0


def test_the_start_is_kept():
    assert repaired(1.7e9 + np.arange(5000) / 1000.0).start == 1.7e9
    assert repaired(np.array([3.0, 4.5])).start == 3.0
    assert repaired(np.arange(-50, 50) / 8.0).start == -6.25


def test_scatter_beyond_the_rounding_is_uneven():
    """Whatever its share of a step: of a good record false modes come of a thousandth."""
    rng = np.random.default_rng(1)
    even, jitter = np.arange(2000) * 1e-3, rng.uniform(-1, 1, 2000) * 1e-3
    for share in (0.0005, 0.008, 0.03):
        with pytest.raises(InputError, match="evenly spaced"):
            repaired(share * jitter + even)
    with pytest.raises(InputError, match="evenly spaced"):
        repaired(0.008e-3 * np.sin(0.01 * np.arange(2000)) + even)
    assert repaired(np.round(0.0004 * jitter + even, 6)).sample_rate == 1000.0  # less than the digits show


def test_a_clock_that_adds_up_its_step_in_single_precision_is_even():
    """A simulator's: each step is even within the rounding, and the sum wanders."""
    times = np.cumsum(np.full(2000, np.float32(0.01)), dtype=np.float32)
    axis = repaired(times)
    assert abs(axis.sample_rate - 100.0) < 0.01
    assert any(note.startswith("The times scatter by up to 0.") for note in axis.notes)
    odd = times.copy()
    odd[1000] += np.float32(5e-5)  # half a hundredth of a step, and many times the rounding
    with pytest.raises(InputError, match="evenly spaced"):
        repaired(odd)
    for whole in (np.arange(100_000) * 0.01, np.float32(0.01) * np.arange(100_000, dtype=np.float32)):
        assert repaired(whole.astype(np.float32)).sample_rate == pytest.approx(100.0, rel=1e-7)


@pytest.mark.parametrize("n", [5, 20, 100, 3000])
def test_a_gap_in_times_as_coarse_as_their_step(n):
    axis = repaired(np.round(np.delete(np.arange(n) / 100.0, 3), 2))
    assert axis.sample_rate == 100.0
    np.testing.assert_array_equal(axis.positions, np.delete(np.arange(n), 3))
    assert axis.notes[1] == "The time column has 1 gap, the first after 0.02 s: 1 sample marked missing."


def test_steps_lengthened_by_rounding_alone_are_no_gaps():
    for rate in (99.0, 97.3, 80.0, 64.0):
        axis = repaired(np.round(np.arange(1000) / rate, 2))
        assert axis.positions is None
        assert abs(axis.sample_rate - rate) < 0.01


def test_gaps_that_rounding_hides_are_refused():
    times = np.round(np.delete(np.arange(2000) / 801.0, [5, 6, 700]), 3)
    with pytest.raises(InputError, match="more digits"):
        repaired(times)


def test_filling_is_bounded():
    steps = np.ones(100)
    steps[50] = 90.0
    assert repaired(np.cumsum(steps) * 0.01).positions[-1] == 188
    steps[50] = 120.0
    with pytest.raises(InputError, match="gaps shorter together than the record"):
        repaired(np.cumsum(steps) * 0.01)


def test_a_gap_of_a_broken_step_is_refused():
    steps = np.full(100, 0.01)
    steps[50] = 0.0345
    with pytest.raises(InputError, match="a gap must be a whole number of steps"):
        repaired(np.cumsum(steps))


@pytest.mark.parametrize(("fast", "slow"), [(50.0, 20.0), (100.0, 30.0), (1000.0, 300.0), (50.0, 49.0)])
def test_times_of_two_rates_on_their_union_are_uneven(fast, slow):
    digits = 2 if fast == 50.0 and slow == 20.0 else 6
    times = np.unique(np.round(np.concatenate([np.arange(0, 20, 1 / fast), np.arange(0, 20, 1 / slow)]), digits))
    with pytest.raises(InputError):
        repaired(times)


@pytest.mark.parametrize("rate", [97.3, 80.0, 64.0, 51.2345])
@pytest.mark.parametrize("n", [3, 10, 100, 5000])
def test_times_that_are_cut_off_not_rounded_are_even(rate, n):
    times = np.floor((np.arange(n) / rate + 0.00371) * 100.0) / 100.0
    axis = repaired(times)
    assert axis.positions is None
    assert abs(axis.sample_rate / rate - 1.0) < 0.02 / (n / rate)


@pytest.mark.parametrize(("scale", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_times_without_a_unit_that_count_from_1970_are_known_by_their_size(scale, name):
    ticks = 1714564800.0 * scale + np.rint(np.arange(1000) * 0.02 * scale)
    axis = repaired(ticks, scale=None)
    assert axis.sample_rate == 50.0
    assert axis.start == 0.0
    assert f"by their size its times are {name} since 1970, from 2024-05-01T12:00:00" in axis.notes[-1]
    assert repaired(1.7e9 + np.arange(1000) * 0.5, scale=None).sample_rate == 2.0
