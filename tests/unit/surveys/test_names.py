"""Surveys of rotors with blades: frequencies in the fixed frame and names, against Coleman's constant form."""

import json

import numpy as np
import pytest
from tests.blades import BLADES, FIXED, coleman, modelled, rotor

import floquid as fq
from floquid.errors import InputError
from floquid.exports import survey_columns, survey_summary

GROUPS = {"flap": BLADES[:3], "edge": BLADES[3:]}
RANGE = (0.9, 1.6)


def at(omega):
    return modelled(rotor(*coleman(omega), omega=omega), omega=omega)


def constant(omega):
    """The frequencies of the constant form (modes,), by its eigenvalues [rad/s]."""
    stiffness, damping = coleman(omega)
    n = len(stiffness)
    values = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]]))
    return np.sort(values[values.imag > 0].imag)


@pytest.fixture(scope="module")
def found():
    return fq.survey(at, over="speed", between=RANGE, points=6, blades=GROUPS, fixed=FIXED)


def test_frequencies_are_those_of_the_fixed_frame(found):
    tracked = np.sort([track.frequency for track in found.tracks], axis=0)
    assert tracked == pytest.approx(np.transpose([constant(omega) for omega in found.values]), rel=1e-8)


def test_a_shifted_track_is_still_the_model_moved(found):
    """λ of a track is that of the model, or its mirror image, moved by `shifts` fundamentals."""
    for track in found.tracks:
        for place, point in enumerate(track.points):
            own = found.points[point].model.exponents[track.modes[place, 0]]
            moved = (own.conj() if track.mirrored[place] else own) + 1j * found.values[point] * track.shifts[place]
            assert track.exponents[place, 0] == pytest.approx(moved, rel=1e-9)


def test_tracks_have_the_names_of_their_patterns(found):
    names = [track.name for track in found.tracks]
    assert len(set(names)) == len(names)
    for name in ("1st flap collective", "1st flap forward", "1st edge backward", "1st edge forward"):
        assert name in names
    track = found.tracks[names.index("1st flap forward")]
    assert set(track.names) == {"flap forward"}
    assert (track.name_share > 0.6).all()
    assert (track.leak < 1e-8).all()
    assert np.diff(track.frequency).min() > 0.0  # it rises with the speed, and that of the backward one falls


def test_names_come_back_and_stand_in_the_table(found, tmp_path):
    fq.save(found, tmp_path / "survey.h5")
    back = fq.load(tmp_path / "survey.h5")
    assert [track.name for track in back.tracks] == [track.name for track in found.tracks]
    assert back.tracks[0].names == found.tracks[0].names
    np.testing.assert_equal(back.points[0].blades, found.points[0].blades)
    columns = survey_columns(found)
    assert "flap forward" in columns["pattern"]
    told = json.loads(json.dumps(survey_summary(found)))["tracks"][0]
    assert len(told["names"]) == len(told["name_share"]) == len(told["leak"]) == len(found.points)


def test_without_blades_tracks_are_numbered():
    found = fq.survey(at, over="speed", between=RANGE, points=4)
    assert [track.name for track in found.tracks] == [f"mode {k + 1}" for k in range(len(found.tracks))]


def test_a_blade_that_is_no_channel_is_refused():
    with pytest.raises(InputError, match="`blades` of `read_shapes` must"):
        fq.survey(at, over="speed", between=RANGE, points=4, blades={"flap": ["flap1", "flap9"]})
