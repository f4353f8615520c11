"""Interpolation at arbitrary instants and synchronous resampling: the stated errors, against analytical signals."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import i0

from floquid.core import Channel, ConstantPeriod, Record, TachometerSignal
from floquid.errors import InputError
from floquid.sync import bandwidth, half_width, interpolate, interpolation_error, resample, segment

RATE = 1000.0
START = -0.35
SAMPLES = 4000
CUTOFFS = (500.0, 500.0 / 1.3, 1000.0 / np.pi, 100.0, 25.0)
OPTIONS = [(0.8, 1e-6), (0.5, 1e-2), (0.65, 1e-4), (0.9, 1e-8), (0.95, 1e-3), (0.8, 1e-9), (0.98, 1e-9)]


def sampled(signal, *, rate=RATE, start=START, samples=SAMPLES):
    """A signal (a function of time) at the samples of a record (1, samples)."""
    return np.atleast_2d(signal(start + np.arange(samples) / rate))


def random_instants(rng, half, *, count=400, rate=RATE, start=START, samples=SAMPLES):
    """Random instants that have all their samples."""
    return start + rng.uniform(half, samples - 1 - half, count) / rate


def lines(frequencies, rng, *, growth=0.0):
    """Cosines of random amplitude and phase, added up, and the sum of the amplitudes: functions of time."""
    amplitudes = rng.uniform(0.1, 2.0, len(frequencies))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))

    def signal(times):
        angle = 2.0 * np.pi * np.multiply.outer(times, frequencies) + phases
        return (np.cos(angle) * np.exp(growth * times)[:, None]) @ amplitudes

    return signal, lambda times: amplitudes.sum() * np.exp(growth * times)


# The kernel


def test_weights_are_a_sinc_under_a_kaiser_window():
    """The formula of the docstring, written out a second time and applied to a single sample."""
    cutoff, half = 410.0, half_width(RATE, cutoff=410.0)
    impulse = np.zeros((1, 201))
    impulse[0, 100] = 1.0
    times = np.linspace(100 - half, 100 + half, 1001)[1:-1] / RATE
    attenuation = -20.0 * np.log10(1e-6 / 8.0)
    assert half == np.ceil((attenuation - 7.95) / (2 * 2.285 * 4 * np.pi * 0.2 * cutoff / RATE))
    apart = times - 100 / RATE
    beta = 0.1102 * (attenuation - 8.7)
    window = i0(beta * np.sqrt(1 - (apart * RATE / half) ** 2)) / i0(beta)
    expected = 2 * cutoff / RATE * np.sinc(2 * cutoff * apart) * window
    # What is left is the gain at zero, brought to one.
    assert_allclose(interpolate(impulse, RATE, 0.0, times, cutoff=cutoff)[0], expected, atol=3e-6 * 2 * cutoff / RATE)


@pytest.mark.first(8)
@pytest.mark.parametrize(("band", "accuracy"), OPTIONS)
@pytest.mark.parametrize("cutoff", CUTOFFS[:4])
def test_error_over_the_pass_band_is_below_the_accuracy(band, accuracy, cutoff):
    error = interpolation_error(np.linspace(0, band * cutoff, 101), RATE, cutoff=cutoff, band=band, accuracy=accuracy)
    assert error.max() <= 0.8 * accuracy  # with a margin
    assert error.max() >= 0.05 * accuracy  # no longer a kernel than the bound needs


@pytest.mark.parametrize("cutoff", CUTOFFS)
def test_error_against_analytical_lines_is_below_the_bound(cutoff):
    rng = np.random.default_rng(1)
    half = half_width(RATE, cutoff=cutoff)
    times = random_instants(rng, half)
    for frequency in 0.8 * cutoff * np.array([0.0, 1e-3, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0]):
        signal, total = lines(np.array([frequency]), rng)
        got = interpolate(sampled(signal), RATE, START, times, cutoff=cutoff)
        worst = np.abs(got[0] - signal(times)).max() / total(0.0)
        assert worst <= 1e-6
        # The error that is told is the error there is, but for the phase of the line and the instants drawn.
        told = interpolation_error([frequency], RATE, cutoff=cutoff)[0]
        assert worst <= 1.02 * told + 1e-11


@pytest.mark.parametrize(("band", "accuracy"), OPTIONS[:5])
def test_error_of_many_lines_is_below_accuracy_times_the_sum_of_amplitudes(band, accuracy):
    rng = np.random.default_rng(2)
    for cutoff in CUTOFFS[:3]:
        signal, total = lines(rng.uniform(0.0, band * cutoff, 12), rng)
        options = {"cutoff": cutoff, "band": band, "accuracy": accuracy}
        times = random_instants(rng, half_width(RATE, **options))
        got = interpolate(sampled(signal), RATE, START, times, **options)[0]
        assert (np.abs(got - signal(times)) <= accuracy * total(times)).all()


@pytest.mark.parametrize("growth", [-60.0, -20.0, -2.0, 5.0, 20.0, 60.0])
def test_error_of_decaying_and_growing_lines(growth):
    rng = np.random.default_rng(3)
    for cutoff in (500.0, 318.0):
        half = half_width(RATE, cutoff=cutoff)
        factor = np.exp(4.0 * abs(growth) * half / RATE)
        frequencies = np.linspace(0.0, 0.8 * cutoff, 101)
        assert interpolation_error(frequencies, RATE, cutoff=cutoff, growth=growth).max() <= 1e-6 * factor
        signal, total = lines(frequencies[[100, 96, 20, 3]], rng, growth=growth)
        times = random_instants(rng, half)
        got = interpolate(sampled(signal), RATE, START, times, cutoff=cutoff)[0]
        assert (np.abs(got - signal(times)) <= 1e-6 * factor * total(times)).all()


def test_decay_within_the_kernel_costs_accuracy():
    """The factor of the bound for decaying lines is needed: at the edge of the band one is not enough."""
    assert interpolation_error([400.0], RATE, cutoff=500.0, growth=-60.0)[0] > 5e-6


@pytest.mark.parametrize(("band", "accuracy"), OPTIONS[:5])
def test_what_lies_beyond_the_stop_edge_is_stopped(band, accuracy):
    rng = np.random.default_rng(4)
    cutoff = 180.0
    options = {"cutoff": cutoff, "band": band, "accuracy": accuracy}
    times = random_instants(rng, half_width(RATE, **options))
    for frequency in np.linspace((2.0 - band) * cutoff, 500.0, 15):
        signal, total = lines(np.array([frequency]), rng)
        assert np.abs(interpolate(sampled(signal), RATE, START, times, **options)).max() <= accuracy * total(0.0)


def test_without_the_cut_off_a_line_above_the_new_nyquist_rate_folds():
    """Decimation by 7 of a line at 230 Hz: gone with the cut-off, and in the response at 55.1 Hz without it."""
    rng = np.random.default_rng(5)
    signal, total = lines(np.array([230.0]), rng)
    half = half_width(RATE, cutoff=500.0 / 7.0)
    times = START + np.arange(half, SAMPLES - half, 7) / RATE
    folded = interpolate(sampled(signal), RATE, START, times, cutoff=500.0)
    assert np.abs(folded).max() > 0.9 * total(0.0)
    assert np.abs(interpolate(sampled(signal), RATE, START, times, cutoff=500.0 / 7.0)).max() <= 1e-6 * total(0.0)


def test_gain_at_zero_is_one():
    rng = np.random.default_rng(6)
    for cutoff in CUTOFFS:
        times = random_instants(rng, half_width(RATE, cutoff=cutoff, accuracy=1e-2))
        got = interpolate(np.full((2, SAMPLES), 1e4), RATE, START, times, cutoff=cutoff, accuracy=1e-2)
        assert_allclose(got, 1e4, rtol=1e-13)


def test_white_noise_comes_out_with_its_share_of_the_band():
    noise = np.random.default_rng(7).normal(size=(40, 5000))
    for cutoff in (450.0, 200.0, 80.0):
        times = START + np.arange(300.0, 4700.0, np.pi) / RATE
        got = interpolate(noise, RATE, START, times, cutoff=cutoff)
        # Half of each transition band's power is lost: a quarter of its width, twice; few lines are wide.
        assert_allclose(got.var(), 2.0 * cutoff / RATE, rtol=0.06)


def test_samples_themselves_come_back_at_the_full_cut_off():
    noise = np.random.default_rng(8).normal(size=(3, 200))
    whole = np.arange(60, 140)
    assert_allclose(interpolate(noise, 1.0, 0.0, whole, cutoff=0.5), noise[:, whole], atol=1e-12)


def test_instants_near_an_end_are_missing():
    half = half_width(RATE, cutoff=300.0)
    last = 500 - 1
    inside = np.array([half, half + 0.25, last - half - 1e-6, 250.5])
    outside = np.array([half - 1 - 1e-6, last - half + 1, -5.0, 600.0, last, 0.0])
    noise = np.random.default_rng(9).normal(size=(2, 500))
    got = interpolate(noise, RATE, START, START + np.concatenate([inside, outside]) / RATE, cutoff=300.0)
    assert np.isfinite(got[:, :4]).all()
    assert np.isnan(got[:, 4:]).all()


def test_a_missing_sample_takes_its_neighbourhood_in_its_channel_and_no_more():
    rng = np.random.default_rng(10)
    noise = rng.normal(size=(3, 900))
    holed = noise.copy()
    holed[1, [300, 520, 521]] = np.nan
    position = np.sort(rng.uniform(50, 849, 3000))
    half = half_width(RATE, cutoff=470.0)
    whole = interpolate(noise, RATE, START, START + position / RATE, cutoff=470.0)
    got = interpolate(holed, RATE, START, START + position / RATE, cutoff=470.0)
    near = (np.abs(position[:, None] - np.array([300, 520, 521])) < half).any(axis=1)
    assert 0 < near.sum() < 600
    assert_array_equal(np.isnan(got), np.array([np.zeros(3000), near, np.zeros(3000)], dtype=bool))
    assert_allclose(got[:, ~near], whole[:, ~near], rtol=0, atol=1e-13)


def test_instants_come_in_any_order_and_any_number():
    rng = np.random.default_rng(11)
    noise = rng.normal(size=(2, 30000))
    times = START + rng.uniform(50, 29900, 20000) / RATE  # several blocks of weights
    got = interpolate(noise, RATE, START, times, cutoff=500.0)
    for some in (slice(0, 1), slice(7000, 7003), slice(19990, None)):
        assert_allclose(got[:, some], interpolate(noise, RATE, START, times[some], cutoff=500.0), atol=1e-13)
    assert interpolate(noise, RATE, START, [], cutoff=500.0).shape == (2, 0)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"cutoff": 501.0}, "`cutoff` of `interpolate` must lie between 1e-4 of the sampling rate and half of it"),
        ({"cutoff": 0.0}, "`cutoff` of `interpolate` must be positive"),
        ({"cutoff": 0.01}, "`cutoff`"),
        ({"cutoff": 100.0, "band": 1.0}, "`band` of `interpolate` must lie in [0.5, 0.98]"),
        ({"cutoff": 100.0, "accuracy": 0.0}, "`accuracy` of `interpolate` must lie in [1e-9, 1e-2]"),
    ],
)
def test_impossible_options_are_refused(options, says):
    with pytest.raises(InputError, match=re.escape(says)):
        interpolate(np.zeros((1, 100)), RATE, 0.0, [0.05], **options)


# Synchronous resampling


@dataclass(frozen=True)
class Wandering:
    """A shaft of known angle Ω t + a sin(w t) [rad], whose inverse is found by Newton's method."""

    speed: float = 2.0 * np.pi * 9.7
    depth: float = 0.5
    wander: float = 2.0 * np.pi * 0.21
    periods_per_revolution: float = 1.0

    measured = True
    fitted = False
    period = None

    def phase(self, *_):
        raise AssertionError("`resample` asks for turns alone")

    phase_zero = since_phase_zero = fluctuation = angle_spread = phase

    def angle(self, times):
        return self.speed * times + self.depth * np.sin(self.wander * times)

    def time_at(self, angle):
        times = angle / self.speed
        for _ in range(20):
            rate = self.speed + self.depth * self.wander * np.cos(self.wander * times)
            times = times - (self.angle(times) - angle) / rate
        return times

    def turns(self, times):
        return self.angle(times) * self.periods_per_revolution / (2.0 * np.pi)

    def times_at(self, turns):
        return self.time_at(2.0 * np.pi * turns / self.periods_per_revolution)


