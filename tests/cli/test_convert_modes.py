"""`floquid convert` of a result: its modes for other programs."""

import json

import pytest
import pyuff
from tests.cli.conftest import contents, simulated

from floquid.cli._app import run
from floquid.exports import MODE_FORMATS, summary
from floquid.pipeline import identify
from floquid.store import save


@pytest.fixture(scope="module")
def analysis():
    return identify(simulated(), validate=False)


@pytest.fixture
def result(analysis, here):
    save(analysis, here / "out" / "result.h5")
    return here


@pytest.mark.parametrize("suffix", MODE_FORMATS)
@pytest.mark.parametrize("source", ["out/result.h5", "out"], ids=["file", "folder"])
def test_each_format_is_written_and_nothing_else(result, capsys, source, suffix):
    before = contents(result)
    assert run(["convert", source, f"modes{suffix}"]) == 0
    assert f"Written to modes{suffix}: 2 modes, of 3 harmonics." in capsys.readouterr().out
    after = contents(result)
    assert after.pop(f"modes{suffix}")
    assert after == before


def test_the_numbers_are_those_of_the_result(result, analysis):
    assert run(["convert", "out/result.h5", "modes.json"]) == 0
    assert json.loads((result / "modes.json").read_text("utf-8")) == summary(analysis)
    assert run(["convert", "out/result.h5", "modes.uff"]) == 0
    shapes = pyuff.UFF("modes.uff").read_sets()[2:]
    assert complex(shapes[0]["id2"].split("=")[1].split()[0]) == analysis.model.exponents[0]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["out/result.h5", "modes.npz"], "`OUT` must have a suffix that modes can be written to"),
        (["out/result.h5", "modes"], "Use one of .uff, .unv, .mat, .csv, .json."),
        (["out/result.h5", "out/result.h5"], "must be another file"),
        (["out/result.h5", "modes.uff", "--rate", "3"], "`--rate` must come with a record"),
        (["out/result.h5", "modes.uff", "--origin", "3"], "`--origin` must come with a record"),
        (["out/result.h5", "none/modes.uff"], "`OUT` must be a path that can be written"),
        (["out/figures", "modes.uff"], "there is no file"),
    ],
)
def test_what_cannot_be_ends_in_words_and_writes_nothing(result, capsys, words, said):
    before = contents(result)
    assert run(["convert", *words]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert said in message
    assert "Traceback" not in message
    assert contents(result) == before


def test_a_damaged_result_is_refused(result, capsys):
    whole = (result / "out" / "result.h5").read_bytes()
    (result / "cut.h5").write_bytes(whole[: len(whole) // 2])
    assert run(["convert", "cut.h5", "modes.uff"]) == 2
    assert "cut.h5" in capsys.readouterr().err
    assert not (result / "modes.uff").exists()
