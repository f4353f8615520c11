"""The angle of the shaft against a known one: its deviation, its repairs, its verdict, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from tests.unit.sync.test_pulses import TACHOMETER, train

from floquid.core import AzimuthSignal, Channel, ConstantPeriod, PulseTimes, Record, TachometerSignal
from floquid.errors import InputError
from floquid.plot import save_figure, speed
from floquid.sync import shaft_angle

TURN = 2.0 * np.pi
SPEED = TURN * 10.0
PERIOD_OF_ROTOR = 0.046153846153846156  # half a revolution
SECONDS = 10.0
JITTER = 1e-5


def theta(times, wander):
    """The true angle [rad]: the speed wanders by `wander` (amplitude, relative) at 0.3 Hz."""
    w = TURN * 0.3
    return SPEED * (times + wander / w * np.sin(w * times + 0.4))


def when(angles, wander):
    """The instants of `angles`: Newton's method on the formula."""
    times = angles / SPEED
    for _ in range(50):
        times = times - (theta(times, wander) - angles) / (SPEED * (1.0 + wander * np.cos(TURN * 0.3 * times + 0.4)))
    assert np.abs(theta(times, wander) - angles).max() < 1e-9
    return times


def spaced(lines, seed=0, by=0.2):
    """The true deviations of lines from even spacing [rad], by up to so much of the spacing."""
    g = np.random.default_rng(seed).uniform(-by, by, lines) * TURN / lines
    return g - g.mean()


def pulses(wander=0.002, lines=1, geometry=0.0, jitter=JITTER, seed=0, turns=98, start=0.5):
    """Times of pulses: the first is of line 0, at the angle `start` + geometry[0]."""
    numbers = np.arange(lines * turns)
    angles = start + TURN * numbers / lines + np.broadcast_to(geometry, lines)[numbers % lines]
    return when(angles, wander) + jitter * np.random.default_rng(seed).standard_normal(len(numbers))


def record(clock, values=None, unit="-", rate=1000.0):
    values = np.zeros(int(SECONDS * rate)) if values is None else values
    return Record(values=values[None], sample_rate=rate, channels=[Channel(name="x", unit=unit)], clock=clock)


def found(times, lines=1, **options):
    return shaft_angle(record(PulseTimes(times=times, pulses_per_revolution=lines, **options)))


def standardised(shaft, truth, count=60):
    times = np.linspace(shaft.first, shaft.last, count)
    return (shaft.angle(times) - truth(times)) / shaft.angle_std(times)


def said(shaft, words):
    return any(words in reason for reason in shaft.reasons)


# The estimate and its deviation.


@pytest.mark.slow
@pytest.mark.parametrize("lines", [1, 4])
@pytest.mark.parametrize("wander", [0.0, 0.0002, 0.002, 0.02])
def test_the_deviations_are_the_errors(wander, lines):
    """Over seeds: of the angle, of the mean period, and of the encoder's lines."""
    angles, periods, geometries = [], [], []
    for seed in range(30):
        geometry = spaced(lines, seed)
        shaft = found(pulses(wander, lines, geometry, seed=seed), lines)
        angles.append(standardised(shaft, lambda t, g=geometry: theta(t, wander) - 0.5 - g[0]))
        turned = theta(shaft.last, wander) - theta(shaft.first, wander)
        periods.append((shaft.period - TURN * (shaft.last - shaft.first) / turned) / shaft.period_std)
        if lines > 1:
            geometries.append((shaft.geometry - geometry) / shaft.geometry_std)
            assert np.abs(geometries[-1]).max() < 5.0
    assert 0.8 < np.sqrt(np.mean(np.square(angles))) < 1.25
    assert 0.6 < np.sqrt(np.mean(np.square(periods))) < 1.4
    assert np.abs(periods).max() < 4.0
    if lines > 1:
        assert 0.75 < np.sqrt(np.mean(np.square(geometries))) < 1.25


@pytest.mark.slow
def test_a_steady_shaft_is_a_straight_line():
    straight = [found(pulses(0.0, seed=seed)).spline.degree == 1 for seed in range(60)]
    assert sum(straight) >= 57
    shaft = found(pulses(0.0))
    assert shaft.wander == 0.0
    assert shaft.speed([1.0, 5.0]) == pytest.approx([shaft.mean_speed] * 2, rel=1e-12)
    assert shaft.jitter == pytest.approx(JITTER, rel=0.3)
    assert shaft.jitter_unit == "s"


