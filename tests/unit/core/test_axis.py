"""Exponents and deviations read from the mean and the squared half-difference of a block."""

import numpy as np
import pytest

from floquid.core import readings


@pytest.mark.parametrize("square", [-30.0, -3.0, -1.0, 0.0, 1.0, 3.0, 30.0])
def test_the_reading_of_a_normal_error_of_q_holds(square):
    """Of q in its own deviations, σ exact but for a little, intervals of 95 % and of four deviations."""
    generator, covariance = np.random.default_rng(0), np.diag([1e-6, 1.0])
    truth = np.sqrt(complex(square))
    off = []
    for own in square + generator.standard_normal(4000):
        exponents, std = readings(0.0, own, covariance, 0, 2.0)
        gap = exponents[0] - truth
        one = std[0]
        off.append([abs(gap.real) / one.real, abs(gap.imag) / one.imag if one.imag else 0.0])
    inside = np.mean(np.array(off) < 1.96, axis=0)
    assert inside.min() > 0.94
    assert inside[0 if square > 0.0 else 1] < 0.99
    assert np.mean(np.array(off) > 4.0) < 2e-3


@pytest.mark.parametrize("square", [4.0, -4.0])
def test_a_reading_far_from_zero_is_that_of_first_order(square):
    """Of σ and q that are not correlated."""
    covariance, slope = np.diag([0.04, 0.09]) * 1e-4, 1.0 / (2.0 * 2.0)
    exponents, std = readings(-0.1, square, covariance, 1, 2.0)
    assert exponents == pytest.approx(-0.1 + 1j + np.sqrt(complex(square)) * np.array([1.0, -1.0]))
    own, apart = np.sqrt(np.diag(covariance)) * [1.0, slope]
    assert std == pytest.approx(np.full(2, np.hypot(own, apart) if square > 0.0 else own + 1j * apart), rel=1e-2)
