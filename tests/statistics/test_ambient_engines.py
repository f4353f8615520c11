"""Outputs alone of rotors in an engine: every mode within four deviations, and none false."""

from pathlib import Path

import numpy as np
import pytest
from tests.driven import strayed

from floquid import Channel, Record, identify_ambient

DATA = Path(__file__).parents[1] / "data"


def noisy(name, noise, seed):
    """A record with noise of a share of the random response, without the orbit; its period and exponents."""
    with np.load(DATA / f"{name}.npz") as file:
        own = dict(file)
    values, period = own["values"].astype(float), float(own["period"])
    cycles = values.reshape(len(values), -1, round(float(own["sample_rate"]) * period))
    size = (cycles - cycles.mean(axis=1, keepdims=True)).std(axis=(1, 2))
    values += noise * size[:, None] * np.random.default_rng(1000 + seed).standard_normal(values.shape)
    channels = [Channel(name=str(n), unit=str(u)) for n, u in zip(own["channels"], own["units"], strict=True)]
    record = Record(values=values, sample_rate=float(own["sample_rate"]), channels=channels)
    return record, period, own["exponents"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ambient_rotor", "ambient_blades"])
def test_every_mode_is_found_and_none_is_false(name):
    record, period, truth = noisy(name, 0.01, 0)
    found = identify_ambient(record, period=period)
    model = found.model
    assert found.passed
    assert model.order == len(truth)
    assert strayed(model, truth) < 4.0
    # All of them are seen: none is told by its deviation alone.
    assert np.abs(model.exponent_std.real / model.exponents.real).max() < 0.15
