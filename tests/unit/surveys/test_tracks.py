"""Modes followed from point to point: whatever branch is reported, through locks, past modes that are missing."""

from dataclasses import replace

import numpy as np
import pytest
from tests.locks import TOGETHER, known, labels

from floquid.surveys import Point, survey

SPEEDS = np.arange(17.6, 25.01, 0.4)
STD, SHAPE_STD = 0.002, 0.01


def surveyed(speeds=SPEEDS, **options):
    """The survey of models; an option is a value, or a function of the number of the point."""
    points = []
    for k, speed in enumerate(speeds):
        own = {name: value(k) if callable(value) else value for name, value in options.items()}
        points.append(Point(values={"speed": speed}, model=known(speed, std=STD, shape_std=SHAPE_STD, seed=k, **own)))
    return survey(points, over="speed")


@pytest.fixture(scope="module")
def plain():
    return surveyed()


def frequencies(found):
    return [track.frequency for track in found.tracks]


def test_all_modes_are_followed_through_both_locks(plain):
    assert [len(track.points) for track in plain.tracks] == [len(SPEEDS)] * 4
    assert not plain.unlinked
    assert np.median(frequencies(plain), axis=1) == pytest.approx([6.45, 10.05, 16.36, 16.4], abs=0.1)


@pytest.mark.slow
def test_no_other_branch_changes_a_track(plain):
    """Every mode, each of a couple, is reported up to three harmonics away from the point before."""
    moves = np.random.default_rng(1).integers(-3, 4, (len(SPEEDS), 5))
    moves[0] = 0
    moved = surveyed(branch=lambda k: moves[k])
    for one, other in zip(frequencies(plain), frequencies(moved), strict=True):
        assert one == pytest.approx(other, abs=1e-9)
    assert all((track.shifts != 0).any() for track in moved.tracks)


def test_a_mirror_image_does_not_change_a_track(plain):
    """Every second point reports mode 1, and each of a couple, below zero: its conjugate stands in the table."""
    found = surveyed(SPEEDS[:6], branch=lambda k: (-2, -2) if k % 2 else ())
    track, straight = found.tracks[1], plain.tracks[1]
    assert track.mirrored.tolist() == [False, True, False, True, False, True]
    assert track.frequency == pytest.approx(straight.frequency[:6], abs=1e-9)


@pytest.mark.slow
def test_the_instants_at_which_records_begin_change_no_track(plain):
    turns = np.random.default_rng(2).uniform(size=len(SPEEDS))
    moved = surveyed(turn=lambda k: turns[k])
    assert not moved.unlinked
    # Where modes 2 and 3 are locked with each other, both have one shape.
    apart = (TOGETHER[0] > SPEEDS) | (TOGETHER[1] < SPEEDS)
    for one, other in zip(plain.tracks, moved.tracks, strict=True):
        assert one.frequency[apart] == pytest.approx(other.frequency[apart], abs=1e-9)
        linked = apart & np.concatenate([[True], apart[:-1]])  # to a point where they are apart, too
        assert one.mac[linked] == pytest.approx(other.mac[linked], abs=0.02, nan_ok=True)
    least = [min(np.nanmin(track.mac) for track in found.tracks) for found in (plain, moved)]
    assert least[1] > least[0] - 0.02


def test_a_mode_stays_itself_behind_its_lock(plain):
    """Its mirror image, at ω - 10, would be as good by its shape."""
    track = plain.tracks[1]
    behind = SPEEDS[track.points] > 21.0
    assert (np.abs(track.frequency[behind] - 10.0) < 0.25).all()
    assert track.mirrored.sum() == 0


def test_a_mode_stays_itself_behind_a_long_lock():
    """Shapes of a lock alone are remembered at its end, and its mirror image is as much like those."""
    speeds = np.arange(18.7, 21.51, 0.2)
    track = surveyed(speeds).tracks[1]
    assert track.locked.sum() > 6
    behind = speeds[track.points] > 21.0
    assert (np.abs(track.frequency[behind] - 10.0) < 0.25).all()


