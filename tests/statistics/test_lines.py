"""Modes fitted to measured lines by repetition: how many and of what kind, and errors over deviations."""

import numpy as np
import pytest
from tests.driven import flapping, lag, mathieu, mathieu_and_lag, paper_rotor, pulls, shaken, two_masses

from floquid import fit_transfer, measure_transfer
from floquid.findings import Severity

DRAWS = 20
HARMONICS = np.arange(-3, 4)


@pytest.mark.parametrize(
    ("system", "phases", "turns", "noise", "real", "rings"),
    [
        (mathieu(), 20, 64, 0.05, 0, False),
        (lag(), 20, 64, 0.05, 1, False),
        (flapping(), 40, 64, 0.01, 2, False),
        (mathieu_and_lag(), 20, 64, 0.02, 1, False),
        (two_masses(), 24, 64, 0.02, 0, False),
        (paper_rotor(), 50, 128, 0.02, 0, True),
    ],
    ids=["Mathieu", "a periodic lag", "two real negative multipliers", "a pair and a real one", "two masses", "rotor"],
)
def test_modes_of_lines(system, phases, turns, noise, real, rings):
    order, pull, errors, variances, squares, nearer = len(system.exponents()), [], [], [], [], []
    for seed in range(DRAWS):
        _, record, names = shaken(system, phases, turns, 5, noise, seed, spare=0.0)
        measured = measure_transfer(record, inputs=names, harmonics=HARMONICS)
        found = fit_transfer(measured)
        assert found.model.order == order, seed
        assert np.count_nonzero(found.model.real) == real, seed
        assert not any(one.severity == Severity.FAILURE for one in found.findings), seed
        std, own = found.model.exponent_std.real, pulls(system, found.model)[:, 0]
        pull.append(own)
        errors.append(own * std)
        variances.append(std**2)
        exact = system.sampled_transfer(measured.transfer.frequencies_hz, HARMONICS, phases)
        there, fit = np.isfinite(measured.transfer.values), found.transfer(sampled=True)
        gap = (fit.values - exact)[there]
        squares.append(np.mean((gap.real / fit.std.real[there]) ** 2))
        before = (measured.transfer.values - exact)[there]
        nearer.append([np.mean(np.abs(one / measured.transfer.std[there]) ** 2) for one in (before, gap)])
    # Deviations are those of the linearisation, which are the bound of Cramér and Rao.
    assert np.sqrt(np.mean(np.square(pull))) < 1.35
    assert np.max(pull) < 5.0
    if rings:
        # What rings on in later repeats counts as noise near resonances: deviations are wide there, z was 0.67.
        return
    assert np.sqrt(np.mean(np.square(pull))) > 0.7
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(variances)) < 1.4
    assert 0.85 < np.sqrt(np.mean(squares)) < 1.2
    before, after = np.mean(nearer, axis=0)
    assert before > 4.0 * after
