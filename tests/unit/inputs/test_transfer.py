"""Harmonic transfer functions of a fit against the harmonic state space of the equations, which shares no code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import flapping, mathieu, record_of, transfer_functions, two_masses
from tests.unit.inputs.test_search import record

from floquid import PeriodicModel, identify

HARMONICS = np.arange(-2, 3)


def fitted(system, periods, phases, noise, seed=0):
    values, inputs = record_of(system, periods, phases, noise, seed)
    names = [f"F{n}" for n in range(len(inputs))]
    return identify(record(system, values, inputs, phases), period=system.period, inputs=names, validate=False)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("system", "periods", "phases"), [(mathieu(direct=0.4), 80, 20), (two_masses(), 60, 24), (flapping(), 120, 24)]
)
def test_transfer_functions_are_those_of_the_equations(system, periods, phases):
    found = fitted(system, periods, phases, 0.01)
    hertz = np.linspace(0.03, 0.9, 20) / system.period * 2.0
    got, truth = found.transfer(hertz, HARMONICS), system.transfer(hertz, HARMONICS)
    assert np.abs(got.values - truth).max() < 0.02 * np.abs(truth).max()
    off = got.values - truth
    both = np.concatenate([(off.real / got.std.real).ravel(), (off.imag / got.std.imag).ravel()])
    assert np.sqrt(np.mean(both**2)) < 2.0
    assert np.mean(np.abs(both) < 1.96) > 0.75


@pytest.mark.slow
def test_those_of_the_model_are_those_of_the_fit():
    found = fitted(two_masses(), 40, 24, 0.02)
    hertz = np.array([-0.3, 0.05, 0.2])
    both = found.transfer(hertz, HARMONICS), transfer_functions(found.model, hertz, HARMONICS)
    assert both[0].values == pytest.approx(both[1].values, rel=1e-12)


def test_that_of_samples_has_the_hold_in_it():
    system = mathieu(direct=0.4)
    found, hertz = fitted(system, 60, 20, 0.001), np.linspace(0.05, 1.2, 12)
    got, truth = found.transfer(hertz, HARMONICS, sampled=True), system.sampled_transfer(hertz, HARMONICS, 20)
    assert got.step == pytest.approx(system.period / 20)
    assert np.abs(got.values - truth).max() < 2e-3 * np.abs(truth).max()
    assert np.abs(found.transfer(hertz, HARMONICS).values - truth).max() > 0.02 * np.abs(truth).max()


def test_a_negative_frequency_is_the_conjugate_of_the_mirrored_harmonic():
    found = fitted(mathieu(), 60, 20, 0.02)
    up, down = found.transfer([0.2], [-1, 0, 1]).values, found.transfer([-0.2], [-1, 0, 1]).values
    assert down == pytest.approx(up[::-1].conj(), rel=1e-10)


def test_half_of_the_sidebands_dropped_is_seen():
    found = fitted(mathieu(), 80, 20, 0.01)
    own = found.model.inputs
    less = replace(own, coefficients=np.where(own.harmonics < 0, 0.0, own.coefficients))
    model = PeriodicModel(
        exponents=found.model.exponents,
        coefficients=found.model.coefficients,
        harmonics=found.model.harmonics,
        period=found.model.period,
        channels=found.model.channels,
        inputs=less,
    )
    hertz, truth = np.array([0.1, 0.2, 0.3]), mathieu().transfer(np.array([0.1, 0.2, 0.3]), HARMONICS)
    assert np.abs(transfer_functions(model, hertz, HARMONICS).values - truth).max() > 0.05 * np.abs(truth).max()
