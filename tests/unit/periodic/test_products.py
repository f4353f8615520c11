"""Modes that a nonlinearity makes of two others: their exponents are sums, of conjugates too, modulo iω."""

import numpy as np
import pytest

from floquid.core import Channel, PeriodicModel
from floquid.periodic import combinations_of

PERIOD = 0.9
OMEGA = 2.0 * np.pi / PERIOD
A, B = -0.1 + 2.1j, -0.05 + 0.7j
SUMS = {
    "a + b": A + B,
    "a + conj b": A + B.conjugate(),
    "conj a + b": A.conjugate() + B,
    "2 a": 2 * A,
    "2 b, twice ω on": 2 * B + 2j * OMEGA,
}


def model(third, *, size=0.1):
    """Two large pairs and a small third, each known to 1e-6."""
    values = np.array([A, A.conjugate(), B, B.conjugate(), third, np.conj(third)])
    sizes = np.repeat([1.0, 0.8, size], 2)
    return PeriodicModel(
        exponents=values,
        coefficients=sizes[:, None, None, None] * np.ones((6, 1, 1, 1), complex),
        harmonics=np.array([0]),
        period=PERIOD,
        channels=(Channel(name="x"),),
        covariance=1e-12 * np.eye(12),
    )


@pytest.mark.parametrize("name", SUMS)
def test_a_sum_of_two_modes_is_named_with_both(name):
    (found,) = combinations_of(model(SUMS[name]), np.array([[0.01]]))
    both = {A.imag, B.imag} if "a" in name and "b" in name else {A.imag} if "a" in name else {B.imag}
    assert found.code == "product"
    assert found.numbers["frequency"] == pytest.approx(abs(SUMS[name].imag) / (2.0 * np.pi))
    assert sorted(found.numbers["of"]) == pytest.approx(sorted(value / (2.0 * np.pi) for value in both))


@pytest.mark.parametrize("third", [-0.15 + 2.9j, -0.4 + 2.8j, -0.15 + 1.5j])
def test_what_is_no_sum_is_not(third):
    assert combinations_of(model(third), np.array([[0.01]])) == ()


def test_a_larger_mode_is_no_product_of_smaller_ones():
    assert combinations_of(model(SUMS["a + conj b"], size=2.0), np.array([[0.01]])) == ()
