"""`floquid floquet`: what it prints and writes, its verdicts and checks, and what cannot be."""

import json
import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io
from tests.cli.conftest import contents
from tests.cli.test_commands import PERIOD, strict_json, typed
from tests.unit.floquet.files.test_read_openfast import REAL, Rotor, even, write_turn

from floquid import floquet
from floquid.cli.commands import floquet as command
from floquid.floquet import state_participation
from floquid.floquet.monodromy_matrix import _collocation
from floquid.systems import JeffcottRotor

FILES = {"summary.json", "modes.npz", "figures/exponents.png", "figures/shapes.png"}
ROTOR = JeffcottRotor()
STATES = ["X", "Y", "d/dt X", "d/dt Y"]
KEYS = [
    "format", "period", "order", "modes", "stability", "check", "defective", "azimuths", "states", "source", "warnings",
]  # fmt: skip


def sampled(system, period, count=64):
    return np.stack([np.array(system(t), dtype=float) for t in np.arange(count) * period / count], axis=-1)


def mathieu(a, q, zeta=0.0):
    return lambda t: [[0, 1], [-(a - 2 * q * np.cos(2 * t)), -2 * zeta]]


def save(name, system, period, states=None, **more):
    arrays = {"A": sampled(system, period), "period": period, **more}
    np.savez(name, **arrays if states is None else {**arrays, "states": states})


def flat(text):
    return " ".join(text.split())


