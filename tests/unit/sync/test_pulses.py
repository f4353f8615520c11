"""When pulses came: against known instants, whatever the rise, the width, the polarity, the noise and the gaps."""

import re
from pathlib import Path

import numpy as np
import pytest

from floquid.core import Record, TachometerSignal
from floquid.errors import InputError
from floquid.sync import pulse_times

TACHOMETER = Path(__file__).parents[4] / "shared" / "data" / "rotor_650rpm_tach.npz"
SPACING = 94.523  # samples, as in the rotor's record
N = 7000


def ramp_area(z, rise):
    """The integral of a ramp from 0 to 1 that takes `rise` samples about zero."""
    share = np.clip(z / rise + 0.5, 0.0, 1.0)
    return np.where(z > rise / 2, z, rise * share**2 / 2)


def train(instants, width, rise, *, noise=0.0, seed=0, n=N, integrating=True):
    """Pulses whose leading edges are half-way up at `instants` [samples], each sample an average over one."""
    x = np.arange(n, dtype=float)

    def edge(z):
        if not integrating:
            return np.clip(z / rise + 0.5, 0.0, 1.0)
        return ramp_area(z + 0.5, rise) - ramp_area(z - 0.5, rise)

    values = np.zeros(n)
    for instant in instants:
        near = slice(max(int(instant - rise - 3), 0), max(int(instant + width + rise + 4), 0))
        values[near] += edge(x[near] - instant) - edge(x[near] - instant - width)
    return values + noise * np.random.default_rng(seed).standard_normal(n)


def even(start=60.3, spacing=SPACING, n=N):
    instants = start + spacing * np.arange(int(n / spacing) + 1)
    return instants[instants < n - 60]


def of(values, *, rate=1.0, start=0.0, clock=None):
    record = Record(values=np.asarray(values)[None], sample_rate=rate, channels=["tach"], start=start, clock=clock)
    return pulse_times(record, "tach")


# A wide pulse is timed by its leading edge, a narrow one by its middle. The bounds are two or three times what was
# measured: rounding without noise; with noise of 0.5 % of the height, 0.007 to 0.019 samples.
WIDE = [(47.2615, 0.3), (47.2615, 1.0), (47.2615, 5.0), (12.0, 1.0)]
NARROW = [(1.8905, 0.3), (1.8905, 1.0), (2.5, 0.3), (4.0, 1.0), (4.0, 5.0)]


@pytest.mark.parametrize(("width", "rise"), WIDE + NARROW)
@pytest.mark.parametrize(("noise", "bound"), [(0.0, 1e-6), (0.005, 0.04)])
def test_times_agree_with_known_instants(width, rise, noise, bound):
    truth = even() + (0.0 if (width, rise) in WIDE else width / 2)
    found = of(train(even(), width, rise, noise=noise))
    assert len(found) == len(truth)
    assert np.sqrt(np.mean((found - truth) ** 2)) < bound
    assert abs(np.mean(found - truth)) < bound / 3


@pytest.mark.parametrize(("width", "rise", "bound"), [(47.0, 1.0, 1e-6), (47.0, 5.0, 1e-6), (47.0, 0.3, 0.25)])
def test_a_sensor_that_does_not_average_loses_only_what_falls_between_samples(width, rise, bound):
    """With a rise of 0.3 sample an edge lies between two samples 70 % of the time: 0.7/√12 = 0.2 sample is lost."""
    error = of(train(even(), width, rise, integrating=False)) - even()
    assert np.sqrt(np.mean(error**2)) < bound
    assert np.abs(error).max() < 2.0 * bound


