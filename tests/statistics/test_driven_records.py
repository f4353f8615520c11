"""Records with measured inputs of an engine and of a circuit: every mode within four deviations, and none false."""

from pathlib import Path

import numpy as np
import pytest
from tests.driven import strayed

from floquid import Channel, Record, identify_driven

DATA = Path(__file__).parents[1] / "data"
DRAWS = 10


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("name", ["driven_rotor_gravity", "driven_rotor_hits", "driven_circuit"])
def test_every_mode_is_found_and_none_is_false(name, noise):
    with np.load(DATA / f"{name}.npz") as file:
        own = dict(file)
    values = own["values"].astype(float)
    outputs, period = len(values) - 2, float(own["period"])
    for seed in range(DRAWS if noise else 1):
        noisy = values.copy()
        generator = np.random.default_rng(1000 + seed)
        size = values[:outputs].std(axis=1, keepdims=True)
        noisy[:outputs] += noise * size * generator.standard_normal(values[:outputs].shape)
        channels = [Channel(name=str(n), unit=str(u)) for n, u in zip(own["channels"], own["units"], strict=True)]
        record = Record(values=noisy, sample_rate=float(own["sample_rate"]), channels=channels)
        found = identify_driven(record, period=period, inputs=[str(n) for n in own["channels"][outputs:]])
        model, truth = found.model, own["exponents"]
        assert found.passed
        assert model.order == len(truth)
        assert strayed(model, truth) < 4.0
