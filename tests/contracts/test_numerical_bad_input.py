"""Records that are not what they seem: right within the stated deviations, doubted, or refused, never wrong in silence.

The table is that of `examples/bad_records`, which the guide shows. pytest makes errors of warnings, numpy's too.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.cli.conftest import after_stages

from floquid.cli import run
from floquid.readers import write

EXAMPLE = Path(__file__).parents[2] / "examples" / "bad_records"
sys.path.insert(0, str(EXAMPLE))
from bad_records import MOST, NOISE, RECORDS, noise, record, response, told, worst  # noqa: E402

import floquid as fq  # noqa: E402

ROWS = [pytest.param(bad, id=bad.name, marks=[pytest.mark.slow] if bad.slow else []) for bad in RECORDS]
OF = {name: next(bad for bad in RECORDS if bad.name == name) for name in (bad.name for bad in RECORDS)}

TYPED = [
    ("nothing is wrong", 0),
    ("a channel of a constant, as sampled", 2),
    ("a channel of 1e200, as sampled", 2),
    ("a channel of subnormal numbers, as sampled", 2),
    ("integers that wrapped round", 2),
    ("one hit given twice, in other units", 2),
    ("an orbit and no free response, as sampled", 1),
    ("a random walk", 1),
    ("three periods", 1),
    ("more poles than modes", 1),
]
"""Rows that are typed as a command, and its exit code with --enforce."""


def test_names_are_distinct():
    assert len(OF) == len(RECORDS)


@pytest.mark.first(8)  # the build of the site looks at every row
@pytest.mark.parametrize("bad", ROWS)
def test_right_doubted_or_refused(bad):
    answer, words, deviations = told(bad)
    assert answer == bad.answer, words
    assert bad.words in words
    if answer == "modes":
        assert deviations < MOST


@pytest.mark.first(4)
@pytest.mark.parametrize(("name", "code"), TYPED, ids=[name for name, _ in TYPED])
def test_typed_as_a_command(name, code, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    bad = OF[name]
    made = bad.make()
    for number, one in enumerate([made] if isinstance(made, fq.Record) else made):
        write(one, f"{number}.npz")
    files = sorted(path.name for path in tmp_path.iterdir())
    options = [word for key, value in bad.settings.items() for word in (f"--{key}", str(value))]
    assert run(["identify", *files, *options, "--enforce"]) == code
    printed = capsys.readouterr()
    assert not re.search("Traceback|Unexpected|Warning:", printed.err)
    if code:
        said = after_stages(printed.err)
        assert said.startswith("floquid: ")
        assert bad.words in said.replace("`--", "").replace("\n", " ") or bad.words in printed.out


@pytest.mark.first(2)
@pytest.mark.parametrize("kind", ["white", "red", "peaked", "walk"])
@pytest.mark.parametrize("channels", [1, 4])
def test_noise_alone_is_no_mode_whatever_the_seed(kind, channels):
    """Before: 11 of 20 random walks in one channel passed as slow modes."""
    for seed in range(6):
        with pytest.raises(fq.IdentificationError, match=r"no mode rises above the noise|is random"):
            fq.identify(noise(kind, channels, 16, seed=seed)())


def pulls(change, draws=20):
    """The errors of the decay in deviations (draws,), of records that are changed."""
    found = []
    for seed in range(draws):
        model = fq.identify(record(change(response(seed=seed, exponents=(-0.03 + 0.7j,)))), validate=False).model
        own = int(np.argmin(np.abs(model.exponents - (-0.03 + 0.7j))))
        found.append((model.exponents[own].real + 0.03) / model.exponent_std[own].real)
    return np.array(found)


@pytest.mark.slow
def test_what_is_left_out_would_have_made_deviations_too_small(monkeypatch):
    """A channel three more times, in other units: its errors are what they were, its deviations are not."""
    monkeypatch.setattr("floquid.pipeline._identify.look_for_sums", lambda prepared: None)
    monkeypatch.setattr("floquid.pipeline.free._doubts._sum_of_others", lambda analysis: None)
    copies = pulls(lambda v: np.concatenate([v, 2.0 * v[:1], 3.0 * v[:1], 4.0 * v[:1]]))
    assert 0.6 < pulls(lambda v: v).std() < 1.4
    assert copies.std() > 1.4


def with_quantised_copy():
    """Two loggers at one sensor: what the second rounds differently is a hundredth of the noise."""
    v = response()
    step = 0.1 * NOISE * np.abs(v[0]).max()
    return record(np.concatenate([v, step * np.round(v[:1] / step)]))


def test_a_quantised_copy_in_a_given_order_is_a_warning():
    """Too low an order leaves modes in the noise, alike in independent channels: then it is said, and kept."""
    analysis = fq.identify(with_quantised_copy(), order=4)
    assert any("deviations are too small. Leave it out" in word for word in analysis.warnings)
    assert len(analysis.model.channels) == 3


def test_a_quantised_copy_is_left_out_too():
    analysis = fq.identify(with_quantised_copy())
    assert [channel.name for channel in analysis.model.channels] == ["X", "Y"]
    assert "Channel 'Z' was left out: it is 1 times channel 'X', noise included" in analysis.warnings[0]
    assert worst(analysis.model, OF["nothing is wrong"].truth) < MOST


def test_a_sum_that_is_one_of_the_states_is_refused():
    with pytest.raises(fq.InputError, match=r"Argument `states` of `identify` must be independent measurements"):
        fq.identify(OF["the sum of two channels"].make(), states=("X", "Z"))


@pytest.mark.parametrize("settings", [{"excitation": "ambient"}, {"inputs": ("f",)}], ids=["alone", "inputs"])
def test_three_phases_that_add_up_to_zero_are_found_at_once(settings, monkeypatch):
    """The first is said before any search, whatever kind of record: the chain is given two of three phases."""
    draws = np.random.default_rng(0)
    both, force = draws.standard_normal((2, 4000)), draws.standard_normal((1, 4000))
    phases = np.concatenate([both, -both.sum(axis=0, keepdims=True), force])
    given = fq.Record(values=phases, sample_rate=1e3, channels=["a", "b", "c", "f"])
    names = list[str]()

    def chain(prepared, report):
        names.extend(channel.name for channel in prepared.responses[0].channels)
        raise fq.IdentificationError("seen")

    kind = "inputs" if "inputs" in settings else "ambient"
    channels = () if kind == "inputs" else ("a", "b", "c")
    monkeypatch.setattr("floquid.pipeline._identify.CHAINS", {kind: chain})
    with pytest.raises(
        fq.IdentificationError, match="Channel 'c' was left out: it is -1 times channel 'a' and -1 times"
    ):
        fq.identify(given, period=0.012, channels=channels, **settings)
    assert names == ["a", "b"]


@pytest.mark.slow
def test_channels_that_modes_without_noise_make_sums_of_are_kept():
    """Twelve terms make thirteen of 24 channels sums of the others, but none of noise."""
    values = response(channels=24, noise=0.0)
    given = fq.Record(values=values, sample_rate=6.0, channels=[f"c{k}" for k in range(24)])
    assert len(fq.identify(given, period=2.0).model.channels) == 24


@pytest.mark.slow
def test_channels_that_share_half_of_their_noise_are_let_pass():
    v = response()
    own = NOISE * np.abs(v[0]).max() * np.random.default_rng(5).standard_normal(v.shape[1])
    found = fq.identify(record(np.concatenate([v, v[:1] + own])))
    assert worst(found.model, OF["nothing is wrong"].truth) < MOST


@pytest.mark.parametrize("records", [None, 3, "run.npz", [], [1]])
def test_no_record_at_all(records):
    with pytest.raises(fq.InputError, match=r"`records` of `identify` must be a Record or a list of them"):
        fq.identify(records)


def test_what_is_wrong_with_the_samples_is_said_of_a_refusal_too():
    """Clipped so hard that nothing is found: the clipping is said all the same."""
    v = np.random.default_rng(0).standard_normal((2, 480)).clip(-0.5, 0.5)
    with pytest.raises(fq.IdentificationError, match=r"(?s)no mode rises above .*'X' is clipped at -0.5 and 0.5"):
        fq.identify(record(v))


def struck(*, ambient, own, common=0.0, second=0.5, seed=0):
    """A mode of 3.1 Hz seen by two sensors: struck, shaken a little by its surroundings, and measured with noise."""
    rate, n, rest = 64.0, 1024, np.random.default_rng(seed)
    pole = np.exp((-0.01 + 1j) * 2.0 * np.pi * 3.1 / rate)
    force = ambient * np.sqrt(1.0 - abs(pole) ** 2) * rest.standard_normal(n)
    force[0] = 1.0
    motion = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], force)
    motion /= np.abs(motion).max()
    values = np.array([motion, second * motion]) + common * rest.standard_normal(n)
    values += own * rest.standard_normal((2, n))
    return fq.Record(values=values, sample_rate=rate, channels=["a", "b"], clock=fq.ConstantPeriod(period=0.25))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_decay_in_noise_that_the_structure_makes_itself_is_no_noise(seed):
    """There the noise has its peak where the mode is. It is said, and not taken for the mode."""
    found = fq.identify(struck(ambient=0.02, own=5e-4, seed=seed))
    assert np.abs(np.abs(found.model.exponents.imag) / (2.0 * np.pi) - 3.1).min() < 0.05


@pytest.mark.slow
def test_sensors_that_share_most_of_their_noise_are_warned_of_and_kept():
    found = fq.identify(struck(ambient=0.0, own=5e-4, common=0.01, second=1.0))
    assert any("deviations are too small" in words for words in found.warnings)
    assert len(found.model.channels) == 2
    found = fq.identify(struck(ambient=0.0, own=5e-5, common=0.01, second=1.0))
    assert len(found.model.channels) == 1
    assert "noise included" in found.warnings[0]
