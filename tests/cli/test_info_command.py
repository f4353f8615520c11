"""`floquid info`: each candidate by the step of `identify` that uses it, and a command to type as it stands."""

import json
import shlex

import numpy as np
import pytest
from tests.cli.test_commands import typed

import floquid as fq
from floquid import read
from floquid.cli import run
from floquid.core import Channel, Record
from floquid.preparation import Candidate, prepare, propose
from floquid.readers import describe_file, write

RATE, SAMPLES, TURNS = 400.0, 4800, 8.0  # of the records [Hz], and revolutions a second
TIMES = np.arange(SAMPLES) / RATE


def struck(instants, noise=1e-3):
    """The force and the response of a periodic system that is struck at some instants [s]."""
    response, force = np.zeros((2, SAMPLES)), np.zeros(SAMPLES)
    wave = 1.0 + 0.3 * np.cos(2 * np.pi * TURNS * TIMES)
    for instant in instants:
        first = round(instant * RATE)
        force[first : first + 3] += [0.5, 1.0, 0.4]
        since = TIMES[first:] - instant
        for place, phase in enumerate((0.0, 1.2)):
            response[place, first:] += np.exp(-1.3 * since) * np.sin(2 * np.pi * 17.0 * since + phase) * wave[first:]
    generator = np.random.default_rng(0)
    return force + noise * generator.standard_normal(SAMPLES), response + noise * generator.standard_normal(
        (2, SAMPLES)
    )


def pulses(noise=0.01):
    return 5.0 * (TURNS * TIMES % 1.0 < 0.1) + noise * np.random.default_rng(1).standard_normal(SAMPLES)


def saved(path, rows):
    """A record whose rows are by their channels, in a file."""
    write(Record(values=list(rows.values()), sample_rate=RATE, channels=list(rows)), path)
    return path


def ambient():
    """A response to noise that nobody measured, of two modes."""
    from scipy.signal import lfilter

    generator = np.random.default_rng(3)
    rows = []
    for hertz in (11.0, 29.0):
        pole = np.exp((-2.0 + 2j * np.pi * hertz) / RATE)
        rows.append(lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], generator.standard_normal(SAMPLES)))
    return np.array([[1.0, 0.5], [0.6, -1.0]]) @ np.array(rows)


def next_of(path, *more):
    text = typed(["info", str(path), *more])
    return next(line for line in text.splitlines() if line.startswith("Next"))


@pytest.fixture(scope="module")
def hammer(tmp_path_factory):
    """Three even blows by a hammer whose channel says nothing, and a tachometer whose channel says nothing."""
    force, (x, y) = struck((1.0, 5.0, 9.0))
    rows = {
        Channel(name="ch1", unit="V"): force, Channel(name="x", unit="m/s^2"): x, Channel(name="y", unit="m/s^2"): y,
        Channel(name="ch4", unit="V"): pulses(),
    }  # fmt: skip
    return saved(tmp_path_factory.mktemp("info") / "run.npz", rows)


def test_a_hammer_is_no_clock_and_a_tachometer_is(hammer):
    text = " ".join(typed(["info", str(hammer)]).split())
    assert "ch1 [V]: 3 impacts. Use --find-hits. It rises 3 times in 12 s and rests between: hits, and" in text
    assert "Possible clock: ch4, it rises once a revolution, 95 times, every 0.125 s, evenly to 0.0" in text
    assert "Possible clock: ch1" not in text
    assert "add --periods-per-rev: 2 of an asymmetric shaft seen from the ground" in text
    assert text.endswith(f"Next: floquid identify {hammer} --channels x,y --find-hits --tach ch4")


def test_many_even_blows_are_no_clock_either(tmp_path):
    force, (x, y) = struck(np.arange(0.5, 12.0, 0.5))
    rows = {Channel(name="ch1", unit="V"): force, Channel(name="x", unit="m"): x, Channel(name="y", unit="m"): y}
    rows[Channel(name="ch4", unit="V")] = pulses()
    assert next_of(saved(tmp_path / "run.npz", rows)).endswith("--channels x,y --find-hits --tach ch4")


