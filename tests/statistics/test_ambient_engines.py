"""Outputs alone of rotors in an engine: every mode within four deviations, and none false."""

import numpy as np
import pytest
from tests.driven import engine_record, strayed

from floquid import identify


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ambient_rotor", "ambient_blades"])
def test_every_mode_is_found_and_none_is_false(name):
    record, period, truth, _ = engine_record(name, 0.01, 0)
    found = identify(record, period=period, excitation="ambient")
    model = found.model
    assert found.passed
    assert model.order == len(truth)
    assert strayed(model, truth) < 4.0
    # All of them are seen: none is told by its deviation alone.
    assert np.abs(model.exponent_std.real / model.exponents.real).max() < 0.15
