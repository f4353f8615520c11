"""A model fitted anew to other samples: same modes, same bands, by samples and by whole cycles alike."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid import ConstantPeriod, InputError, PeriodicModel, Record, identify
from floquid.errors import IdentificationError
from floquid.periodic import instants, own_period, refit, unexplained
from floquid.periodic.least_squares import KeptCycles
from floquid.sync import shaft_angle
from floquid.systems import JeffcottRotor, Run

PERIOD = 2.0 * np.pi
CHANNELS = ("x", "y")


def truth(growth=0.0, hits=1):
    """A pair, a positive and a negative real multiplier, in two channels; the first decays or grows."""
    draw = np.random.default_rng(3)
    pair = np.array([-0.01 + growth + 0.31j, -0.01 + growth - 0.31j])
    b = np.zeros((4, 2, hits, 3), complex)
    b[0] = draw.standard_normal((2, hits, 3)) + 1j * draw.standard_normal((2, hits, 3))
    b[1] = b[0, :, :, ::-1].conj()
    # e^{-0.03t}: harmonics -m are conjugates; e^{(-0.02 + i/2)t}: harmonic -1 - m is that of m.
    b[2, :, :, 2] = draw.standard_normal((2, hits)) + 1j * draw.standard_normal((2, hits))
    b[2, :, :, 0], b[2, :, :, 1] = b[2, :, :, 2].conj(), draw.standard_normal((2, hits))
    b[3, :, :, 1] = draw.standard_normal((2, hits)) + 1j * draw.standard_normal((2, hits))
    b[3, :, :, 0] = b[3, :, :, 1].conj()
    return PeriodicModel(
        exponents=[*pair, -0.03, -0.02 + 0.5j],
        coefficients=b,
        harmonics=[-1, 0, 1],
        period=PERIOD,
        channels=CHANNELS,
    )


def record_of(model, *, hit=0, cycles=40, phases=10, start=0.0, noise=1e-3, seed=0, rest=0):
    times = start + np.arange(cycles * phases + rest) * PERIOD / phases
    values = model.response(times)[:, hit]
    values = values + noise * np.random.default_rng(seed).standard_normal(values.shape)
    return Record(values=values, sample_rate=phases / PERIOD, channels=CHANNELS, start=start)


def at(model, exponents, period=None):
    """The same shapes at other exponents, or with another period."""
    return PeriodicModel(
        exponents=exponents,
        coefficients=model.coefficients,
        harmonics=model.harmonics,
        period=period or model.period,
        channels=model.channels,
    )


def off(model, true):
    """The distance of each true exponent from the nearest of a model."""
    return np.abs(np.subtract.outer(true.exponents, model.exponents)).min(axis=1)


def without(record, cycles, phases=10):
    """The record without some of its cycles."""
    values = record.values.copy()
    for n in cycles:
        values[:, n * phases : (n + 1) * phases] = np.nan
    return replace(record, values=values)


CLOCK = ConstantPeriod(period=PERIOD)


@pytest.mark.parametrize("growth", [0.0, 0.03])
def test_a_fit_comes_back_to_the_truth_with_its_deviations(growth):
    true = truth(growth, hits=2)
    records = [without(record_of(true, hit=h, cycles=40 - 8 * h, seed=h), [3, 4, 11]) for h in range(2)]
    near = np.where(np.arange(4) == 2, -0.0302, true.exponents)
    found = refit(at(true, near), records, [CLOCK, CLOCK], noise=np.full((2, 2), 1e-3))
    order = [int(np.argmin(np.abs(found.exponents - value))) for value in true.exponents]
    gap, std = found.exponents[order] - true.exponents, found.exponent_std[order]
    assert np.abs(gap.real / std.real).max() < 4.5
    assert np.abs(gap.imag[:2] / std.imag[:2]).max() < 4.5
    assert np.abs(std[:2]).max() < 1e-3
    wide = found.coefficients[order]
    error = np.abs(wide - true.coefficients) / np.maximum(np.abs(found.coefficient_std[order]), 1e-30)
    assert error[true.coefficients != 0].max() < 5.0
    assert (wide[true.coefficients == 0] == 0).all()


def test_a_mode_that_samples_do_not_tell_may_stay_as_the_model_has_it():
    true = truth()
    response = np.array(true.coefficients)
    response[2] = 0.0  # in none of the samples
    record, given = record_of(at(true, true.exponents), noise=1e-3), {"noise": np.full((2, 1), 1e-3)}
    record = replace(record, values=record_of(replace(true, coefficients=response)).values)
    with pytest.raises(IdentificationError, match="hardly rises above the noise"):
        refit(true, [record], [CLOCK], **given)
    found = refit(true, [record], [CLOCK], **given, hold=True)
    assert found.order == true.order
    assert true.exponents[2] in found.exponents
    assert off(found, true).max() < 1e-3


def test_whole_cycles_are_as_good_as_their_samples():
    true = truth()
    record = without(record_of(true, start=0.3), [0, 7, 8, 20])
    assert KeptCycles.of(record, CLOCK, PERIOD, 0) is not None
    cheap = refit(true, [record], [CLOCK], noise=np.full((2, 1), 1e-3))
    # One sample more, of a cycle that is not whole, and both are blocks of samples.
    later = replace(record, values=np.concatenate([record.values, np.full((2, 1), np.nan)], axis=1))
    single = replace(later, values=np.where(np.arange(later.n_samples) == 1, 0.0, later.values))
    assert KeptCycles.of(later, CLOCK, PERIOD, 0) is not None
    assert KeptCycles.of(single, CLOCK, PERIOD, 0) is None
    uneven = replace(record, sample_rate=record.sample_rate * (1.0 + 1e-6))
    assert KeptCycles.of(uneven, CLOCK, PERIOD, 0) is None
    slow = refit(true, [uneven], [CLOCK], noise=np.full((2, 1), 1e-3))
    # A millionth of the rate moves the exponents by as much, and nothing else.
    assert_allclose(slow.exponents, cheap.exponents, rtol=1e-4)
    assert_allclose(slow.coefficients, cheap.coefficients, atol=1e-4)
    assert_allclose(slow.coefficient_std, cheap.coefficient_std, rtol=1e-3)
    assert_allclose(
        unexplained(true, [record], [CLOCK])[0], unexplained(true, [uneven], [CLOCK])[0], atol=2e-3, equal_nan=True
    )


def test_the_period_is_fitted_where_that_is_wanted():
    true, noise = truth(), np.full((2, 1), 1e-3)
    record = record_of(true)
    # A negative multiplier has half the fundamental, whatever that is.
    near = np.where(np.arange(4) == 3, -0.02 + 0.5j / 1.0002, true.exponents)
    stretched = at(true, near, PERIOD * 1.0002)
    clock = ConstantPeriod(period=stretched.period)
    held = refit(stretched, [record], [clock], noise=noise)
    free = refit(stretched, [record], [clock], noise=noise, free_period=True)
    assert held.period == stretched.period
    assert held.estimates.period_std() == 0.0
    std = free.estimates.period_std()
    assert 0.0 < std < 1e-4 * PERIOD
    assert abs(free.period - PERIOD) < 5.0 * std
    assert off(free, true).max() < 5.0 * np.abs(free.exponent_std).max()
    # With the period given, all is as precise or more so.
    given = refit(true, [record], [CLOCK], noise=noise)
    assert (np.diag(given.covariance) <= np.diag(free.covariance) * (1.0 + 1e-6)).all()


def test_the_period_of_a_measured_angle_is_not_fitted():
    shaft = shaft_angle(Run(n_periods=60, samples_per_period=16.3, imbalance=0.0, seed=4).record())
    record = record_of(truth())
    with pytest.raises(InputError, match="`free_period` of `refit` must be false where the angle of a shaft is measur"):
        refit(truth(), [record], [shaft], noise=np.full((2, 1), 1e-3), free_period=True)


def test_wider_bands_are_fitted_beside_where_that_is_wanted():
    true, noise = truth(), np.full((2, 1), 1e-3)
    record = record_of(true)
    plain, wider = (refit(true, [record], [CLOCK], noise=noise, wider=wanted) for wanted in (False, True))
    assert plain.unselected is None
    assert_allclose(wider.exponents, plain.exponents, rtol=1e-12)
    # Ten samples a period show four harmonics: three more than there are on either side.
    assert wider.unselected.harmonics.max() == 4
    assert set(plain.estimates.harmonics) < set(wider.unselected.harmonics)


def test_samples_left_out_take_no_part():
    true, clocks, noise = truth(), [CLOCK], np.full((2, 1), 1e-3)
    record = record_of(true)
    spoilt = without(record, [5])
    garbage = replace(record, values=np.where(np.isnan(spoilt.values), 100.0, record.values))
    assert off(refit(true, [spoilt], clocks, noise=noise), true).max() < 2e-4
    assert off(refit(true, [garbage], clocks, noise=noise), true).max() > 2e-3


def test_what_is_left_is_the_record_less_the_response():
    true = truth(hits=2)
    records = [record_of(true, hit=h, start=0.7, rest=3) for h in range(2)]
    records[0] = without(records[0], [2])
    for hit, left in enumerate(unexplained(true, records, [CLOCK, CLOCK])):
        expected = records[hit].values - true.response(records[hit].times)[:, hit]
        assert_allclose(left, expected, atol=1e-12, equal_nan=True)


def test_a_channel_and_a_record_may_have_no_samples_at_all():
    true = truth(hits=3)
    records = [record_of(true, hit=h, start=0.7, rest=3) for h in range(3)]
    nothing = np.full(records[0].values.shape, np.nan)
    records[0] = replace(records[0], values=np.where([[True], [False]], records[0].values, np.nan))
    records[1] = replace(records[1], values=nothing)
    left = unexplained(true, records, [CLOCK] * 3)
    for hit, rest in enumerate(left):
        expected = records[hit].values - true.response(records[hit].times)[:, hit]
        assert_allclose(rest, expected, atol=1e-12, equal_nan=True)
    with pytest.raises(InputError, match="channel 'y' of record 1 has none"):
        refit(true, records, [CLOCK] * 3, noise=np.ones((2, 3)))
    with pytest.raises(InputError, match="`clocks` of `unexplained` must be one a record"):
        unexplained(true, records, [CLOCK])


def test_a_record_that_begins_late_counts_from_its_own_phase_zero():
    true = truth()
    record = record_of(true, start=0.3)
    later = replace(record, start=record.start + 5 * PERIOD)
    assert_allclose(unexplained(true, [later], [CLOCK])[0], unexplained(true, [record], [CLOCK])[0], atol=1e-12)
    times, angles = instants(later, CLOCK, true.fundamental)
    assert times[0] == pytest.approx(0.3)
    assert_allclose(angles, times * true.fundamental)


@cache
def rotor():
    """A model of the rotor, from a steady record."""
    record = JeffcottRotor().simulate(n_periods=100, samples_per_period=16, noise=0.01, seed=1)
    return record, identify(record, validate=False).model


def test_a_shaft_whose_speed_wanders():
    run = Run(n_periods=60, samples_per_period=16.3, imbalance=0.0, pulse_deg=90.0, seed=4)
    whole = run.record()
    shaft = shaft_angle(whole)
    record = whole.select([c.name for c in whole.channels if c.name != whole.clock.channel])
    noise = 0.02 * np.abs(record.values).max(axis=1, keepdims=True)
    model = rotor()[1]
    found = refit(at(model, model.exponents, period=shaft.period), [record], [shaft], noise=noise)
    left = unexplained(found, [record], [shaft])[0]
    assert_allclose(left.std(axis=1) / noise[:, 0], 1.0, atol=0.06)
    gap = np.subtract.outer(JeffcottRotor().exponents(), found.exponents)
    gap = np.abs(gap.real + 1j * (gap.imag - np.rint(gap.imag))).min(axis=1)  # modulo i times the rotor's own ω
    assert gap.max() < 5.0 * np.abs(found.exponent_std).max()
    steady = [ConstantPeriod(period=shaft.period, origin=float(shaft.time_at(np.zeros(1))[0]))]
    assert unexplained(found, [record], steady)[0].std() > 1.02 * left.std()


def test_a_period_that_is_another():
    record, model = rotor()
    noise = 0.01 * np.abs(record.values).max(axis=1, keepdims=True)
    right = own_period(model, [record], [record.clock], noise=noise)
    assert abs(right[0]) < 4.5 * right[1]
    wrong = replace(record, sample_rate=record.sample_rate / 1.0002)
    stretched = at(model, model.exponents / 1.0002)
    found = own_period(stretched, [wrong], [record.clock], noise=noise)
    assert found[0] == pytest.approx(2e-4, abs=4.5 * found[1])
    assert abs(found[0]) > 8.0 * found[1]


def test_one_harmonic_does_not_tell_the_period():
    true = truth()
    single = PeriodicModel(
        exponents=true.exponents[:2],
        coefficients=true.coefficients[:2] * (np.arange(3) == 1),
        harmonics=true.harmonics,
        period=PERIOD,
        channels=CHANNELS,
    )
    assert own_period(single, [record_of(single)], [CLOCK], noise=np.full((2, 1), 1e-3)) is None


@pytest.mark.parametrize("lines", [1, 2, 3])
def test_a_real_multiplier_beside_its_axis_is_no_sign_of_the_period(lines):
    """A pair that is off its axis, taken for one real multiplier: its lines move, as of another period."""
    turns = np.arange(-3, 4)
    b = np.zeros((1, 2, 1, 7), complex)
    b[0, :, 0, 3:6] = np.array([[1.0, 0.5j, 0.3], [-0.4, 0.2 + 0.1j, 0.6j]]) * (np.arange(3) < lines)
    b[..., :3] = b[..., 5:2:-1].conj()
    parts = {"harmonics": turns, "period": PERIOD, "channels": CHANNELS}
    alone = PeriodicModel(exponents=[-0.02 + 0.5j], coefficients=b, **parts)
    pair = np.concatenate([b * (turns >= 0), b[..., ::-1].conj() * (turns <= 0)])
    pair = PeriodicModel(exponents=[-0.02 + 0.5001j, -0.02 - 0.5001j], coefficients=pair, **parts)
    found = own_period(alone, [record_of(pair)], [CLOCK], noise=np.full((2, 1), 1e-3))
    assert (found is None) == (lines < 3)
    assert found is None or abs(found[0]) < 4.0 * found[1] < 1e-4


@pytest.mark.parametrize(
    ("records", "noise", "said"),
    [
        ([record_of(truth())] * 2, np.ones((2, 1)), "`records` of `refit` must be 1 of 2 channels"),
        ([record_of(truth())], np.zeros((2, 1)), "`noise` of `refit` must be positive"),
        ([record_of(truth())], np.ones((3, 1)), "`noise` of `refit` must have shape"),
    ],
)
def test_what_does_not_belong_together_is_refused(records, noise, said):
    with pytest.raises(InputError, match=said):
        refit(truth(), records, [CLOCK] * len(records), noise=noise)


def test_a_model_without_modes_is_refused():
    empty = PeriodicModel(
        exponents=[], coefficients=np.zeros((0, 2, 1, 1)), harmonics=[0], period=PERIOD, channels=CHANNELS
    )
    with pytest.raises(InputError, match="must have a mode"):
        refit(empty, [record_of(truth())], [CLOCK], noise=np.ones((2, 1)))
