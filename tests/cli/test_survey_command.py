"""`floquid survey`: records at several speeds become points, tracks and edges; one bad record costs one point."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.cli.test_commands import strict_json, typed

import floquid as fq
from floquid import plot
from floquid.cli.arguments.options import Choices
from floquid.cli.arguments.points import jobs_of
from floquid.core import ConstantPeriod
from floquid.reporting._survey_page import survey_page
from floquid.systems import JeffcottRotor

SPEEDS = (0.70, 0.71, 0.73, 0.77)
QUICK = "--over speed --channels X,Y --order 4 --no-validate --no-constrained --workers 1"
LISTS = (
    "mode", "frequency_rad_s", "frequency_std_rad_s", "decay", "decay_std", "damping_ratio", "whirl", "whirl_std",
    "names", "name_share", "leak", "leak_interval", "whirl_interval", "locked", "weak", "confidence", "mac",
)  # fmt: skip
PLAIN = "survey --order 4 --no-validate --no-constrained --workers 1 runs/run0.npz"


@pytest.fixture(scope="module")
def records():
    each = [JeffcottRotor(speed=v).simulate(n_periods=40, samples_per_period=8, noise=0.01, seed=1) for v in SPEEDS]
    return [record.with_point({"speed": speed}) for record, speed in zip(each, SPEEDS, strict=True)]


@pytest.fixture
def runs(records, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for name in ("campbell", "damping", "multipliers"):  # drawn elsewhere
        monkeypatch.setattr(plot, name, lambda found, **_: found)
    monkeypatch.setattr(plot, "save_figure", lambda _, path: path.write_text("drawn"))
    (tmp_path / "runs").mkdir()
    for k, record in enumerate(records):
        fq.write(record, tmp_path / "runs" / f"run{k}.npz")
    return tmp_path


def test_records_become_a_survey(runs):
    (runs / "runs" / "bad.csv").write_text("time,X\n0,hello\n")
    fq.write(
        fq.Record(values=np.ones((2, 9)), sample_rate=1.0, channels=["X", "Y"], point={"speed": 0.8}), "runs/z.npz"
    )
    text = typed(f"survey runs {QUICK} --out out")
    assert "5 points, speed 0.7 to 0.8; 1 without a result." in text
    assert text.count("4 of 5") == 2
    assert "Edges of instability" in text
    assert "runs/bad.csv is left out:" in text
    assert "speed = 0.8: no result." in text
    found = {path.name for path in (runs / "out").rglob("*") if path.is_file()}
    assert found >= {
        "survey.h5",
        "survey.json",
        "survey.csv",
        "edges.csv",
        "report.html",
        "campbell.png",
        "damping.png",
    }
    content = strict_json((runs / "out" / "survey.json").read_text())
    assert [point["speed"] for point in content["points"]] == [*SPEEDS, 0.8]
    assert [edge["kind"] for edge in content["edges"]] == ["lock", "lock"]
    assert set(content) >= {"format", "over", "points", "tracks", "edges", "unlinked", "warnings"}
    assert all({"speed", "files", "passed", "order", "reason"} <= set(point) for point in content["points"])
    assert all(
        {"value", "std", "interval", "kind", "direction", "tracks"} <= set(edge) and len(edge["interval"]) == 2
        for edge in content["edges"]
    )
    for track in content["tracks"]:
        assert {len(track[name]) for name in LISTS} == {len(track["points"])}
        assert set(track["names"]) == set(track["whirl"]) == {None}  # neither blades nor pairs were given
    assert {"harmonics", "whirl_low", "leak_high"} <= set(
        (runs / "out" / "survey.csv").read_text().split("\n")[0].split(",")
    )
    back = fq.load("out/survey.h5")
    assert "95 % interval" in back.summary()
    assert "90 % interval" in replace(back, confidence=0.9).summary()
    assert back.summary() == "\n".join(line.rstrip() for line in back.summary().splitlines())
    assert json.loads(typed(f"survey runs/run0.npz runs/run1.npz {QUICK} --format json"))["tracks"] == []


@pytest.mark.pages
def test_the_page_of_a_survey(runs):
    point = fq.Record(values=np.ones((2, 9)), sample_rate=1.0, channels=["X", "Y"], point={"speed": 0.8})
    fq.write(point, "runs/z.npz")
    typed(f"survey runs {QUICK} --out out")
    page = survey_page(fq.load("out/survey.h5"), title=None)
    assert page.index('id="verdict"') < page.index('id="edges"') < page.index('id="tracks"')
    unsure = "0 of 5 points pass their checks, 4 not checked, 1 without a result."
    assert f"{unsure} 2 edges of instability." in page


def jobs(files, table=None, over="speed", **settings):
    choices = Choices().with_given(**settings) if settings else Choices()
    return jobs_of(files, choices, over, table)


def test_records_of_one_point_are_hits(runs, records):
    fq.write(records[1], runs / "again.npz")
    found = jobs([runs / "runs", runs / "again.npz"])
    assert [len(job.files) for job in found] == [1, 2, 1, 1]
    assert found[1].values["speed"] == SPEEDS[1]


def test_a_table_says_what_files_do_not(runs, records):
    bare = replace(records[0], clock=None, point={})
    fq.write(bare, runs / "bare.npz")
    table = runs / "points.csv"
    table.write_text("file,speed_rpm,temperature,period\nbare.npz,742,21.5,\nruns/run1.npz,,22.5,0.25\n")
    first, second = jobs([], table, over="speed_rpm")
    assert first.values == {"speed_rpm": 742.0, "temperature": 21.5}
    assert first.choices.settings.period == pytest.approx(60.0 / 742.0)
    assert second.choices.settings.period == 0.25
    assert second.values == {"speed_rpm": 240.0, "speed": SPEEDS[1], "temperature": 22.5}
    twice = jobs([runs / "bare.npz"], table, over="speed_rpm", periods_per_revolution=2)
    assert twice[0].choices.settings.period == pytest.approx(30.0 / 742.0)


def test_the_speed_is_that_of_the_clock(runs, records):
    fq.write(replace(records[0], point={}, clock=ConstantPeriod(period=0.02)), runs / "clocked.npz")
    assert jobs([runs / "clocked.npz"], over="speed_rpm")[0].values == {"speed_rpm": pytest.approx(3000.0)}


def test_variables_are_channels_by_their_names(runs, records):
    """As `floquid info` says: a file of named vectors needs --channels, in a survey as elsewhere."""
    rows = dict(zip("XY", records[0].values[:2], strict=True))
    np.savez(runs / "plain.npz", time=np.arange(len(rows["X"])) / records[0].sample_rate, speed_rpm=30.0, **rows)
    named, alone = (jobs([runs / "plain.npz"], over="speed_rpm", **how)[0] for how in ({"channels": ("X", "Y")}, {}))
    assert named.reason is None
    assert named.values == {"speed_rpm": 30.0}
    assert named.choices.settings.period == pytest.approx(2.0)
    assert "Name them by" in alone.reason
    assert "there is no file" in jobs([runs / "lost"], over="speed_rpm")[0].reason
    typed("identify plain.npz --channels X,Y", code=2, message="`--period` must be given")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("survey", "`FILES` must name records or results"),
        ("survey runs --table runs/run0.npz", "`--table` must have a column `file`"),
        ("survey empty", "`FILES` must hold records"),
        (f"{PLAIN} --over torque", "a value of torque each"),
        (f"{PLAIN} other.npz --over speed", "have two channels in common at least, but share X."),
        (f"{PLAIN} half.npz", "have periods of one part of a revolution, but half.npz has one of 2 revolutions"),
        (f"{PLAIN} metres.npz --over speed", "have one unit a channel, but metres.npz has 'X' in m, and runs/run0.npz"),
    ],
)
def test_what_is_refused(runs, records, command, message):
    (runs / "empty").mkdir()
    channels = {
        "other": [fq.Channel(name="X"), fq.Channel(name="strain")],
        "metres": [fq.Channel(name=name, unit="m") for name in "XY"],
    }
    for name, named in channels.items():
        fq.write(replace(records[1], values=records[1].values[:2], channels=named), runs / f"{name}.npz")
    fq.write(records[2].with_point({"speed_rpm": 120.0 / records[2].period}), runs / "half.npz")
    fq.write(
        replace(records[0], channels=[replace(c, unit="mm") for c in records[0].channels]), runs / "runs" / "run0.npz"
    )
    typed(command, code=2, message=message)


@pytest.mark.slow
def test_processes_give_the_same(runs):
    options = QUICK.replace("--workers 1", "--workers 2")
    assert typed(f"survey runs {options} --format json") == typed(f"survey runs {QUICK} --format json")