def test_an_angle_and_its_time_are_inverse_also_beyond_the_evidence():
    shaft = found(pulses(0.02))
    times = np.linspace(-1.0, SECONDS + 1.0, 500).reshape(50, 10)
    assert shaft.time_at(shaft.angle(times)) == pytest.approx(times, abs=1e-12)
    step = 1e-4
    assert (shaft.angle(times + step) - shaft.angle(times - step)) / (2 * step) == pytest.approx(
        shaft.speed(times), rel=1e-5
    )
    beyond = np.array([shaft.last, shaft.last + 1.0])
    assert np.diff(shaft.angle(beyond))[0] == pytest.approx(shaft.speed(shaft.last).item(), rel=1e-12)
    assert shaft.angle_std(beyond)[1] > 2.0 * shaft.angle_std(beyond)[0]


def test_zero_is_at_the_first_pulse():
    times = pulses(0.002, 4, spaced(4))
    shaft = found(times, 4)
    assert abs(shaft.angle(times[0])) < 6.0 * JITTER * SPEED
    assert shaft.angle(times[8]) == pytest.approx(2.0 * TURN, abs=6.0 * JITTER * SPEED)


def test_half_a_revolution():
    times = pulses(0.0)
    assert found(times, periods_per_revolution=2).period == pytest.approx(0.05, rel=1e-5)
    assert found(times, periods_per_revolution=0.5).period == pytest.approx(0.2, rel=1e-5)


def test_a_sampled_tachometer_from_beginning_to_end():
    """Pulses of 2 % of a revolution that rise over two samples, at a speed that wanders, with noise."""
    rate = 1000.0
    edges = when(0.3 + TURN * np.arange(97), 0.002) * rate
    values = train(edges, 9.0, 2.0, noise=0.005, n=int(SECONDS * rate))
    shaft = shaft_angle(record(TachometerSignal(channel="x"), values))
    assert shaft.n_pulses == 97
    assert shaft.jitter < 0.03 / rate
    z = standardised(shaft, lambda t: theta(t, 0.002) - 0.3)
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert shaft.wander == pytest.approx(0.002 / np.sqrt(2.0), rel=0.05)


# Pulses that are missing, doubled, or far off.


@pytest.mark.parametrize(("lines", "by"), [(1, 0.0), (3, 0.15), (8, 0.15), (8, 0.3), (60, 0.1)])
@pytest.mark.parametrize("seed", range(3))
def test_missing_and_doubled_pulses_are_found(lines, by, seed):
    rng = np.random.default_rng(100 + seed)
    geometry = spaced(lines, seed, by)
    times = pulses(0.002, lines, geometry, seed=seed)
    chosen = rng.choice(np.arange(3, len(times) - 3, 4), 9, replace=False)  # not next to one another
    extra = times[chosen[4:]] + rng.choice([-1, 1], 5) * rng.uniform(0.05, 0.25, 5) * TURN / SPEED / lines
    shaft = found(np.sort(np.concatenate([np.delete(times, chosen[:4]), extra])), lines)
    # With uneven lines, an extra pulse may lie nearer to where a line is expected than the line's own: it is then
    # one too many in another place.
    assert (shaft.missing, shaft.doubled) == (4, 5)
    assert shaft.rejected == 0 or by == 0.3
    assert np.abs(standardised(shaft, lambda t: theta(t, 0.002) - 0.5 - geometry[0])).max() < 6.0
    assert said(shaft, " missing beside ")
    assert said(shaft, "left out: more than there are lines")
    if lines > 1:
        assert np.abs((shaft.geometry - geometry) / shaft.geometry_std).max() < 5.0
        assert said(shaft, "unevenly spaced")


@pytest.mark.parametrize(("lines", "by"), [(2, 0.15), (8, 0.3), (5, 0.3), (12, 0.25)])
@pytest.mark.parametrize("seed", range(4))
def test_uneven_lines_are_neither_missing_nor_doubled(lines, by, seed):
    shaft = found(pulses(0.002, lines, spaced(lines, seed, by)), lines)
    assert (shaft.missing, shaft.doubled, shaft.rejected) == (0, 0, 0)


