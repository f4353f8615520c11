"""Steady tones beside the modes, and two modes that are one which moves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from floquid import ConstantPeriod, PeriodicModel, Record, identify
from floquid.checks import Evidence
from floquid.checks._modes import doubts_of, partners
from floquid.exports import summary
from floquid.systems import JeffcottRotor
from floquid.views import outcome_lines

ROTOR = JeffcottRotor()


def ringing(**options):
    return ROTOR.simulate(**{"n_periods": 120, "samples_per_period": 24, "noise": 0.01, "seed": 1} | options)


def with_tone(size, frequency, seed=1):
    """The rotor's record with a tone of so many times the noise in each channel, and its frequency [Hz]."""
    record = ringing(seed=seed)
    sigma = 0.01 * np.abs(record.values).max(axis=1, keepdims=True)
    tone = np.sqrt(2.0) * size * sigma * np.cos(2.0 * np.pi * frequency * record.times + np.arange(4)[:, None])
    return replace(record, values=record.values + tone), sigma


@pytest.mark.first(1)
@pytest.mark.parametrize("size", [0.5, 5.0])
@pytest.mark.parametrize("frequency", [0.513, 1.0731])
def test_mains_hum_is_named_and_no_mode(size, frequency):
    record, sigma = with_tone(size, frequency)
    found = identify(record)
    assert found.model.order == 4
    assert found.validation.passed
    (tone,) = [own for own in found.fit.findings if own.code == "interference"]
    assert tone.numbers["frequency"] == pytest.approx(frequency, abs=2e-5)
    assert tone.numbers["amplitude"] == pytest.approx(np.sqrt(2.0) * size * sigma.max(), rel=0.2)
    assert f"{frequency:.3g}" in outcome_lines(found)["Interference"]
    assert found.fit.forced is None
    assert summary(found)["interference"] == [dict(tone.numbers)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 19])
def test_modes_that_do_not_decay_stay_modes_where_all_stand_still(seed):
    """Two of three were held as columns without a word, since their decay is not known to a share of itself."""
    times, omega = np.arange(500) / 9.98, np.array([0.445042, 1.246980, 1.801938])
    shapes = np.array([[0.328, 0.737, 0.591], [0.591, 0.328, -0.737], [0.737, -0.591, 0.328]])
    values = shapes.T @ (np.array([[10.0], [2.0], [3.0]]) * np.cos(omega[:, None] * times))
    values += 1e-3 * np.random.default_rng(seed).standard_normal(values.shape)
    record = Record(values=values, sample_rate=9.98, channels=["a", "b", "c"], clock=ConstantPeriod(period=1.0))
    found = identify(record, validate=False).model
    upper = np.sort(found.exponents[found.exponents.imag > 0].imag)
    assert upper == pytest.approx(omega, abs=1e-5)


def test_an_order_that_is_given_is_that_of_the_model_with_the_tone():
    record, _ = with_tone(5.0, 0.513)
    assert identify(record, order=6, validate=False).model.order == 6


def test_a_mode_that_hardly_decays_stays_a_mode_where_its_decay_is_seen():
    """A decay of half in the record, known to a percent."""
    times = np.arange(24 * 200) / 24.0
    values = np.exp(-0.0035 * times) * np.cos(2.0 * np.pi * 0.37 * times + np.arange(3)[:, None])
    values = values + np.exp(-0.05 * times) * np.cos(2.0 * np.pi * 0.81 * times)
    values += 0.01 * np.random.default_rng(0).standard_normal(values.shape)
    record = Record(values=values, sample_rate=24.0, channels=["a", "b", "c"], clock=ConstantPeriod(period=1.0))
    found = identify(record, validate=False)
    assert found.model.order == 4
    assert not any(own.code == "interference" for own in found.fit.findings)


