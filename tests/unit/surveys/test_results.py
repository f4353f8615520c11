"""Surveys kept in files, as tables, as figures and as a page."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.locks import known

import floquid as fq
from floquid.errors import InputError
from floquid.exports import columns_text, edge_columns, survey_columns, survey_summary
from floquid.reporting._chosen_figures import _curves, shape_columns
from floquid.surveys import Point, link_runs, track_rows, unstable_spans

SPEEDS = np.arange(18.0, 22.1, 0.5)


@pytest.fixture(scope="module")
def found():
    points = [
        Point(
            values={"speed_rpm": 30.0 / np.pi * speed, "temperature": 21.0 + k},
            files=(f"r{k}.npz",),
            model=known(speed, std=0.002, shape_std=0.01, seed=k, without=(0,) if k == 1 else ()),
            passed=True,
        )
        for k, speed in enumerate(SPEEDS)
    ]
    return fq.survey([*points, Point(values={"speed_rpm": 300.0}, files=("bad.npz",), reason="It is too short.")])


@pytest.fixture(scope="module")
def whirling(found):
    return fq.survey(found.points, pairs=["a:b"])


def test_every_field_comes_back(whirling, tmp_path):
    found = whirling
    fq.save(found, tmp_path / "survey.h5")
    back = fq.load(tmp_path / "survey.h5")
    assert (back.over, back.edges, back.unlinked) == (found.over, found.edges, found.unlinked)
    assert (back.notes, back.warnings) == (found.notes, found.warnings)
    for one, other in zip(found.tracks, back.tracks, strict=True):
        for name in one.__dataclass_fields__:
            np.testing.assert_equal(getattr(one, name), getattr(other, name))
    for one, other in zip(found.points, back.points, strict=True):
        assert (one.values, one.files, one.passed, one.reason) == (
            other.values,
            other.files,
            other.passed,
            other.reason,
        )
        assert (one.model is None) == (other.model is None)
    np.testing.assert_equal(back.points[2].model.covariance, found.points[2].model.covariance)


@pytest.mark.slow
def test_a_survey_of_its_own_points_is_the_same(found):
    assert fq.survey(found.points).edges == found.edges


def test_whirl_is_read_at_each_point(found, whirling):
    """Channels a and b have shapes of random phases: what they whirl like is that of the shape of the mode."""
    again = whirling
    for track in again.tracks:
        for whirl, point, (mode, _) in zip(track.whirl, track.points, track.modes, strict=True):
            x, y = again.points[point].model.shape(mode).values[:2]
            lam = again.points[point].model
            signs = np.sign(lam.exponents[mode].imag + lam.fundamental * lam.harmonics)
            turning, energy = -np.sum(signs * (x.conj() * y).imag), 0.5 * np.sum(np.abs(x) ** 2 + np.abs(y) ** 2)
            assert whirl == pytest.approx(turning / energy)
        assert set(track.sense) <= {-1, 0, 1}
        assert np.isnan(track.whirl_interval).all()  # models without deviations have no interval, and no zero width
    assert any((track.sense != 0).any() for track in again.tracks)
    assert again.plot.campbell()
    assert not any((track.sense != 0).any() for track in found.tracks)


def test_orbits_go_round_as_their_lines_whirl(whirling):
    """By the area that each encloses, and the energy of both directions."""
    again = whirling
    kinds = set()
    for point, place in ((3, again.points[3]), (5, again.points[5])):
        model = place.model
        for mode in model.upper_modes:
            row = shape_columns(again, point)(mode, 0, mirrored=False)
            x, y = model.shape(mode).values[:2]
            ahead = model.exponents[mode].imag + model.fundamental * model.harmonics > 0.0
            turning = np.where(ahead, 1.0, -1.0) * (np.abs(x + 1j * y) ** 2 - np.abs(x - 1j * y) ** 2)
            strongest = int((np.abs(x) ** 2 + np.abs(y) ** 2).argmax())
            for kind in (0, 1):
                curves = _curves(row["orbits"], kind)
                for xs, ys in zip(curves["xs"], curves["ys"], strict=True):
                    area = np.sum(np.array(xs[:-1]) * np.diff(ys) - np.array(ys[:-1]) * np.diff(xs))
                    assert np.sign(area) == 1 - 2 * kind
            if row["orbits"][0][0] < 2:
                assert row["orbits"][0][0] == (turning[strongest] < 0.0)
                kinds.add(row["orbits"][0][0])
    assert kinds == {0.0, 1.0}


def test_rows_and_summary(found):
    columns = survey_columns(found)
    assert {len(column) for column in columns.values()} == {sum(t.modes[t.modes >= 0].size for t in found.tracks) + 1}
    locked = [k for k, value in enumerate(columns["locked"]) if value]
    assert len(locked) == 2 * found.tracks[1].locked.sum() > 0
    assert {columns["damping_ratio"][k] for k in locked} == {None}
    assert columns["reason"][-1] == "It is too short."
    assert columns["temperature"][0] == 21.0
    text = columns_text(columns)
    assert text.count("\n") == len(columns["point"]) + 1
    assert "nan" not in text
    assert edge_columns(found)["kind"] == ["lock", "lock"]
    summary = survey_summary(found)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["format"] == "floquid-survey/1"
    assert [track["name"] for track in summary["tracks"]] == ["mode 1", "mode 2", "mode 3", "mode 4"]
    assert summary["points"][-1]["order"] is None


@pytest.mark.parametrize(
    ("name", "options"),
    [("campbell", {"fan": 1}), ("damping", {"unit": "ratio"}), ("damping", {"unit": "decay"}), ("multipliers", {})],
)
def test_figures(found, name, options):
    drawn = getattr(found.plot, name)(**options)
    assert isinstance(drawn, Figure)
    assert len(drawn.legends[0].get_texts()) >= 4


def test_doubtful_links_have_a_dash_of_their_own(found):
    track = replace(found.tracks[0], confidence=np.array([np.nan, 1.0, 0.5, 0.5, 1.0]))
    assert list(link_runs(track)) == [(slice(0, 2), False), (slice(1, 4), True), (slice(3, 5), False)]
    doubtful = replace(found, tracks=tuple(replace(own, confidence=0.0 * own.confidence) for own in found.tracks))
    solid = [sum(line.get_linestyle() == "-" for line in one.plot.damping().axes[0].lines) for one in (found, doubtful)]
    assert solid[1] == solid[0] - len(found.tracks)
    assert [one.plot.campbell().legends[0].get_lines()[0].get_linestyle() for one in (found, doubtful)] == ["-", "-"]


def test_unstable_spans_are_between_edges(found):
    """The lock of mode 2, from edge to edge; where one has no value, from half way between two points."""
    low, high = sorted(edge.value for edge in found.edges)
    assert unstable_spans(found) == [(low, high)]
    lost = replace(found, edges=tuple(replace(edge, value=None) for edge in found.edges))
    ((first, last),) = unstable_spans(lost)
    before, after = found.values[np.searchsorted(found.values, first) + np.array([-1, 0])]
    assert first == pytest.approx(0.5 * (before + after))
    assert first < high
    assert last > low


def test_whirl_is_in_the_table_where_it_was_read(found, whirling):
    assert {len(row) for row in track_rows(found)} == {6}
    assert {row[4] for row in track_rows(whirling)} >= {
        f"{whirling.tracks[0].whirl[0]:+.2f} … {whirling.tracks[0].whirl[-1]:+.2f}"
    }


def test_what_no_figure_is_of(found):
    with pytest.raises(InputError, match="be a Survey"):
        fq.plot.campbell("survey")
    with pytest.raises(InputError, match="decay, ratio, decrement"):
        found.plot.damping(unit="percent")
    with pytest.raises(InputError, match="fan"):
        found.plot.campbell(fan=7)
    with pytest.raises(InputError, match="modes of transfer functions and surveys have none"):
        fq.report(found, "r.html", truth=([0.0], [[[1.0]]]))


@pytest.mark.pages
def test_page(found, tmp_path):
    text = fq.report(found, tmp_path / "survey.html").read_text(encoding="utf-8")
    assert "mode 2, locked with itself" in text
    assert "It is too short." in text