@pytest.mark.parametrize("lines", [2, 4, 6])
def test_lines_so_uneven_that_an_interval_looks_like_two_are_told_apart(lines):
    """Intervals of 0.44 and 1.56 spacings in turn, of which one alone would be a pulse too many, one a pulse lost."""
    geometry = np.resize([-0.28, 0.28], lines) * TURN / lines
    shaft = found(pulses(0.002, lines, geometry), lines)
    assert (shaft.missing, shaft.doubled, shaft.rejected) == (0, 0, 0)
    assert np.abs((shaft.geometry - geometry) / shaft.geometry_std).max() < 5.0


def test_a_wheel_of_four_less_one():
    """A third of the pulses that there are come after a gap, up to the ends of the record."""
    numbers = np.arange(160)[np.arange(160) % 4 != 2]
    times = when(TURN * numbers / 4, 0.002) + 1e-6 * np.random.default_rng(0).standard_normal(len(numbers))
    shaft = found(times, 4)
    assert (shaft.missing, shaft.doubled, shaft.rejected) == (40, 0, 0)
    assert said(shaft, "No pulse comes from line 3 of 4")


def test_even_lines_are_not_called_uneven():
    assert not said(found(pulses(0.002, 8), 8), "unevenly")


@pytest.mark.parametrize("first", [0, 7, 21, 59])
def test_a_wheel_with_missing_teeth_says_where_zero_is(first):
    """Sixty less two: whichever pulse is the first of the record, zero is the first tooth after the gap."""
    numbers = np.arange(first, 60 * 40)
    numbers = numbers[(numbers % 60 != 20) & (numbers % 60 != 21)]
    times = when(TURN * numbers / 60, 0.002) + 1e-6 * np.random.default_rng(0).standard_normal(len(numbers))
    shaft = found(times, 60)
    assert (shaft.doubled, shaft.rejected) == (0, 0)
    assert shaft.missing == numbers[-1] - numbers[0] + 1 - len(numbers)
    assert said(shaft, "No pulse comes from lines 58, 59 of 60. Phase zero is the first line after the gap.")
    assert np.isnan(shaft.geometry[58:]).all()
    assert np.isfinite(shaft.geometry[:58]).all()
    at_gap = when(np.array([TURN * (22 + 60 * 5) / 60]), 0.002)
    assert (shaft.angle(at_gap)[0] / TURN + 0.5) % 1.0 == pytest.approx(0.5, abs=1e-4)


def test_outliers_are_left_out():
    times = pulses(0.002)
    late = [12, 40, 41, 77]
    times[late] += [1e-3, -2e-3, 5e-3, 4e-4]
    shaft = found(times)
    assert shaft.rejected == 4
    assert np.flatnonzero(~shaft.kept).tolist() == late
    assert np.sqrt(np.mean(standardised(shaft, lambda t: theta(t, 0.002) - 0.5) ** 2)) < 2.0
    assert said(shaft, "4 pulses left out: far off the angle of the others.")


@pytest.mark.parametrize(("rate", "place"), [(2.0, 0.01), (0.6, 0.1)])
def test_no_exact_pulse_is_left_out_where_the_speed_changes_quickly(rate, place):
    """A step of the speed: small residuals elsewhere made those around it outliers, and the angle 5 degrees wrong."""

    def turned(times):
        steep = 8.0 * place
        return 2.0 * np.pi * (10.0 * times + 0.01 * rate * steep * np.log(np.cosh((times - 8.0) / steep)))

    grid = np.linspace(0.0, 16.0, 400_001)
    times = np.interp(2.0 * np.pi * np.arange(1, 159) + turned(0.0), turned(grid), grid)
    shaft = found(times)
    assert shaft.rejected == 0
    between = np.linspace(shaft.first, shaft.last, 3001)
    errors = shaft.angle(between) - (turned(between) - turned(times[0]))
    assert np.abs(errors).max() < np.deg2rad(0.3)
    assert np.mean(np.abs(errors) < 1.96 * shaft.angle_std(between)) > 0.85


