"""Linearisations of a known turbine at several speeds: surveyed, and compared with what they were made of."""

import numpy as np
import pytest
from tests.cli.test_commands import strict_json, typed
from tests.unit.floquet.files.test_read_openfast import lin_text

import floquid as fq
from floquid import floquet
from floquid.surveys import Point

NAMES = ("ED x1, m", "ED x2, m", "ED First time derivative of x1, m/s", "ED First time derivative of x2, m/s")
STATES = [(name, "F", 2) for name in NAMES]
SPEEDS = (1.0, 1.1, 1.2)
LOOK = np.array([[0.0, 0, 0, 0], [1.0, 0, 0, 0], [0.3, 1.0, 0, 0]])
"""C: OpenFAST's azimuth, which no state moves, and two moments."""


def matrix(speed, azimuth, stiffness=1.0):
    turned = 0.3 * np.array([[np.cos(2 * azimuth), np.sin(2 * azimuth)], [np.sin(2 * azimuth), -np.cos(2 * azimuth)]])
    k = stiffness * np.array([[2.0, 0.4], [0.4, 5.0]]) + speed**2 * turned
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-k, -np.diag([0.05, 0.08])]])


def system(speed_rpm, stiffness=1.0):
    speed = speed_rpm * np.pi / 30.0
    return lambda t: matrix(speed, speed * t, stiffness), 2.0 * np.pi / speed


@pytest.fixture
def turbines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for speed in SPEEDS:
        folder = tmp_path / "lin" / f"{speed}"
        folder.mkdir(parents=True)
        for number, azimuth in enumerate(2.0 * np.pi * np.arange(12) / 12):
            options = {"A": matrix(speed, azimuth), "C": LOOK, "D": np.zeros((3, 0)), "states": STATES, "speed": speed}
            (folder / f"t.{number}.lin").write_text(lin_text(azimuth, **options, wind=f"{10.0 * speed}"))
    return tmp_path


def test_a_survey_of_folders(turbines):
    printed = strict_json(typed("survey lin --format json --workers 1"))
    assert [point["speed_rpm"] for point in printed["points"]] == pytest.approx([30.0 / np.pi * v for v in SPEEDS])
    assert [len(track["points"]) for track in printed["tracks"]] == [3, 3]
    wind = strict_json(typed("survey lin --over wind_m_s --format json --workers 1"))
    assert [point["wind_m_s"] for point in wind["points"]] == [10.0, 11.0, 12.0]
    found = fq.survey([floquet.read_openfast(turbines / "lin" / f"{v}") for v in SPEEDS])
    assert [channel.name for channel in found.points[0].model.channels] == ["Azimuth", "RootMyb2", "GenPwr"]


def test_compared_with_what_they_were_made_of(turbines):
    def true(speed_rpm):
        return floquet.modes(*system(speed_rpm), outputs=LOOK, channels=["Azimuth", "RootMyb2", "GenPwr"])

    measured = [
        Point(values={"speed_rpm": 30.0 / np.pi * v}, model=true(30.0 / np.pi * v), passed=True) for v in SPEEDS
    ]
    survey = fq.survey(measured)
    found = fq.compare(survey, turbines / "lin")
    assert len(found.pairs) == 6
    assert max(abs(pair.difference) for pair in found.pairs) < 1e-8
    assert min(pair.mac for pair in found.pairs) > 1.0 - 1e-9
    one = fq.compare(measured[1], turbines / "lin" / "1.1")
    assert len(one.pairs) == 2
    stiffer = floquet.modes(*system(30.0 / np.pi * 1.1, 1.02), outputs=LOOK[1:], channels=["RootMyb2", "GenPwr"])
    assert fq.compare(turbines / "lin" / "1.1", stiffer).pairs[0].difference.imag < -1e-3