@pytest.mark.slow
def test_a_band_limited_edge_is_timed_as_well():
    """Oversampled thirty-two times, filtered at 0.4 of the rate as a recorder does, and decimated: the edges ring."""
    from scipy.signal import firwin, lfilter

    over, taps = 32, 32 * 24 + 1
    fine = train(even() * over, 40 * over, 3 * over, n=N * over)
    filtered = lfilter(firwin(taps, 0.8 / over), 1.0, fine)[(taps - 1) // 2 :]
    found = of(filtered[::over])
    assert len(found) == len(even())
    assert np.std(found - even()) < 0.02
    assert abs(np.mean(found - even())) < 0.02


def test_levels_polarity_rate_and_start_do_not_matter():
    values = train(even(), 1.8905, 1.0, noise=0.005)
    plain = of(values)
    assert of(-3.0 - 5e-3 * values) == pytest.approx(plain, abs=1e-9)
    assert of(values, rate=1024.0, start=-2.0) == pytest.approx(plain / 1024.0 - 2.0, abs=1e-12)


def test_pulses_of_half_the_time_are_timed_at_the_rise():
    values = 7.0 + 2.0 * train(even(), 47.0, 1.0, noise=0.005)
    assert of(values) == pytest.approx(even(), abs=0.06)


def test_pulses_that_go_down_are_timed_at_the_fall():
    """A keyway: high for nine tenths of the time."""
    assert of(5.0 - 5.0 * train(even(), 9.0, 1.0)) == pytest.approx(even(), abs=1e-6)


def test_very_rare_pulses_are_seen():
    """Two samples in two thousand: neither a quantile nor a mean shows them."""
    truth = even(spacing=2003.7, n=60000)
    found = of(train(truth, 2.0, 1.0, noise=0.02, n=60000))
    assert found == pytest.approx(truth + 1.0, abs=0.2)


def test_noise_spikes_and_crosstalk_trigger_nothing():
    values = train(even(), 9.0, 1.0, noise=0.05, seed=3)
    values[[500, 2500]] += 8.0  # spikes, away from the pulses
    values[30::95] += 0.1  # crosstalk of a tenth of the height
    found = of(values)
    extra = [t for t in found if np.abs(even() - t).min() > 1.0]
    assert len(found) == len(even()) + 2
    assert extra == pytest.approx([500.0, 2500.0], abs=10.0)  # a spike looks like a pulse: `shaft_angle` leaves it out


def test_a_drifting_base_moves_no_edge():
    values = train(even(), 30.0, 3.0)
    drift = 0.05 * np.sin(2.0 * np.pi * np.arange(N) / 3000.0)
    assert of(values + drift) == pytest.approx(even(), abs=0.03)


def test_slow_edges_in_noise_are_counted_once():
    values = train(even(), 40.0, 12.0, noise=0.04, seed=5)
    found = of(values)
    assert len(found) == len(even())


def test_missing_samples_cost_their_pulses_and_no_others():
    values = train(even(), 9.0, 1.0)
    truth = even()
    for pulse in (3, 17):
        values[int(truth[pulse])] = np.nan
    values[int(truth[30]) + 40 : int(truth[31]) - 40] = np.nan
    found = of(values)
    assert found == pytest.approx(np.delete(truth, [3, 17]), abs=1e-6)


@pytest.mark.parametrize("start", [-5.0, -1.0])
def test_a_record_may_begin_and_end_within_a_pulse(start):
    """The first has no leading edge to see; the last has, and its end is not needed."""
    truth = even(start=start, spacing=100.0, n=2050)[:20]
    values = train(truth, 20.0, 1.0, n=1910)
    assert of(values) == pytest.approx(truth[1:], abs=1e-6)


def test_an_uneven_encoder_does_not_mislead_the_choice_of_the_estimate():
    """Judged from a revolution to the next, where the clock tells it."""
    rng = np.random.default_rng(2)
    lines = 5
    spaces = SPACING * (1.0 + np.tile(rng.uniform(-0.3, 0.3, lines), 14))
    truth = 40.0 + np.cumsum(spaces)
    truth = truth[truth < N - 40]
    clock = TachometerSignal(channel="tach", pulses_per_revolution=lines)
    found = of(train(truth, 1.8905, 1.0, noise=0.005), clock=clock)
    assert np.std(found - truth) < 0.03


def refused(values, channel="tach"):
    record = Record(values=np.asarray(values, dtype=float)[None], sample_rate=1.0, channels=["tach"])
    with pytest.raises(InputError) as error:
        pulse_times(record, channel)
    return str(error.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.ones(100), "must hold pulses, but channel 'tach' is constant"),
        (np.full(100, np.nan), "is missing throughout"),
        (
            np.random.default_rng(0).standard_normal(5000),
            "stand out of a base, but what goes highest in channel 'tach'",
        ),
        (np.sin(np.arange(5000) * 0.05), "and 15 are needed"),
        (train([500.0], 9.0, 1.0, n=1000), "must hold two pulses or more, but channel 'tach' holds 1 whole pulse."),
        (train([-4.0, 995.0], 9.0, 1.0, n=1000), "holds no whole pulses."),
    ],
)
def test_what_holds_no_pulses_is_refused(values, words):
    assert re.search(re.escape(words), refused(values))


def test_an_unknown_channel_is_refused_with_those_there_are():
    assert "The channels are: tach." in refused(np.ones(10), "tacho")


@pytest.mark.skipif(not TACHOMETER.exists(), reason=f"{TACHOMETER.name} is not here")
def test_the_rotors_pulses_are_timed_to_a_hundredth_of_a_sample():
    """The speed is constant: what the times leave over from a line is their error, 0.006 samples."""
    with np.load(TACHOMETER) as data:
        record = Record(values=data["values"], sample_rate=float(data["sample_rate"]), channels=list(data["channels"]))
    times = pulse_times(record, "tach") * record.sample_rate
    numbers = np.arange(len(times))
    left = times - np.polyval(np.polyfit(numbers, times, 1), numbers)
    assert len(times) == 75
    assert np.std(left) < 0.008


def noisy(height, starts, *, width=3, seed=0):
    """White noise of unit deviation with pulses of so many deviations that start at given samples."""
    values = np.random.default_rng(seed).standard_normal(20_000)
    for begin in starts:
        values[begin : begin + width] += height
    return values


@pytest.mark.parametrize("height", [8.0, 9.7, 12.0])
@pytest.mark.parametrize("width", [2, 12])
def test_low_pulses_that_come_evenly_are_pulses(height, width):
    """Of 390 one in a hundred may be of noise: what the angle makes of those is a matter of its faults."""
    starts = np.arange(100, 19_900, 50.7).astype(int)
    record = Record(values=noisy(height, starts, width=width)[None], sample_rate=1.0, channels=["tach"])
    times = pulse_times(record, "tach")
    false = np.abs(np.subtract.outer(times, starts)).min(axis=1) > 0.5 * width + 3.0
    assert len(times) - false.sum() > 0.98 * len(starts)
    assert false.sum() <= 0.01 * len(starts)


@pytest.mark.parametrize("seed", range(4))
def test_low_pulses_at_random_are_none_nor_are_few(seed):
    generator = np.random.default_rng(seed)
    random = np.sort(generator.choice(np.arange(100, 19_900, 10), 300, replace=False))
    assert "or 6 of 22 pulses that come evenly" in refused(noisy(10.0, random, seed=seed))
    assert "or 6 of 22 pulses that come evenly" in refused(noisy(10.0, range(500, 20_000, 1500), seed=seed))
    assert "and 15 are needed" in refused(generator.standard_t(6, 20_000))