def test_a_wander_that_the_curve_cannot_follow_is_told():
    """Over seven revolutions the speed comes and goes and is followed; over less than two, no knots are that near."""
    numbers = np.arange(100)
    times = (
        numbers / 10.0 + 1e-3 * np.sin(TURN * numbers / 7.0) + JITTER * np.random.default_rng(0).standard_normal(100)
    )
    assert not said(found(times), "from pulse to pulse, so its deviations are too small")
    numbers = np.arange(400)
    fast = numbers / 40.0 + 1e-3 * np.sin(TURN * numbers / 7.0)
    assert said(found(fast, 4), "from pulse to pulse, so its deviations are too small")
    assert not said(found(pulses(0.002)), "from pulse to pulse, so its deviations are too small")


@pytest.mark.slow
def test_a_long_record_has_as_many_knots_as_its_wander_needs():
    """A hundred and eighty cycles of wander in six thousand revolutions."""
    shaft = found(pulses(0.002, turns=6000, seed=3))
    assert shaft.wander == pytest.approx(0.002 / np.sqrt(2.0), rel=0.02)
    assert np.sqrt(np.mean(standardised(shaft, lambda t: theta(t, 0.002) - 0.5, 500) ** 2)) < 1.25


def test_a_long_gap_is_bridged_and_told():
    times = np.delete(pulses(0.002), np.arange(40, 48))
    shaft = found(times)
    assert shaft.missing == 8
    assert said(shaft, "revolutions: a smooth curve bridges them")


def test_a_gap_that_cannot_be_counted_is_told():
    """The speed is 10 Hz before and 10.5 Hz after: in nine seconds that is more than four revolutions."""
    times = np.concatenate([np.arange(30) / 10.0, 12.0 + np.arange(30) / 10.5])
    assert said(found(times), "is a guess")


def test_a_record_beyond_the_pulses_is_told():
    assert said(found(pulses(0.0)[:80]), "revolutions after it: the speed is taken as constant there.")
    assert not said(found(pulses(0.0, turns=100)), "beyond the evidence")


# The verdict.


@pytest.mark.parametrize(
    ("wander", "steady", "words"),
    [
        (0.0, True, "The speed is constant at 10"),
        (0.01, True, "steady enough for a periodic model"),
        (0.04, True, "Above 1 % take care"),
        (0.1, False, "more than 5 %: no periodic model holds"),
    ],
)
def test_the_verdict_goes_by_the_wander(wander, steady, words):
    """A whole number of cycles of the wander: none of it is a run-up."""
    shaft = found(pulses(wander, turns=100, lines=4), 4)
    times = shaft.times[shaft.times < 20.0 / 3.0]
    shaft = found(times, 4)
    assert shaft.steady is steady
    assert words in shaft.reasons[0]
    assert shaft.wander == pytest.approx(wander / np.sqrt(2.0), rel=0.05)


@pytest.mark.parametrize(("sign", "word"), [(1, "rises"), (-1, "falls")])
def test_a_run_up_is_not_steady(sign, word):
    fine = np.linspace(0.0, SECONDS, 200001)
    angles = SPEED * (fine + sign * 0.01 * fine**2)
    times = np.interp(TURN * np.arange(int(angles[-1] / TURN)), angles, fine)
    shaft = found(times)
    assert not shaft.steady
    assert f"The speed {word} by" in shaft.reasons[0]


# Azimuth.

AZIMUTH = AzimuthSignal(channel="x")
RATE = 500.0


def azimuth(seed=0, noise=0.01, wander=0.002, start=1.0):
    times = np.arange(int(SECONDS * RATE)) / RATE
    return start + theta(times, wander) + noise * np.random.default_rng(seed).standard_normal(len(times))


def of_azimuth(values, unit="deg"):
    return shaft_angle(record(AZIMUTH, values, unit, RATE))


