"""Moves of a search with inputs: what they are predicted to change J by, and what a structure costs."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import mathieu, two_masses
from tests.unit.inputs.test_start import samples_from

from floquid.fit import chi2_limit
from floquid.inputs import Limits, linearise
from floquid.inputs.search._bands import growths, helpful, shrinkages
from floquid.inputs.search._changes import additions, removals
from floquid.inputs.search._point import Point
from floquid.inputs.search._structure import Structure

LIMITS = Limits()


def begun(system, noise=0.05):
    samples = samples_from(system, 60, 20, noise)
    none = Point(samples, LIMITS, linearise(samples, []), helpful)
    (first, *_) = sorted(additions(none), key=lambda move: move.change)
    return none, none.tried(first)


@pytest.fixture(scope="module")
def descent():
    """Mathieu's equation from its first candidate on, until no band lowers J."""
    point = begun(mathieu())[1]
    points = [point]
    while True:
        moves = sorted([*growths(point), *shrinkages(point)], key=lambda move: move.change)
        better = next((trial for trial in map(point.tried, moves) if trial.value < point.value), None)
        if better is None:
            return points
        point = better
        points.append(point)


def test_a_unit_costs_what_noise_exceeds_in_its_numbers(descent):
    point = descent[-1]
    (mode,), price = point.structure.modes, point.price
    own = chi2_limit(4, LIMITS.mode_alarm)  # an exponent and a first state
    own += (len(mode.turns) + len(mode.reach)) * chi2_limit(2, LIMITS.harmonic_alarm)
    assert price.of(point.structure) == pytest.approx(own)
    with_direct = Structure((mode,), (0.0, 1.0))
    more = chi2_limit(1, LIMITS.harmonic_alarm) + chi2_limit(2, LIMITS.harmonic_alarm)
    assert price.of(with_direct) == pytest.approx(own + more)
    assert point.value == pytest.approx(point.at.cost + own)


def test_harmonics_less_change_j_as_predicted(descent):
    """A band one harmonic wider than the last one: without it J is that of the last point again."""
    point = descent[-1]
    (mode,) = point.structure.modes
    wide = mode.with_band("turns", np.append(mode.turns, mode.turns[-1] + 1.0))
    wider = point.settled(Structure((wide,), point.structure.direct))
    (move,) = shrinkages(wider)
    assert wider.tried(move).value - wider.value == pytest.approx(move.change, abs=0.5)
    assert wider.tried(move).value == pytest.approx(point.value, abs=0.5)


def test_a_false_mode_is_removed_and_the_true_one_is_no_candidate_for_that(descent):
    point = descent[-1]
    (mode,) = point.structure.modes
    false = point.settled(point.structure.joined([mode.with_band("turns", [0.0])]))
    assert not list(removals(point))
    best = min(removals(false), key=lambda move: move.change)
    assert false.tried(best).value < false.value


def test_no_harmonic_is_beyond_the_highest():
    none, first = begun(two_masses())
    narrow = Point(none.samples, Limits(highest=1), none.at, helpful)
    (mode,) = narrow.settled(first.structure).structure.modes
    assert np.abs(mode.turns).max() <= 1.0
    assert np.abs(mode.reach).max() <= 1.0


def test_the_name_of_a_structure_is_that_of_all_its_branches(descent):
    point = descent[-1]
    (mode,), omega = point.structure.modes, point.samples.fundamental
    renamed = mode.with_band("turns", mode.turns - 1.0)
    renamed = replace(renamed, exponent=mode.exponent + 1j * omega, reach=mode.reach + 1.0)
    assert point.name(Structure((renamed,), ())) == point.name(Structure((mode,), ()))
    assert point.name(Structure((mode.with_band("turns", mode.turns[1:]),), ())) != point.name(Structure((mode,), ()))
