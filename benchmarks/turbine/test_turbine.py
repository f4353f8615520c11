"""The command on one draw, and its judgement of models that are wrong or name a mode of the system."""

import json
from dataclasses import replace

import pytest
from benchmarks.turbine import __main__ as turbine

RIGHT = turbine.Row(
    seed=0, outcome="passed", order=6, modes=2, others=2, named=2, damping=(0.5, 1.0), frequency=(2.1, 0.2), seconds=1.0
)


@pytest.mark.slow
def test_the_command_writes_a_row_a_draw_and_finds_fault_with_exponents_that_are_off(monkeypatch, tmp_path, capsys):
    assert turbine.main(["--draws", "1", "--out", str(tmp_path / "new" / "rows.json")]) == 0
    assert "| draws | 0 to 0 |" in capsys.readouterr().out
    (row,) = json.loads((tmp_path / "new" / "rows.json").read_text())
    assert row["right"]
    honest = turbine.identify

    def shifted(*arguments, **options):
        found = honest(*arguments, **options)
        exponents = found.model.exponents + 7.0 * found.model.exponent_std.real
        return replace(found, model=replace(found.model, exponents=exponents, estimates=None))

    monkeypatch.setattr(turbine, "identify", shifted)
    row = turbine.judged(0)
    assert row.worst > 5.0
    assert not row.right


@pytest.mark.parametrize(
    "wrong",
    [{"outcome": "failed"}, {"modes": 3}, {"named": 1}, {"misnamed": 1}, {"damping": (0.5, 5.5)}],
    ids=lambda wrong: next(iter(wrong)),
)
def test_what_is_not_right_is_named(wrong):
    assert RIGHT.right
    row = replace(RIGHT, seed=7, **wrong)
    assert not row.right
    told = turbine.table([RIGHT, row])
    assert "| not right | 7 |" in told
    assert ("passed | 1 of 2" in told) == (row.outcome == "failed")


def test_intervals_are_counted_over_the_models_that_passed():
    told = turbine.table([RIGHT, replace(RIGHT, outcome="failed", frequency=(9.0, 9.0)), replace(RIGHT, seconds=30.0)])
    assert "| frequency: 95 % intervals that hold | 2 of 4 (50%), rms 1.49, largest 2.1 |" in told
    assert "| damping: 95 % intervals that hold | 4 of 4 (100%)" in told
    assert "| seconds: median, nine of ten, most | 1, 24, 30 |" in told
