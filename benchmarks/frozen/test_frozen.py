"""Two cheap records end to end; a decision that changes is reported, judged by the truth, and ends in exit code 1."""

import functools
import json
from dataclasses import replace

import pytest
from benchmarks.frozen import __main__ as frozen
from benchmarks.frozen import run
from benchmarks.frozen.compare import compared
from benchmarks.frozen.records import CHAINS, RECORDS
from benchmarks.frozen.run import Decision, Mode
from benchmarks.frozen.tables import TABLES, changes

CHEAP = ("inputs, Mathieu, 1", "adversary, plain, 1")
"""One of two kinds, a fifth of a second each."""

PAIR = Mode(exponent=(-0.1, 1.0), std=(1e-3, 1e-3), kind="pair", harmonics=(-1, 0, 1))
THEN = Decision(
    record="free, two_real", seed=0, outcome="believed", passed=True, fundamental=4.0, modes=(PAIR,), must=2, found=2
)


def quicken(patch):
    """Neither warm up nor calibrate for seconds that decide nothing; what is asked for again here is decided once."""
    patch.setattr(frozen, "warm", lambda kinds: None)
    patch.setattr(run, "calibration", lambda: 1.0)
    patch.setattr(frozen, "decided", functools.cache(frozen.decided))


@pytest.fixture(scope="module")
def today(tmp_path_factory):
    """The file of decisions on two cheap records of today."""
    folder = tmp_path_factory.mktemp("frozen")
    with pytest.MonkeyPatch.context() as patch:
        quicken(patch)
        assert frozen.main(["freeze", "--records", ";".join(CHEAP), "--folder", str(folder)]) == 0
    return (folder / "then.json").read_text(encoding="utf-8")


@pytest.fixture
def kept(today, tmp_path, monkeypatch):
    """A folder with that file; what is decided then is decided anew."""
    quicken(monkeypatch)
    (tmp_path / "then.json").write_text(today, encoding="utf-8")
    return tmp_path


def changed(path, name, **fields):
    """The file with other fields of one decision."""
    whole = json.loads(path.read_text(encoding="utf-8"))
    for row in whole["decisions"]:
        if f"{row['record']}, {row['seed']}" == name:
            row.update(fields)
    path.write_text(json.dumps(whole), encoding="utf-8")


def test_a_decision_as_it_was_is_equal_and_one_that_is_worse_ends_in_exit_code_1(kept, capsys):
    told = ["--records", ";".join(CHEAP), "--folder", str(kept)]
    rows, _ = frozen.read(kept / "then.json")
    assert set(rows) == set(CHEAP)
    assert all(row.linearisations > 0 and row.found == row.must for row in rows.values())
    changed(kept / "then.json", CHEAP[0], found=3)
    assert frozen.main(told) == 1
    out = capsys.readouterr().out
    assert f"{CHEAP[0]}: worse: found 3 → 2" in out
    assert "2 decisions: 1 equal, 0 better, 1 worse, 0 other." in out
    (kept / "reasons.toml").write_text('"inputs, Mathieu" = "one is right"\n', encoding="utf-8")
    assert frozen.main(["--records", CHEAP[0], *told[2:]]) == 0
    assert "(one is right)" in capsys.readouterr().out


def test_a_part_that_is_frozen_again_leaves_the_rest_as_it_was(kept):
    changed(kept / "then.json", CHEAP[1], linearisations=-1)
    changed(kept / "then.json", CHEAP[0], linearisations=-1)
    assert frozen.main(["freeze", "--records", CHEAP[0], "--folder", str(kept)]) == 0
    rows, _ = frozen.read(kept / "then.json")
    assert rows[CHEAP[0]].linearisations > 0
    assert rows[CHEAP[1]].linearisations == -1


@pytest.mark.parametrize(
    ("now", "phrase", "verdict"),
    [
        ({"outcome": "refused", "modes": (), "passed": None, "found": 0}, "outcome believed → refused", "worse"),
        ({"outcome": "failed", "modes": (), "passed": None, "found": 0}, "outcome believed → failed", "worse"),
        ({"false": 1}, "false 0 → 1", "worse"),
        ({"passed": False}, "passed True → False", "worse"),
        ({"warned": ("line_as_mode",)}, "warned none → line_as_mode", "other"),
        ({"modes": (replace(PAIR, harmonics=(0, 1)),)}, "harmonics -1..1 → 0,1", "other"),
        ({"modes": (replace(PAIR, exponent=(-0.1, 1.0002)),)}, "moved by 0.2 deviations", "other"),
        ({"modes": (replace(PAIR, std=(2e-3, 1e-3)),)}, "deviations 0.001, 0.001 → 0.002, 0.001", "other"),
        ({"modes": (replace(PAIR, exponent=(-0.1, 0.0), kind="real"),), "found": 1}, "order 2 → 1", "worse"),
        ({"modes": (replace(PAIR, exponent=(-0.1, 2.0)),)}, "mode -0.1+1i is missing", "other"),
        ({"modes": (replace(PAIR, exponent=(-0.1, 5.0), harmonics=(-2, -1, 0)),)}, "another branch, +1", "other"),
    ],
)
def test_what_differs_is_named_and_judged(now, phrase, verdict):
    difference = compared(THEN, replace(THEN, **now))
    assert phrase in str(difference)
    assert difference.verdict == verdict
    if phrase.endswith("branch, +1"):
        assert "harmonics" not in str(difference)
    back = compared(replace(THEN, **now), THEN)
    assert back.verdict == {"worse": "better"}.get(verdict, verdict)


def test_seconds_and_linearisations_decide_nothing():
    assert compared(THEN, replace(THEN, seconds=9.0, linearisations=7)).verdict == "equal"


def test_there_are_60_records_of_every_kind():
    assert sum(len(own.seeds) for own in RECORDS.values()) >= 60
    assert {own.kind for own in RECORDS.values()} == set(CHAINS)


def test_tables_that_are_there_are_frozen_and_a_number_that_is_worse_ends_in_exit_code_1(tmp_path, capsys):
    told = ["--tables", str(tmp_path / "build"), "--folder", str(tmp_path)]
    assert frozen.main(["freeze", *told]) == 0
    kept = json.loads((tmp_path / "tables.json").read_text(encoding="utf-8"))
    assert set(kept) == {name for name, table in TABLES.items() if table.committed}
    assert frozen.main(told) == 0
    kept["chain"]["two_real"]["right"] += 1
    (tmp_path / "tables.json").write_text(json.dumps(kept), encoding="utf-8")
    assert frozen.main(told) == 1
    assert "chain, two_real: worse: right" in capsys.readouterr().out


def test_groups_of_another_number_of_runs_are_not_compared():
    then = {"order": {"all": {"runs": 3, "right": 3}}}
    (change,) = changes(then, {"order": {"all": {"runs": 2, "right": 2}}})
    assert (change.number, change.worse) == ("runs", False)
