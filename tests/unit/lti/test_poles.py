"""Sets of poles: kinds, counting, real parameters, and the order in which conjugates come."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.lti._poles import NEGATIVE, PAIR, POSITIVE, PoleSet

MULTIPLIERS = np.array([0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j), 0.7, -0.8, 1.1 * np.exp(-2j), 1.1 * np.exp(2j)])


def mixed():
    return PoleSet.from_multipliers(MULTIPLIERS)


def test_each_pair_is_taken_once_and_real_multipliers_have_kinds_of_their_own():
    poles = mixed()
    assert_array_equal(poles.kind, [PAIR, POSITIVE, NEGATIVE, PAIR])
    assert_allclose(poles.s, [np.log(0.9) + 0.5j, np.log(0.7), np.log(0.8) + np.pi * 1j, np.log(1.1) + 2j], rtol=1e-14)
    assert (len(poles), poles.order) == (4, 6)
    assert_array_equal(poles.sizes, [2, 1, 1, 2])
    assert_array_equal(poles.starts(), [0, 2, 3, 4])


def test_multipliers_come_back_conjugates_next_to_each_other_and_real_ones_exactly_real():
    back = mixed().multipliers()
    assert_allclose(back, MULTIPLIERS[[0, 1, 2, 3, 5, 4]], rtol=1e-14)
    assert_array_equal(back[2:4].imag, [0.0, 0.0])
    assert back[0] == back[1].conj()
    assert_allclose(np.exp(mixed().full()), back, rtol=1e-14)


@pytest.mark.parametrize("angle", [1e-12, 1e-3])
def test_a_multiplier_is_real_within_the_tolerance_only(angle):
    pair = 0.9 * np.exp(1j * np.array([angle, -angle]))
    kinds = PoleSet.from_multipliers(pair, tolerance=1e-9).kind
    assert PAIR in kinds if angle > 1e-9 else PAIR not in kinds


def test_zero_is_no_multiplier():
    assert len(PoleSet.from_multipliers(np.array([0.0, 0.5]))) == 1


@pytest.mark.parametrize("imag", [0.4, -0.4, 2.0 * np.pi - 0.4, 4.0 * np.pi + 0.4])
def test_a_reflected_or_wrapped_pair_is_the_same_pair(imag):
    poles = PoleSet.of(np.array([-0.1 + 1j * imag]), np.array([PAIR]))
    assert poles.s[0] == pytest.approx(-0.1 + 0.4j, abs=1e-14)


def test_real_kinds_stay_on_the_axis():
    poles = PoleSet.of(np.array([-0.1 + 0.3j, -0.2 + 2.9j]), np.array([POSITIVE, NEGATIVE]))
    assert_array_equal(poles.s, [-0.1, -0.2 + np.pi * 1j])


def test_the_parameter_map_is_the_derivative_of_all_poles():
    """By finite differences, which are exact for a linear map."""
    poles = mixed()
    numbers = np.zeros((poles.order, poles.order), complex)
    for k in range(poles.order):
        step = np.zeros(poles.order)
        step[k] = 1e-3
        numbers[:, k] = (poles.moved(step).full() - poles.full()) / 1e-3
    assert_allclose(poles.parameter_map(), numbers, atol=1e-10)


def test_a_step_beyond_the_axis_is_reflected():
    poles = PoleSet.of(np.array([-0.1 + 0.2j]), np.array([PAIR]))
    assert poles.moved(np.array([0.0, -0.3])).s[0] == pytest.approx(-0.1 + 0.1j)


def test_taking_away_and_adding():
    poles = mixed()
    assert_array_equal(poles.without(1).kind, [PAIR, NEGATIVE, PAIR])
    assert_array_equal(poles.keep(np.array([True, False, False, True])).s, poles.s[[0, 3]])
    joined = poles.without(1).plus(poles.keep(np.array([False, True, False, False])))
    assert_array_equal(joined.kind, [PAIR, NEGATIVE, PAIR, POSITIVE])
    assert joined.order == poles.order


def test_no_poles():
    none = PoleSet.empty()
    assert (len(none), none.order) == (0, 0)
    assert none.full().shape == none.multipliers().shape == none.starts().shape == (0,)
    assert none.parameter_map().shape == (0, 0)
    assert none.plus(mixed()).order == 6
