"""`floquid identify --memory`: a record that is read in blocks, and what cannot go with it."""

import pytest
from tests.cli.test_commands import strict_json, typed
from tests.unit.large.test_large import decay

import floquid as fq


@pytest.fixture
def scan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    fq.write(decay(cycles=400), "scan.h5")


@pytest.mark.usefixtures("scan")
def test_a_record_is_identified_within_a_memory():
    text = typed("identify scan.h5 --memory 1GB --out found")
    assert "no A(t), checks and whitening" in text
    assert "Written to found/: result.h5" in text
    found = fq.load("found/result.h5")
    assert len(found.exponents) == 3
    modes = strict_json(typed("identify scan.h5 --memory 1GB --out found --format json"))["modes"]
    assert [mode["exponent"] for mode in modes] == [[value.real, value.imag] for value in found.exponents]


@pytest.mark.usefixtures("scan")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("scan.h5 --memory 1GB", "come with --out"),
        ("scan.h5 --memory much --out found", "such as 1GB"),
        ("scan.h5 --memory 100MB --out found", "Allow more."),
        ("scan.h5 --memory 1GB --out found --states x0", "stand alone with --memory"),
        ("scan.h5 --memory 1GB --out found --enforce", "`--enforce` must stand alone with --memory"),
        ("scan.h5 --memory 1GB --out found --figures", "`--figures` must stand alone with --memory"),
        ("scan.h5 --memory 1GB --out found --channels values,x0", "must name one matrix"),
        ("none.h5 --memory 1GB --out found", "none.h5"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(words, message):
    typed(f"identify {words}", code=2, message=message)


@pytest.mark.usefixtures("scan")
def test_commands_take_the_result_or_say_which_do():
    typed("identify scan.h5 --memory 1GB --out found")
    typed("identify scan.h5 --period 1 --no-validate --out whole")
    assert "3" in typed("compare found whole")
    readings = strict_json(typed("shapes found --pairs x0:x1 --format json"))
    assert len(readings["modes"]) == 3
    for command in ("report found", "bootstrap found", "scan found", "transfer found --at 0.1"):
        typed(command, code=2, message="`floquid compare`, `survey` and `shapes` take it.")
