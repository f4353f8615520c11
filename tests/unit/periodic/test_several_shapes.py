"""Hits that share several shapes of one multiplier, and hits of which one differs: in its shape, or in its decay."""

from dataclasses import replace

import numpy as np
import pytest
from tests.several_hits import Hits

from floquid import identify
from floquid.errors import IdentificationError
from floquid.testing import pair_exponents

EQUAL = [-0.2 + 2.1j, -0.2 + 2.1j, -0.3 + 0.7j]


def told(found):
    return [finding.code for finding in (*found.findings, *found.fit.findings)]


def of_equal(hits, periods=30, noise=0.01, seed=0):
    """Two modes of one multiplier, a symmetric rotor's, beside a third: each hit has some of all."""
    generator = np.random.default_rng(seed)
    drawn = Hits.drawn(EQUAL, hits, periods, noise=noise)
    states = generator.standard_normal((3, hits)) + 1j * generator.standard_normal((3, hits))
    return replace(drawn, states=states)


@pytest.mark.parametrize("hits", [3, 5])
def test_modes_of_one_multiplier_are_found_with_their_shapes(hits):
    """They were one mode with a shape for each hit: order 4, and ambiguous."""
    drawn = of_equal(hits)
    found = identify(drawn.records(0))
    assert found.model.order == 6
    assert found.model.one_shape
    assert found.passed
    assert "several_shapes" in told(found)
    assert "double" not in told(found)  # they were one mode with more harmonics, perhaps, on the same lines
    assert not found.choice.ambiguous
    pairing = pair_exponents(found.model.exponents, [*drawn.exponents, *drawn.exponents.conj()], 1.0)
    std = found.model.exponent_std[pairing.permutation]
    assert (np.abs(pairing.differences.real) < 4.0 * std.real).all()
    assert (np.abs(pairing.differences.imag) < 4.0 * std.imag).all()
    assert found.periodicity is None  # wider free residues said that harmonics of 5e6 % may hide
    # By free residues of two columns that are all but one, the period was told to be another.
    own, spread = found.fit.own_period
    assert abs(own) < 4.0 * spread < 1e-2


def test_modes_of_one_multiplier_are_found_where_there_is_hardly_noise():
    """Below 1e-4 of the response they were one mode with a shape for each hit, and it passed without a doubt."""
    found = identify(of_equal(4, noise=1e-5).records(0), validate=False)
    assert found.model.order == 6
    assert not found.choice.ambiguous


def test_modes_of_one_multiplier_are_no_more_than_the_order_that_is_given():
    """The fit went on to order 6: residues were left unconstrained, as of a record with fewer modes, and it passed."""
    found = identify(of_equal(4).records(0), order=4, validate=False)
    assert found.model.order == 4
    assert "hits_disagree" in told(found)
    assert "order_not_held" not in told(found)


def test_two_hits_have_two_shapes_of_anything():
    found = identify(of_equal(2).records(0), validate=False)
    assert found.model.order == 4
    assert found.choice.ambiguous
    assert "hits_disagree" in told(found)


def test_hits_in_two_groups_are_no_two_modes():
    """A machine that changed after the second of five hits."""
    drawn = of_equal(5)
    states = drawn.states.copy()
    states[1, :2] = states[0, 2:] = 0.0
    found = identify(replace(drawn, states=states).records(0), validate=False)
    assert found.model.order == 4
    assert found.choice.ambiguous
    (warned,) = (finding for finding in found.findings if finding.code == "hits_disagree")
    assert "Hits 1, 2 share one shape, and hits 3, 4, 5 another." in str(warned)


def test_one_hit_that_decays_slower_makes_no_second_mode():
    """It was two modes of one shape, each in the hits that decay like it: it passed, and its order was clear."""
    drawn = Hits.drawn([-0.2 + 2.1j, -0.35 + 4.0j], 3, 30, noise=0.01)
    drawn = replace(drawn, states=np.array([[1.5, 1.0, 1.5j], [1.0, 1.2j, 1.0j]]))
    slower = replace(drawn, exponents=drawn.exponents + np.array([0.04, 0.0]))
    found = identify([*drawn.records(0)[:2], slower.records(0)[2]])
    assert found.model.order == 4
    assert not found.passed
    (failed,) = (finding for finding in found.findings if finding.code == "hits_unlike")
    assert failed.severity.value == "failure"
    assert failed.numbers["hits"][1] == 3
    assert failed.numbers["decays"] == pytest.approx([0.2, 0.16], rel=0.01)
    assert "No exponent fits all." in str(failed)
    assert "hits_disagree" not in told(found)


