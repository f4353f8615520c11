"""The experiment of Allen 2009, "Frequency-Domain Identification of Linear Time-Periodic Systems using LTI Techniques".

Section 3: a rotor of which X, Y and the turntable's X and Y are measured with 2 % noise, 50 samples in each of 1024
periods, after a unit impulse at 45 degrees. The paper's own estimates are off by 4e-5 to 1.4e-4 in the exponents, and
by 0.013 in the worst element of A(t) (figure 8). The truth is the rotor's equations (eq. 22, corrected), through an
integrator that shares no code with the chain.
"""

from functools import cache

import numpy as np
import pytest

from floquid import identify, reconstruct
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close

ROTOR = JeffcottRotor()
EXPONENTS = ROTOR.exponents()


@cache
def found(seed):
    """The model of a draw of the experiment."""
    return identify(ROTOR.simulate(seed=seed), validate=False).model


def errors_of_the_state_matrix(model):
    """The largest error over all elements and 50 instants, with the mass' states and with the turntable's."""
    mass = reconstruct(model, ["X", "Y"])
    turntable = reconstruct(model, ["X_tt", "Y_tt"])
    return (
        np.abs(mass.system - ROTOR.system(mass.times)).max(),
        np.abs(turntable.system - ROTOR.turntable_system(turntable.times)).max(),
    )


def check(seed):
    """Order 4, exponents within 1e-5 in both parts, A(t) within 0.012 and 0.045: the errors of A(t)."""
    model = found(seed)
    assert model.order == 4
    assert_exponents_close(model.exponents, EXPONENTS, ROTOR.period, atol=1e-5)
    mass, turntable = errors_of_the_state_matrix(model)
    assert mass <= 0.012
    assert turntable <= 0.045
    return mass, turntable


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(3))
def test_two_percent_noise(seed):
    check(seed)


@pytest.mark.slow
def test_two_percent_noise_over_twenty_seeds():
    """The means of the largest errors: 0.0053 and 0.0294 were measured, with 0.0083 and 0.0373 the largest."""
    mass, turntable = np.transpose([check(seed) for seed in range(20)])
    assert mass.mean() <= 0.007
    assert turntable.mean() <= 0.032


def test_each_exponent_is_within_its_own_deviation_and_that_is_a_twentieth_of_the_papers_error():
    model = found(0)
    std = model.exponent_std
    assert (std.real < 2.1e-6).all()
    assert (std.imag < 2.1e-6).all()
    off = model.principal() - EXPONENTS[np.argmin(np.abs(np.subtract.outer(model.principal(), EXPONENTS)), axis=1)]
    assert (np.abs(off.real) < 4.0 * std.real).all()
    assert (np.abs(off.imag) < 4.0 * std.imag).all()


def test_physical_branches_are_those_near_the_frozen_frequencies():
    """The paper's harmonics centre on m = -1 of the principal branch: 0.1303 stands for 0.8697, 0.2594 for 0.7406."""
    model = found(0)
    np.testing.assert_allclose(model.exponents[::2].imag, [0.7406064, 0.8696643], atol=1e-5)


def test_without_noise():
    model = identify(ROTOR.simulate(noise=0.0), validate=False).model
    assert_exponents_close(model.exponents, EXPONENTS, ROTOR.period, atol=1e-10)
    assert max(errors_of_the_state_matrix(model)) <= 1e-6


@pytest.mark.slow
def test_the_period_may_start_anywhere():
    """The blow at another phase of the shaft and another direction: the same exponents and the same A(t)."""
    model = identify(ROTOR.simulate(noise=0.0, first_phase=0.37, impulse_deg=-10.0)).model
    assert_exponents_close(model.exponents, EXPONENTS, ROTOR.period, atol=1e-10)
    assert max(errors_of_the_state_matrix(model)) <= 1e-6


@pytest.mark.slow
def test_two_blows_are_better_than_one():
    one = found(0)
    two = identify([ROTOR.simulate(seed=0), ROTOR.simulate(seed=1, impulse_deg=135.0, first_phase=0.5)]).model
    assert two.order == 4
    assert_exponents_close(two.exponents, EXPONENTS, ROTOR.period, atol=1e-5)
    assert (two.exponent_std.real < one.exponent_std.real).all()
    assert max(np.array(errors_of_the_state_matrix(two)) / [0.012, 0.045]) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("speed", [0.3, 0.4, 0.6, 0.71])
def test_other_speeds(speed, seed):
    """Stable speeds up to next to the first instability at 0.7212: every exponent within its own deviations."""
    rotor = JeffcottRotor(speed=speed)
    model = identify(rotor.simulate(seed=seed)).model
    assert model.order == 4
    truth = rotor.exponents()
    off = np.subtract.outer(model.principal(), truth)
    off -= 1j * model.fundamental * np.round(off.imag / model.fundamental)
    off = off[np.arange(4), np.argmin(np.abs(off), axis=1)]
    assert (np.abs(off.real) < 4.5 * model.exponent_std.real).all()
    assert (np.abs(off.imag) < 4.5 * model.exponent_std.imag + 1e-15).all()