def test_blows_that_come_too_close_are_inputs(tmp_path):
    """Of a clock of 8 Hz four periods are half a second: nothing between blows that are closer is a free response."""
    force, (x, y) = struck(np.arange(0.3, 12.0, 0.3))
    rows = {Channel(name="F", unit="N"): force, Channel(name="x", unit="m"): x, Channel(name="y", unit="m"): y}
    rows[Channel(name="tach", unit="V")] = pulses()
    path = saved(tmp_path / "run.npz", rows)
    text = " ".join(typed(["info", str(path)]).split())
    assert "Input candidate: F: it rises 39 times in 12 s and rests between, too often for free responses" in text
    assert text.endswith("--inputs F --tach tach")


def test_what_is_proposed_can_be_typed(hammer):
    words = shlex.split(next_of(hammer).removeprefix("Next: floquid "))
    found = json.loads(typed([*words, "--format", "json", "--no-validate"]))
    assert found["period"] == pytest.approx(1.0 / TURNS, rel=1e-4)
    hertz = min(abs(mode["exponent"][1]) / (2 * np.pi) % TURNS for mode in found["modes"])
    assert min(hertz, TURNS - hertz) == pytest.approx(1.0, abs=0.01)  # 17 Hz is 1 Hz beside the second harmonic


def test_the_proposal_is_for_python_too(hammer):
    record = read(hammer)
    found = propose(record, describe_file(hammer).clock_candidates)
    assert found.settings == {"channels": ("x", "y"), "find_hits": True, "tach": "ch4"}
    assert [(own.name, own.use) for own in found.candidates] == [("ch4", "clock"), ("ch1", "hits")]
    assert isinstance(found.clock, Candidate)
    assert len(prepare(record, **found.settings).responses) == 3


def test_pulses_that_do_not_stand_out_are_told_and_not_proposed(tmp_path):
    _, (x, y) = struck((0.0,))
    rows = {Channel(name="x", unit="m"): x, Channel(name="y", unit="m"): y, Channel(name="tach", unit="V"): pulses(1.0)}
    text = " ".join(typed(["info", str(saved(tmp_path / "run.npz", rows))]).split())
    assert "Possible clock: tach, its quantity is pulse; its name has the word 'tach'. It must hold pulses that" in text
    assert "--tach tach" not in text
    assert "--estimate-period" in text
    assert "Of a rotor: --period is 60 over the speed in rpm" in text


def test_a_response_that_lasts_is_ambient(tmp_path):
    x, y = ambient()
    rows = {Channel(name="x", unit="m"): x, Channel(name="y", unit="m"): y}
    path = saved(tmp_path / "run.npz", rows)
    text = " ".join(typed(["info", str(path)]).split())
    assert "Excitation: the response does not decay, and its energy is spread over many frequencies." in text
    assert "Next, with the period of the system [s]: floquid identify" in text
    assert "--excitation ambient --period S" in text
    rows[Channel(name="tach", unit="V")] = pulses()
    assert next_of(saved(path, rows)).endswith("--excitation ambient --tach tach")


def test_voltages_with_noise_that_was_injected(tmp_path):
    x, y = ambient()
    noise = np.random.default_rng(5).standard_normal(SAMPLES)
    rows = {Channel(name="i", unit="A"): x, Channel(name="v", unit="V"): y, Channel(name="source", unit="V"): noise}
    record = Record(values=list(rows.values()), sample_rate=RATE, channels=list(rows))
    found = propose(record)
    assert found.settings == {"inputs": ("source",)}
    assert [own.why for own in found.of_use("input")] == ["its spectrum is flat, as that of injected noise"]


def test_a_grid_and_a_steady_speed_are_the_period(tmp_path):
    generator = np.random.default_rng(6)
    waves = 325.0 * np.cos(2 * np.pi * 50.0 * TIMES + np.array([[0.0], [2.1], [4.2]]))
    rows = {Channel(name=f"v{k}", unit="V"): wave + generator.standard_normal(SAMPLES) for k, wave in enumerate(waves)}
    assert next_of(saved(tmp_path / "grid.npz", rows)).endswith("--frequency 50")
    speed = 1500.0 + 0.01 * generator.standard_normal(SAMPLES)
    rows = {Channel(name="x", unit="mm"): struck((0.0,))[1][0], Channel(name="RotSpeed", unit="rpm"): speed}
    command = shlex.split(next_of(saved(tmp_path / "turbine.npz", rows)))
    assert command[-5:-2] == ["--channels", "x", "--period"]
    assert float(command[-2]) == pytest.approx(0.04, rel=1e-5)
    assert command[-1] == "--estimate-period"


