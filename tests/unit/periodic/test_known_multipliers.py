"""The forced response in lifted responses: what is there is found, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.lifting import lift, whitened
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


@pytest.mark.parametrize(("more", "roots", "drift"), ADDED.values(), ids=ADDED)
def test_what_is_taken_off_is_carried_along(more, roots, drift):
    """Through another noise and a filter: no noise is left along it."""
    free, known, _ = without_known(lift(segment(replace(RECORD, values=RECORD.values + SIZE * more))), 2.0)
    if not known:
        assert free.responses.taken is None
        return
    later = whitened(free.with_noise(2.0 * free.noise), np.array([[1.0, -0.5]] * free.n_channels))
    for each in (free, later):
        cycles = int(each.responses.lengths.max())
        basis, _ = np.linalg.qr(each.responses.taken)
        assert each.responses.taken.shape == (cycles, known.basis(cycles).shape[1])
        np.testing.assert_allclose(basis @ (basis.T @ known.basis(cycles)), known.basis(cycles), atol=0.02)
