"""Modes fitted to measured lines by repetition: how many and of what kind, and errors over deviations."""

from functools import cache

import numpy as np
import pytest
from tests.driven import flapping, lag, mathieu, mathieu_and_lag, paper_rotor, pulls, shaken, two_masses

from floquid import fit_transfer, measure_transfer
from floquid.findings import Severity

DRAWS = 20
HARMONICS = np.arange(-3, 4)


SYSTEMS = {  # phases, turns, noise, real multipliers
    "Mathieu": (mathieu, 20, 64, 0.05, 0),
    "a periodic lag": (lag, 20, 64, 0.05, 1),
    "two real negative multipliers": (flapping, 40, 64, 0.01, 2),
    "a pair and a real one": (mathieu_and_lag, 20, 64, 0.02, 1),
    "two masses": (two_masses, 24, 64, 0.02, 0),
    "rotor": (paper_rotor, 50, 128, 0.02, 0),
}


@cache
def drawn(name):
    """Errors of Re λ over their deviations, these errors and variances, squares of G, its error before and after."""
    make, phases, turns, noise, real = SYSTEMS[name]
    system = make()
    order, pull, errors, variances, squares, nearer = len(system.exponents()), [], [], [], [], []
    for seed in range(DRAWS):
        _, record, names = shaken(system, phases, turns, 5, noise, seed, spare=0.0)
        measured = measure_transfer(record, inputs=names, harmonics=HARMONICS)
        found = fit_transfer(measured)
        if found.model.order != order or np.count_nonzero(found.model.real) != real:
            pytest.fail(f"seed {seed}: order {found.model.order}, multipliers {found.model.multipliers}")
        if any(one.severity == Severity.FAILURE for one in found.findings):
            pytest.fail(f"seed {seed}: {found.warnings}")
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
    return np.array(pull), errors, variances, squares, nearer


@pytest.mark.parametrize("name", SYSTEMS)
def test_order_and_kind_are_right_and_deviations_are_not_too_small(name):
    pull, *_ = drawn(name)
    assert np.sqrt(np.mean(pull**2)) < 1.35
    assert pull.max() < 5.0


@pytest.mark.parametrize("name", SYSTEMS)
def test_deviations_hold(name):
    # Deviations are those of the linearisation, which are the bound of Cramér and Rao.
    pull, errors, variances, squares, nearer = drawn(name)
    assert np.sqrt(np.mean(pull**2)) > 0.7
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(variances)) < 1.4
    assert 0.85 < np.sqrt(np.mean(squares)) < 1.2
    before, after = np.mean(nearer, axis=0)
    assert before > 4.0 * after


@pytest.mark.parametrize("noise", [0.05, 0.01])
def test_the_fit_has_a_fifth_of_the_error_of_the_lines(noise):
    """Of Mathieu's equation over repeats of 128 periods; and the variance of the lines is right to 5 %."""
    errors = []
    for seed in range(DRAWS):
        _, record, names = shaken(mathieu(), 20, 128, 5, noise, seed, spare=0.0)
        measured = measure_transfer(record, inputs=names, harmonics=HARMONICS)
        exact = mathieu().sampled_transfer(measured.transfer.frequencies_hz, HARMONICS, 20)
        both = measured.transfer.values, fit_transfer(measured).transfer(sampled=True).values
        errors.append([np.nanmean(np.abs((own - exact) / np.abs(measured.transfer.std)) ** 2) for own in both])
    lines, fit = np.mean(errors, axis=0)
    assert lines == pytest.approx(1.0, abs=0.05)
    assert fit < 0.2**2 * lines
