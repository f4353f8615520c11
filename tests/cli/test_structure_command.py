"""A(t) on the command line: its forms, its structure, the output-error step, and the deviations that are printed."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.cli.conftest import save_npz
from tests.cli.test_commands import strict_json, typed

import floquid
from floquid.cli.output import printed, terminal
from floquid.reconstruction import refine
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()
IDENTIFY = f"identify rotor.npz --channels X,Y --period {2.0 * np.pi!r}"
STRUCTURE = '"stiffness 1 symmetric;damping 0 known 0,1=0 1,0=0"'


@pytest.fixture
def rotor(here):
    record = ROTOR.simulate(n_periods=200, samples_per_period=20, noise=0.02, seed=7)
    save_npz("rotor.npz", record.values, sample_rate=record.sample_rate)
    return here


def numbers(line):
    """Values and deviations of cells such as 0.550856(33): {place in the line: (value, deviation)}."""
    found = []
    for value, digits in re.findall(r"(-?[\d.]+)\((\d+)\)", line):
        places = len(value.partition(".")[2])
        found.append((float(value), int(digits) / 10**places))
    return found


def test_the_structure_is_printed_with_its_fit_and_its_parameters(rotor):
    text = typed(f"{IDENTIFY} --states X,Y --structure {STRUCTURE} --out new")
    said = strict_json((rotor / "new" / "summary.json").read_text())["system"]["structure"]
    assert said["text"] == "stiffness 1 symmetric; damping 0 known 0,1=0.0 1,0=0.0"
    flat = " ".join(text.split())
    assert "Structure given: symmetric stiffness with 1 harmonic; damping constant, 2 elements known" in flat
    assert f"a chi-square of {said['chi_square']:.4g} for {said['degrees']} degrees of freedom" in flat
    assert "the structure does not contradict the record" in flat
    assert said["conditional_on"] == ["symmetric stiffness with 1 harmonic; damping constant, 2 elements known"]
    assert f"The deviations are conditional on: {said['conditional_on'][0]}." in flat
    known = {one["name"]: one for one in said["parameters"]}
    assert len(known) == 11
    rows = [line for line in text.splitlines() if re.match(r" (stiffness|damping)\[", line)]
    assert [row.split()[0] for row in rows] == [
        *("stiffness[0,0]", "stiffness[0,1]", "stiffness[1,1]"),
        *("damping[0,0]", "damping[1,1]"),
    ]
    for row in rows:
        element = row.split()[0]
        parts = ("", " cos 1", " sin 1") if element.startswith("stiffness") else ("",)
        for (value, std), part in zip(numbers(row), parts, strict=True):
            one = known[f"{element}{part}"]
            assert value == pytest.approx(one["value"], abs=std)
            assert std == pytest.approx(one["std"], rel=0.05)
    assert max(len(line) for line in text.splitlines()) <= 80


@pytest.mark.slow
def test_every_element_has_its_largest_deviation_below_it(rotor):
    text = typed(f"{IDENTIFY} --states X,Y --out new")
    state = floquid.load("new/result.h5").state
    lines = text[text.index("A(t) [1/s², 1/s]: smallest … largest over the period") :].splitlines()
    assert lines[1].split() == ["X", "Y", "d/dt", "X", "d/dt", "Y"]
    for row, i in ((2, 2), (4, 3)):
        cells = [cell.split("…") for cell in lines[row].split()[2:]]
        assert [float(cell[0]) for cell in cells] == pytest.approx(state.system[:, i].min(axis=0), abs=6e-4)
        assert [float(cell[-1]) for cell in cells] == pytest.approx(state.system[:, i].max(axis=0), abs=6e-4)
        assert lines[row + 1].split()[0] == "deviation"
        shown = [float(word) for word in lines[row + 1].split()[1:]]
        assert shown == pytest.approx(state.system_std[:, i].max(axis=0), rel=0.05)
    assert "no deviations" not in text
    assert "The states are" not in text


@pytest.mark.slow
def test_a_structure_that_is_found(rotor):
    text = typed(f"{IDENTIFY} --states X,Y --structure auto --output-error --out new")
    analysis = floquid.load("new/result.h5")
    settings = (rotor / "new" / "settings.toml").read_text()
    assert 'structure = "auto"' in settings
    assert "output_error = true" in settings
    flat = " ".join(text.split())
    assert f"Structure found: {analysis.refinement.structure.words()}" in flat
    assert " ".join(analysis.refinement.reasons[1].split()) in flat
    without = refine(analysis.model, ["X", "Y"], analysis.refinement.structure)
    moved = np.abs(analysis.refinement.parameters - without.parameters) / without.std
    assert 1e-7 < moved.max() < 0.1


@pytest.mark.slow
def test_settings_read_back_give_the_same_state(rotor):
    typed(f"{IDENTIFY} --states X,Y --structure {STRUCTURE} --output-error --out one")
    typed("identify rotor.npz --settings one/settings.toml --out two")
    for name in ("summary.json", "settings.toml"):
        assert (rotor / "one" / name).read_bytes() == (rotor / "two" / name).read_bytes()
    typed(f"{IDENTIFY} --states X --form delayed --delay 1.5 --out three")
    typed("identify rotor.npz --settings three/settings.toml --out four")
    assert (rotor / "three" / "summary.json").read_bytes() == (rotor / "four" / "summary.json").read_bytes()
    refused = "identify rotor.npz --settings one/settings.toml --structure ''"
    assert typed(refused, code=2, message="`--output-error` must come with a structure") == ""


@pytest.mark.slow
def test_delayed_states_say_what_they_are(rotor):
    text = typed(f"{IDENTIFY} --states X --form delayed --delay 1.5")
    assert "A(t) [1/s]: smallest … largest over the period" in text
    flat = " ".join(text.split())
    assert (
        "The states are delayed outputs, X, X(t + 1.5 s), X(t + 3 s), X(t + 4.5 s): Φ and A are those of these" in flat
    )
    rows = [line.split()[:2] for line in text.splitlines() if line.startswith(" d/dt")]
    assert rows == [["d/dt", str(k)] for k in (1, 2, 3, 4)]
    assert max(len(line) for line in text.splitlines()) <= 80


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--states X,Y --structure 'stiffness 0'", "The structure contradicts the data"),
        ("--states X", "name 2 channels: 4 modes"),
        ("--channels X,Y,X_tt --states X,Y,X_tt", "as many states, half of them velocities, but names 3"),
    ],
)
def test_without_the_state_matrix_that_was_asked_for_there_are_the_modes_and_1(rotor, options, words):
    """The message may be broken anywhere."""
    printed = typed(f"{IDENTIFY.replace('--channels X,Y ', '')} {options}", code=1, message="A(t) was not rebuilt")
    assert "Modes: order 4" in printed
    assert words in " ".join(printed.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--states X,Y --structure 'stiffness 2 symetric'", "`--structure` must go on with one of none, symmetric"),
        (
            "--states X,Y --structure 'stiffness 2 known 5,5=1'",
            "`--structure` must name elements of a block",
        ),
        (
            "--states X,Y --structure 'stiffness 2; gyroscopic 0'",
            "`--structure` must in its damping block be symmetric",
        ),
        ("--structure auto", "`--structure` must come with states"),
        ("--states X,Y --output-error", "`--output-error` must come with a structure"),
        ("--states X,Y --delay 2", '`--delay` must be None unless the form is "delayed"'),
        ("--states X,Y --form square", 'Invalid value "square" for --form'),
        ("--states X+Q,Y", "`--states` must name channels of the record, but has 'Q'"),
    ],
)
def test_what_is_no_state_matrix_is_one_message(rotor, words, message):
    assert typed(f"{IDENTIFY} {words}", code=2, message=message) == ""


@pytest.fixture(scope="module")
def refined():
    record = ROTOR.simulate(n_periods=200, samples_per_period=20, noise=0.02, seed=7).select(["X", "Y"])
    return floquid.identify(record, states=["X", "Y"], structure="stiffness 3", validate=False)


def test_many_harmonics_are_a_list(refined, capsys, monkeypatch):
    """Beside each other they are too wide for 80 columns, and no number is cut short."""
    monkeypatch.setenv("COLUMNS", "80")
    printed.print_structure(terminal.terminal(), refined.refinement)
    text = capsys.readouterr().out
    rows = [line for line in text.splitlines() if re.match(r" (stiffness|damping)\[", line)]
    assert len(rows) == len(refined.refinement.names) == 32
    for name, row, value in zip(refined.refinement.names, rows, refined.refinement.parameters, strict=True):
        assert row.strip().startswith(f"{name} ")
        ((shown, std),) = numbers(row)
        assert shown == pytest.approx(value, abs=std)
    monkeypatch.setenv("COLUMNS", "200")
    printed.print_structure(terminal.terminal(), refined.refinement)
    wide = [line for line in capsys.readouterr().out.splitlines() if re.match(r" (stiffness|damping)\[", line)]
    assert len(wide) == 8
    assert [cell for row in rows for cell in numbers(row)] == [cell for row in wide for cell in numbers(row)]


def test_a_rare_misfit_is_told(refined, capsys):
    for p_value, words in ((0.02, "does not contradict"), (0.005, "chance seldom leaves as much"), (0.0, "p < 1e-300")):
        found = replace(refined.refinement, p_value=p_value)
        printed.print_structure(terminal.terminal(), found)
        assert words in " ".join(capsys.readouterr().out.split())


def test_the_modes_have_deviations_of_frequency_and_damping_where_they_fit(refined, capsys, monkeypatch):
    model = refined.model
    for columns, marked in ((80, 4), (60, 2)):
        monkeypatch.setenv("COLUMNS", str(columns))
        printed.print_modes(terminal.terminal(), refined)
        rows = [line for line in capsys.readouterr().out.splitlines() if re.match(r"\s*[12] ", line)]
        assert [len(numbers(row)) for row in rows] == [marked, marked]
    monkeypatch.setenv("COLUMNS", "80")
    printed.print_modes(terminal.terminal(), refined)
    rows = [line for line in capsys.readouterr().out.splitlines() if re.match(r"\s*[12] ", line)]
    for row, r in zip(rows, model.upper_modes, strict=True):
        assert len(row) <= 80
        (frequency, frequency_std), (damping, damping_std), *_ = numbers(row)
        assert frequency == pytest.approx(model.frequencies_hz[r], abs=frequency_std)
        assert frequency_std == pytest.approx(model.frequency_std_hz[r], rel=0.06)
        assert damping == pytest.approx(100.0 * model.damping_ratios[r], abs=damping_std)
        assert damping_std == pytest.approx(100.0 * model.damping_ratio_std[r], rel=0.06)


def test_the_help_names_the_options(here):
    text = typed("identify --help")
    assert {"--form", "--delay", "--structure", "--output-error"} <= set(text.split())
    assert Path("good.npz").exists()
