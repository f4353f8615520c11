"""Shapes that are even about a turning point, of scans and of what is none, over draws."""

import numpy as np
import pytest

import floquid as fq
from floquid.errors import IdentificationError

SCANS, ROTORS = 100, 60


def scan(seed):
    """A strip with one to three modes under a sensor that runs over a part of it, with 0.1 to 10 % of noise."""
    rng = np.random.default_rng(seed)
    period, phases, modes = 0.1, 32, int(rng.integers(1, 4))
    times = period / phases * np.arange(50 * phases)
    x = np.cos(2.0 * np.pi * times / period + rng.uniform(-np.pi, np.pi))
    size = 2.0 * np.pi / period * rng.uniform(0.6, 6.0, modes)
    ratio = rng.uniform(0.003, 0.015, modes)
    exponents = size * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    middle, width = rng.uniform(0.35, 0.65), rng.uniform(0.2, 0.33)
    shapes = np.sin(np.pi * np.multiply.outer(np.arange(1, modes + 1), middle + width * x))
    factors = rng.uniform(0.5, 1.0, modes) * np.exp(2j * np.pi * rng.uniform(size=modes))
    clean = np.einsum("rn,rn,r->n", shapes, np.exp(np.multiply.outer(exponents, times)), factors).real
    noise = 10.0 ** rng.uniform(-3.0, -1.0) * clean.std() * rng.standard_normal(len(times))
    return fq.Record(values=[clean + noise], sample_rate=phases / period, channels=["v"]), period


def rotor(seed):
    """Two modes with free lines around the strongest, in one channel or two, with 0.1 to 10 % of noise."""
    rng = np.random.default_rng(seed)
    times, channels, most = np.arange(960) / 16.0, 1 + seed % 2, 1 + seed % 2
    lines, clean = np.arange(-most, most + 1), np.zeros((channels, 960))
    for _ in range(2):
        parts = rng.standard_normal((2, channels, len(lines)))
        shape = (parts[0] + 1j * parts[1]) * 0.25 ** np.abs(lines)
        exponent = complex(-rng.uniform(0.02, 0.08), rng.uniform(1.0, 12.0))
        clean += (shape @ np.exp(2j * np.pi * np.multiply.outer(lines, times)) * np.exp(exponent * times)).real
    noise = 10.0 ** rng.uniform(-3.0, -1.0) * clean.std() * rng.standard_normal(clean.shape)
    return fq.Record(values=clean + noise, sample_rate=16.0, channels=["x", "y"][:channels]), 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("made", "draws", "told"), [(scan, SCANS, False), (rotor, ROTORS, True)])
def test_rotors_are_told_and_scans_are_not(made, draws, told):
    right = []
    for seed in range(draws):
        record, period = made(seed)
        try:
            found = fq.identify(record, period=period, branch="symmetric", validate=False)
        except IdentificationError:  # says nothing of a turning point
            continue
        right.append(told == any(own.code in {"branch_left", "branch_uneven"} for own in found.findings))
    assert len(right) > 0.9 * draws
    assert np.mean(right) >= 0.97
