"""Records with measured inputs of an engine and of a circuit: every mode within four deviations, and none false."""

import pytest
from tests.driven import engine_record, strayed

from floquid import identify

DRAWS = 10


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("name", ["driven_rotor_gravity", "driven_rotor_hits", "driven_circuit"])
def test_every_mode_is_found_and_none_is_false(name, noise):
    for seed in range(DRAWS if noise else 1):
        record, period, truth, inputs = engine_record(name, noise, seed)
        found = identify(record, period=period, inputs=inputs)
        model = found.model
        assert found.passed
        assert model.order == len(truth)
        assert strayed(model, truth) < 4.0