@pytest.fixture
def work(tmp_path, monkeypatch):
    """A folder with the paper's rotor in `rotor.npz`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    save("rotor.npz", ROTOR.system, ROTOR.period, STATES)
    return tmp_path


def rows(text, title):
    lines = text.split(f"\n{title}", 1)[1].splitlines()[2:]
    return [re.split(r"\s{2,}", line.strip()) for line in lines if re.match(r" \d+  ", line)]


def test_the_rotor(work):
    text = typed("floquet rotor.npz")
    assert "A(t): 4 states; period 6.2831853 s (ω = 1 rad/s); 64 samples at equal steps" in flat(text)
    assert "Stability: asymptotically stable" in text
    assert re.search(
        r"λ = -0\.002 ± 0\.\d+i 1/s decays most slowly: by half in 346\.6 s \(55\.16 periods\)", flat(text)
    )
    found = floquet.modes(ROTOR.system, ROTOR.period)
    upper = [r for r in range(4) if found.exponents[r].imag > 0]
    table = rows(text, "Modes: order 4, conjugates counted one by one")[:2]
    for row, r in zip(table, upper, strict=True):
        assert float(row[1]) == pytest.approx(found.exponents[r].real, rel=1e-5)
        assert float(row[2].lstrip("±")) == pytest.approx(found.exponents[r].imag, rel=1e-5)
        assert float(row[3]) == pytest.approx(found.frequencies_hz[r], rel=1e-4)
        assert float(row[4]) == pytest.approx(100 * found.damping_ratios[r], rel=1e-2)
        assert float(row[5]) == pytest.approx(abs(found.multipliers[r]), rel=1e-3)
        assert float(row[6]) == pytest.approx(abs(found.principal()[r].imag), abs=1e-4)
    shares = state_participation(found)
    for row, r in zip(rows(text, "Shapes"), upper, strict=True):
        strongest = re.match(r"0: ([\d.]+)%, (-1|\+1): ", row[1])
        assert float(strongest[1]) == pytest.approx(100 * found.participation[r].max(), rel=1e-2)
        name, share = re.match(r"(.+?) (\d+)%", row[2]).groups()
        assert name in (STATES[r % 2], STATES[2 + r % 2]) or shares[r, STATES.index(name)] > 0.4
        assert float(share) == pytest.approx(100 * shares[r].max(), abs=0.6)
    difference = float(re.search(r"finds the same exponents to (\S+) 1/s \(±\d+ harmonics\)", flat(text))[1])
    assert difference < 1e-12
    assert "Warning" not in text
    assert max(map(len, text.splitlines())) <= 80
    assert set(contents(work)) == {"rotor.npz"}


@pytest.mark.slow
def test_json_is_the_summary_alone(work):
    text = typed("floquet rotor.npz --format json --out new")
    assert text == (work / "new" / "summary.json").read_text()
    content = strict_json(text)
    assert list(content) == KEYS
    assert content["format"] == "floquid-floquet/1"
    assert (content["period"], content["order"], content["states"]) == (ROTOR.period, 4, STATES)
    found = floquet.modes(sampled(ROTOR.system, ROTOR.period), ROTOR.period)
    for r, mode in enumerate(content["modes"]):
        assert complex(*mode["exponent"]) == pytest.approx(found.exponents[r])
        assert complex(*mode["principal"]) == pytest.approx(found.principal()[r])
        assert complex(*mode["multiplier"]) == pytest.approx(found.multipliers[r])
        assert mode["exponent_std"] is None
        assert mode["frequency_hz"] == pytest.approx(found.frequencies_hz[r])
        assert mode["damping_ratio"] == pytest.approx(found.damping_ratios[r])
        assert sum(mode["participation"]) == pytest.approx(1.0)
        assert len(mode["participation"]) == len(mode["harmonics"])
    assert content["stability"]["verdict"] == "stable"
    assert content["stability"]["growth"] == pytest.approx(-0.002, rel=1e-6)
    assert content["check"]["method"] == "hill"
    assert content["check"]["outcome"] == "converged"
    assert content["check"]["difference"] < 1e-12
    assert (content["defective"], content["azimuths"], content["warnings"]) == ([], None, [])


def test_the_folder_holds_the_modes_and_the_figures(work, monkeypatch):
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, target, **_: target.touch())
    text = typed("floquet rotor.npz --out new")
    said = " ".join(text.split())
    assert said.endswith("new/: summary.json, modes.npz, figures/exponents.png, figures/shapes.png")
    assert set(contents(work / "new")) == FILES
    with np.load(work / "new" / "modes.npz") as arrays:
        found = floquet.modes(sampled(ROTOR.system, ROTOR.period), ROTOR.period)
        assert arrays["exponents"] == pytest.approx(found.exponents)
        assert arrays["coefficients"] == pytest.approx(found.coefficients)
        assert arrays["harmonics"].tolist() == found.harmonics.tolist()
        assert arrays["period"] == ROTOR.period
        assert arrays["states"].tolist() == STATES


@pytest.mark.slow
def test_the_same_again_is_the_same_to_the_last_byte(work):
    typed("floquet rotor.npz --out new")
    before = contents(work / "new")
    for name in ("exponents", "shapes"):
        assert (work / "new" / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    typed("floquet rotor.npz --out new")
    assert contents(work / "new") == before


@pytest.mark.parametrize("kind", ["npz", "mat", "json"])
def test_the_same_from_every_format(work, kind):
    A = sampled(ROTOR.system, ROTOR.period)
    if kind == "mat":
        names = np.empty(4, dtype=object)
        names[:] = STATES
        scipy.io.savemat("a.mat", {"A": A, "period": ROTOR.period, "states": names})
    elif kind == "json":
        (work / "a.json").write_text(json.dumps({"A": A.tolist(), "period": ROTOR.period, "states": STATES}))
    else:
        np.savez("a.npz", A=A, states=STATES)
    option = {"npz": f"--frequency {1 / ROTOR.period!r}", "mat": "", "json": f"--period {ROTOR.period!r}"}[kind]
    found, expected = (
        strict_json(typed(f"floquet {words} --format json")) for words in (f"a.{kind} {option}", "rotor.npz")
    )
    assert found["states"] == expected["states"]
    assert found["modes"][0]["exponent"] == pytest.approx(expected["modes"][0]["exponent"], rel=1e-9)


def test_what_was_identified_is_analysed(work):
    record = ROTOR.simulate(n_periods=60, samples_per_period=16, noise=1e-4, seed=1)
    np.savez("record.npz", values=record.values, sample_rate=record.sample_rate, channels=["X", "Y", "X_tt", "Y_tt"])
    quick = "--order 4 --no-validate --no-constrained"
    typed(f"identify record.npz --period {PERIOD} --channels X,Y --states X,Y {quick} --out result")
    expected = strict_json((work / "result" / "summary.json").read_text())["modes"]
    for name in ("summary.json", "result.h5"):
        content = strict_json(typed(f"floquet result/{name} --format json"))
        assert content["states"] == STATES
        found = [complex(*mode["exponent"]) for mode in content["modes"]]
        for mode in expected:
            assert min(abs(complex(*mode["exponent"]) - value) for value in found) < 1e-8
    before = contents(work / "result")
    assert typed("floquet result/summary.json --out result", code=2, message="holds result.h5") == ""
    assert contents(work / "result") == before


# Verdicts.


LOCKED = "λ = 0.0499416 + 1i 1/s doubles in 13.88 s"
STABLE, MARGINAL = "asymptotically stable", "marginal within the accuracy of the exponents"


@pytest.mark.parametrize(
    ("system", "period", "verdict", "words"),
    [
        (mathieu(1, 0.1), np.pi, "unstable", f"{LOCKED} (4.418 periods): locked at half per period, 0.15915 Hz (a rea"),
        (mathieu(1, 0.1), 2 * np.pi, "unstable", f"{LOCKED} (2.209 periods): locked at 1 per period, 0.15915 Hz (a re"),
        (JeffcottRotor(speed=0.8, damping=0.0).system, np.pi / 0.4, "unstable", "flutter at"),
        (mathieu(2, 0.5), np.pi, MARGINAL, "± 1.36951i 1/s neither grows nor decays by more"),
        (mathieu(2, 0.5, 0.01), np.pi, STABLE, "decays most slowly: by half in 69.31 s"),
    ],
)
def test_verdicts(work, system, period, verdict, words):
    save("a.npz", system, period)
    text = typed("floquet a.npz")
    assert f"Stability: {verdict}\n" in text
    assert words in flat(text)


def test_divergence_is_told(work):
    save("a.npz", lambda t: [[0, 1], [1, 0.1 * np.cos(t)]], 2.0 * np.pi)
    content = strict_json(typed("floquet a.npz --format json"))
    assert content["stability"]["verdict"] == "unstable"
    assert content["stability"]["reasons"][0].endswith("divergence (a real positive multiplier).")
    assert len(content["stability"]["reasons"]) == 1


def test_a_defective_group_is_told(work):
    save("a.npz", lambda t: [[0.0, 1.0], [0.0, 0.0]], 1.0)
    text = typed("floquet a.npz")
    assert "Stability: marginal" in text
    assert "it shares its shape with another, and the response may grow as t" in flat(text)
    assert "Warning: These exponents share a shape, or nearly: 0+0j, 0+0j" in flat(text)
    assert strict_json(typed("floquet a.npz --format json"))["defective"] == [[0, 1]]


def test_growth_within_the_root_of_the_tolerance_is_no_growth(work):
    """λ = ±2.2e-7, whose shapes nearly coincide: they are known to 1e-5."""
    save("a.npz", lambda t: [[0.5, 0.5], [-0.5 + 1e-13, -0.5]], 1.0)
    content = strict_json(typed("floquet a.npz --format json --no-check"))
    assert content["defective"] == [[0, 1]]
    assert content["stability"]["verdict"] == "marginal"
    save("a.npz", lambda t: [[0.5, 0.5], [-0.5 + 1e-9, -0.5]], 1.0)
    assert strict_json(typed("floquet a.npz --format json --no-check"))["stability"]["verdict"] == "unstable"


@pytest.mark.slow
def test_vastly_different_multipliers_have_a_summary(work):
    save("a.npz", lambda t: np.diag([-900.0, 300.0]) * (1 + 0.1 * np.cos(t)), 2.0 * np.pi)
    content = strict_json(typed("floquet a.npz --format json --no-check --out new"))
    assert [mode["multiplier"] for mode in content["modes"]] == [None, [0.0, 0.0]]
    assert [mode["exponent"][0] for mode in content["modes"]] == pytest.approx([300.0, -900.0])


# Checks.


def test_without_the_check(work):
    text = typed("floquet rotor.npz --no-check")
    assert "Hill" not in text
    assert strict_json(typed("floquet rotor.npz --no-check --format json"))["check"] is None


def off_by(shift, monkeypatch):
    right = command.hill

    def wrong(matrix, **options):
        found = right(matrix, **options)
        return replace(found, exponents=found.exponents + shift)

    monkeypatch.setattr(command, "hill", wrong)


def test_two_routes_that_differ_a_little_are_told(work, monkeypatch):
    off_by(1e-7, monkeypatch)
    text = typed("floquet rotor.npz")
    assert "Warning: Hill's method disagrees: its exponents differ by up to 1e-07 1/s, more than both" in flat(text)
    content = strict_json(typed("floquet rotor.npz --format json"))
    assert content["check"]["difference"] == pytest.approx(1e-7)
    assert content["warnings"]


def test_two_routes_that_both_claim_to_be_right_and_differ_are_refused(work, monkeypatch):
    off_by(1e-3, monkeypatch)
    before = contents(work)
    message = "Integration over the period and Hill's method disagree. Integration gives -0.002"
    assert typed("floquet rotor.npz --out new", code=1, message=message) == ""
    assert contents(work) == before
    assert "Hill" not in typed("floquet rotor.npz --no-check")


@pytest.mark.parametrize("damping", [2e-7, -2e-7])
def test_a_disagreement_does_not_make_a_mode_rest(work, monkeypatch, damping):
    save("a.npz", mathieu(2, 0.5, damping), np.pi)
    off_by(1e-6, monkeypatch)
    content = strict_json(typed("floquet a.npz --format json"))
    assert content["stability"]["verdict"] == ("stable" if damping > 0 else "unstable")
    assert any(warning.startswith("Hill's method disagrees") for warning in content["warnings"])


def test_far_lines_are_stable_or_not_as_they_are(work):
    system = lambda t: [[0, 1], [-36 - 0.3 * np.cos(t) - 0.4 * np.cos(12 * t), -0.01]]  # noqa: E731
    save("a.npz", system, 2 * np.pi)
    content = strict_json(typed("floquet a.npz --format json"))
    assert content["stability"]["verdict"] == "unstable"
    assert content["stability"]["growth"] == pytest.approx(0.01165624, abs=1e-8)
    assert content["check"]["difference"] < 1e-12
    assert content["warnings"] == []


def test_a_mode_that_rests_shows_the_value_found(work):
    save("a.npz", mathieu(2, 0.5, 1e-12), np.pi)
    text = typed("floquet a.npz")
    found = floquet.modes(mathieu(2, 0.5, 1e-12), np.pi)
    shown = rows(text, "Modes: order 2, conjugates counted one by one")[0][1]
    assert shown[0] == "-"
    assert float(shown) == pytest.approx(found.exponents[0].real, abs=3e-13)


@pytest.mark.slow
def test_hill_that_does_not_settle_is_told(work, monkeypatch):
    rng = np.random.default_rng(0)
    np.savez("a.npz", A=rng.standard_normal((2, 2, 1001)) * 3.0 - 5.0 * np.eye(2)[:, :, None], period=1.0)
    monkeypatch.setattr(command, "hill", partial(command.hill, n_harmonics=6, tolerance=1e-14))
    content = strict_json(typed("floquet a.npz --interpolation linear --format json"))
    assert content["check"]["outcome"] == "truncated"
    assert content["check"]["difference"] > 1e-12
    assert any(warning.startswith("Hill's method has not settled") for warning in content["warnings"])


def test_samples_that_do_not_resolve_are_told(work):
    np.savez("a.npz", A=np.where(np.arange(12) < 5, -1.0, -2.0) * np.eye(2)[:, :, None], period=1.0)
    assert "Warning: The highest third of the harmonics that 12 samples tell" in flat(typed("floquet a.npz"))
    np.savez("a.npz", A=np.array([-1.0, -2.0]) * np.eye(2)[:, :, None], edges=[0.0, 5 / 12], period=1.0)
    text = typed("floquet a.npz")
    assert "2 constant pieces" in text
    assert "Warning: The highest" not in flat(text)


# OpenFAST.


def test_a_turn_of_a_rotor(work):
    (work / "turn").mkdir()
    write_turn(work / "turn", Rotor(swing=0.004).text, even(12, start=0.0))
    text = flat(typed("floquet turn"))
    assert "A(t): 3 states" in text
    assert "OpenFAST, 12 azimuths of one revolution at 2 rad/s, harmonics up to 5." in text
    assert "The azimuths resolve A(t). The 12 azimuths are equally spaced" in text
    assert "Set aside, as the phase of the period: ED Variable speed generator." in text
    halved = float(re.search(r"Every other azimuth alone gives exponents that differ by up to (\S+) 1/s", text)[1])
    azimuths = strict_json(typed("floquet turn --format json"))["azimuths"]
    assert azimuths["resolved"] is True
    assert azimuths["count"] == 12
    assert azimuths["every_other"] == pytest.approx(halved, rel=0.1)
    assert halved < 1e-9
    assert azimuths["set_aside"] == ["ED Variable speed generator DOF (internal DOF index = DOF_GeAz)"]


def test_azimuths_that_are_too_few(work):
    rotor = Rotor(swing=0.004, harmonics=2)
    for count, words in ((6, "alone gives exponents that differ by up to"), (5, "there are 5, and it takes an even")):
        folder = work / f"turn{count}"
        folder.mkdir()
        write_turn(folder, rotor.text, even(count))
        text = flat(typed(["floquet", *map(str, sorted(folder.glob("*.lin")))]))
        assert "The azimuths do not resolve A(t)." in text
        assert "Warning: The azimuths do not resolve A(t)." in text
        assert words in text
    five, six = (strict_json(typed(f"floquet turn{count} --format json"))["azimuths"] for count in (5, 6))
    assert five["every_other"] is None
    assert 1e-3 < six["every_other"] < 1.0
    assert five["resolved"] is six["resolved"] is False


@pytest.mark.slow
@REAL
def test_a_real_turbine(work):
    from tests.unit.floquet.files.test_read_openfast import FOLDER

    text = typed(["floquet", *(str(FOLDER / f"Main.{number}.lin") for number in (1, 12, 24)), "--out", "new"])
    assert "Stability: asymptotically stable" in text
    assert "The azimuths do not resolve A(t)." in text
    assert max(len(line) for line in text.splitlines() if not line.startswith("Written to")) <= 80
    assert set(contents(work / "new")) == FILES


# What cannot be.


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("floquet", "`FILES` must name at least one file with A(t)"),
        ("floquet none.npz", "there is no file none.npz"),
        ("floquet bare.npz", "must be given, but is not, and bare.npz states none (it holds `A`)"),
        ("floquet bare.npz --period 0", "`--period` must be positive"),
        ("floquet bare.npz --frequency 0", "`--frequency` must be positive"),
        ("floquet bare.npz --period 1 --frequency 1", "`--frequency` must not be given beside --period"),
        ("floquet rotor.npz --period 3", "must be left out or be that of rotor.npz, 6.28318531 s, but is 3 s"),
        ("floquet rotor.npz bare.npz", "must name one file, but names 2"),
        ("floquet record.npz", "has no `A` (it holds `values`, `sample_rate`)"),
        ("floquet text.txt", "must end in .npz, .mat, .h5, .hdf5, .json or .lin"),
        ("floquet .", "there is no such file in ."),
        ("floquet rotor.npz --tolerance 1", "`--tolerance` must lie in [1e-14, 1e-3], but is 1"),
        ("floquet rotor.npz --interpolation spline", "Choose from"),
        ("floquet series.npz --interpolation linear", "must be left out for harmonics"),
        ("floquet rotor.npz --out rotor.npz", "`--out` must be a folder"),
        ("floquet rotor.npz --out blocked", "blocked/modes.npz is a folder"),
        ("floquet rotor.npz --format xml", "Choose from"),
    ],
)
def test_bad_input_is_one_message(work, words, message):
    np.savez("bare.npz", A=sampled(ROTOR.system, ROTOR.period))
    np.savez("record.npz", values=np.zeros((2, 9)), sample_rate=3.0)
    np.savez("series.npz", coefficients=np.eye(2)[:, :, None], harmonics=[0], period=1.0)
    (work / "text.txt").write_text("1 2 3")
    (work / "blocked" / "modes.npz").mkdir(parents=True)
    before = contents(work)
    assert typed(words, code=2, message=message) == ""
    assert contents(work) == before


@pytest.mark.slow
def test_a_refused_analysis_leaves_an_earlier_result(work, monkeypatch):
    typed("floquet rotor.npz --out kept")
    fast = sampled(lambda t: [[0, 1], [-(1 + 0.9 * np.cos(100 * t)), 0]], 2.0 * np.pi, 512)
    np.savez("fast.npz", A=fast, period=2.0 * np.pi)
    before = contents(work)
    monkeypatch.setattr(_collocation, "MOST", 10)
    words = "floquet fast.npz --out kept"
    assert typed(words, code=1, message="floquid: A(t) must be integrable to a relative error of 1e-12, but") == ""
    assert contents(work) == before


def test_the_shapes_of_a_turbine_are_those_of_its_structure():
    """A wave filter swings with less damping than the tower, and would be drawn alone."""
    A = np.zeros((6, 6))
    for k, (decay, swing) in enumerate([(0.01, 0.9), (0.1, 2.2), (0.05, 3.3)]):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-decay, swing], [-swing, -decay]]
    found = floquet.modes(lambda t: A * (1.0 + 0.1 * np.cos(t)), 2.0 * np.pi)
    names = ["HD Exctn1", "HD Exctn2", "ED tower", "ED d/dt tower", "BD_1 blade", "BD_1 d/dt blade"]

    def moving(states):
        chosen = command._moving(SimpleNamespace(modes=found, file=SimpleNamespace(states=states)))
        return chosen and found.exponents[chosen].real.round(6).tolist()

    assert moving(names) == [-0.05, -0.1]
    assert moving(None) is moving(names[2:4] * 3) is moving([name[3:] for name in names]) is None
