"""The commands that work: what they print, what they write, and that the one follows from the other."""

import contextlib
import inspect
import io
import json
import re
import shlex
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from tests.cli.conftest import EARLIER, ROTOR, ROTOR_PERIOD, after_stages, contents, quicken, save_npz, simulated

import floquid
from floquid.cli import run
from floquid.cli._app import COMMANDS as LISTED
from floquid.cli._app import app_of
from floquid.cli.arguments.options import Choices, FreeOptions, ModelOptions, RecordOptions, choices_of
from floquid.cli.output import printed, terminal
from floquid.findings import warning
from floquid.plot import FIGURES
from floquid.systems import JeffcottRotor
from floquid.views import MODE_NOTES

PERIOD = repr(2.0 * np.pi)
GOOD = f"identify good.npz --period {PERIOD}"
COMMANDS = ["bootstrap", "demo", "floquet", "identify", "info", "scan", "simulate"]
OF_SOME = {"system_elements", "speed", "transfer", "harmonic_spectra"}
RESULT = {"result.h5", "summary.json", "settings.toml", "report.html"}
DRAWN = {*RESULT, *(f"figures/{name}.png" for name in FIGURES if name not in OF_SOME)}


def typed(words, code=0, message=""):
    """What a command prints on stdout; it must print nothing on stderr but its stages and the message expected."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        ended = run(shlex.split(words) if isinstance(words, str) else words)
    assert ended == code, err.getvalue()
    said = after_stages(err.getvalue())
    assert message in said if message else said == ""
    return out.getvalue()


def strict_json(text):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def rows_of_modes(text):
    """The rows of the table of modes, as lists of words."""
    lines = text.split("Modes: order", 1)[1].splitlines()[2:]
    return [line.split() for line in lines if re.match(r"\s*\d+ +-?\d", line)]


@pytest.fixture(scope="module")
def rotor(tmp_path_factory):
    """The text printed for a hit of the README's example, and the folder with its result."""
    folder = tmp_path_factory.mktemp("rotor")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        quicken(patch)
        text = typed(["identify", ROTOR[0], "--period", ROTOR_PERIOD, "--verbose", "--out", str(folder / "out")])
    return text, folder / "out"


# The example of the README.


def test_the_rotor_prints_eight_pairs(rotor):
    text, folder = rotor
    rows, modes = rows_of_modes(text), strict_json((folder / "summary.json").read_text())["modes"]
    upper = [mode for mode in modes if mode["exponent"][1] > 0]
    assert [row[0] for row in rows] == list("12345678")
    assert len(upper) == 8
    assert "Modes: order 16, conjugates counted one by one" in text
    for row, mode in zip(rows, upper, strict=True):
        real, imag = (float(re.sub(r"\(\d+\)", "", word.lstrip("±"))) for word in row[3:5])
        assert real == pytest.approx(mode["exponent"][0], abs=mode["exponent_std"][0])
        assert imag == pytest.approx(mode["exponent"][1], abs=mode["exponent_std"][1])
        assert row[4].startswith("±")
        frequency, damping = (float(re.sub(r"\(\d+\)", "", word)) for word in row[1:3])
        assert frequency == pytest.approx(mode["frequency_hz"], abs=mode["frequency_std_hz"])
        assert damping == pytest.approx(100.0 * mode["damping_ratio"], abs=100.0 * mode["damping_ratio_std"])


def test_the_rotor_text_names_every_channel_and_unit(rotor):
    text, _ = rotor
    for words in ("1 record, 6 channels at 2533.3333 Hz", "40 samples a period", "disc tip x", "housing tilt about y"):
        assert words in text
    assert max(len(line) for line in text.splitlines() if not line.startswith("Written to")) <= 80


def test_the_rotor_result_is_whole(rotor):
    _, folder = rotor
    assert set(contents(folder)) == RESULT
    analysis = floquid.load(folder / "result.h5")
    summary = strict_json((folder / "summary.json").read_text())
    assert summary == floquid.exports.summary(analysis)


# summary.json.


