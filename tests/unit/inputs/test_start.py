"""Candidates for exponents by how often they come up, and modes that are chosen together."""

import numpy as np
import pytest
from tests.driven import mathieu, record_of, two_masses

from floquid.inputs import samples_of
from floquid.inputs._start import _lower, bare_mode, candidates, chosen_together, products_of_lags


def samples_from(system, periods, phases, noise, seed=0):
    values, inputs = record_of(system, periods, phases, noise, seed)
    omega = 2.0 * np.pi / system.period
    return samples_of([values], [inputs], [0.0], step=system.period / phases, fundamental=omega)


def gaps(system, found):
    """Distances of each true exponent of positive frequency to the nearest found, modulo iω and conjugates."""
    omega, rows = 2.0 * np.pi / system.period, []
    for truth in system.exponents():
        both = np.concatenate([found, np.conj(found)]) - truth
        rows.append(np.abs(both - 1j * omega * np.rint(both.imag / omega)).min() / abs(truth.real))
    return np.array(rows)


@pytest.mark.parametrize(("system", "count"), [(mathieu(), 1), (two_masses(), 2)])
def test_poles_of_the_system_come_up_more_often_than_others(system, count):
    samples = samples_from(system, 60, 24, 0.02)
    found, shares = candidates(samples, samples.values)
    assert gaps(system, found[:count]).max() < 0.3
    assert (np.diff(shares) <= 0.0).all()
    assert shares[0] > 0.8


def test_too_short_a_record_has_no_candidates():
    samples = samples_from(mathieu(), 2, 10, 0.01)
    found, shares = candidates(samples, samples.values)
    assert len(found) == len(shares) == 0
    assert chosen_together(samples, [], 20) == []


@pytest.mark.parametrize("periods", [12, 20])
def test_a_short_record_of_one_output_has_candidates_by_fewer_sidebands(periods):
    samples = samples_from(mathieu(), periods, 20, 0.02)
    found, _ = candidates(samples, samples.values)
    assert gaps(mathieu(), found[:3]).max() < 0.25


def test_modes_are_chosen_before_what_is_none():
    system = two_masses()
    samples = samples_from(system, 60, 24, 0.02)
    # On the branches where they are seen most: two masses of frequencies about 1.1 and 2.3, in a period of 2 pi.
    slow, fast = sorted((own for own in system.exponents() if own.imag > 0.0), key=lambda own: own.imag)
    offered = np.array([-0.9 + 0.2j, slow + 1.0j, fast + 2.0j, -0.4 + 0.45j])
    turns = np.arange(-1.0, 2.0)
    bare = [bare_mode(samples, exponent, turns, turns) for exponent in offered.tolist()]
    found = chosen_together(samples, bare, 2)
    assert gaps(system, np.array([mode.exponent for mode in found])).max() < 1e-9


def test_products_of_lags_are_those_of_the_table():
    signals = np.random.default_rng(0).standard_normal((3, 50))
    table = np.concatenate([signals[:, lag : lag + 45] for lag in range(6)])
    for parts in ([signals], np.split(signals, [3, 7, 20], axis=1)):
        assert np.abs(products_of_lags(iter(parts), 3, 6) - table @ table.T).max() < 1e-12


def test_the_factor_of_products_that_are_rounding():
    root = np.random.default_rng(0).standard_normal((6, 3))
    products = root @ root.T - 5e-3 * np.eye(6)
    factor, rounding = _lower(products)
    assert np.abs(np.triu(factor, 1)).max() == 0.0
    assert np.abs(factor @ factor.T - products).max() < 6e-3
    assert np.count_nonzero(np.linalg.svd(factor)[1] > 1.01 * rounding) == 3


@pytest.mark.parametrize("turns", [0.5, 1.5, 7.0, 2000.0])
def test_many_turns_are_products_of_few(turns):
    samples = samples_from(mathieu(), 4, 16, 0.0)
    expected = np.exp(-1j * turns * samples.fundamental * samples.times)
    np.testing.assert_allclose(samples.turned(-turns), expected, atol=1e-9)