def test_two_multipliers_of_a_lock_are_one_object(plain):
    track = plain.tracks[1]
    inside = (SPEEDS > 19.13) & (SPEEDS < 20.87)
    assert (track.locked == inside).all()
    assert (track.growth > 0.0)[inside].all()
    assert track.decay[inside] == pytest.approx(-0.1, abs=0.01)


def test_missing_modes_leave_gaps_in_their_tracks_alone():
    lost = {1: (1,), 5: (0, 1), 8: (3,), 9: (2,)}
    found = surveyed(SPEEDS[:11], without=lambda k: lost.get(k, ()))
    assert sorted(len(track.points) for track in found.tracks) == [9, 10, 10, 11] or [
        len(t.points) for t in found.tracks
    ]


def test_exchangeable_modes_are_told(plain):
    """In the middle of a lock of two modes both have one shape: whichever is called which, it is said."""
    doubtful = {link.between[1] for link in plain.links if link.confidence < 0.5}
    assert doubtful
    assert all(22.0 < SPEEDS[k] < 24.1 for k in doubtful)
    assert any("confidence below 0.8" in words for words in plain.warnings)


def test_a_mode_on_which_hits_disagree_is_told():
    """It stands for two that fold onto one another: the link to it and that from it may be of either."""
    results = []
    for k, speed in enumerate(SPEEDS[:5]):
        model = replace(known(speed, std=STD, shape_std=SHAPE_STD, seed=k), point={"speed": speed})
        second = model.coefficients.copy()
        if k == 2:
            second[[0, 4]] = 0.8 * model.coefficients[[2, 6]]  # of the mode at 10 rad/s the shape of another
        hits = np.concatenate([model.coefficients, second], axis=2)
        results.append(replace(model, coefficients=hits, coefficient_std=np.repeat(model.coefficient_std, 2, axis=2)))
    found = survey(results, over="speed")
    doubtful = [(link.track, link.between) for link in found.links if link.confidence < 0.8]
    assert doubtful == [(1, (1, 2)), (1, (2, 3))]


def test_a_crossing_is_told(plain):
    assert "mode 3 and mode 4 cross" in plain.notes[0]


def test_a_far_branch_is_not_found():
    """Seven harmonics away is one more than are looked at: the mode is missing there, and another is left over."""
    found = surveyed(SPEEDS[:5], branch=lambda k: (0, 7 * (k == 2), 0, 0))
    assert sorted(len(track.points) for track in found.tracks) == [4, 5, 5, 5]
    assert len(found.unlinked) == 1


@pytest.mark.slow
def test_links_with_modes_missing_and_false_ones():
    """A tenth of all modes are missing, and 0.3 false ones are at each point."""
    right, wrong, sure, surely_wrong = 0, 0, 0, 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        points, names = [], []
        for k, speed in enumerate(SPEEDS):
            count = len(labels(speed))
            lost = [mode for mode in range(count - 3, count) if generator.random() < 0.1]
            false = int(generator.poisson(0.3))
            options = {"seed": 100 * seed + k, "without": lost, "false": false}
            points.append(Point(values={"speed": speed}, model=known(speed, std=STD, shape_std=SHAPE_STD, **options)))
            names.append(labels(speed, lost, false))
        for track in survey(points, over="speed").tracks:
            own = np.array([names[k][mode] for k, mode in zip(track.points, track.modes[:, 0], strict=True)])
            # Where modes 2 and 3 are locked with each other, both have one shape.
            apart = (SPEEDS[track.points] < TOGETHER[0]) | (SPEEDS[track.points] > TOGETHER[1])
            is_right = own == np.bincount(own + 1).argmax() - 1
            right += int((is_right & apart).sum())
            wrong += int((~is_right & apart).sum())
            sure += int((~is_right & apart & (track.confidence >= 0.8)).sum())
            links = apart[1:] & apart[:-1] & (own[1:] != own[:-1])
            surely_wrong += int((links & (track.confidence[1:] >= 0.8)).sum())
    assert right > 1100
    assert wrong <= 0.003 * right
    assert sure <= 0.002 * right
    assert surely_wrong == 0