def test_json_is_the_summary_alone(here, quick_pictures):
    text = typed(f"{GOOD} --states X,Y --format json --out new")
    assert text == (here / "new" / "summary.json").read_text()
    summary = strict_json(text)
    assert list(summary) == [
        "format", "excitation", "period", "period_std", "point", "misfit", "failed", "order", "order_choice",
        "n_cycles", "n_phases", "outputs", "noise", "noise_whitening", "modes", "inputs", "lengths", "periodicity",
        "forced", "interference", "synchronisation", "system", "validation", "warnings", "findings",
    ]  # fmt: skip
    assert summary["format"] == "floquid-summary/2"
    assert summary["period"] == pytest.approx(2.0 * np.pi, rel=1e-15)
    assert (summary["order"], summary["n_cycles"], summary["n_phases"]) == (4, 40, 8)
    assert summary["period_std"] is None
    assert summary["point"]["speed_rpm"] == pytest.approx(60.0 / summary["period"])
    assert summary["validation"]["passed"] is True
    assert summary["validation"]["fit"] > 0.95
    assert summary["validation"]["reasons"] == []
    assert all(isinstance(warning, str) for warning in summary["warnings"])


def test_json_has_every_exponent_with_its_conjugate(here):
    modes = strict_json(typed(f"{GOOD} --format json"))["modes"]
    assert len(modes) == 4
    for mode in modes:
        assert list(mode) == [
            "exponent", "exponent_std", "principal", "multiplier", "multiplier_std", "multiplier_interval",
            "frequency_hz", "frequency_std_hz",
            "damping_ratio", "damping_ratio_std", "harmonics", "participation",
        ]  # fmt: skip
        real, imag = mode["exponent"]
        assert [mode["exponent"][0], -imag] in [other["exponent"] for other in modes]
        assert mode["frequency_hz"] == pytest.approx(np.hypot(real, imag) / (2.0 * np.pi))
        assert mode["damping_ratio"] == pytest.approx(-real / np.hypot(real, imag))
        assert complex(*mode["multiplier"]) == pytest.approx(np.exp(complex(real, imag) * 2.0 * np.pi))
        assert abs(mode["principal"][1]) <= 0.5
        assert min(mode["exponent_std"]) > 0
        size = np.hypot(real, imag)
        slopes = np.array([real, imag]) / size
        assert mode["frequency_std_hz"] == pytest.approx(
            np.linalg.norm(slopes * mode["exponent_std"]) / (2.0 * np.pi), rel=0.05
        )
        assert mode["damping_ratio_std"] == pytest.approx(mode["exponent_std"][0] / size, rel=0.05)
        grown = abs(complex(*mode["multiplier"])) * 2.0 * np.pi
        assert np.linalg.norm(mode["multiplier_std"]) == pytest.approx(
            grown * np.linalg.norm(mode["exponent_std"]), rel=0.05
        )
        assert len(mode["participation"]) == len(mode["harmonics"])
        assert sum(mode["participation"]) == pytest.approx(1.0)


