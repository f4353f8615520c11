"""`floquid report`: the page again, from a saved result, and the page in the folder of a result."""

from dataclasses import replace

import pytest

import floquid as fq
from floquid.cli import run
from floquid.errors import InputError
from floquid.findings import note

pytestmark = pytest.mark.pages


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A result as `floquid identify --out` writes it, of a short record, but for its figures."""
    place = tmp_path_factory.mktemp("results")
    record = fq.systems.JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=2).select(["X", "Y"])
    fq.write(record, place / "run.npz")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("floquid.plot.save_figures", lambda *_, **__: [])
        words = ["--period", str(record.clock.period), "--out", str(place / "out")]
        assert run(["identify", str(place / "run.npz"), *words]) == 0
    return place / "out"


def test_identify_writes_the_page_beside_the_result(folder):
    assert "The model passes its checks." in (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture
def no_figures(monkeypatch):
    """A page of words alone: drawing takes most of its time, and the fixture of the module draws one."""
    monkeypatch.setattr("floquid.reporting._page.decay_part", lambda _: ({}, {}))


def test_from_the_folder(folder, no_figures, capsys):
    (folder / "report.html").unlink()
    assert run(["report", str(folder)]) == 0
    assert (folder / "report.html").exists()
    assert f"Written: {folder / 'report.html'}" in capsys.readouterr().out


def test_elsewhere_with_a_title(folder, no_figures, tmp_path):
    page = tmp_path / "page.html"
    assert run(["report", str(folder / "result.h5"), "--out", str(page), "--title", "Run <7>"]) == 0
    assert "<h1>Run &lt;7&gt;</h1>" in page.read_text(encoding="utf-8")


def test_a_brief_with_the_speed_in_rpm(folder, no_figures, tmp_path, capsys):
    assert run(["report", str(folder), "--brief", "--speed-unit", "rpm"]) == 0
    assert f"Written: {folder / 'brief.html'}" in capsys.readouterr().out
    words = (folder / "brief.html").read_text(encoding="utf-8")
    assert "shaft at 9.5493 rpm" in words
    assert "<script" not in words
    for part in ("f [Hz]", "The model passes its checks.", "data:image/png", "<code>period</code> 6.28"):
        assert part in words
    analysis = fq.load(folder / "result.h5")
    assert "shaft at 9.5493 rpm" in analysis.summary(speed_unit="rpm")
    assert "0.159155 Hz" in analysis.summary()
    turning = replace(analysis, settings=replace(analysis.settings, periods_per_revolution=2.0))
    assert "shaft at 4.77465 rpm, 2 periods a revolution" in turning.summary(speed_unit="rpm")
    said = replace(analysis, findings=(note("speed_constant", hz=2.5),))
    assert "The speed is constant at 150 rpm," in said.summary(speed_unit="rpm")
    page = fq.report(said, tmp_path / "rpm.html", speed_unit="rpm").read_text(encoding="utf-8")
    assert "The speed is constant at 150 rpm," in page
    with pytest.raises(InputError, match="`speed_unit` of `summary`"):
        analysis.summary(speed_unit="kmh")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["no-such-folder"], "there is no file no-such-folder"),
        (["{folder}/summary.json"], "must be a result file that `save` wrote"),
        (["{folder}", "--out", "page.pdf"], "must end in .html"),
        (["{folder}", "--out", "no/such/folder/page.html"], "there is no folder"),
    ],
)
def test_bad_input_ends_in_a_message(folder, words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["report", *(word.format(folder=folder) for word in words)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert message in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []
