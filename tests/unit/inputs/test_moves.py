"""Moves of a search with inputs: what they are predicted to change J by, and what a structure costs."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import creeping, lag, mathieu, mathieu_and_lag, two_masses
from tests.unit.inputs.test_start import samples_from

from floquid.fit import chi2_limit
from floquid.inputs import Limits, bare_mode, fitted_together, linearise, searched
from floquid.inputs.search._bands import Point, far_growths, growths, helpful, shrinkages
from floquid.inputs.search._search import additions, kinds, removals
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


@pytest.mark.parametrize(("stiffness", "real"), [(0.0141, True), (0.0149, False)])
def test_a_pair_and_two_real_multipliers_become_each_other(stiffness, real):
    """From the wrong kind, as a search may come to it: J falls as one step of the block predicts."""
    system = creeping(stiffness)
    samples = samples_from(system, 120, 16, 0.02)
    decay, gap = -0.5 * 0.24, 0.02
    harmonics = np.arange(2.0)
    if real:
        wrong = [bare_mode(samples, decay + 1j * gap, np.arange(-1.0, 2.0), np.arange(-1.0, 2.0))]
    else:
        wrong = [bare_mode(samples, complex(decay + way), harmonics, harmonics, real=True) for way in (gap, -gap)]
    none = Point(samples, LIMITS, linearise(samples, []), helpful)
    point = none.settled(Structure(tuple(fitted_together(samples, samples.values, wrong)[1]), ()))
    (move,) = [move for move in kinds(point) if move.name == "kind"]
    assert [mode.real for mode in move.structure.modes] == ([True, True] if real else [False])
    assert point.tried(move).value < point.value


def test_a_pair_that_stands_for_one_real_multiplier_becomes_it():
    samples = samples_from(lag(), 120, 20, 0.02)
    none = Point(samples, LIMITS, linearise(samples, []), helpful)
    (first, *_) = sorted(additions(none), key=lambda move: move.change)
    point = none.tried(first)
    (move,) = [move for move in kinds(point) if move.name == "single"]
    (mode,) = move.structure.modes
    assert mode.real
    assert point.tried(move).value < point.value - 0.5 * point.price.of(point.structure) + point.price.of(
        move.structure
    )


@pytest.mark.slow
def test_a_real_multiplier_beside_a_pair_is_found():
    found, unfinished = searched(samples_from(mathieu_and_lag(), 160, 20, 0.02), LIMITS)
    assert not unfinished
    assert sorted(mode.real for mode in found.modes) == [False, True]


def test_a_strong_harmonic_beyond_weak_ones_is_found():
    own = mathieu()
    system = replace(own, C=lambda t: own.C(t) * (1.0 + 0.3 * np.cos(12.0 * t)))
    point = begun(system)[1]
    assert all(np.abs(mode.turns).max() < 5.0 for move in growths(point) for mode in move.structure.modes)
    (far,) = far_growths(point)
    assert max(np.abs(mode.turns).max() for mode in far.structure.modes) >= 5.0
    assert point.tried(far).value < point.value + 0.5 * far.change


@pytest.mark.slow
def test_a_move_that_promises_less_than_noise_that_drives_is_none(monkeypatch):
    point = begun(two_masses())[1]
    promised = -min(move.change for move in additions(point))
    for least, there in ((1.9 * promised, True), (2.1 * promised, False)):
        monkeypatch.setattr("floquid.inputs.search._search.by_noise_beyond", lambda *_, least=least: least)
        assert bool(list(additions(point))) == there
