"""The benchmark of the order in small, and that it can find fault."""

import json
from dataclasses import replace

import numpy as np
from benchmarks.order import run
from benchmarks.order.__main__ import main
from benchmarks.order.cases import CASES, PLAIN, system_of
from benchmarks.order.drawing import random_system
from benchmarks.order.run import Found, judged

EASY = replace(PLAIN, modes=(2, 2), outputs=(20, 20), cycles=(80, 80))


def test_it_runs_and_writes_its_tables(tmp_path, capsys):
    assert main(["--draws", "2", "--systems", "3", "--cases", "2 modes", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert (tmp_path / "order.md").read_text(encoding="utf-8") == text
    assert "| 2 modes, 2 % |" in text
    assert "| all | 3 |" in text
    rows = [json.loads(line) for line in (tmp_path / "order.jsonl").read_text(encoding="utf-8").splitlines()]
    assert sorted(row["seed"] for row in rows if row["case"] == "random systems") == [0, 1, 2]
    assert [row["right"] for row in rows if row["case"] == "2 modes, 2 %"] == [True, True]


def test_unknown_cases_are_refused(capsys):
    assert main(["--cases", "no such case"]) == 2
    assert "20 modes, 2 %" in capsys.readouterr().err


def test_every_case_has_the_modes_of_its_name():
    for name in CASES:
        expected = 2 if name.startswith("pair") else int(name.split()[0])
        assert system_of(name, 0).truth.order == 2 * expected


def told(monkeypatch, change):
    """The row of an easy system when the identifier gives its true poles after `change`."""
    system = random_system(0, EASY)
    monkeypatch.setattr(run, "identified", lambda *_: change(system.truth.exponents.copy()))
    return judged(system, 0)


def test_the_true_poles_are_right_and_cost_nothing(monkeypatch):
    row = told(monkeypatch, lambda poles: Found(poles, ambiguous=False, reasons=()))
    assert (row.right, row.silent, row.told, row.lost, row.extra, row.stray) == (True, False, True, 0, 0, 0)
    assert np.allclose(row.squares, 0.0)
    assert len(row.squares) == 2 * row.true


def test_a_mode_missed_is_lost_in_silence_or_not(monkeypatch):
    for ambiguous in (False, True):
        row = told(monkeypatch, lambda poles, a=ambiguous: Found(poles[2:], ambiguous=a, reasons=()))
        assert (row.right, row.silent, row.lost, row.order) == (False, not ambiguous, 2, 2)
        assert len(row.squares) == 2 * 2


def test_a_mode_eleven_bounds_off_is_lost_and_one_nine_off_is_not(monkeypatch):
    bound = random_system(0, EASY).findable()[0].std.real
    for times, lost in ((9.0, 0), (11.0, 2)):
        row = told(
            monkeypatch,
            lambda poles, t=times: Found(poles + t * bound * (np.arange(4) < 2), ambiguous=False, reasons=()),
        )
        assert row.lost == lost
        assert row.right == (not lost)


def test_a_false_mode_is_one_too_many_and_astray(monkeypatch):
    far = np.array([-0.1 + 0.001j, -0.1 - 0.001j])
    row = told(monkeypatch, lambda poles: Found(np.append(poles, 50.0 * far), ambiguous=False, reasons=()))
    assert (row.right, row.extra, row.lost) == (False, 2, 0)


def test_nothing_found_loses_all(monkeypatch):
    row = told(monkeypatch, lambda poles: Found(poles[:0], ambiguous=False, reasons=()))
    assert (row.lost, row.order, row.squares, row.silent) == (4, 0, (), True)
