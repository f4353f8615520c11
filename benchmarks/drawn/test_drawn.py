"""The command on one draw of each kind, and its judgement of models that are wrong."""

import json
from dataclasses import replace

import pytest
from benchmarks.drawn import __main__ as drawn

RIGHT = drawn.Row(seed=0, states=4, outcome="passed", order=4, worst=2.0, seconds=1.0)


@pytest.mark.parametrize(
    ("excitation", "seed"),
    [
        ("inputs", 7),
        pytest.param("inputs", 0, marks=pytest.mark.slow),
        pytest.param("ambient", 2, marks=pytest.mark.slow),
        pytest.param("ambient", 117, marks=pytest.mark.slow),
    ],
)
def test_the_command_writes_a_row_a_draw_and_finds_fault_with_exponents_that_are_off(
    excitation, seed, monkeypatch, tmp_path, capsys
):
    out = tmp_path / "new" / "rows.json"
    assert drawn.main([excitation, "--draws", "1", "--first", str(seed), "--out", str(out)]) == 0
    assert f"| draws | {seed} to {seed} |" in capsys.readouterr().out
    (row,) = json.loads(out.read_text())
    assert row["outcome"] == "passed"
    assert row["worst"] < drawn.OFF
    honest = drawn.identify

    def shifted(*arguments, **options):
        found = honest(*arguments, **options)
        exponents = found.model.exponents + 9.0 * found.model.exponent_std.real
        return replace(found, model=replace(found.model, exponents=exponents, estimates=None))

    monkeypatch.setattr(drawn, "identify", shifted)
    again = drawn.judged(seed, excitation)
    assert again.worst > drawn.OFF
    assert not again.correct


def test_what_is_wrong_is_named():
    untold, told = replace(RIGHT, seed=7, worst=6.0), replace(RIGHT, seed=8, false=1, codes=("inputs_untold",))
    failed = replace(RIGHT, seed=9, outcome="failed", order=2)
    found = drawn.table([RIGHT, untold, told, failed])
    assert "| passed | 3 of 4 |" in found
    assert "| wrong, with a warning | 8 |" in found
    assert "| wrong, without | 7 |" in found
    assert "| failed though right | 1 |" in found
    assert "WRONG UNTOLD" in str(untold)
    assert "UNTOLD" not in str(told)