def record(signal, *, rate=RATE, start=START, samples=SAMPLES, channels=("X",), units=None, noise=0.0):
    values = np.vstack(
        [(row + 1) * sampled(signal, rate=rate, start=start, samples=samples) for row in range(len(channels))]
    )
    if noise:
        values = values + noise * np.random.default_rng(99).normal(size=values.shape)
    named = channels if units is None else [Channel(name=n, unit=u) for n, u in zip(channels, units, strict=True)]
    return Record(values=values, sample_rate=rate, channels=named, start=start)


def expected_instants(clock, cycles, first):
    turns = first + np.arange(cycles.n_cycles)[None, :] + np.arange(cycles.n_phases)[:, None] / cycles.n_phases
    if isinstance(clock, ConstantPeriod):
        return clock.origin + turns * clock.period
    return clock.time_at(2.0 * np.pi * turns / clock.periods_per_revolution)


def first_cycle(cycles, clock, signal, near):
    """The number of the first kept cycle, found from the values themselves."""
    errors = [
        np.abs(
            cycles.values[0] - signal(expected_instants(clock, cycles, k).ravel()).reshape(cycles.values[0].shape)
        ).max()
        for k in near
    ]
    return near[int(np.argmin(errors))]


@pytest.mark.parametrize(
    ("clock", "phases"),
    [
        pytest.param(ConstantPeriod(period=0.0512, origin=0.013), 32, id="rational, down"),
        pytest.param(ConstantPeriod(period=0.1 / np.sqrt(3.0), origin=-7.0), 50, id="irrational, down"),
        pytest.param(ConstantPeriod(period=0.1 / np.sqrt(3.0), origin=3.3), 128, id="irrational, up"),
        pytest.param(ConstantPeriod(period=np.pi / 100.0), 9, id="irrational, far down"),
        pytest.param(Wandering(), 60, id="wandering"),
        pytest.param(Wandering(periods_per_revolution=2.0), 40, id="wandering, two periods a revolution"),
        pytest.param(
            Wandering(periods_per_revolution=0.5, depth=-1.2), 300, id="wandering, half a period a revolution"
        ),
    ],
)
def test_resampled_cycles_are_the_signal_at_the_instants(clock, phases):
    rng = np.random.default_rng(12)
    times = START + np.arange(SAMPLES) / RATE
    if isinstance(clock, ConstantPeriod):
        longest = clock.period
    else:
        nu = clock.periods_per_revolution
        longest = 2.0 * np.pi / nu / (clock.speed - abs(clock.depth) * clock.wander)
    passed = 0.8 * 0.5 * min(RATE, phases / longest)
    signal, total = lines(rng.uniform(0.0, passed, 8), rng)
    (cycles,) = resample(record(signal, channels=("X", "Y")), clock, n_phases=phases)
    assert cycles.n_phases == phases
    assert cycles.first_phase == 0.0
    low = (
        (START - clock.origin) / clock.period
        if isinstance(clock, ConstantPeriod)
        else clock.periods_per_revolution * clock.angle(START) / (2.0 * np.pi)
    )
    first = first_cycle(cycles, clock, signal, range(int(np.ceil(low)), int(np.ceil(low)) + 12))
    instants = expected_instants(clock, cycles, first)
    error = np.abs(cycles.values[0] - signal(instants.ravel()).reshape(instants.shape))
    assert error.max() <= 1e-6 * total(0.0)
    assert_allclose(cycles.values[1], 2.0 * cycles.values[0], rtol=0, atol=1e-12 * total(0.0))
    # As many cycles as have their samples on either side, and the length that each has.
    half = half_width(RATE, cutoff=passed / 0.8) / RATE
    every = expected_instants(clock, cycles, first)
    assert every.min() >= times[0] + half - 1.0 / RATE
    assert every.max() <= times[-1] - half + 1.0 / RATE
    before, after = (
        expected_instants(clock, cycles, first - 1)[0, 0],
        expected_instants(clock, cycles, first + 1)[-1, -1],
    )
    assert before < times[0] + half
    assert after > times[-1] - half - 1.0 / RATE
    ends = expected_instants(clock, cycles, first + 1)[0]
    assert_allclose(cycles.periods, ends - instants[0], rtol=1e-9)


