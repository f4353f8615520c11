"""Results that are no survey: refused with the names of the files, or told."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.locks import known

from floquid.errors import InputError
from floquid.surveys import Point, point_of, survey


@pytest.fixture
def points():
    return [
        Point(values={"speed_rpm": speed, "speed": speed}, files=(f"{speed:g}.npz",), model=known(speed * 3.0))
        for speed in (6.0, 6.2, 6.4)
    ]


def changed(point, **options):
    return Point(**{"values": point.values, "files": point.files, "model": point.model} | options)


def test_points_without_a_value(points):
    with pytest.raises(InputError, match=r"6\.2\.npz has none\.\n.*--point speed_rpm=742"):
        survey([points[0], changed(points[1], values={}), points[2]])


def test_points_that_are_equal(points):
    twice = changed(points[1], values=points[0].values)
    with pytest.raises(InputError, match=r"6\.npz; 6\.2\.npz are both at 6\."):
        survey([points[0], twice, points[2]])


def test_periods_of_other_parts_of_a_revolution(points):
    points = [changed(p, model=known(p.values["speed"] * 0.10471975511965977)) for p in points]
    survey(points)
    half = changed(points[1], model=known(points[1].values["speed"] * 0.20943951023931953))
    with pytest.raises(InputError, match=r"6\.2\.npz has one of 0\.5 revolutions, and most 1\."):
        survey([points[0], half, points[2]])


def test_channels_that_differ(points):
    rest = points[:2]
    survey([*rest, changed(points[2], model=known(19.2, channels=("b", "d")))], over="speed")
    with pytest.raises(InputError, match="share b"):
        survey([*rest, changed(points[2], model=known(19.2, channels=("b",)))], over="speed")


def test_units_that_differ(points):
    mixed = points[2].model
    channels = [
        replace(channel, unit=unit) for channel, unit in zip(mixed.channels, ("m", "m", "mm", "-"), strict=True)
    ]
    other = changed(points[2], model=replace(mixed, channels=channels))
    survey([*points[:2], other], over="speed")  # of a channel without a unit nothing is known
    metres = replace(mixed, channels=[replace(channel, unit="m") for channel in channels])
    third = changed(points[2], values={"speed": 7.0}, files=("7.npz",), model=metres)
    with pytest.raises(InputError, match=r"7\.npz has 'c' in m, and 6\.4\.npz in mm\."):
        survey([*points[:2], other, third], over="speed")


def test_a_system_that_repeats_within_its_period_is_told(points):
    """Where most of the points have every second harmonic alone; not where one of three has."""

    def with_even_harmonics(point):
        model = replace(point.model, harmonics=2 * point.model.harmonics)
        return changed(point, model=replace(model, coefficient_std=np.full(model.coefficients.shape, 1e-3 + 1e-3j)))

    even = [with_even_harmonics(point) for point in points]
    told = [len([own for own in survey(of, over="speed").warnings if "--periods-per-rev 2" in own]) for of in
            (points, [*points[:2], even[2]], [points[0], *even[1:]])]  # fmt: skip
    assert told == [0, 0, 1]
    # At half a revolution a period, as `--periods-per-rev 2` makes them: before, that was the advice.
    # Backwards, too.
    for periods, way, advice in ((1, 1.0, "of it: `--periods-per-rev 2`."), (2, -1.0, "of it: `--periods-per-rev 4`.")):
        turned = [
            changed(own, values={"speed_rpm": 60.0 * way / (periods * own.model.period), "speed": own.values["speed"]})
            for own in even
        ]
        assert sum(advice in own for own in survey(turned, over="speed").warnings) == 1


@pytest.mark.parametrize(
    ("passed", "failed", "reasons", "told"),
    [
        (True, False, ("Some is left.",), None),
        (False, True, ("No period.", "Some is left."), "No period."),
        (False, False, ("The prediction is off. Look at it.",), "The prediction is off. Look at it."),
        (False, False, (), None),
        (None, False, ("No room.",), None),
    ],
    ids=["passes with a remainder", "fails by a finding", "fails by samples left out", "not checked", "no answer"],
)
def test_a_point_fails_as_its_result_does(passed, failed, reasons, told, points):
    """Before: of one that fails by samples left out no reason was told."""
    found = SimpleNamespace(model=points[0].model, passed=passed, failed=failed, reasons=reasons)
    point = replace(point_of(found), values=points[0].values)
    assert point.reason == told
    said = survey([point, *points[1:]], over="speed").warnings
    assert [own for own in said if "the model fails" in own] == (
        [f"speed = 6: the model fails. {told.partition('. ')[0].rstrip('.')}."] if told else []
    )


def test_two_points_give_a_table(points):
    found = survey(points[:2], over="speed")
    assert not found.tracks
    assert "3 at least are needed" in found.warnings[-1]
    assert len(found.points) == 2


def test_a_point_without_a_result_costs_one_point(points):
    points = [changed(p, values={"speed": v}, model=known(v)) for p, v in zip(points, (18.0, 18.4, 19.2), strict=True)]
    lost = Point(values={"speed": 18.8}, files=("lost.npz",), reason="It holds no response.")
    found = survey([*points, lost], over="speed")
    assert [point.model is None for point in found.points] == [False, False, True, False]
    assert all(track.points.tolist() == [0, 1, 3] for track in found.tracks[:3])
    assert found.warnings[0] == "speed = 18.8: no result. It holds no response."


def test_what_is_no_result(points):
    with pytest.raises(InputError, match="but holds"):
        survey([points[0], ("x",)], over="speed")
    with pytest.raises(InputError, match="none was given"):
        survey([])
    with pytest.raises(InputError, match="two ends of the range"):
        survey(lambda value: value)
