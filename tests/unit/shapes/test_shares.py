"""Shares of energy: intervals over draws of known shapes, next to nothing and the whole; mixtures; what is dropped."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.core import Shape
from floquid.shapes import read_shapes
from floquid.shapes._shares import Energies

CHANNELS, LINES, DRAWS = 3, 4, 400


def shape_of(off, seed=0, size=0.02):
    """A shape whose last two lines have a share `off` of its energy; errors differ, and channels share some."""
    generator = np.random.default_rng(seed)
    parts = generator.standard_normal((2, 2, CHANNELS, 2))
    inside, outside = (part / np.linalg.norm(part) for part in parts[0] + 1j * parts[1])
    values = np.concatenate([np.sqrt(1.0 - off) * inside, np.sqrt(off) * outside], axis=1)
    root = size * generator.standard_normal((CHANNELS, 2 * LINES, 2 * LINES)) / np.sqrt(2 * LINES)
    common = 0.5 * size * generator.standard_normal((2, CHANNELS, LINES, 3))
    return Shape(
        values=values, harmonics=np.arange(LINES), channels=["a", "b", "c"], slopes=common[0] + 1j * common[1],
        spread=root @ root.transpose(0, 2, 1),
    )  # fmt: skip


def energies_of(shape):
    return Energies.of(shape, np.eye(CHANNELS * LINES).reshape(-1, CHANNELS, LINES).astype(complex))


OFF = np.tile(np.arange(LINES) >= LINES // 2, CHANNELS)


@pytest.mark.first(1)
@pytest.mark.parametrize("off", [2e-3, 0.0, 0.02, 0.3])
def test_intervals_hold_a_share_in_95_of_100_draws(off, monkeypatch):
    """Next to its bound, where a share has no slope, and far from it; that of the rest is its mirror image."""
    monkeypatch.setattr("floquid.shapes._shares._dropped", lambda _: 0.0)
    shape, held = shape_of(off), 0
    for values in shape.drawn(DRAWS, np.random.default_rng(1)):
        energies = energies_of(replace(shape, values=values))
        share, rest = energies.share(OFF), energies.share(~OFF)
        assert rest.interval == pytest.approx((1.0 - share.interval[1], 1.0 - share.interval[0]))
        held += share.interval[0] <= off <= share.interval[1]
    assert 0.93 <= held / DRAWS <= (1.0 if off == 0.0 else 0.975)


def test_what_was_dropped_is_in_the_interval(monkeypatch):
    """A harmonic just below the limit at either end: four times the noise of one, of two lines."""
    shape = shape_of(0.3)
    low, high = energies_of(shape).share(OFF).interval
    monkeypatch.setattr("floquid.shapes._shares._dropped", lambda _: 0.0)
    energies = energies_of(shape)
    without = energies.share(OFF).interval
    each = float(np.trace(shape.covariance(np.eye(12).reshape(-1, 3, 4).astype(complex)))) / LINES
    assert high - without[1] == pytest.approx(2.0 * 6.4 * each * (1.0 - without[1]), rel=0.02)
    assert low < without[0]


def test_a_shape_below_its_noise_tells_nothing():
    share = energies_of(shape_of(0.02, size=1.0)).share(OFF)
    assert share.interval == (0.0, 1.0)
    assert share.std is None


def test_a_mode_on_which_hits_disagree_has_no_whirl(oracle):
    """Next to one multiplier two modes are found as one: its shape is any mixture of theirs."""
    known = oracle.known(oracle.systems["gyroscopic"], oracle.displacements(2), hits=2, size=0.01)
    generator, mixtures = np.random.default_rng(0), 0
    for _ in range(20):
        drawn = known.drawn(generator)
        mixtures += sum(drawn.shape(mode).is_mixture for mode in range(drawn.order))
    assert mixtures == 0
    own, other = drawn.upper_modes
    lines = drawn.coefficients.copy()
    lines[own, :, 1] += 0.2 * lines[other, :, 1]
    readings = read_shapes(replace(drawn, coefficients=lines), pairs=["c0:c1"])
    found = {one.mode: one for one in readings.modes}
    assert found[own].is_mixture
    assert found[own].whirl.interval == (-1.0, 1.0)
    assert found[own].whirl.word.startswith("mixed")
    assert not found[other].is_mixture
    assert "stands for several" in readings.warnings[0]