@pytest.mark.parametrize("clock", [ConstantPeriod(period=0.1 / np.sqrt(3.0)), Wandering()])
def test_what_would_fold_is_removed_also_at_the_slowest_cycle(clock):
    """A line just beyond the stop edge, which the longest cycle sets."""
    slow = clock.period if isinstance(clock, ConstantPeriod) else 2.0 * np.pi / (clock.speed - 0.5 * clock.wander)
    signal, total = lines(np.array([1.2 * 0.5 * 20 / slow * 1.002]), np.random.default_rng(30))
    (cycles,) = resample(record(signal), clock, n_phases=20)
    assert np.abs(cycles.values).max() <= 1e-6 * total(0.0)


def test_a_resampled_record_can_be_lifted_where_a_cut_one_is_refused():
    """53.3 samples a period: `segment` refuses, `resample` gives cycles whose tones come back each period."""
    clock = ConstantPeriod(period=0.16 / 3.0)
    signal, _ = lines(np.arange(1, 9) / clock.period, np.random.default_rng(13))
    whole = record(signal)
    with pytest.raises(InputError, match="whole number of sampling intervals"):
        segment(whole.with_clock(clock))
    (cycles,) = resample(whole, clock, n_phases=32)
    assert_allclose(cycles.values, np.broadcast_to(cycles.values[:, :, :1], cycles.values.shape), atol=3e-5)