@pytest.mark.parametrize("turns", [0, 1])
@pytest.mark.parametrize(
    ("apart", "turned", "moves"), [(0.7, 0.0, True), (0.8, 0.0, False), (0.7, 0.5, False)], ids=["one", "far", "other"]
)
def test_modes_of_one_shape_nearer_than_three_quarters_of_their_decays(apart, turned, moves, turns):
    """On any branch: a whole number of fundamentals goes from the exponent to the shape."""
    shape = np.zeros((2, 2, 9), complex)
    shape[:, 0, 3:6] = np.array([[1.0, 2.0, 0.5], [0.3, 1.0, -0.4j]])
    shape[:, 1, 3:6] = shape[:, 0, 3:6] * np.exp(2j * np.pi * turned * np.arange(3))
    shape[1, 1] *= 1.0 - 2.0 * turned
    shape = np.stack([shape[:, 0], np.roll(shape[:, 1], -turns, axis=-1)])
    exponents = np.array([-0.1 + 2.0j, -0.3 + 2.0j + 1j * np.sqrt((0.4 * apart) ** 2 - 0.2**2) + 1j * turns])
    model = PeriodicModel(
        exponents=np.concatenate([exponents, exponents.conj()]),
        coefficients=np.concatenate([shape, shape[..., ::-1].conj()])[:, :, None, :],
        harmonics=np.arange(-4, 5),
        period=2.0 * np.pi,
        channels=["x", "y"],
    )
    assert any(own.code == "one_that_moves" for own in doubts_of(model)) == moves


@pytest.mark.parametrize("between", [False, True])
def test_modes_of_one_shape_in_a_row_are_one_that_moves(between):
    """The first and the last are too far apart but for the one between, whose shape is another."""
    shape = np.zeros((3, 2, 1, 9), complex)
    shape[:, :, 0, 3:6] = np.array([[1.0, 2.0, 0.5], [0.3, 1.0, -0.4j]])
    shape[1, 1] *= -1.0
    own = np.array([True, between, True])
    exponents, shape = np.array([-0.1 + 2.0j, -0.3 + 2.1j, -0.6 + 2.3j])[own], shape[own]
    model = PeriodicModel(
        exponents=np.concatenate([exponents, exponents.conj()]),
        coefficients=np.concatenate([shape, shape[..., ::-1].conj()]),
        harmonics=np.arange(-4, 5),
        period=2.0 * np.pi,
        channels=["x", "y"],
    )
    told = [own.numbers for own in doubts_of(model) if own.code == "one_that_moves"]
    assert [round(2.0 * np.pi * own["second"], 1) for own in told] == [2.4] * between


@pytest.mark.slow
@pytest.mark.parametrize(("kappa", "moves"), [(0.0, False), (0.4, True)])
def test_two_modes_of_one_shape_are_named_as_one_that_moves(kappa, moves):
    """An oscillator with a cubic stiffness, integrated; its frequency falls with the amplitude."""
    from scipy.integrate import solve_ivp

    def rates(t, x):
        stiffness = 4.0 * (1.0 + 0.2 * np.cos(t))
        return [x[1], -stiffness * x[0] - kappa * x[0] ** 3 - 0.02 * x[1]]

    times = 2.0 * np.pi / 32 * np.arange(32 * 100)
    y = solve_ivp(rates, (0.0, times[-1]), [0.5, 0.0], t_eval=times, rtol=1e-10, atol=1e-12).y
    values = y + 0.002 * np.abs(y).max(axis=1, keepdims=True) * np.random.default_rng(2).standard_normal(y.shape)
    record = Record(
        values=values, sample_rate=32 / (2.0 * np.pi), channels=["x", "v"], clock=ConstantPeriod(period=2.0 * np.pi)
    )
    found = identify(record)
    assert any(own.code == "one_that_moves" for own in found.findings) == moves
    assert (found.model.order > 2) == moves


def test_half_of_the_true_period_is_told():
    found = identify(replace(ringing(), clock=ConstantPeriod(period=0.5 * ROTOR.period)), validate=False)
    assert found.model.order == 8
    assert "period_halved" in {own.code for own in found.findings}


@pytest.mark.parametrize("negative", range(4))
def test_negative_multipliers_of_a_real_system_come_in_twos(negative):
    exponents = [-0.1 - 0.05 * k + 0.5j for k in range(negative)] + [-0.2]
    shape = np.zeros((len(exponents), 1, 1, 3), complex)
    shape[:, 0, 0, :2], shape[-1, 0, 0, :] = 1.0, [0.0, 1.0, 0.0]
    model = PeriodicModel(
        exponents=exponents, coefficients=shape, harmonics=[-1, 0, 1], period=2.0 * np.pi, channels=["x"]
    )
    told = partners(SimpleNamespace(model=model), Evidence())
    assert [own.code for own in told] == ["partner_missing"] * (negative % 2)
