"""Surveys of rotors with blades: frequencies in the fixed frame and names, against Coleman's constant form."""

import json
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from tests.blades import BLADES, FIXED, coleman, modelled, rotor

import floquid as fq
from floquid import floquet
from floquid.errors import InputError
from floquid.exports import survey_columns, survey_summary
from floquid.reporting._chosen_figures import shape_columns
from floquid.shapes import ShapeOptions
from floquid.shapes._read import _named
from floquid.surveys import look_of, looks, order_end, order_lines

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
    return fq.survey(at, over="speed", between=RANGE, points=4, blades=GROUPS, fixed=FIXED)


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


def two_blades(speed):
    def matrix(t):
        shear = np.cos(speed * t + np.pi * np.arange(2))
        stiffness = np.diag(11.0 + 0.5 * speed**2 + 1.5 * shear) - np.array([[0.0, 2.0], [2.0, 0.0]])
        return np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -0.2 * np.eye(2)]])

    return floquet.modes(matrix, 2.0 * np.pi / speed, outputs=np.eye(2, 4), channels=["flap1", "flap2"])


def test_a_mode_that_stands_in_the_turning_frame_has_its_frequency_there():
    """Its two lines in the fixed frame are of one size: either would be taken by chance."""
    found = fq.survey(two_blades, over="speed", between=(1.2, 1.6), points=5, blades={"flap": ["flap1", "flap2"]})
    track = next(own for own in found.tracks if own.name == "1st flap differential")
    assert track.frequency == pytest.approx(np.sqrt(13.0 + 0.5 * found.values**2), rel=0.01)


def test_a_weak_mode_has_a_name_where_its_share_is_sure(found):
    reading = found.shapes.read(at(1.3)).modes[0]
    for std, named in ((0.05, True), (0.4, False), (None, False)):
        first = replace(reading.blades.shares[0], std=std)
        pattern = replace(reading.blades, shares=(first, *reading.blades.shares[1:]))
        assert (_named([replace(reading, is_weak=True, blades=pattern)])[0].name is not None) is named


def test_looks_are_those_of_family_and_direction(found):
    by_name = {track.name: look_of(track, found) for track in found.tracks}
    green, red, blue = (by_name[name][0] for name in ("1st flap collective", "1st edge collective", "1st fa"))
    assert len({green, red, blue}) == 3
    for name, (colour, dash) in by_name.items():
        _, family, *direction = name.split()
        assert colour == {"flap": green, "edge": red}.get(family, blue)
        assert dash == {"backward": "dashed", "forward": "dashdot"}.get("".join(direction), "solid")
    hawc = replace(found, shapes=replace(found.shapes, words="hawc"))
    assert look_of(replace(found.tracks[0], names=("flap BW",)), hawc) == (green, "dashed")
    unnamed = replace(found, tracks=tuple(replace(track, names=()) for track in found.tracks), shapes=ShapeOptions())
    assert look_of(unnamed.tracks[0], unnamed) is None
    labels, hertz = zip(*order_lines(found), strict=True)
    assert labels == ("1P", "3P", "6P", "9P")
    np.testing.assert_allclose(hertz[1], 3.0 * found.values / (2.0 * np.pi))
    assert not order_lines(unnamed)
    assert [own[0] for own in looks(unnamed)[:4]] == ["#0072B2", "#D55E00", "#009E73", "#E69F00"]
    last = found.values[-1]
    assert order_end(found, hertz[1], 1e3) == (last, hertz[1][-1])
    assert order_end(found, hertz[1], 0.0) is None
    x, top = order_end(found, hertz[1], 0.5 * (hertz[1][0] + hertz[1][-1]))
    assert np.interp(x, found.values, hertz[1]) == pytest.approx(top)
    assert len(found.plot.campbell().axes[0].lines) > len(found.tracks)


def test_multipliers_go_round_the_circle(found):
    """Angles change by turns from point to point: a straight line would go across."""
    ways = [np.hypot(*line.get_data()) for line in found.plot.multipliers().axes[1].lines]
    assert len(ways) > len(found.tracks)
    sizes = np.exp([track.decay * point.model.period for track in found.tracks for point in found.points])
    assert min(way.min() for way in ways) > 0.99 * sizes.min()


def test_all_motion_over_equal_blades_is_where_wave_and_harmonic_agree(found):
    waves, columns = {"collective": 0, "backward": 1, "forward": -1}, cache(partial(shape_columns, found))
    for track in found.tracks:
        family, _, direction = track.name.split(maxsplit=1)[1].partition(" ")
        for place, point in enumerate(track.points.tolist()):
            mode, shift, mirrored = track.modes[place, 0], int(track.shifts[place]), bool(track.mirrored[place])
            row = columns(point)(mode, shift, mirrored=mirrored)
            tables = {name: np.reshape(row[f"waves {name}"], (3, -1)) for name in GROUPS}
            for table in tables.values():
                off = [share for (n, m), share in np.ndenumerate(table) if n - 1 != m - table.shape[1] // 2]
                assert max(off) < 1e-3
            if direction:
                n = waves[direction]
                assert tables[family][n + 1, n + tables[family].shape[1] // 2] > 0.6


@pytest.mark.pages
def test_page(found, tmp_path):
    text = fq.report(found, tmp_path / "survey.html", damping_unit="decrement").read_text(encoding="utf-8")
    assert "logarithmic decrement" in text
    assert all(f'id="{name}"' in text for name in ("frequency", "damping", "waves-0", "waves-1"))
    assert 'id="orbits"' not in text


def test_without_blades_tracks_are_numbered():
    found = fq.survey(two_blades, over="speed", between=(1.2, 1.6), points=3)
    assert [track.name for track in found.tracks] == [f"mode {k + 1}" for k in range(len(found.tracks))]


def test_a_blade_that_is_no_channel_is_refused():
    with pytest.raises(InputError, match="`blades` of `read_shapes` must"):
        fq.survey(at, over="speed", between=RANGE, points=4, blades={"flap": ["flap1", "flap9"]})