def test_several_hits_share_channels_and_phases():
    rng = np.random.default_rng(14)
    signal, total = lines(np.array([11.0, 47.0, 90.0]), rng)
    hits = [record(signal), record(signal, rate=1700.0, start=2.9, samples=5000)]
    clocks = [ConstantPeriod(period=0.06), ConstantPeriod(period=0.0601, origin=3.0)]
    several = resample(hits, clocks)
    assert len(several) == 2
    assert several[0].n_phases == several[1].n_phases >= 2 * 90.0 * 0.0601 / 0.8
    for cycles, clock in zip(several, clocks, strict=True):
        first = first_cycle(cycles, clock, signal, range(-10, 12))
        instants = expected_instants(clock, cycles, first)
        assert np.abs(cycles.values[0] - signal(instants.ravel()).reshape(instants.shape)).max() <= 1e-6 * total(0.0)


def test_the_longest_run_between_gaps_is_kept():
    clock = ConstantPeriod(period=0.05)
    signal, total = lines(np.array([33.0, 120.0]), np.random.default_rng(15))
    whole = record(signal, channels=("X", "Y"), start=0.0)
    holed = whole.values.copy()
    holed[0, 1210] = np.nan
    holed[1, 3005:3020] = np.nan
    (cycles,) = resample(Record(values=holed, sample_rate=RATE, channels=whole.channels), clock, n_phases=40)
    half = half_width(RATE, cutoff=400.0)
    # Cycle 25 starts 40 samples past the first gap; the last instant of 58 is 106 before the second.
    first = int(np.ceil((1210 + half) / 50.0))
    last = int(np.floor((3005 - half - 48.75) / 50.0))
    assert cycles.n_cycles == last - first + 1
    instants = expected_instants(clock, cycles, first)
    assert np.abs(cycles.values[1] - 2 * signal(instants.ravel()).reshape(instants.shape)).max() <= 2e-6 * total(0.0)
    assert (
        f"; {79 - cycles.n_cycles} of 79 cycles left out, within {half} samples of an end or of a missing sample, "
        "or not in the longest run" in cycles.provenance.steps[-1]
    )


