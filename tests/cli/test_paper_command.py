"""`floquid demo --paper`: the table that it prints, the files that it writes, and what it refuses."""

import re
import shlex

import pytest
from tests.cli.conftest import EARLIER, contents, quicken
from tests.cli.test_commands import RESULT, strict_json, typed

import floquid
from floquid.cli import run

pytestmark = pytest.mark.pages

FIGURES = {f"figures/paper_{number}.png" for number in range(2, 9)}
SHORT = "demo jeffcott --paper --periods 60 --draws 2"


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """What a short run prints, and its folder: of pictures the paper's alone."""
    folder = tmp_path_factory.mktemp("paper")
    with pytest.MonkeyPatch.context() as patch:
        quicken(patch)
        patch.setenv("COLUMNS", "120")
        return typed(f"{SHORT} --out {folder / 'out'}"), folder / "out"


@pytest.mark.slow
def test_the_folder_holds_the_result_and_the_comparison(shown):
    _, folder = shown
    assert set(contents(folder)) == {*RESULT, "record.npz", "figures/system_elements.png", "paper.md", *FIGURES}
    for name in FIGURES:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_page_shows_every_figure_and_the_table(shown):
    text = (shown[1] / "paper.md").read_text(encoding="utf-8")
    assert set(re.findall(r"!\[.*?\]\((.*?)\)", text)) == FIGURES
    for number in range(2, 9):
        assert f"## Figure {number}: " in text
    assert "| AMI | maximum likelihood |" in text
    assert "| 0.1256637 |" in text


@pytest.mark.slow
def test_the_result_is_that_of_maximum_likelihood(shown):
    _, folder = shown
    analysis = floquid.load(folder / "result.h5")
    assert strict_json((folder / "summary.json").read_text()) == floquid.exports.summary(analysis)
    assert analysis.state is not None
    again = typed(f"identify {folder / 'record.npz'} --settings {folder / 'settings.toml'} --format json")
    assert again == (folder / "summary.json").read_text()


@pytest.mark.slow
def test_the_table_is_printed_whole(shown):
    text, folder = shown
    for words in (
        "Section 3 of the paper",
        "Section 3.1",
        "Section 3.2",
        "Section 3.3",
        "mean of 2 draws",
        "-0.002051",
    ):
        assert words in text
    lines = text.splitlines()
    assert max(len(line) for line in lines if str(folder) not in line) <= 120
    (row,) = [line for line in lines if line.startswith("sampling interval")]
    assert row.split()[-4:] == ["0.126", "0.1256637", "0.1256637", "0.1256637"]
    (row,) = [line for line in lines if line.startswith("upper edge of unstable band 3")]
    assert row.split()[-2:] == ["0.92", "0.9018"]
    # Each mark has its note, and each note its mark.
    marks = {int(mark) for line in lines if not line.startswith("[") for mark in re.findall(r"\[(\d+)\]", line)}
    notes = [int(line[1:].split("]")[0]) for line in lines if re.match(r"\[\d+\] ", line)]
    assert notes == sorted(marks) == list(range(1, len(notes) + 1))
    assert str(folder / "paper.md") in text


@pytest.mark.slow
def test_json_is_the_summary_alone_and_the_seed_counts(quick_pictures, here, monkeypatch):
    monkeypatch.setattr("floquid.cli._demo.save_figure", lambda figure, path: path.write_bytes(b""))
    text = typed("demo --paper --periods 150 --draws 1 --seed 3 --format json --out one")
    assert text == (here / "one" / "summary.json").read_text()
    assert typed("demo --periods 150 --seed 3 --format json --out two") == text
    assert "paper.md" not in contents(here / "two")


@pytest.mark.slow
def test_a_later_result_leaves_the_comparison_alone(here, shown, quick_pictures):
    """They may be the owner's own files of these names: nothing that this result does not hold is touched."""
    earlier = {name: data for name, data in contents(shown[1]).items() if "paper" in name}
    for name, data in earlier.items():
        (here / "out" / name).write_bytes(data)
    typed("identify good.npz --period 6.283185307179586 --out out")
    now = contents(here / "out")
    assert {name: now[name] for name in earlier} == earlier


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("--draws 0", 2, r"`--draws` must be at least 1, but is 0"),
        ("--draws 1.5", 2, r"1\.5"),
        ("--periods 2", 1, "holds 2 whole periods"),
        ("--periods 6 --noise 0.3", 1, "exponents were found|no mode"),
        ("--seed -1", 2, "`--seed` must be"),
    ],
)
def test_what_is_refused_touches_nothing(here, capsys, words, code, message):
    assert run(f"demo --paper {words} --out out".split()) == code
    assert re.search(message, capsys.readouterr().err)
    assert contents(here / "out") == {name: EARLIER[name] for name in EARLIER}


def test_a_folder_in_the_way_is_refused_before_any_work(here, capsys):
    (here / "out" / "paper.md").mkdir()
    assert run(f"{SHORT} --out out".split()) == 2
    assert "paper.md is a folder" in capsys.readouterr().err
    assert contents(here / "out") == EARLIER


@pytest.mark.slow
def test_a_figure_that_cannot_be_written_leaves_the_earlier_result(here, capsys, monkeypatch, quick_pictures):
    def fail(figure, path):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("floquid.cli._demo.save_figure", fail)
    assert run(shlex.split("demo --paper --periods 100 --draws 1 --out out")) == 2
    assert "No space left" in capsys.readouterr().err
    assert contents(here / "out") == EARLIER