def test_hits_share_a_shape_beside_a_pair_within_its_decay_of_an_axis():
    """All modes kept residues of their own in each hit, a weak harmonic was not seen, and the right model failed."""
    generator = np.random.default_rng(1)
    exponents = -generator.uniform(0.05, 0.3, 5) + 1j * np.sort(generator.uniform(0.2, 6.0, 5))
    found = identify(Hits.drawn(exponents, 4, 60, channels=3, noise=0.02, seed=1).records(1))
    assert found.model.order == 10
    assert found.model.one_shape
    assert found.passed


def test_weak_harmonics_that_two_modes_share_are_seen_by_all_hits_together():
    """Their bands were those of free residues: samples left out had 1.4 times the expected error."""
    strengths = np.zeros((2, 9))
    strengths[0, 2:8] = 0.02, 0.05, 1.0, 0.3, 0.05, 0.02
    strengths[1, :6] = 0.02, 0.05, 0.3, 0.6, 1.0, 0.05
    exponents = np.array([-0.125 + 0.62j * np.pi, -0.135 + 0.02j + 4.62j * np.pi])  # the second folds onto the first
    drawn = Hits.drawn(exponents, 2, 40, channels=4, noise=0.015, seed=9, phases=64)
    shapes = np.random.default_rng(9).standard_normal((2, 4, 9, 2)) @ np.array([1.0, 1j]) * strengths[:, None]
    found = identify(replace(drawn, shapes=shapes).records(9))
    assert found.model.order == 4
    assert found.passed


def with_odd_hits(drawn, slower, steps):
    """Records in which the exponents of some modes are `steps` away in each hit."""
    each = [replace(drawn, exponents=drawn.exponents + step * np.array(slower)) for step in steps]
    return [other.records(0)[hit] for hit, other in enumerate(each)]


def with_a_real_one(steps):
    """Four hits on a real multiplier, whose decay differs by `steps`, and a pair."""
    drawn = Hits.drawn([-0.25, -0.3 + 2.0j], 4, 30, noise=0.01)
    generator = np.random.default_rng(0)
    states = generator.standard_normal((2, 4)) + 1j * generator.standard_normal((2, 4))
    return identify(with_odd_hits(replace(drawn, states=states / np.abs(states)), [1.0, 0.0], steps))


def test_a_real_multiplier_that_differs_between_hits_does_not_pass_as_two():
    """They were -0.183 and -0.287, and passed: what no exponent of all hits fits became a pair near the axis."""
    assert not with_a_real_one((0.0, 0.03, 0.06, -0.03)).passed


def test_a_real_multiplier_that_differs_in_one_hit_is_one():
    """It passed as two."""
    found = with_a_real_one((0.0, 0.0, 0.0, 0.04))
    assert found.model.order == 3
    (failed,) = (finding for finding in found.findings if finding.code == "hits_unlike")
    assert failed.severity.value == "failure"
    assert "disagree on the real multiplier at 0 Hz" in str(failed)
    assert "0 Hz and" not in str(failed)
    assert failed.numbers["decays"] == pytest.approx([0.25, 0.21], rel=0.02)
    assert "one_shape" not in told(found)  # which says that hits differ in their first state only


@pytest.mark.parametrize("step", [pytest.param(0.03, marks=pytest.mark.slow), 0.08])
def test_one_hit_that_decays_slower_is_no_third_mode_of_one_multiplier(step):
    """It passed with order 8: the slower decay had a shape that the two others of the multiplier make up."""
    found = identify(with_odd_hits(of_equal(5), [1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, step]), validate=False)
    assert found.model.order < 8
    assert "failure" in {finding.severity.value for finding in found.findings if finding.code == "hits_unlike"}


def test_a_hit_of_which_all_modes_decay_slower_doubles_none():
    drawn = Hits.drawn([-0.2 + 2.1j, -0.35 + 4.6j], 3, 30, noise=0.01)
    found = identify(with_odd_hits(drawn, [1.0, 1.0], [0.0, 0.0, 0.05]), validate=False)
    assert found.model.order == 4
    assert told(found).count("hits_unlike") == 2


def test_a_decay_of_few_periods_is_not_called_noise():
    """Two modes far above the noise were refused: the responses look like white noise."""
    with pytest.raises(IdentificationError, match="as far as the whole periods of the record tell") as told:
        identify(Hits.drawn([-0.2 + 2.1j, -0.3 + 0.7j], 1, 4, noise=0.01).records(0))
    assert "white noise" not in str(told.value)