def test_the_provenance_says_what_was_done():
    signal, _ = lines(np.array([20.0]), np.random.default_rng(16))
    (cycles,) = resample(record(signal, start=0.0, noise=0.01), ConstantPeriod(period=0.05), n_phases=20)
    said = (
        "resampled from 1000 Hz to 20 samples a period (400 Hz), equally spaced in time: pass band up to 160 Hz, error "
        "at most 1e-06 of each line's amplitude; 3 of 79 cycles left out, within 57 samples of an end"
    )
    assert cycles.provenance.steps == (said,)
    (cycles,) = resample(record(signal, noise=0.01), Wandering(), n_phases=20)
    assert "equally spaced in shaft angle" in cycles.provenance.steps[0]
    signal, _ = lines(np.array([20.0, 190.0]), np.random.default_rng(16))
    (cycles,) = resample(record(signal, start=0.0, noise=0.01), ConstantPeriod(period=0.05), n_phases=20)
    assert re.search(
        r"; warning: the response reaches 19[0-3](\.\d+)? Hz, beyond the pass band: what lies above 240 Hz is removed, "
        "what lies between is weakened$",
        cycles.provenance.steps[0],
    )


def test_the_values_are_not_held_with_what_was_left_out():
    signal, _ = lines(np.array([20.0]), np.random.default_rng(17))
    (cycles,) = resample(record(signal), ConstantPeriod(period=0.05), n_phases=20)
    assert not cycles.values.flags.writeable
    base = cycles.values
    while base.base is not None:
        base = base.base
    assert base.size == cycles.values.size