@pytest.mark.parametrize(
    ("change", "unit"),
    [
        (lambda a: np.degrees(a) % 360.0, "deg"),
        (lambda a: np.degrees(a) % 360.0, "-"),
        (lambda a: (np.degrees(a) + 180.0) % 360.0 - 180.0, "deg"),
        (lambda a: a % TURN, "rad"),
        (lambda a: a % TURN, "-"),
        (np.degrees, "deg"),
        (lambda a: a, "rad"),
    ],
)
def test_an_azimuth_is_unwrapped_whatever_its_unit(change, unit):
    """Noise of half a degree makes it cross the wrap to and fro."""
    shaft = of_azimuth(change(azimuth()), unit)
    z = standardised(shaft, lambda t: 1.0 + theta(t, 0.002))
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.6
    assert shaft.rejected == 0
    assert shaft.jitter_unit == "rad"


@pytest.mark.slow
def test_the_deviations_of_an_azimuth_are_the_errors():
    z = [
        standardised(of_azimuth(np.degrees(azimuth(seed)) % 360.0), lambda t: 1.0 + theta(t, 0.002))
        for seed in range(15)
    ]
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_a_shaft_that_turns_backwards_is_counted_as_positive():
    shaft = of_azimuth(np.degrees(-azimuth()) % 360.0)
    assert shaft.mean_speed == pytest.approx(SPEED, rel=1e-3)
    assert np.abs(standardised(shaft, lambda t: 1.0 + theta(t, 0.002))).max() < 5.0
    assert said(shaft, "turns backwards")


def test_missing_samples_and_samples_averaged_over_the_wrap():
    fine = np.degrees(1.0 + theta((np.arange(50000) - 4.5) / (10.0 * RATE), 0.002)) % 360.0
    values = fine.reshape(-1, 10).mean(axis=1)
    true = lambda t: 1.0 + theta(t, 0.002)  # noqa: E731
    rng = np.random.default_rng(4)
    values[rng.choice(len(values), 200, replace=False)] = np.nan
    values = values + 0.1 * rng.standard_normal(len(values))
    shaft = of_azimuth(values)
    assert shaft.missing == 200
    assert shaft.rejected > 50
    times = np.linspace(0.5, 9.5, 50)
    assert np.abs(shaft.angle(times) - true(times)).max() < 0.002
    assert said(shaft, "200 samples missing")


# What is refused.


def refused(subject):
    with pytest.raises(InputError) as error:
        shaft_angle(subject)
    return str(error.value)


@pytest.mark.parametrize(
    ("values", "unit", "words"),
    [
        (np.degrees(azimuth()) / 360.0 % 1.0, "-", "must have an azimuth that wraps at 360 deg or 2π rad, but 'x'"),
        (np.degrees(azimuth()) / 360.0 % 1.0, "deg", "must have an azimuth that wraps at 360 deg, but 'x' wraps at 1."),
        (azimuth() % TURN, "deg", "must have an azimuth that wraps at 360 deg, but 'x' wraps at 6.28"),
        (azimuth(), "-", "has no unit and runs over 628"),
        (np.degrees(azimuth()) % 360.0, "V", "must have an azimuth in deg or rad, but 'x' has unit 'V'"),
        (np.zeros(5000), "deg", "must have a channel of azimuth that turns, but 'x' is constant"),
        (np.full(5000, np.nan), "deg", "is missing throughout"),
        (100.0 * np.sin(np.arange(5000) * 0.005), "deg", "must be of a shaft that turns one way throughout"),
    ],
)
def test_what_is_no_azimuth_is_refused(values, unit, words):
    assert words in refused(record(AZIMUTH, values, unit, RATE))


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        (None, "must have a clock of pulses or azimuth, but has none."),
        (ConstantPeriod(period=0.1), "has a ConstantPeriod"),
        (PulseTimes(times=[1.0, 2.0]), "must have three pulses or more"),
        (TachometerSignal(channel="y"), "must name channels of the record, but has 'y'"),
        (AzimuthSignal(channel="y"), "must name channels of the record, but has 'y'"),
        (TachometerSignal(channel="x"), "must hold pulses, but channel 'x' is constant"),
    ],
)
def test_a_clock_that_tells_no_angle_is_refused(clock, words):
    assert words in refused(record(clock))


def test_fewer_than_three_revolutions_of_an_encoder_are_taken_as_even():
    shaft = found(pulses(0.0, 16, turns=2), 16)
    assert shaft.geometry is None
    assert said(shaft, "the 16 lines are taken as evenly spaced")


# The rotor, and the figure.


