"""Deviations of exponents in a model that has a pair or two real multipliers for a block."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.inputs.test_states import block

from floquid.core import readings
from floquid.inputs._parts import _slopes_of_readings


@pytest.mark.parametrize("along", [-0.9, 0.0, 0.5])
@pytest.mark.parametrize("square", [-30.0, -1.0, 0.0, 0.3, 3.0, 300.0])
def test_slopes_and_variances_beside_make_the_deviations_that_are_read(square, along):
    """Of any correlation of σ and q, `square` in deviations of q."""
    mode, s = block(0.0), 1e-3
    mode = replace(mode, square=square * s)
    covariance = np.array([[0.02**2, along * 0.02 * s], [along * 0.02 * s, s**2]])
    slopes, more = _slopes_of_readings(mode, covariance)
    _, std = readings(mode.exponent.real, mode.square, covariance, 0, 1.0)
    variance = np.einsum("epk,kl,epl->ep", slopes, covariance, slopes) + more
    assert variance == pytest.approx(np.stack([std.real, std.imag], axis=1) ** 2, rel=1e-9, abs=1e-18)