def refused(records, clocks, **options):
    with pytest.raises(InputError) as error:
        resample(records, clocks, **options)
    return str(error.value)


def test_what_cannot_be_resampled_is_refused():
    signal, _ = lines(np.array([20.0]), np.random.default_rng(18))
    whole, clock = record(signal), ConstantPeriod(period=0.05)
    assert "at least one record, but is empty" in refused([], [])
    assert "one for each of 2 records, but holds 1" in refused([whole, whole], [clock])
    other = record(signal, channels=("Z",))
    assert "number 1 has X [-] and number 2 has Z [-]" in refused([whole, other], [clock, clock])
    metres, millimetres = record(signal, units=("m",)), record(signal, units=("mm",))
    assert "number 1 has X [m] and number 2 has X [mm]" in refused([metres, millimetres], [clock, clock])
    assert "one is a TachometerSignal" in refused(whole, [TachometerSignal(channel="X")])
    fast = refused(whole, ConstantPeriod(period=0.0019))
    assert "periods of at least two samples, but one is 0.0019 s, or 1.9 samples at 1000 Hz" in fast
    assert "one record of 4 s holds 0.571 periods" in refused(whole, ConstantPeriod(period=7.0))
    short = refused(record(signal, samples=290), clock, n_phases=8)
    assert "hold a whole cycle with 142 samples on either side of each instant" in short
    assert "`n_phases` of `resample` must be an integer of at least 2" in refused(whole, clock, n_phases=1)
    assert "`band` of `resample`" in refused(whole, clock, band=0.3)
    assert "grows over each record" in refused(whole, Wandering(depth=60.0, wander=2.0 * np.pi))


# Bandwidth


@pytest.mark.slow
@pytest.mark.parametrize("samples", [1500, 6000, 40000])
def test_white_noise_holds_no_response(samples):
    """False alarms in 1 of 1000 records, by the statement: none or one in 200 (two, 1 time in 60)."""
    rng = np.random.default_rng(19)
    count = 200 if samples < 10000 else 50
    noise = (rng.normal(size=(3, samples)) for _ in range(count))
    alarms = sum(bandwidth(Record(values=n, sample_rate=RATE, channels=("X", "Y", "Z"))) > 0 for n in noise)
    assert alarms <= 1


