"""Pairs and real modes of a periodic model: each pair once, each real multiplier by itself."""

import numpy as np
import pytest

from floquid.core import Channel, PeriodicModel

OMEGA = 2.0 * np.pi


def model(*values):
    lam = np.array(values, complex)
    size = (len(lam), 1, 1, 1)
    return PeriodicModel(
        exponents=lam, coefficients=np.ones(size), harmonics=[0], period=1.0, channels=(Channel(name="x"),)
    )


@pytest.mark.parametrize(
    ("values", "upper", "real"),
    [
        ((-0.1 + 2.0j, -0.1 - 2.0j), (0,), []),
        ((-0.1 - 2.0j, -0.1 + 2.0j), (1,), []),
        ((-0.1, -0.2 + 1.0j, -0.2 - 1.0j), (0, 1), [0]),
        ((-0.1, -0.1), (0, 1), [0, 1]),
        ((-0.1 + 0.5j * OMEGA, -0.3), (0, 1), [0, 1]),
        ((-0.1 - 0.5j * OMEGA,), (0,), [0]),
        # A pair is one also where its multipliers are real: a mode of such a multiplier is listed once.
        ((-0.1 + 0.5j * OMEGA, -0.1 - 0.5j * OMEGA), (0,), []),
        ((-0.1 + 2.0j, -0.1 - 2.0j * (1.0 + 1e-12)), (0,), []),
        ((), (), []),
    ],
)
def test_each_pair_once_and_real_ones_by_themselves(values, upper, real):
    found = model(*values)
    assert found.upper_modes == upper
    assert np.flatnonzero(found.real).tolist() == real
    assert (found.unpaired[found.real]).all()
