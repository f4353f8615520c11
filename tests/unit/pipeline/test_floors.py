"""Good decays that were refused for their noise: larger where the response is, or all there is in a channel."""

import numpy as np
import pytest

from floquid import ConstantPeriod, Record, identify

EXPONENTS = np.array([-0.03 + 1.07j, -0.05 + 8.67j])
RATE = 32.0


def decays(seed, periods=120):
    """Two modes with two harmonics beside each (channels, samples)."""
    generator = np.random.default_rng(seed)
    times = np.arange(periods * RATE) / RATE
    turns = np.exp(2j * np.pi * np.outer(np.arange(-2, 3), times))
    weights = [0.1, 0.3, 1.0, 0.3, 0.1]
    shapes = (generator.standard_normal((2, 3, 5)) + 1j * generator.standard_normal((2, 3, 5))) * weights
    modes = np.exp(np.outer(EXPONENTS, times)) * np.array([1.0, 0.6])[:, None]
    return 2 * np.einsum("rcm,mt,rt->ct", shapes, turns, modes).real, generator


def right(analysis):
    """True where the modes are the true ones within four deviations, and no others."""
    model = analysis.model
    if model.order != 4:
        return False
    off = np.subtract.outer(np.append(EXPONENTS, EXPONENTS.conj()), model.exponents)
    off = off.real + 1j * (off.imag - 2 * np.pi * np.rint(off.imag / (2 * np.pi)))
    near = off[np.abs(off).argmin(axis=0), np.arange(4)]
    pulls = np.maximum(np.abs(near.real) / model.exponent_std.real, np.abs(near.imag) / model.exponent_std.imag)
    return bool(pulls.max() < 4.0)


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_errors_in_proportion_to_the_response_are_no_modes(share):
    """A gain that scatters by 1 to 5 %: the search went on and on, and the record was refused for it."""
    values, generator = decays(seed=301)
    values = values * (1 + share * generator.standard_normal(values.shape))
    values += 1e-4 * generator.standard_normal(values.shape)
    clock = ConstantPeriod(period=1.0)
    found = identify(Record(values=values, sample_rate=RATE, channels=["x", "y", "z"], clock=clock))
    assert right(found)
    assert any("below 0.01 of the largest value" in words for words in found.warnings)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_channel_of_noise_makes_no_decay_random(seed):
    """Five modes lose 0.5 to 3.6 % a period: a fourth channel of noise alone lasts as long as the record."""
    generator = np.random.default_rng(100 + seed)
    times = np.arange(110 * RATE) / RATE
    turns = np.array([0.11, 0.19, 0.27, 0.36, 0.44]) + generator.uniform(-0.02, 0.02, 5) + generator.integers(0, 3, 5)
    exponents = np.log1p(-np.linspace(0.005, 0.036, 5)) + 2j * np.pi * turns
    shapes = (generator.standard_normal((5, 3, 3)) + 1j * generator.standard_normal((5, 3, 3))) * [0.3, 1.0, 0.3]
    beside = np.exp(2j * np.pi * np.outer(np.arange(-1, 2), times))
    values = 2 * np.einsum("rcm,mt,rt->ct", shapes, beside, np.exp(np.outer(exponents, times))).real
    values += 0.066 * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    values = np.concatenate([values, generator.standard_normal((1, len(times)))])
    clock = ConstantPeriod(period=1.0)
    found = identify(Record(values=values, sample_rate=RATE, channels=["x", "y", "z", "dead"], clock=clock))
    assert found.passed
    assert found.model.order == 10