def test_the_highest_line_above_the_noise_sets_the_bandwidth():
    signal, _ = lines(np.array([10.0, 60.0, 141.0]), np.random.default_rng(20))
    found = bandwidth(record(signal, samples=20000, noise=0.5))
    assert 141.0 <= found <= 146.0
    # Its own noise: the second channel is twice the first, and the same is found.
    assert 141.0 <= bandwidth(record(signal, samples=20000, noise=0.5, channels=("X", "Y"))) <= 146.0


def test_a_decay_at_the_start_of_a_long_record_is_found():
    def signal(times):
        return np.exp(-8.0 * times) * (np.cos(2.0 * np.pi * 12.0 * times) + 0.3 * np.cos(2.0 * np.pi * 212.0 * times))

    found = bandwidth(record(signal, start=0.0, samples=100000, noise=0.01))
    assert 208.0 <= found <= 218.0


def test_a_burst_and_a_weak_line_are_both_found():
    """The burst is in one stretch of hundreds, the line above the noise in none of them but in their mean."""

    def burst(times):
        return 2.0 * np.exp(-0.5 * ((times - 50.0) / 0.06) ** 2) * np.cos(2.0 * np.pi * 333.0 * times)

    def weak(times):
        return 0.1 * np.cos(2.0 * np.pi * 222.0 * times)

    assert 325.0 <= bandwidth(record(burst, start=0.0, samples=100000, noise=1.0)) <= 341.0
    assert 221.0 <= bandwidth(record(weak, start=0.0, samples=100000, noise=1.0)) <= 226.0


def test_stretches_with_missing_samples_do_not_count():
    signal, _ = lines(np.array([10.0, 141.0]), np.random.default_rng(21))
    whole = record(signal, samples=20000, noise=0.5)
    holed = whole.values.copy()
    holed[0, ::3000] = np.nan
    assert 141.0 <= bandwidth(Record(values=holed, sample_rate=RATE, channels=("X",))) <= 146.0
    holed[0, ::200] = np.nan
    assert 141.0 <= bandwidth(Record(values=holed, sample_rate=RATE, channels=("X",))) <= 160.0
    holed[0, ::50] = np.nan
    assert bandwidth(Record(values=holed, sample_rate=RATE, channels=("X",))) == 500.0
    assert bandwidth(Record(values=np.zeros((1, 500)), sample_rate=RATE, channels=("X",))) == 0.0


@pytest.mark.parametrize(
    ("highest", "phases"),
    [(10.0, 8), (60.0, range(8, 10)), (141.0, range(18, 20)), (230.0, range(29, 31)), (390.0, range(49, 51))],
)
def test_phases_are_chosen_from_the_bandwidth(highest, phases):
    """At 1000 Hz and 20 Hz: 0.8·P·20/2 Hz must reach the highest line, with P from 8 to 50."""
    signal, _ = lines(np.array([9.0, highest]), np.random.default_rng(22))
    (cycles,) = resample(record(signal, samples=20000, noise=0.3), ConstantPeriod(period=0.05))
    assert cycles.n_phases in (phases if isinstance(phases, range) else (phases,))
    assert ("warning" in cycles.provenance.steps[0]) == (highest > 400.0)


def test_a_response_beyond_what_the_sampling_rate_lets_pass_is_warned_of():
    signal, _ = lines(np.array([9.0, 430.0]), np.random.default_rng(23))
    (cycles,) = resample(record(signal, samples=20000, noise=0.3), ConstantPeriod(period=0.05))
    assert cycles.n_phases == 50
    assert "warning: the response reaches 43" in cycles.provenance.steps[0]


def test_fewer_than_eight_samples_a_period_are_not_made_more():
    signal, _ = lines(np.array([30.0]), np.random.default_rng(24))
    (cycles,) = resample(record(signal, noise=0.1), ConstantPeriod(period=0.0055))
    assert cycles.n_phases == 5
