"""Errors that are larger where the response is: a record is believed down to a share of its largest value."""

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