def rotor():
    with np.load(TACHOMETER) as data:
        return Record(
            values=data["values"],
            sample_rate=float(data["sample_rate"]),
            channels=list(data["channels"]),
            clock=TachometerSignal(channel="tach", periods_per_revolution=2),
        )


@pytest.mark.skipif(not TACHOMETER.exists(), reason=f"{TACHOMETER.name} is not here")
def test_the_rotors_period():
    shaft = shaft_angle(rotor())
    assert abs(shaft.period - PERIOD_OF_ROTOR) < 5.0 * shaft.period_std
    assert shaft.period_std < 6e-7 * shaft.period
    assert shaft.steady
    assert shaft.spline.degree == 1


def test_the_figure_shows_speed_residuals_and_lines(tmp_path: Path):
    geometry = spaced(8)
    times = pulses(0.002, 8, geometry)
    times[300] += 2e-3
    source = record(PulseTimes(times=times, pulses_per_revolution=8))
    shaft = shaft_angle(source)
    figure = speed(shaft, source, speed_unit="rpm")
    top, middle, bottom = figure.axes
    assert top.get_title(loc="left").replace("\n", " ") == shaft.reasons[0].replace("9.99959 Hz", "599.975 rpm")
    assert top.get_ylabel() == "speed [rpm]"
    assert middle.get_ylabel() == "pulse − fit [µs]"
    assert middle.get_xlabel() == "time [s]"
    assert bottom.get_ylabel() == "ahead of even [deg]"
    (curve,) = [line for line in top.lines if line.get_label() == "speed"]
    assert np.asarray(curve.get_ydata()) == pytest.approx(60.0 / TURN * shaft.speed(curve.get_xdata()))
    (out,) = [line for line in middle.lines if str(line.get_label()).startswith("left out")]
    assert np.asarray(out.get_ydata()) > 0.0  # it came late
    assert np.asarray(bottom.lines[0].get_ydata()) == pytest.approx(np.degrees(shaft.geometry))
    assert save_figure(figure, tmp_path / "speed.png").stat().st_size > 10000


def test_the_figure_of_an_azimuth_has_degrees():
    figure = speed(of_azimuth(np.degrees(azimuth()) % 360.0))
    assert [axes.get_ylabel() for axes in figure.axes] == ["speed [Hz]", "azimuth − fit [deg]"]


def test_the_figure_refuses_what_is_no_shaft():
    with pytest.raises(InputError, match="`shaft` of `speed` must be a ShaftAngle"):
        speed(3)
    with pytest.raises(InputError, match="`record` of `speed` must be a Record or None"):
        speed(found(pulses(0.0)), 3)


def test_the_pattern_of_edges_that_are_known_to_a_sample_is_no_motion_of_the_shaft():
    """At 25.08 samples a revolution their rounding repeats: a spline of many pieces follows that as if it were one."""
    assert angle_error(jitter=0.0) < 0.2 / np.sqrt(12.0)


@pytest.mark.parametrize("jitter", [1.0, 2.0])
def test_edges_that_jitter_beyond_a_sample_still_show_how_the_shaft_moves(jitter):
    assert angle_error(jitter=jitter) < 0.35 * jitter


def angle_error(jitter):
    """The rms error of the angle over that in a sample, the larger of two draws; `jitter` of edges [samples]."""
    speed, rate, errors = TURN * 2450.0 / 60.0, 1024.0, []
    times = np.arange(8 * int(rate)) / rate
    for seed in range(2):
        phases = np.random.default_rng(seed).uniform(0.0, TURN, 3)
        waves = sum(np.sin(w * times + phase) / w for w, phase in zip((0.9, 2.2, 3.4), phases, strict=True))
        angles = speed * (times + 0.0008 * waves)
        late = jitter * speed / rate * np.random.default_rng(seed + 9).standard_normal(1000)
        level = 5.0 * (np.mod(angles - 2.0 + late[((angles - 1.0) // TURN).astype(int)], TURN) < 0.9)
        shaft = shaft_angle(record(TachometerSignal(channel="x"), level, unit="V", rate=rate))
        inside = (times >= shaft.first) & (times <= shaft.last)
        off = shaft.angle(times[inside]) - angles[inside]
        errors.append(off.std() / (speed / rate))
    return max(errors)