def test_the_speed_of_a_file_is_its_period(tmp_path):
    """Not one to be found from the response: `floquid survey` takes it so, too."""
    record = fq.Record(values=np.ones((2, 40)), sample_rate=10.0, channels=["x", "y"], point={"speed_rpm": 1500.0})
    fq.write(record, tmp_path / "run.npz")
    text = typed(f"info {tmp_path / 'run.npz'}")
    assert "--period 0.04" in text
    assert "--estimate-period" not in text
    assert "That is a revolution at speed_rpm = 1500. Halve it" in text


def test_a_speed_that_runs_away_is_no_period(tmp_path):
    rows = {Channel(name="x", unit="mm"): struck((0.0,))[1][0], Channel(name="n", unit="rpm"): 900.0 + 100.0 * TIMES}
    text = typed(["info", str(saved(tmp_path / "run.npz", rows))])
    assert "Possible clock: n, its unit is rpm. " in text
    assert "--period 0" not in text


def test_json_has_all_that_the_text_has(hammer):
    found = json.loads(typed(["info", str(hammer), "--format", "json"]))
    assert found["format"] == "floquid-info/1"
    assert [channel["name"] for channel in found["channels"]] == ["ch1", "x", "y", "ch4"]
    assert (found["channels"][1]["quantity"], found["channels"][1]["unit"]) == ("acceleration", "m/s^2")
    assert (found["sample_rate"], found["n_samples"], found["duration"]) == (RATE, SAMPLES, 12.0)
    assert found["time_axis"] == ["Sampling rate 400 Hz: as the file states."]
    clock, hits = found["candidates"]
    assert (clock["name"], clock["use"], clock["options"]) == ("ch4", "clock", "--tach ch4")
    assert (hits["name"], hits["use"], hits["impacts"], hits["options"]) == ("ch1", "hits", 3, "--find-hits")
    assert found["next"]["command"] == next_of(hammer).removeprefix("Next: ")
    assert found["next"]["complete"] is True
    assert "add --periods-per-rev: 2 of an asymmetric shaft" in found["next"]["hints"][0]
    assert found["settings"] == {"channels": ["x", "y"], "find_hits": True, "tach": "ch4"}


def test_json_of_a_file_without_a_rate(here):
    (here / "run.csv").write_text("x [m],rpm [rpm]\n1,2\n2,1\n")
    found = json.loads(typed("info run.csv --format json"))
    assert found["sample_rate"] is None
    assert found["time_axis"] == ["No sampling rate in the file: pass `--rate` [Hz] to read it."]
    assert found["next"] == {"command": "floquid info run.csv --rate HZ", "complete": False, "hints": []}


def test_a_result_is_told_with_what_starts_from_it(tmp_path):
    record = fq.systems.JeffcottRotor().simulate(n_periods=30, noise=0.01, seed=1).select(["X", "Y"])
    fq.save(fq.identify(record, order=4, validate=False), tmp_path / "result.h5")
    for place in (tmp_path, tmp_path / "result.h5"):
        first, *following = typed(["info", str(place)]).splitlines()
        assert first.startswith(f"{place}: a result of `floquid identify`, 2 modes of 2 channels, period ")
        assert following[0] == f"Next: floquid report {place}"
        for line in following[1:]:
            assert run(line.removeprefix("  or floquid ").replace("modes.csv", str(tmp_path / "m.csv")).split()) == 0
        found = json.loads(typed(["info", str(place), "--format", "json"]))
        assert found["next"]["command"] == f"floquid report {place}"


def test_names_may_be_given(tmp_path):
    fq.write(fq.Record(values=np.eye(2, 20), sample_rate=10.0, channels=["x", "y"]), tmp_path / "run.npz")
    text = typed(["info", str(tmp_path / "run.npz"), "--names", "hip,knee"])
    assert [line.split()[0] for line in text.splitlines()[2:4]] == ["hip", "knee"]
    assert " --names hip,knee " in text
