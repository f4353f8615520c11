"""`floquid identify --inputs` and `floquid transfer`: files, tables, and what a newcomer mistypes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from tests.driven import imbalance_of, mathieu, record_of

from floquid import Channel, Record, load
from floquid.cli import run
from floquid.cli.output.printed import print_analysis
from floquid.preparation import FORBIDDEN
from floquid.readers import write

PERIOD = f"{np.pi:.15g}"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    values, inputs = record_of(mathieu(), 25, 20, 0.02, 0)
    channels = [Channel(name="x", unit="m"), Channel(name="F", unit="N")]
    path = tmp_path_factory.mktemp("file") / "shaken.csv"
    write(Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=channels), path)
    return path


def test_a_result_is_printed_and_written(file, tmp_path, capsys, monkeypatch):
    out = tmp_path / "result"
    assert run(["identify", str(file), "--period", PERIOD, "--inputs", "F", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Modes: order 2" in said
    assert "Input F, held between samples." in said
    assert "passes" in said
    assert sorted(p.name for p in out.iterdir() if not p.name.startswith(".")) == [
        "report.html",
        "result.h5",
        "settings.toml",
        "summary.json",
        "transfer.csv",
    ]
    assert load(out / "result.h5").inputs[0].name == "F"
    found = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert found["order"] == 2
    assert found["inputs"]["channels"] == [{"name": "F", "unit": "N"}]
    table = np.genfromtxt(out / "transfer.csv", delimiter=",", skip_header=1)
    assert table.shape[1] == 1 + 4 * 5
    again = ["identify", str(file), "--settings", str(out / "settings.toml"), "--format", "json"]
    assert run(again) == 0
    assert json.loads(capsys.readouterr().out)["modes"] == found["modes"]
    kept = load(out / "result.h5")
    monkeypatch.setattr("floquid.cli.commands.identify.identify_records", lambda *_, **__: kept)
    assert run([*again, "--enforce"]) == 0
    monkeypatch.setattr(type(kept), "passed", False)
    assert run(again) == 0
    assert run([*again, "--enforce"]) == 3
    assert "does not pass its checks" in capsys.readouterr().err


def test_the_state_matrix_is_printed_saved_and_exported(file, tmp_path, capsys, monkeypatch):
    out = tmp_path / "result"
    words = ["identify", str(file), "--period", PERIOD, "--inputs", "F", "--states", "x", "--system-times", "8"]
    assert run([*words, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "A(t) [1/s², 1/s]: smallest" in said
    assert "F [m/N · 1/s²]" in said[said.index("B(t): smallest") :]
    assert "Deviation: the largest standard deviation" in said
    found = json.loads((out / "summary.json").read_text(encoding="utf-8"))["system"]
    assert found["states"] == ["x", "d/dt x"]
    times = np.array(found["times"])
    for name, std, truth in (
        ("values", "std", np.array([[-(2.0 - np.cos(2.0 * t)), -0.1 * np.sqrt(2.0)] for t in times])),
        ("inputs", "inputs_std", np.ones((8, 1))),
    ):
        pulls = (np.array(found[name])[:, 1] - truth) / np.array(found[std])[:, 1]
        assert 0.1 < np.abs(pulls).max() < 4.0
    kept = load(out / "result.h5")
    assert np.array_equal(kept.state.inputs, found["inputs"])
    assert np.array(found["outputs"])[:, 0] == pytest.approx(np.tile([1.0, 0.0], (8, 1)), abs=1e-9)
    assert np.shape(found["direct"]) == (8, 1, 1)
    assert run(["convert", str(out), str(tmp_path / "modes.mat")]) == 0
    table = loadmat(tmp_path / "modes.mat")
    assert np.array_equal(np.moveaxis(table["B_std"], 2, 0), found["inputs_std"])
    assert table["Phi"].shape == (2, 2, 8)
    # Nothing is said of deviations where the tables are too wide for the terminal.
    monkeypatch.setenv("COLUMNS", "20")
    print_analysis(kept)
    said = capsys.readouterr().out
    assert "too wide" in " ".join(said.split())
    assert "Deviation: the largest" not in " ".join(said.split())
    monkeypatch.setenv("COLUMNS", "80")
    # A model that fails has no deviations.
    print_analysis(replace(kept, state=kept.state.without_deviations()))
    said = capsys.readouterr().out
    assert "B(t): smallest" in said
    assert "deviation" not in said[said.index("A(t)") :].lower()


def test_states_that_are_too_few_lose_no_search(file, capsys):
    words = ["identify", str(file), "--period", PERIOD, "--inputs", "F", "--states", "x", "--form", "first-order"]
    assert run(words) == 1
    printed = capsys.readouterr()
    said = " ".join(printed.out.split())
    assert "A(t) was not rebuilt:" in printed.err
    assert "must name 2 channels" in said
    assert "Verdict passes" in said
    assert "A(t) [" not in said


@pytest.mark.slow
def test_lines_of_a_revolution_of_two_periods(tmp_path, capsys):
    values, inputs = record_of(mathieu(), 100, 20, 0.02, 0)
    values += 20.0 * values.std() * imbalance_of(mathieu(), 100, 20)
    path = tmp_path / "unbalanced.csv"
    write(Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=["x", "F"]), path)
    words = ["identify", str(path), "--period", PERIOD, "--inputs", "F", "--no-validate"]
    assert run(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Modes: order 2" in said
    assert "say so: `--periods-per-rev 2`" in said
    assert run([*words, "--periods-per-rev", "2"]) == 0
    said = capsys.readouterr().out
    assert "Modes: order 2" in said
    assert "Warning" not in said


@pytest.mark.slow
def test_a_model_that_was_found_to_be_wrong_is_exit_code_one(tmp_path, capsys):
    """The force is measured with noise; the result is printed all the same."""
    values, inputs = record_of(mathieu(), 40, 20, 0.02, 0)
    inputs += 0.03 * np.random.default_rng(1).standard_normal(inputs.shape)
    path = tmp_path / "noisy.csv"
    write(Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=["x", "F"]), path)
    assert run(["identify", str(path), "--period", PERIOD, "--inputs", "F", "--no-validate"]) == 1
    both = capsys.readouterr()
    assert "Modes of a model that fails: order" in both.out
    assert "noise on the measured inputs" in both.err


def test_transfer_functions_as_text_json_table_and_picture(file, tmp_path, capsys):
    command = ["transfer", str(file), "--period", PERIOD, "--inputs", "F", "--at", "0.1,0.2"]
    assert run(command) == 0
    said = capsys.readouterr().out
    assert "F to x [m/N]" in said
    assert "m = -1" in said
    assert run([*command, "--harmonics", "0", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["frequencies_hz"] == [0.1, 0.2]
    assert np.array(found["values"]).shape == (1, 1, 1, 2, 2)
    truth = mathieu().transfer([0.1, 0.2], [0])
    value = np.array(found["values"])[0, 0, 0] @ [1.0, 1j]
    assert value == pytest.approx(truth[0, 0, 0], rel=0.02)
    for name in ("g.csv", "g.mat", "g.png"):
        assert run([*command, "--out", str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 100
    assert run([*command, "--out", str(tmp_path / "g.s1p")]) == 2
    assert "--harmonics 0" in capsys.readouterr().err
    assert run([*command, "--harmonics", "0", "--out", str(tmp_path / "g.s1p")]) == 0
    assert "# Hz Z RI R 1" in (tmp_path / "g.s1p").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["transfer", "FILE", "--period", PERIOD], "--inputs"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--at", "low"], "--at"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--harmonics", "half"], "--harmonics"),
        (["identify", "FILE", "--period", PERIOD, "--inputs", "G"], "--inputs"),
        (["identify", "FILE", "--period", PERIOD, "--inputs", "F", "--hold", "second"], "--hold"),
        (["identify", "FILE", "--period", PERIOD, "--inputs", "F", "--states", "z"], "`--states` must"),
        (
            ["identify", "FILE", "--period", PERIOD, "--inputs", "F", "--states", "x", "--structure", "6"],
            "`--structure`",
        ),
        (["identify", "FILE", "--period", PERIOD, "--excitation", "ambient", "--states", "z"], "`--states` must"),
    ],
)
def test_slips_are_usage(file, words, message, capsys):
    assert run([str(file) if word == "FILE" else word for word in words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--inputs", "F"], ["--excitation", "ambient"]])
def test_without_a_period_what_tells_it_is_named(file, words, capsys):
    assert run(["identify", str(file), *words]) == 2
    said = capsys.readouterr().err
    assert "--estimate-period" not in said
    assert "Use a tachometer (--tach), the shaft angle (--azimuth), or 60 over the speed in rpm." in said


@pytest.mark.parametrize("words", [["--inputs", "F"], ["--excitation", "ambient"]])
def test_options_of_free_responses_are_refused_in_the_words_of_the_command(file, words, capsys):
    command = ["identify", str(file), "--period", PERIOD, *words]
    free = ["--no-constrained", "--identifier era", "--find-hits", "--estimate-period"]
    for own in free:
        assert run([*command, *own.split()]) == 2
        said = capsys.readouterr().err
        assert f"`{own.split()[0].replace('--no-', '--')}` must be left as it is" in said


def test_the_help_says_why_an_option_is_of_free_responses(capsys):
    assert run(["identify", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", "").split())
    forbidden = {name for reasons in FORBIDDEN.values() for name in reasons}
    assert said.count(" Not of free responses: ") + said.count(" Not where inputs are measured or of") + said.count(
        " Not of outputs alone: "
    ) == len(forbidden)


def test_transfer_functions_of_a_saved_result_are_those_of_its_records(file, tmp_path, capsys):
    told = ["--period", PERIOD, "--inputs", "F"]
    assert run(["identify", str(file), *told, "--out", str(tmp_path / "kept"), "--format", "json"]) == 0
    capsys.readouterr()
    said = []
    for words in ([str(file), *told], [str(tmp_path / "kept")], [str(tmp_path / "kept" / "result.h5")]):
        assert run(["transfer", *words, "--at", "0.1,0.2", "--format", "json"]) == 0
        said.append(json.loads(capsys.readouterr().out)["values"])
    assert said[1] == said[2]
    assert np.allclose(said[0], said[1], rtol=1e-9)
    for words, message in (
        (["--rate", "3"], "`--rate` must not be given beside a saved result"),
        (["--method", "repeats"], "`--method` must be model of a saved result"),
    ):
        assert run(["transfer", str(tmp_path / "kept"), *words]) == 2
        assert message in capsys.readouterr().err
    assert run(["scan", str(tmp_path / "kept")]) == 2
    assert "The result must be of free responses" in capsys.readouterr().err


def test_a_scan_is_of_free_responses(file, capsys):
    command = ["scan", str(file), "--period", PERIOD]
    for words in (["--inputs", "F"], ["--excitation", "ambient"]):
        assert run([*command, *words]) == 2
        assert f"`floquid identify {' '.join(words)}` finds" in capsys.readouterr().err
    assert run(["scan", "--help"]) == 0
    said = capsys.readouterr().out
    assert "--inputs" not in said
    assert "--excitation" not in said


def test_a_force_that_goes_on_names_the_way(file, capsys):
    assert run(["identify", str(file), "--period", PERIOD]) == 1
    assert "--inputs F" in capsys.readouterr().err


def test_channels_are_the_outputs_and_inputs_are_read_beside_them(file, capsys):
    words = ["identify", str(file), "--period", PERIOD, "--channels", "x", "--inputs", "F", "--format", "json"]
    assert run(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert [channel["name"] for channel in found["outputs"]] == ["x"]
    assert [channel["name"] for channel in found["inputs"]["channels"]] == ["F"]


def test_info_names_what_seems_to_drive_the_system(file, capsys):
    assert run(["info", str(file)]) == 0
    said = capsys.readouterr().out
    assert "Input candidate: F: its quantity is force (--inputs F)" in said
    assert f"floquid identify {file} --inputs F --period S\n  A forced response does not tell the period." in said
    assert run(["identify", str(file), "--period", PERIOD]) == 1
    assert "--inputs F" in capsys.readouterr().err


def test_candidates_for_inputs_by_name_and_by_unit(tmp_path, capsys):
    generator = np.random.default_rng(0)
    channels = [
        Channel(name="x", unit="m"), Channel(name="motor", unit="Nm"), Channel(name="shaker_command", unit="-"),
        Channel(name="hammer", unit="N"), Channel(name="azimuth", unit="deg"),
    ]  # fmt: skip
    values = generator.standard_normal((5, 400))
    values[3] = np.arange(400) == 40
    path = tmp_path / "run.csv"
    write(Record(values=values, sample_rate=20.0, channels=channels), path)
    assert run(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "motor: its unit is Nm, beside motions; shaker_command: its name has the word 'shaker' (" in said
    assert "(--inputs motor,shaker_command)" in said
    # After a blow the response is free.
    assert "hammer [N]: 1 impact. Use --find-hits." in said
    assert f"Next: floquid identify {path} --channels x,shaker_command --find-hits" in said


@pytest.mark.slow
def test_a_structure_is_printed_written_and_drawn_from(file, tmp_path, capsys):
    out = tmp_path / "result"
    words = ["identify", str(file), "--period", PERIOD, "--inputs", "F", "--states", "x", "--structure", "auto"]
    assert run([*words, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Structure found: symmetric stiffness with 1 harmonic; damping constant" in said
    assert "its 0 numbers" not in said
    assert "B(t): smallest" in said
    structure = json.loads((out / "summary.json").read_text(encoding="utf-8"))["system"]["structure"]
    assert structure is not None
    assert run(["bootstrap", str(out), "--draws", "20", "--workers", "1", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["holds"] is True