def test_json_system(here):
    assert strict_json(typed(f"{GOOD} --format json"))["system"] is None
    system = strict_json(typed(f"{GOOD} --states X,Y --format json"))["system"]
    assert list(system) == ["states", "coordinates", "times", "values", "std", "structure"]
    assert (system["coordinates"], system["structure"]) == ("second-order form from X, Y", None)
    assert system["states"] == ["X", "Y", "d/dt X", "d/dt Y"]
    times, values = np.array(system["times"]), np.array(system["values"])
    assert values.shape == (len(times), 4, 4)
    np.testing.assert_allclose(values[:, :2, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(values[:, :2, 2:], np.broadcast_to(np.eye(2), (len(times), 2, 2)), atol=1e-9)
    std = np.array(system["std"])
    assert std.shape == values.shape
    assert (std[:, :2] == 0.0).all()
    assert (std[:, 2:] > 0.0).all()
    truth = JeffcottRotor().system(times)
    assert (np.abs(values - truth)[:, 2:] < 5.0 * std[:, 2:]).all()


# The folder.


def test_out_holds_the_result_and_nothing_else(here, quick_pictures):
    typed(f"{GOOD} --states X,Y --out new/deeper --figures")
    assert set(contents(here / "new")) == {f"deeper/{name}" for name in (*DRAWN, "figures/system_elements.png")}


@pytest.mark.pages
def test_pictures_and_the_page_are_drawn(here, monkeypatch):
    """Some of the figures: `tests/unit/plot` draws each, and `make slow` the README's."""
    some = ["exponents", "spectra", "time_record"]
    monkeypatch.setattr("floquid._show.Figures.__dir__", lambda self: some)
    typed(f"{GOOD} --out new --figures")
    found = contents(here / "new")
    assert len([name for name in found if name.endswith(".png")]) > 2
    assert all(data.startswith(b"\x89PNG") for name, data in found.items() if name.endswith(".png"))
    assert found["report.html"].lower().startswith(b"<!doctype html>")


def test_figures_without_a_folder_are_refused(here):
    assert typed(f"{GOOD} --figures", 2, "Add `--out DIR`.") == ""


def test_a_new_result_takes_the_place_of_the_old_one_and_of_its_figures(here, quick_pictures):
    typed(f"{GOOD} --out out")
    now = contents(here / "out")
    assert set(now) == {*RESULT, "notes.txt", "record.npz"}  # no picture of an A(t) that is not in this result
    for name in ("notes.txt", "record.npz"):  # not ours to touch
        assert now.pop(name) == EARLIER[name]
    assert not [name for name in now if now[name] == EARLIER.get(name)]
    assert floquid.load("out/result.h5").model.order == 4


def test_settings_are_read_back_as_they_were_written(tmp_path):
    written = Choices().with_given(period=2.0, rate=100.0, origin=0.25, identifier="ami", order=4, states=("X", "Y"))
    (tmp_path / "settings.toml").write_text(written.text(), encoding="utf-8")
    assert choices_of(tmp_path / "settings.toml") == written


@pytest.mark.slow
def test_settings_read_back_give_the_same_result(here, quick_pictures):
    save_npz("wrong.npz", sample_rate=1.0)
    words = "--channels Y,X,X_tt --states X,Y --harmonics 2 --order 4 --origin 0.25"
    typed(
        f"identify wrong.npz --frequency {1.0 / (2.0 * np.pi)!r} --rate {simulated().sample_rate!r} {words} --out one"
    )
    typed("identify wrong.npz --settings one/settings.toml --out two")
    one, two = contents(here / "one"), contents(here / "two")
    assert one["summary.json"] == two["summary.json"]
    assert one["settings.toml"] == two["settings.toml"]
    assert strict_json(one["summary.json"])["modes"][0]["harmonics"] == [-2, -1, 0, 1, 2]
    typed("identify wrong.npz --settings one/settings.toml --origin 0 --out three")
    assert contents(here / "three")["summary.json"] != one["summary.json"]


@pytest.mark.slow
def test_options_come_before_settings(here):
    Path("settings.toml").write_text(f'period = {PERIOD}\norder = 2\nstates = ["X"]\nchannels = ["X", "Y"]\n')
    low = {"code": 1, "message": "The model fails"}
    said = strict_json(typed("identify good.npz --settings settings.toml --format json", **low))
    assert (said["order"], len(said["system"]["states"])) == (2, 2)
    said = strict_json(typed("identify good.npz --settings settings.toml --order 4 --states X,Y --format json"))
    assert (said["order"], len(said["system"]["states"])) == (4, 4)
    said = strict_json(typed("identify good.npz --settings settings.toml --states '' --format json", **low))
    assert said["system"] is None
    assert typed("identify good.npz --settings settings.toml --frequency 0.0001", code=2, message="shorter than") == ""


@pytest.mark.slow
def test_frequency_is_one_over_the_period(here):
    by_period = strict_json(typed("identify good.npz --period 6.25 --rate 1.28 --format json"))
    by_frequency = strict_json(typed("identify good.npz --frequency 0.16 --rate 1.28 --format json"))
    assert by_period == by_frequency


def test_several_hits(here):
    record = JeffcottRotor().simulate(n_periods=50, samples_per_period=8, noise=0.02, seed=2, impulse_deg=120.0)
    save_npz("other.npz", record.values)
    third = JeffcottRotor().simulate(n_periods=20, samples_per_period=8, noise=0.02, seed=3, impulse_deg=70.0)
    save_npz("third.npz", third.values)
    words = f"identify good.npz other.npz third.npz --period {PERIOD} --verbose --no-validate --no-constrained"
    text = " ".join(typed(words).split())
    assert "3 records, 4 channels" in text
    assert "8 samples a period, 40, 50, 20 periods." in text
    assert "least of 3 hits" in text


# From one command to the next.


@pytest.mark.first(1)
@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_simulate_info_identify(here, suffix):
    said = typed(f"simulate --out 'a record.{suffix}' --periods 40 --samples-per-period 8 --seed 3")
    assert f"a record.{suffix}: 4 channels, 320 samples at 1.2732395 Hz, period 6.28318530718 s." in said
    told = typed(["info", f"a record.{suffix}"])
    for words in ("4 channels, 320 samples", "1.2732395", "X_tt", "displacement", "period of 6.28318531 s"):
        assert words in told
    proposed = said.split("Identify it: floquid ", 1)[1].strip()
    identified = strict_json(typed(f"{proposed} --format json"))
    assert identified["order"] == 4
    assert identified["system"]["states"] == ["X", "Y", "d/dt X", "d/dt Y"]
    # The file states its own period, so none need be given.
    assert strict_json(typed(["identify", f"a record.{suffix}", "--format", "json"]))["modes"] == identified["modes"]


@pytest.mark.slow
def test_npz_and_csv_give_the_same(here):
    for suffix in ("npz", "csv"):
        typed(f"simulate --out record.{suffix} --periods 40 --samples-per-period 8 --noise 0.05 --impulse-deg 30")
    one, other = (strict_json(typed(f"identify record.{suffix} --format json")) for suffix in ("npz", "csv"))
    np.testing.assert_allclose(
        [mode["exponent"] for mode in one["modes"]], [mode["exponent"] for mode in other["modes"]], rtol=1e-9
    )


def test_info_of_a_file_with_gaps(here):
    values = simulated().values.copy()
    values[0, 3:6] = np.nan
    save_npz("gaps.npz", values, units=["m", "m", "mm", "mm"])
    row = next(line for line in typed("info gaps.npz").splitlines() if line.lstrip().startswith("X "))
    assert row.split()[1:3] == ["displacement", "m"]
    assert row.split()[-1] == "3"


def test_demo(here, quick_pictures):
    text = typed("demo jeffcott --periods 80 --out shown")
    assert set(contents(here / "shown")) == {*DRAWN, "record.npz", "figures/system_elements.png"}
    assert [row[0] for row in rows_of_modes(text)] == ["1", "2"]
    for words in ("Principal Floquet exponents, against the truth", "Re λ2 [1/s]", "X_tt, Y_tt", "Written to shown/"):
        assert words in text
    assert text.endswith("settings.toml, figures/\n")
    assert max(map(len, text.splitlines())) <= 80
    errors = [float(line.split()[-2]) for line in text.splitlines() if re.match(r" X(_tt)?, Y", line)]
    assert len(errors) == 2
    assert max(errors) < 0.1
    summary = strict_json((here / "shown" / "summary.json").read_text())
    # What the folder holds can be made again from what the folder holds.
    again = typed("identify shown/record.npz --settings shown/settings.toml --format json")
    assert strict_json(again) == summary
    assert typed("demo --periods 80 --out again --format json") == (here / "shown" / "summary.json").read_text()


# Help and version.


def words_of(function):
    """The name of each argument and option of a command, and whether it is an option; those that commands share too."""
    for name, parameter in inspect.signature(function).parameters.items():
        shared = [
            own for own in (RecordOptions, FreeOptions, ModelOptions) if own.__name__ in str(parameter.annotation)
        ]
        if shared:
            # `scan` takes the options of inputs to refuse them in words of its own, and does not offer them.
            hidden = ("inputs", "hold", "excitation") if shared[0] is FreeOptions else ()
            yield from ((field.name, True) for field in fields(shared[0]) if field.name not in hidden)
        else:
            yield name, parameter.kind is parameter.KEYWORD_ONLY


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_every_option_with_its_unit(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    text = typed([command, "--help"])
    assert text.startswith(f"Usage: floquid {command}")
    function = app_of()[command].default_command
    units = {"period": "[s]", "origin": "[s]", "frequency": "[Hz]", "rate": "[Hz]", "impulse_deg": "[deg]"}
    for name, typed_by_name in words_of(function):
        word = f"--{name.replace('_', '-')}" if typed_by_name else name.upper()
        said = re.search(rf"{word}\b(?![,.])(.*?)(?=│\n│ +(?:\* +)?--|╰)", text, flags=re.DOTALL)
        assert said, word
        assert re.search(r"[a-z]{3}", said[1]), f"{word} is not explained"
        if name in units:
            assert units[name] in said[1]


@pytest.mark.parametrize("command", LISTED)
def test_the_list_has_the_first_line_of_each_commands_help(command):
    """It is written down, so that `--help` imports no command."""
    function = app_of()[command].default_command
    assert function.__name__ == command
    assert LISTED[command][2] == inspect.getdoc(function).splitlines()[0]


def test_help_of_all(monkeypatch):
    for text in (typed([]), typed(["--help"])):
        assert all(re.search(rf"^│ {command} +\w", text, flags=re.MULTILINE) for command in COMMANDS)


def test_version():
    assert typed(["--version"]).strip() == floquid.__version__


# The width of the terminal, and the streams.


def real_poles():
    """A record with a pair, a negative and a positive real multiplier, over long decimals."""
    t = np.arange(60 * 8) / 8.0
    rng = np.random.default_rng(0)
    shapes = [1.0 + 0.4 * np.cos(2.0 * np.pi * t + phase) for phase in (0.0, 1.0, 2.0)]
    parts = [np.exp(-0.01 * t) * np.cos(123.4 * t), np.exp(-0.05 * t) * np.cos(np.pi * t), 0.7 * np.exp(-0.03 * t)]
    mixed = np.array([[1.0, 0.5, 0.4], [0.3, 1.0, -0.8]]) @ np.array(
        [s * p for s, p in zip(shapes, parts, strict=True)]
    )
    return mixed + 1e-4 * rng.standard_normal(mixed.shape)


def unstable():
    t = np.arange(60 * 8) / 8.0
    grown = [np.exp(0.02 * t) * np.cos(0.7 * t + lag) * (1.0 + 0.3 * np.cos(2.0 * np.pi * t)) for lag in (0.0, 1.0)]
    return np.array(grown) + 1e-3 * np.random.default_rng(0).standard_normal((2, t.size))


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("values", "notes"),
    [(None, {"f?"}), (real_poles(), {"μ<0", "μ>0"}), (unstable(), {"grows"})],
    ids=["rotor", "real", "grows"],
)
def test_no_number_is_cut_short_at_80_columns(values, notes, rotor):
    if values is None:
        analysis = floquid.load(rotor[1] / "result.h5")
    else:
        record = floquid.Record(values=values, sample_rate=8.0, channels=["a", "b"])
        analysis = floquid.identify(record, period=1.0)

    def table(width):
        console = Console(width=width, file=io.StringIO(), markup=False)
        terminal.print_whole(console, printed.modes_table(analysis))
        return console.file.getvalue()

    narrow, wide = table(80), table(300)
    assert max(len(line) for line in narrow.splitlines()) <= 80
    assert narrow.split() == wide.split() == table(20).split()
    assert set(wide.split()) & set(MODE_NOTES) == notes


def test_the_installed_command_keeps_its_streams_apart(here):
    script = str(Path(sys.executable).parent / "floquid")
    words = [script, *shlex.split(GOOD), "--format", "json"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ended.returncode, after_stages(ended.stderr)) == (0, "")
    told = ended.stderr.splitlines()
    assert told[:3] == ["reading good.npz", "cutting into periods", "estimating the noise"]
    assert told.count("searching for modes") == 1
    assert ended.stdout == typed(words[1:])


@pytest.mark.slow
def test_a_terminal_that_cannot_show_greek(here, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    script = str(Path(sys.executable).parent / "floquid")
    ended = subprocess.run([script, *shlex.split(GOOD)], capture_output=True, text=True, check=False)
    assert (ended.returncode, after_stages(ended.stderr)) == (0, "")
    assert "Re \\u03bb [1/s]" in ended.stdout


@pytest.mark.slow
def test_the_legend_says_how_it_was_finished(here):
    free, held = (" ".join(typed(f"{GOOD}{option} --verbose").split()) for option in (" --no-constrained", ""))
    assert "harmonics of the shape that rise above the noise." in free
    assert "harmonics of the shape that rise above the noise, the residues held to them." in held
    bare = " ".join(typed(f"{GOOD} --identifier era --harmonics 2 --verbose").split())
    assert "this identifier gives no standard deviations" in bare
    assert "harmonics of the shape, as asked for." in bare


def test_the_first_screen_fits_a_screen_and_leaves_the_reasons_to_verbose(here):
    short, long = typed(GOOD), typed(f"{GOOD} --verbose")
    assert len(short.splitlines()) < 25
    for name in ("Noise", "Order", "Period", "Verdict"):
        assert re.search(rf"^{name} +\w", short, flags=re.MULTILINE)
    assert "The order is clear." in long
    assert "The order is clear." not in short


def test_a_doubtful_screen_has_each_reason_with_its_remedy(rotor, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    analysis = floquid.load(rotor[1] / "result.h5")
    doubts = [
        warning("misfit", misfit=2.1),
        warning("line_as_mode", frequencies=(4.2,), periods=2, real=False),
        warning("vague_angle", degrees=0.4, energy=12.0),
        warning("weakly_determined", number=2, order=16, limit=0.002),
        warning("period_halved"),
    ]
    printed.print_analysis(replace(analysis, findings=(*analysis.findings, *doubts)))
    text = capsys.readouterr().out
    assert len(text.splitlines()) < 35 - 2, "two more are how to read on, and the place of the files"
    assert text.count("→") == 3
    assert "→ Allow more harmonics (`--harmonics`), or finish with" in text
    assert "→ If a revolution holds 2 periods, say so:" in text
    assert "… and 2 more." in text
