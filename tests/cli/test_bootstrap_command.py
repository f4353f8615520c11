"""`floquid bootstrap`: what it prints and writes, and that what cannot be is one clear message."""

import re

import numpy as np
import pytest
from tests.cli.conftest import EARLIER, contents, save_npz
from tests.cli.test_commands import PERIOD, strict_json, typed

import floquid

FILES = {"bootstrap.json", "bootstrap.npz"}
COMMON = "--draws 20 --workers 1"


@pytest.fixture
def result(here):
    """A result in the folder `kept` beside the record."""
    typed(f"identify good.npz --period {PERIOD} --channels X,Y --states X,Y --out kept")
    return here / "kept"


def rows_after(text, title):
    return [line.split() for line in text.split(title, 1)[1].split("\n\n", 1)[0].splitlines()[1:]]


@pytest.mark.usefixtures("result")
def test_the_tables_say_what_the_numbers_say(monkeypatch):
    drawn, given = [], []
    monkeypatch.setattr(
        "floquid.cli.commands.bootstrap.bootstrap_analysis",
        lambda *own, **options: given.append(options) or drawn.append(floquid.bootstrap(*own, **options)) or drawn[0],
    )
    text = typed(f"bootstrap kept/result.h5 {COMMON} --seed 3")
    (found,), (options,) = drawn, given
    assert (options["draws"], options["seed"], options["workers"]) == (20, 3, 1)
    assert text.startswith("20 records drawn from the model, seed 3: the same modes fitted anew.\n")
    assert max(map(len, text.splitlines())) <= 80
    rows = [line.split() for line in text.splitlines() if re.match(r" *\d? +(Re λ|Im λ|f \[Hz\]|ζ) ", line)]
    assert len(rows) == 2 * 4
    first = rows[0]
    assert first[:3] == ["1", "Re", "λ"]
    upper = int(np.flatnonzero(found.exponents.distinct)[0])
    assert float(first[3]) == pytest.approx(found.exponents.estimate[upper].real, abs=found.exponents.std[upper].real)
    assert float(first[5]) == pytest.approx(found.exponents.std[upper].real, rel=1e-2)
    assert float(first[6]) == pytest.approx(found.exponents.ratio[upper].real, abs=1e-3)
    low, high = found.exponents.interval()
    assert [float(word) for word in first[7:9]] == pytest.approx(
        [low[upper].real, high[upper].real], abs=0.1 * found.exponents.std[upper].real
    )
    (coefficients,) = [line.split() for line in text.splitlines() if line.startswith(" coefficients")]
    ratios = found.coefficients.ratios()
    expected = [len(ratios), ratios.min(), np.median(ratios), ratios.max(), 0]
    assert [float(word) for word in coefficients[1:]] == pytest.approx(expected, abs=1e-3)
    assert "The asymptotic deviations hold" in text
    assert "Add --out DIR" in text


@pytest.mark.slow
def test_json_is_the_bootstrap_alone(result):
    text = typed(f"bootstrap kept {COMMON} --format json --out new")
    content = strict_json(text)
    assert text == (result.parent / "new" / "bootstrap.json").read_text()
    assert set(contents(result.parent / "new")) == FILES
    found = floquid.bootstrap(floquid.load(result / "result.h5"), draws=20, workers=1)
    assert content["format"] == "floquid-bootstrap/1"
    assert (content["draws"], content["used"], content["seed"], content["failed"]) == (20, 20, 0, [])
    assert (content["whole"], content["orders"], content["holds"]) == (False, {"4": 20}, True)
    assert content["reasons"] == list(found.reasons)
    exponents = content["quantities"]["exponents"]
    assert np.array(exponents["std"]) @ [1, 1j] == pytest.approx(found.exponents.std)
    assert np.array(exponents["low"]) @ [1, 1j] == pytest.approx(found.exponents.interval()[0])
    assert np.shape(content["quantities"]["system"]["std"]) == found.system.std.shape
    assert content["ratio_std"] == pytest.approx(1.0 / np.sqrt(38.0))
    with np.load(result.parent / "new" / "bootstrap.npz") as arrays:
        assert set(arrays.files) == {*content["quantities"], "orders"}
        assert np.array_equal(arrays["exponents"], found.exponents.draws)
        assert np.array_equal(arrays["system"], found.system.draws)


@pytest.mark.slow
def test_it_goes_beside_the_result_it_is_of(result):
    before = contents(result)
    text = typed(f"bootstrap kept {COMMON} --out kept")
    after = contents(result)
    assert {name: after[name] for name in before} == before
    assert set(after) == set(before) | FILES
    assert "Written to kept/: bootstrap.json, bootstrap.npz" in text


@pytest.mark.slow
def test_the_whole_again(result):
    text = typed(f"bootstrap kept {COMMON} --whole")
    assert "identified from the beginning" in text
    assert re.search(r"\d+ of \d+ draws gave the same order\. Orders: 4 in", text)


@pytest.mark.slow
def test_wrong_deviations_are_said(result):
    """Of a result whose deviations were spoilt, the command says so; that is no failure of the command."""
    import h5py

    with h5py.File(result / "result.h5", "r+") as file:
        file["model/covariance"][...] *= 25.0
    text = typed(f"bootstrap kept {COMMON}")
    assert "are wrong for exponents" in re.sub(r"\s+", " ", text)
    assert strict_json(typed(f"bootstrap kept {COMMON} --format json"))["holds"] is False


@pytest.mark.slow
def test_a_result_without_deviations(here):
    typed(f"identify good.npz --period {PERIOD} --identifier era --order 4 --harmonics 2 --out kept")
    text = typed(f"bootstrap kept {COMMON}")
    assert "no asymptotic deviations" in re.sub(r"\s+", " ", text)
    assert "Ratio over all elements" not in text
    content = strict_json(typed(f"bootstrap kept {COMMON} --format json"))
    assert content["holds"] is content["quantities"]["exponents"]["ratio"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("bootstrap", "requires an argument"),
        ("bootstrap none.h5", "none.h5"),
        ("bootstrap good.npz", "good.npz is no HDF5 file"),
        ("bootstrap out", "is damaged or not whole"),
        ("bootstrap kept --draws 19", "`--draws` must be at least 20, but is 19"),
        ("bootstrap kept --draws 20.5", "is not a whole number"),
        ("bootstrap kept --seed -1", "`--seed` must be at least 0"),
        ("bootstrap kept --workers 0", "`--workers` must be at least 1"),
        ("bootstrap kept --out good.npz", "`--out` must be a folder"),
        ("bootstrap kept --out blocked", "bootstrap.json is a folder"),
    ],
)
def test_bad_input_is_one_message(here, words, message):
    (here / "blocked" / "bootstrap.json").mkdir(parents=True)
    before = contents(here)
    assert typed(words, code=2, message=message) == ""
    assert contents(here) == before
    assert {name: before[f"out/{name}"] for name in EARLIER} == EARLIER


@pytest.mark.slow
def test_a_result_of_records_as_sampled_has_what_is_needed(here):
    record = np.load(here / "good.npz")["values"].copy()
    record[:, 40:44] = np.nan
    save_npz("gaps.npz", record)
    typed(f"identify gaps.npz --period {PERIOD} --channels X,Y --out kept")
    assert "The asymptotic deviations" in typed(f"bootstrap kept {COMMON}")
