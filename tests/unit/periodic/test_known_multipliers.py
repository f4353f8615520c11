"""The forced response in lifted responses: what is there is found, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.lifting import lift
from floquid.periodic import without_known
from floquid.sync import segment
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()
RECORD = ROTOR.simulate(n_periods=120, samples_per_period=16, noise=0.02, seed=0)
TURNS = np.arange(RECORD.n_samples) / 16.0
SIZE = np.abs(RECORD.values).max()

ADDED = {
    "nothing": (0.0 * TURNS, (), False),
    "an offset": (np.ones_like(TURNS), (0.0,), False),
    "a drift": (np.linspace(-1.0, 1.0, len(TURNS)), None, True),
    "an imbalance, two periods a revolution": (np.cos(np.pi * TURNS + 0.3), (0.5,), False),
    "an offset and an imbalance": (1.0 + np.cos(np.pi * TURNS + 0.3), (0.0, 0.5), False),
}


@pytest.mark.parametrize(("more", "roots", "drift"), ADDED.values(), ids=ADDED)
def test_what_is_there_is_found_and_taken_off(more, roots, drift):
    given, forced = (lift(segment(replace(RECORD, values=RECORD.values + SIZE * own))) for own in (0.0, more))
    free, known, _ = without_known(forced, 2.0)
    assert known.drift == drift
    assert roots is None or known.roots == roots
    left = free.responses.values - given.responses.values
    assert np.sqrt(np.mean(left**2)) < 0.05 * SIZE * max(np.abs(more).max(), 0.1)
