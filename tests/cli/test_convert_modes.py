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
    return identify(simulated(), constrained=False, validate=False)


@pytest.fixture(scope="module")
def content(analysis, tmp_path_factory):
    """The bytes of its file."""
    path = tmp_path_factory.mktemp("saved") / "result.h5"
    save(analysis, path)
    return path.read_bytes()


@pytest.fixture
def result(content, here):
    (here / "out" / "result.h5").write_bytes(content)
    return here


@pytest.mark.parametrize("suffix", MODE_FORMATS)
def test_each_format_is_written_and_nothing_else(result, capsys, suffix):
    before = contents(result)
    for source in ("out/result.h5", "out"):
        assert run(["convert", source, f"modes{suffix}"]) == 0
        assert f"Written to modes{suffix}: 2 modes, of 3 harmonics." in capsys.readouterr().out, source
        after = contents(result)
        assert after.pop(f"modes{suffix}"), source
        assert after == before, source
        (result / f"modes{suffix}").unlink()


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
        (["out/result.h5", "modes"], "Use one of .uff, .unv, .mat, .csv, .json, .tex, .md."),
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


def test_nodes_of_a_table_are_where_a_viewer_draws_them(result, capsys):
    (result / "nodes.csv").write_text("name,x,y,z\nmass,0,0,1.5\nturntable,0,0,0\n")
    assert run(["convert", "out", "modes.uff", "--coordinates", "nodes.csv"]) == 0
    nodes, lines = pyuff.UFF("modes.uff").read_sets()[1:3]
    assert dict(zip(nodes["node_nums"], nodes["z"], strict=True)) == {1.0: 1.5, 2.0: 0.0}
    assert (lines["type"], lines["nodes"].tolist()) == (82, [1, 2])
    (result / "nodes.csv").write_text("hub,0,0,1\n")
    assert run(["convert", "out", "again.uff", "--coordinates", "nodes.csv"]) == 2
    assert "`--coordinates` must be of locations of channels, but has 'hub'" in capsys.readouterr().err
    (result / "nodes.csv").write_text("mass,0,0,1\nturntable,0,0\n")
    assert run(["convert", "out", "again.uff", "--coordinates", "nodes.csv"]) == 2
    assert "must have rows of a name and three numbers" in " ".join(capsys.readouterr().err.split())
    assert not (result / "again.uff").exists()


def test_a_table_of_modes_for_a_paper_in_the_unit_asked_for(result):
    assert run(["convert", "out", "modes.md", "--damping-unit", "decrement"]) == 0
    head, _, first = (result / "modes.md").read_text("utf-8").splitlines()[:3]
    assert head.startswith("| mode | f [Hz] | δ | Re λ [1/s] |")
    ratio = 0.00270  # of the first mode of the rotor; δ = 2πζ/√(1 - ζ²)
    assert float(first.split("|")[3].split("(")[0]) == pytest.approx(2 * 3.14159 * ratio, rel=0.05)
