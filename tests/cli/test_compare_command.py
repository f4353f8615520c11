"""`floquid compare`: tables, JSON, files, and what is refused, for results, systems, files of A(t) and surveys."""

import json

import numpy as np
import pytest
from tests.cli.test_commands import strict_json, typed
from tests.locks import known

import floquid as fq
from floquid import plot
from floquid.surveys import Point
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor(damping=0.02)


@pytest.fixture(scope="module")
def found():
    record = ROTOR.simulate(n_periods=40, samples_per_period=8, noise=0.01, seed=1)
    return fq.identify(record, channels=["X", "Y"], constrained=False, validate=False)


@pytest.fixture(scope="module")
def content(found, tmp_path_factory):
    """The bytes of its file."""
    path = tmp_path_factory.mktemp("saved") / "result.h5"
    fq.save(found, path)
    return path.read_bytes()


@pytest.fixture
def results(content, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "result.h5").write_bytes(content)
    return tmp_path


def test_a_result_and_the_true_system(results, monkeypatch):
    monkeypatch.setattr(plot, "save_figure", lambda _, path: path.write_text("drawn"))
    text = typed("compare d systems:jeffcott,damping=0.02 --out c")
    assert "2 pairs of modes" in text
    assert ": the deviations explain the differences." in text
    assert "Warning" not in text
    names = {path.relative_to(results / "c").as_posix() for path in (results / "c").rglob("*") if path.is_file()}
    assert names == {"comparison.h5", "comparison.json", "comparison.csv", "report.html", "figures/comparison.png"}
    assert (results / "c" / "comparison.csv").read_text().count("\n") == 3
    printed = strict_json(typed("compare d systems:jeffcott,damping=0.02 --format json"))
    assert printed == json.loads((results / "c" / "comparison.json").read_text())
    assert printed["format"] == "floquid-comparison/1"
    assert printed["missing_in_a"] == printed["missing_in_b"] == printed["warnings"] == []
    assert printed["dof"] == 4
    assert printed["p"] > 0.001
    for pair in printed["pairs"]:
        assert {"a", "b", "difference", "std", "z", "mac"} <= set(pair)
        assert np.hypot(*pair["difference"]) < 5.0 * np.hypot(*pair["std"])


def test_what_differs_and_what_is_missing(results):
    assert "more than the deviations explain, most in mode" in typed("compare d/result.h5 systems:jeffcott")
    points = [Point(values={"v": v}, model=known(v)) for v in (17.0, 17.5, 18.0)]
    less = Point(values={"v": 17.5}, model=known(17.5, without=(3,)))
    fq.save(fq.survey(points, over="v"), "a.h5")
    fq.save(fq.survey([points[0], less, points[2]], over="v"), "b.h5")
    text = typed("compare a.h5 b.h5")
    assert "Missing in b: mode 4 of a at v = 17.5" in text
    assert "11 pairs of modes; 3 points" in text
    printed = strict_json(typed("compare b.h5 a.h5 --format json"))
    assert printed["missing_in_a"] == [[1, 3]]
    assert printed["points"] == [17.0, 17.5, 18.0]
    assert printed["chi2"] is printed["p"] is None


def test_channels_of_other_units_need_a_scale(results, monkeypatch):
    monkeypatch.setattr(plot, "save_figure", lambda _, path: path.write_text("drawn"))
    times = ROTOR.period * np.arange(32) / 32
    outputs = np.diag([1e3, 1.0, 1.0, 1.0])[:2]
    np.savez("a.npz", A=np.moveaxis(ROTOR.system(times), 0, -1), period=ROTOR.period, C=outputs, outputs=["X", "Y"])
    plain = strict_json(typed("compare d a.npz --format json"))
    scaled = strict_json(typed("compare d a.npz --scale X=1/1000 --format json --out c"))
    assert min(pair["mac"] for pair in scaled["pairs"]) > 0.999 > max(pair["mac"] for pair in plain["pairs"])
    assert (results / "c" / "figures" / "comparison.png").read_text() == "drawn"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("compare d none.npz", "`B` must be the path of a file that can be read, but there is no file none.npz"),
        ("compare none d", "`A` must be the path of a file that can be read"),
        ("compare d systems:laval", "`B` must name an example system (jeffcott), but is 'systems:laval'"),
        ("compare d empty", "`B` must hold a result, a survey or .lin files, but empty holds none"),
        ("compare d systems:jeffcott,speed=0.7", "`B` must have the period of a, but has 4.48799 s"),
        ("compare d systems:jeffcott --scale X", "`--scale` must be NAME=NUMBER"),
        ("compare d systems:jeffcott --scale Z=2", "`--scale` must name channels of b, but has 'Z'"),
        ("compare d systems:jeffcott --out d", "`--out` must be a folder without a result"),
        ("compare d lin", "`B` must name linearisation files"),
    ],
)
def test_what_is_refused(results, command, message):
    (results / "empty").mkdir()
    (results / "lin").mkdir()
    (results / "lin" / "a.1.lin").write_text("nothing")
    typed(command, code=2, message=message)
