"""`floquid multisine`, and `floquid transfer` line by line: from a design to transfer functions."""

import contextlib
import io
import json

import numpy as np
import pytest
from tests.driven import lag, mathieu, record_of
from tests.unit.transfer.test_chirps import QUARTERS, chirped, records_of
from tests.unit.transfer.test_fit import of_equations
from tests.unit.transfer.test_polynomials import looped
from tests.unit.views.test_three_phase import PERIOD as GRID
from tests.unit.views.test_three_phase import exactly, response

from floquid import Channel, Record, identify, load, read, save
from floquid.cli import run
from floquid.exports import export_transfer
from floquid.readers import write
from floquid.reporting import _report

PERIOD = f"{np.pi:.15g}"
RATE = f"{20.0 / np.pi:.15g}"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The response to a multisine that the command made."""
    folder = tmp_path_factory.mktemp("multisine")
    played = folder / "played.csv"
    words = ["multisine", "--period", PERIOD, "--rate", RATE, "--turns", "32", "--band", "0.05,1", "--inputs", "F"]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert run([*words, "--repeats", "5", "--out", str(played)]) == 0
    assert "F: 13 lines from" in out.getvalue()
    assert [own.quantity for own in read(played).channels] == ["other"]
    inputs = read(played).values
    assert inputs.shape == (1, 5 * 32 * 20)
    assert inputs[:, : 32 * 20] == pytest.approx(inputs[:, 32 * 20 : 64 * 20], abs=1e-9)
    values, _ = record_of(mathieu(), None, 20, 0.01, 0, inputs)
    channels = [Channel(name="x", unit="m"), Channel(name="F", unit="N")]
    path = folder / "answered.csv"
    write(Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=channels), path)
    return path


def test_from_a_design_to_transfer_functions(file, tmp_path, capsys):
    command = ["transfer", str(file), "--period", PERIOD, "--inputs", "F", "--method", "repeats", "--drop", "2"]
    assert run([*command, "--repeat", "32"]) == 0
    named = capsys.readouterr()
    assert run(command) == 0
    captured = capsys.readouterr()
    assert named.out == captured.out
    assert "F to x [m/N]" in captured.out
    assert "3 repeats of 32 periods" in captured.out
    assert "G of samples every" in captured.out
    assert "Warning" not in captured.out
    assert run([*command, "--harmonics", "0,1", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    values = np.array(found["values"])[:, 0, 0] @ [1.0, 1j]
    truth = mathieu().sampled_transfer(found["frequencies_hz"], [0, 1], 20)[:, 0, 0]
    assert values == pytest.approx(truth, abs=0.02 * np.abs(truth).max())
    assert found["method"] == "repeats"
    assert found["step"] == pytest.approx(np.pi / 20)
    assert min(map(min, found["coherence"])) > 0.5
    for name in ("g.csv", "g.png"):
        assert run([*command, "--out", str(tmp_path / name)]) == 0
    table = np.genfromtxt(tmp_path / "g.csv", delimiter=",", skip_header=1)
    assert table.shape == (13, 1 + 4 * 3)
    assert (tmp_path / "g.png").stat().st_size > 1000


def shaken(path, periods):
    """A record of a random force."""
    values, inputs = record_of(mathieu(), periods, 20, 0.02, 0)
    write(Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=["x", "F"]), path)
    return ["transfer", str(path), "--period", PERIOD, "--inputs", "F", "--method"]


def test_polynomials_at_frequencies_that_are_named(file, tmp_path, capsys):
    command = [*shaken(tmp_path / "shaken.csv", 60), "polynomials", "--at", "0.1,0.2"]
    assert run([*command, "--harmonics", "-1,0", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["frequencies_hz"]) == 2
    assert found["harmonics"] == [-1, 0]
    assert run([command[0], str(file), *command[2:]]) == 1
    assert "use its lines (`--method repeats`)" in capsys.readouterr().err


def test_a_loop_with_its_command_as_reference(tmp_path, capsys):
    path = tmp_path / "loop.csv"
    write(looped(mathieu(damping=0.2), 20, 200, 0.3, 0.1, 0.0, 0), path)
    command = ["transfer", str(path), "--period", PERIOD, "--inputs", "F", "--reference", "r", "--at", "0.1,0.2"]
    assert run([*command, "--method", "polynomials"]) == 0
    said = capsys.readouterr().out
    assert "F to y" in said
    assert "F to r" not in said
    # The reference is no output that is asked for, and is read beside those.
    assert run([*command, "--method", "polynomials", "--channels", "y"]) == 0
    assert capsys.readouterr().out == said
    assert run(command) == 2
    assert "--reference" in capsys.readouterr().err
    command = [word if word != "r" else "q" for word in command]
    for more in ([], ["--channels", "y"]):
        assert run([*command, "--method", "polynomials", *more]) == 2
        assert "`--reference` must name channels of the record, but has 'q'.\n" in capsys.readouterr().err


def test_chirps_in_a_file_each(tmp_path, capsys):
    samples = chirped(mathieu(damping=0.2), 16, 60, QUARTERS)
    files = [str(tmp_path / f"chirp{number}.csv") for number in range(4)]
    for own, path in zip(records_of(samples), files, strict=True):
        write(own, path)
    command = ["transfer", *files, "--period", PERIOD, "--inputs", "F", "--method", "chirps", "--at", "0.2,0.5"]
    assert run([*command, "--out", str(tmp_path / "g.h5")]) == 0
    assert "F to y" in capsys.readouterr().out
    truth = mathieu(damping=0.2).sampled_transfer(load(tmp_path / "g.h5").transfer.frequencies_hz, [-1, 0, 1], 16)
    assert load(tmp_path / "g.h5").transfer.values == pytest.approx(truth, abs=0.02 * np.abs(truth).max())
    assert run([*command, "--curvature", "1e6", "--format", "json"]) == 0
    flat = np.array(json.loads(capsys.readouterr().out)["values"]) @ [1.0, 1j]
    assert np.abs(flat - truth).max() > 0.1 * np.abs(truth).max()
    assert run([*command, "--curvature", "0"]) == 2
    assert "`--curvature` must" in capsys.readouterr().err
    assert run([command[0], *files[:2], *command[5:]]) == 1
    assert "do not part 3 transfer functions" in capsys.readouterr().err


@pytest.mark.slow
def test_modes_fitted_to_the_lines(file, capsys):
    command = ["transfer", str(file), "--period", PERIOD, "--inputs", "F", "--method", "fit", "--at", "0.1,0.2"]
    assert run(command) == 0
    said = capsys.readouterr().out
    assert "λ = -0.07" in said
    assert "Modes fitted to the lines: 1." in said
    assert run([*command, "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["exponents"][0][0] == pytest.approx(-0.05 * 2**0.5, abs=5 * found["exponents_std"][0][0])
    assert found["frequencies_hz"] == [0.1, 0.2]
    assert found["step"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "lines"], "--method"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "repeats", "--at", "1"], "--at"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "repeats", "--drop", "-1"], "--drop"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "repeats", "--out", "g.html"], "--out"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--harmonics", "-1,half"], "be whole numbers"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "repeats", "--repeat", "1"], "--repeat"),
        (
            ["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "polynomials", "--repeat", "8"],
            "--repeat",
        ),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--repeat", "8"], "--repeat"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--curvature", "1e-3"], "--curvature"),
        (
            ["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--method", "fit", "--curvature", "1"],
            "--curvature",
        ),
        (["multisine", "--rate", "20"], "--period"),
        (["multisine", "--period", "1"], "--rate"),
        (["multisine", "--period", "1", "--rate", "20", "--band", "low"], "--band"),
        (["multisine", "--period", "1", "--rate", "20", "--inputs", ","], "--inputs"),
        (["multisine", "--period", "1", "--rate", "20.01"], "--rate"),
        (["multisine", "--period", "1", "--rate", "20", "--repeats", "0"], "--repeats"),
        (["multisine", "--period", "1", "--rate", "20", "--seed", "-1"], "`--seed` must"),
        (["transfer", "FILE", "--period", PERIOD, "--inputs", "F", "--out", "g.xyz"], "`--out` must end in .csv"),
    ],
)
def test_slips_are_usage(file, words, message, capsys):
    assert run([str(file) if word == "FILE" else word for word in words]) == 2
    assert message in capsys.readouterr().err


def test_a_design_tells_its_unit_and_where_the_band_ends(tmp_path, capsys):
    words = ["multisine", "--period", "1", "--rate", "20", "--turns", "16", "--out", str(tmp_path / "u.csv")]
    assert run([*words, "--band", "1,9", "--unit", "N"]) == 0
    assert "half the rate" not in capsys.readouterr().out
    assert [(own.quantity, own.unit) for own in read(tmp_path / "u.csv").channels] == [("force", "N")]
    assert run([*words, "--band", "1,30"]) == 0
    assert "no lines beyond half the rate, 10 Hz: the band ends there" in capsys.readouterr().out


def test_inputs_that_do_not_repeat_are_told(tmp_path, capsys):
    assert run([*shaken(tmp_path / "shaken.csv", 30), "repeats"]) == 1
    said = capsys.readouterr().err
    assert "do not repeat" in said
    assert "(`--repeat`)" in said
    assert "(`--method`)" in said


def test_modes_whose_decay_lines_do_not_tell_end_with_one(tmp_path, capsys):
    hertz = np.linspace(0.05, 0.8, 20)
    export_transfer(
        of_equations(mathieu(damping=1e-4), hertz, noise=0.1, harmonics=np.arange(-1, 2)), tmp_path / "g.csv"
    )
    command = ["transfer", "--lines", str(tmp_path / "g.csv"), "--method", "fit", "--period", PERIOD]
    for more in ([], ["--format", "json"]):
        assert run([*command, *more]) == 1
        said = capsys.readouterr()
        assert "The decay is not determined: mode" in said.err
        if "json" in more:
            found = json.loads(said.out)
            assert "The decay is not determined: mode" in found["warnings"][0]
            assert {"failure"} <= {own["severity"] for own in found["findings"]}


@pytest.mark.pages
def test_the_page_says_that_modes_are_not_determined(tmp_path, capsys):
    lines, page, hertz = tmp_path / "g.csv", tmp_path / "g.html", np.linspace(0.05, 0.8, 30)
    export_transfer(of_equations(mathieu(damping=1e-4), hertz, noise=0.1, harmonics=np.arange(-1, 2)), lines)
    assert run(["transfer", "--lines", str(lines), "--method", "fit", "--period", PERIOD, "--out", str(page)]) == 1
    assert "The decay is not determined: mode" in capsys.readouterr().err
    assert "The modes explain the lines." not in page.read_text(encoding="utf-8")


def test_lines_of_a_file_are_fitted(tmp_path, capsys, monkeypatch):
    lines = of_equations(lag(), np.linspace(0.02, 0.4, 20), harmonics=np.arange(-1, 2))
    export_transfer(lines, tmp_path / "g.csv")
    command = ["transfer", "--lines", str(tmp_path / "g.csv"), "--method", "fit", "--at", "0.1"]
    assert run([*command, "--period", PERIOD, "--out", str(tmp_path / "g.h5"), "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["exponents"][0][0] == pytest.approx(-0.5, abs=5 * found["exponents_std"][0][0])
    assert load(tmp_path / "g.h5").model.real.tolist() == [True]
    pages = []
    drawn = {**_report.PAGES, "fitted": lambda fit, **options: pages.append(fit) or "<p>a page of lines</p>"}
    monkeypatch.setattr(_report, "PAGES", drawn)
    assert run(["report", str(tmp_path / "g.h5")]) == 0
    assert pages[0].model.real.tolist() == [True]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "<p>a page of lines</p>"
    capsys.readouterr()
    for words, said in (
        (command, "The period must be given, but is not, and the lines have none.\n  Pass `--period`"),
        ([*command, "run.csv"], "--lines"),
        ([*command[:3], "--period", PERIOD], "--lines"),
        (["transfer", "--lines", str(tmp_path / "g.h5"), "--method", "fit"], "measured"),
        (["bootstrap", str(tmp_path / "g.h5")], "RESULT"),
        (["convert", str(tmp_path / "g.h5"), str(tmp_path / "m.mat")], "RESULT"),
    ):
        assert run(words) == 2
        assert said in capsys.readouterr().err


@pytest.fixture(scope="module")
def converter(tmp_path_factory):
    """The folder of an identification of a converter on the grid: two currents by two voltages, injected."""
    generator = np.random.default_rng(0)
    injected = generator.standard_normal((2, 40 * 40))
    values = response(injected, 40) + 1e-5 * generator.standard_normal((3, 40 * 40))
    units = {"i_a": "A", "i_b": "A", "v_dc": "V", "u_a": "V", "u_b": "V"}
    channels = [Channel(name=name, unit=unit) for name, unit in units.items()]
    record = Record(values=np.concatenate([values, injected]), sample_rate=40 / GRID, channels=channels)
    folder = tmp_path_factory.mktemp("converter")
    save(identify(record, period=GRID, inputs=["u_a", "u_b"], validate=False), folder / "result.h5")
    return folder


PHASES = ["--phases", "i_a,i_b", "--phases", "u_a,u_b"]


def entries(words, capsys):
    assert run([*words, "--at", "20,200", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    return [own["name"] for own in found["outputs"]], np.array(found["values"]) @ [1, 1j]


def test_a_saved_result_in_dq_and_its_impedance(converter, capsys):
    command = ["transfer", str(converter), "--harmonics", "0", "--frame", "dq", *PHASES]
    names, values = entries(command, capsys)
    assert names == ["i_d", "i_q", "v_dc"]
    admittance = np.moveaxis(values[0, :2], 2, 0)
    np.testing.assert_allclose(admittance, exactly(np.array([20.0, 200.0])), atol=2e-3 * np.abs(admittance).max())
    names, values = entries([*command, "--impedance"], capsys)
    assert names == ["u_d", "u_q"]
    np.testing.assert_allclose(np.moveaxis(values[0], 2, 0), np.linalg.inv(admittance), rtol=1e-9)


def test_an_impedance_takes_sidebands_in_and_then_the_frame(converter, capsys):
    command = ["transfer", str(converter), "--harmonics", "0", "--impedance", *PHASES]
    names, _ = entries([*command, "--frame", "sequence"], capsys)
    assert names == ["u_positive", "u_negative"]
    # In αβ a positive sequence at Ω + ω is what turns at Ω in dq.
    assert run([*command, "--frame", "sequence", "--at", "70", "--format", "json"]) == 0
    positive = (np.array(json.loads(capsys.readouterr().out)["values"]) @ [1, 1j])[0, 0, 0, 0]
    Z = np.linalg.inv(exactly(np.array([20.0])))[0]
    both = np.array([[1.0, 1j], [1.0, -1j]])
    assert positive == pytest.approx((both @ Z @ np.linalg.inv(both))[0, 0], rel=5e-3)


@pytest.mark.slow
def test_every_path_is_drawn_with_logarithmic_axes_or_in_the_complex_plane(converter, capsys):
    for more in (["--frequency-axis", "log"], ["--plot", "nyquist"]):
        picture = converter / f"{more[1]}.svg"
        assert run(["transfer", str(converter), "--at", "20:400:9", *more, "--out", str(picture)]) == 0
        text = picture.read_text("utf-8")
        assert all(f"u_{column} to {row}" in text for column in "ab" for row in ("i_a", "i_b", "v_dc"))
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--frame", "dq"], "`--phases` must name the channels for --frame dq"),
        (["--frame", "dq", "--phases", "i_a,nobody"], "`--phases` must name channels"),
        (["--frame", "dq", "--phases", "i_a,u_b"], "`--phases` must be all outputs or all inputs"),
        (["--frame", "alpha-beta", "--phases", "i_a,i_b"], "`--phases` must each name three phases"),
        (["--impedance", "--phases", "i_a,i_b"], "`--phases` must come twice with --impedance"),
        (["--impedance"], "be as many as the voltages"),
    ],
)
def test_frames_that_cannot_be(converter, words, message, capsys):
    assert run(["transfer", str(converter), *words]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
