"""`floquid identify --memory`: a record that is read in blocks, and what cannot go with it."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from tests.cli.test_commands import strict_json, typed
from tests.unit.large.test_large import decay

import floquid as fq
from floquid.cli.commands import identify as commanded


@pytest.fixture
def scan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    fq.write(decay(cycles=400), "scan.h5")


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """What is printed of the scan, and the folder with it and its result in `found`."""
    folder = tmp_path_factory.mktemp("large")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("COLUMNS", "200")
        fq.write(decay(cycles=400), "scan.h5")
        return typed("identify scan.h5 --memory 1GB --out found"), folder


def test_a_record_is_identified_within_a_memory(identified, monkeypatch):
    text, folder = identified
    monkeypatch.chdir(folder)
    assert "Checks of a part (5 of 5 channels, 400 of 400 periods): passes." in text
    assert "Written to found/: result.h5" in text
    found = fq.load("found/result.h5")
    assert len(found.exponents) == 3
    content = strict_json(typed("identify scan.h5 --memory 1GB --out found --format json --enforce"))
    modes, checked = content["modes"], content["validation"]
    assert [mode["exponent"] for mode in modes] == [[value.real, value.imag] for value in found.exponents]
    assert checked == {"passed": True, "reasons": [], "channels": 5, "periods": 400}


@pytest.mark.usefixtures("scan")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("scan.h5 --memory 1GB", "come with --out"),
        ("scan.h5 --memory much --out found", "such as 1GB"),
        ("scan.h5 --memory 100MB --out found", "Allow more."),
        ("scan.h5 --memory 1GB --out found --states x0", "stand alone with --memory"),
        ("scan.h5 --memory 1GB --out found --figures", "`--figures` must stand alone with --memory"),
        ("scan.h5 --memory 1GB --out found --channels values,x0", "must name one matrix"),
        ("none.h5 --memory 1GB --out found", "none.h5"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(words, message):
    typed(f"identify {words}", code=2, message=message)


def test_commands_take_the_result_or_say_which_do(identified, monkeypatch):
    monkeypatch.chdir(identified[1])
    typed("identify scan.h5 --period 1 --no-validate --no-constrained --out whole")
    assert "3" in typed("compare found whole")
    readings = strict_json(typed("shapes found --pairs x0:x1 --format json"))
    assert len(readings["modes"]) == 3
    typed("shapes found --path x.csv", code=2, message="even about a turning point")  # no scan, but it was read
    for command in ("report found", "bootstrap found", "scan found", "transfer found --at 0.1"):
        typed(command, code=2, message="`floquid compare`, `survey` and `shapes` take it.")


@pytest.mark.usefixtures("scan")
def test_checks_of_a_part_end_as_those_of_a_record(monkeypatch):
    wrong = "identify scan.h5 --period 1.0833333333333333 --memory 1GB --out wrong"
    typed(wrong, code=1, message="does not repeat with the period given")
    assert fq.load("wrong/result.h5").passed is False
    colour = scipy.signal.lfilter([1.0], [1.0, -0.6], np.random.default_rng(0).standard_normal((5, 3600)))
    fq.write(replace(decay(cycles=300, noise=0.0), values=decay(cycles=300, noise=0.0).values + 0.3 * colour), "c.h5")
    real, kept = commanded.identify_large, []
    monkeypatch.setattr(
        commanded, "identify_large", lambda *own, **options: kept.append(real(*own, **options)) or kept[0]
    )
    typed("identify c.h5 --memory 1GB --out found --enforce", code=3, message="The noise is not white")
    monkeypatch.setattr(commanded, "identify_large", lambda *_, **__: kept[0])
    typed("identify c.h5 --memory 1GB --out found")
