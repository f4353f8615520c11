"""Modes with inputs: right kind, right order, harmonics by which they are reached, and none that is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import Driven, flapping, mathieu, paper_rotor, pulls, record_of, two_masses

from floquid import Channel, ConstantPeriod, IdentificationError, InputError, PeriodicModel, Record, identify
from floquid.checks._check import is_undetermined
from floquid.pipeline import predicted_rest

NAMES = {"unit": "m"}, {"unit": "N"}


def identified(system, periods, phases, noise, seed=0, **options):
    values, inputs = record_of(
        system, periods, phases, noise, seed, options.pop("inputs", None), options.pop("start", None)
    )
    return identify(record(system, values, inputs, phases), period=system.period, inputs=named(inputs), **options)


def named(inputs):
    return [f"F{number}" for number in range(len(inputs))]


def record(system, values, inputs, phases):
    channels = [Channel(name=f"y{n}", **NAMES[0]) for n in range(len(values))]
    channels += [Channel(name=name, **NAMES[1]) for name in named(inputs)]
    return Record(values=np.concatenate([values, inputs]), sample_rate=phases / system.period, channels=channels)


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [4, 20, 6])
def test_a_short_record_of_many_outputs(outputs):
    seen, system = np.random.default_rng(1).standard_normal((outputs, 4)), two_masses()
    system = replace(system, B=lambda t, b=system.B: b(t)[:, :1], C=lambda _: seen)
    found = identified(system, 15, 20, 0.02, seed=1)
    assert found.model.order == 4
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.slow
def test_two_records_of_one_blow_each():
    """The inputs are zero at most lags: what is left of their products is rounding."""
    system, records = two_masses(), []
    for number in range(2):
        inputs = np.zeros((2, 60 * 40))
        inputs[number, 45:51] = 50.0 * np.sin(np.pi * (np.arange(6) + 0.5) / 6)
        values, _ = record_of(system, 60, 40, 0.01, number, inputs)
        records.append(record(system, values, inputs, 40))
    found = identify(records, period=system.period, inputs=named(inputs))
    assert found.model.order == 4
    assert pulls(system, found.model).max() < 4.0


def test_a_record_without_noise_ends_and_is_right():
    found = identified(mathieu(), 60, 20, 0.0)
    assert found.model.order == 2
    assert found.passed
    assert pulls(mathieu(), found.model).max() < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "offset"), [(1, 1.1e6), (0, 1e6)])
def test_an_offset_however_large_is_no_mode_and_no_reason_for_more_noise(seed, offset):
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.02, seed)
    alone, beside = (
        identify(record(system, values + by, inputs, 20), period=system.period, inputs=named(inputs))
        for by in (0.0, offset * values.std())
    )
    assert beside.passed
    assert beside.model.exponent_std == pytest.approx(alone.model.exponent_std, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [-0.01, -0.0125, -0.03])
def test_a_mode_that_grows_by_several_nepers_passes(damping):
    """By 3.6 to 11: a fit that begins below three goes on beyond, and what is left out is predicted."""
    values, force = record_of(mathieu(damping=damping), 80, 16, 0.01, 0)
    record = Record(values=np.concatenate([values, force]), sample_rate=16 / np.pi, channels=["y", "u"])
    found = identify(record, period=np.pi, inputs=["u"])
    assert found.passed
    assert pulls(mathieu(damping=damping), found.model).max() < 4.0
    predicted, fitted = predicted_rest(found)
    error = (values - predicted)[:, ~fitted]
    assert error.std() < 0.1 * values[:, ~fitted].std()


@pytest.mark.slow
def test_two_outputs_two_inputs_and_a_frame_that_turns():
    system = two_masses()
    found = identified(system, 60, 24, 0.02)
    assert found.model.order == 4
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.slow
def test_two_real_negative_multipliers_that_die_within_a_period():
    system = flapping()
    found = identified(system, 120, 24, 0.005)
    assert found.model.real.sum() == 2
    assert found.model.order == 2
    assert (found.model.multipliers.real < 0.0).all()
    assert pulls(system, found.model)[:, 0].max() < 4.0


@pytest.mark.slow
def test_the_mode_missed_least_is_told_with_its_distance_from_noise():
    told = {}
    for noise in (0.3, 0.6):
        found = identified(two_masses(), 60, 24, noise)
        (told[noise],) = (one.numbers for one in found.findings if one.code == "all_needed")
        assert told[noise]["number"] == 2
        assert np.abs(found.model.frequencies_hz - told[noise]["frequency"]).min() < 1e-9
    assert told[0.3]["rise"] / told[0.6]["rise"] == pytest.approx(4.0, rel=0.1)


def test_a_direct_term():
    system = mathieu(direct=0.7)
    found = identified(system, 80, 20, 0.01)
    own = found.model.inputs
    assert own.direct_harmonics.tolist() == [0]
    assert own.direct[0, 0, 0] == pytest.approx(0.7, abs=0.01)
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.slow
def test_a_free_decay_after_a_measured_blow():
    system = mathieu()
    blow = np.zeros((1, 40 * 24))
    blow[0, 5:8] = [3.0, 8.0, 2.0]
    found = identified(system, 40, 24, 0.01, inputs=blow)
    assert found.model.order == 2
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.slow
def test_several_records_of_one_system():
    system = mathieu()
    records = []
    for seed, start in ((1, None), (2, [0.5, -0.2])):
        values, inputs = record_of(system, 25, 20, 0.03, seed, start=start)
        records.append(record(system, values, inputs, 20))
    found = identify(records, period=system.period, inputs=["F0"], validate=False)
    assert found.model.order == 2
    assert found.model.inputs.initial.shape == (2, 2)
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.slow
def test_first_states_of_negative_multipliers_are_those_at_the_phase_where_a_record_begins():
    system = Driven(
        A=lambda t: np.array([[0.0, 1.0], [-(1.0 - 0.96 * np.cos(2.0 * t)), -0.48]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )
    values, inputs = record_of(system, 60, 20, 0.0, 0, start=[3.0, -2.0])
    noisy = values + 0.01 * values.std() * np.random.default_rng(1).standard_normal(values.shape)
    begin, step = 27, np.pi / 20
    late = Record(
        values=np.concatenate([noisy, inputs])[:, begin:],
        sample_rate=1.0 / step,
        start=begin * step,
        channels=record(system, values, inputs, 20).channels,
        clock=ConstantPeriod(period=np.pi),
    )
    model = identify(late, inputs=["F0"]).model
    assert model.real.all()
    assert (model.multipliers.real < 0.0).all()
    assert model.inputs is not None
    first = model.shapes([begin * step])[:, 0, 0, 0] @ model.inputs.initial[:, 0]
    assert first == pytest.approx(values[0, begin], abs=0.1 * values.std())


@pytest.mark.slow
def test_an_orbit_beside_the_inputs_is_no_mode():
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.02, 3)
    times = np.arange(values.shape[1]) * system.period / 20
    values = values + 5.0 * values.std() * np.cos(2.0 * times + 0.3)
    found = identify(record(system, values, inputs, 20), period=system.period, inputs=["F0"])
    assert found.model.order == 2
    assert pulls(system, found.model).max() < 4.0
    assert "steady_beside_inputs" in [own.code for own in found.findings]


@pytest.mark.slow
def test_a_line_of_the_mains_fails():
    """It came out as a mode that hardly decays, and passed."""
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.01, 4)
    times = np.arange(values.shape[1]) * system.period / 20
    line = 0.5 * values.std() * np.cos(0.35 * times + 1.0)
    found = identify(record(system, values + line, inputs, 20), period=system.period, inputs=["F0"])
    assert [own.numbers["frequencies"] for own in found.findings if own.code == "unreached"] == [
        (pytest.approx(0.35 / (2.0 * np.pi), rel=1e-3),)
    ]
    assert not found.passed


def test_a_mode_that_no_input_reaches_is_named():
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.01, 4)
    times = np.arange(values.shape[1]) * system.period / 20
    ringing = 3.0 * values.std() * np.exp(-0.02 * times) * np.cos(0.35 * times)
    found = identify(record(system, values + ringing, inputs, 20), period=system.period, inputs=["F0"])
    assert found.model.order == 4
    assert [own.code for own in found.findings if own.code == "unreached"] == ["unreached"]
    assert " by none" in found.summary()
    assert "inputs_poor" not in [own.code for own in found.findings]
    assert "No measured input reaches the mode" in found.warnings[0]


@pytest.mark.slow
@pytest.mark.parametrize(("outputs", "forces"), [(1e-9, 1e6), (1e6, 1.0), (1e-9, 1.0), (1.0, 1e6), (1.0, 1e-9)])
def test_units_change_nothing(outputs, forces):
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.02, 0)
    own, other = (
        identify(record(system, a * values, b * inputs, 20), period=system.period, inputs=["F0"])
        for a, b in ((1.0, 1.0), (outputs, forces))
    )
    assert other.passed
    assert other.model.exponents == pytest.approx(own.model.exponents, rel=1e-5)
    assert other.transfer([0.2]).values == pytest.approx(own.transfer([0.2]).values * outputs / forces, rel=1e-4)


@pytest.mark.first(1)
@pytest.mark.parametrize(("off", "told"), [(0.0, False), (3e-4, True), (-3e-4, True)])
def test_a_period_that_is_a_little_off_is_told(off, told):
    system = mathieu()
    values, inputs = record_of(system, 60, 20, 0.02, 0)
    given = system.period * (1.0 + off)
    found = identify(record(system, values, inputs, 20), period=given, inputs=["F0"])
    own = [finding for finding in found.findings if finding.code == "wrong_period"]
    assert bool(own) == told
    assert found.passed == (not told)
    if told:
        assert abs(own[0].numbers["own"] - system.period) < 0.2 * abs(off) * system.period


@pytest.mark.slow
def test_a_copy_of_a_mode_that_makes_up_for_harmonics_not_looked_for_does_not_pass():
    found = identified(mathieu(), 60, 20, 0.01, seed=3, harmonics=1)
    assert found.model.order > 2
    assert found.validation.passed
    assert not found.passed
    assert "`harmonics=`" in found.warnings[0]


def test_limits_at_which_a_search_ends_are_told(monkeypatch):
    monkeypatch.setattr("floquid.pipeline.excited._identify.HIGHEST", 2)
    found = identified(mathieu(), 60, 20, 0.01, seed=3)
    assert found.model.order == 2
    assert any("as many harmonics as were looked for (2)" in text for text in found.warnings)
    # Those of one order more are fitted for what they do to the deviations, and are noise.
    monkeypatch.setattr("floquid.pipeline.excited._identify.HIGHEST", 3)
    found = identified(mathieu(), 60, 20, 0.01, seed=3)
    assert found.model.harmonics.max() == 3
    assert not found.warnings


def test_noise_alone_has_no_mode():
    system = mathieu()
    generator = np.random.default_rng(5)
    values, inputs = generator.standard_normal((2, 1, 1200))
    with pytest.raises(IdentificationError, match="no mode rises above the noise, driven by the inputs"):
        identify(record(system, values, inputs, 20), period=system.period, inputs=["F0"])


def test_states_that_are_no_motions_are_refused_before_the_search(monkeypatch):
    monkeypatch.setattr("floquid.pipeline.excited._identify.searched", lambda *_, **__: pytest.fail("searched"))
    values, inputs = record_of(mathieu(), 20, 20, 0.02, 0)
    given = record(mathieu(), values, inputs, 20)
    strains = replace(given, channels=[Channel(name="y0", quantity="strain"), given.channels[1]])
    with pytest.raises(InputError, match="channels of displacement, velocity or acceleration"):
        identify(strains, period=np.pi, inputs=["F0"], states=["y0"])


def test_an_input_that_repeats_with_the_period_is_refused():
    system = mathieu()
    repeated = np.tile(np.random.default_rng(1).standard_normal((1, 20)), 60)
    with pytest.raises(IdentificationError, match="repeats with the period of the system"):
        identified(system, 60, 20, 0.01, inputs=repeated)


def test_inputs_that_are_copies_are_refused():
    system = two_masses()
    one = np.random.default_rng(1).standard_normal((1, 40 * 24))
    with pytest.raises(IdentificationError, match="copies or sums of one another"):
        identified(system, 40, 24, 0.01, inputs=np.concatenate([one, 2.0 * one]))


def test_an_input_that_never_changes_is_refused():
    with pytest.raises(IdentificationError, match="never changes"):
        identified(mathieu(), 40, 20, 0.01, inputs=np.ones((1, 800)), start=[1.0, 0.0])


def test_few_periods_are_refused():
    with pytest.raises(IdentificationError, match="too few"):
        identified(mathieu(), 5, 20, 0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"inputs": ["G"]}, "`inputs` of `identify`"),
        ({"inputs": ["F0"], "hold": "second"}, "`hold` of `Settings`"),
        ({"inputs": ["F0", "y0"]}, "`inputs` of `identify`"),
        ({"inputs": ["F0"], "constrained": False}, "`constrained` of `identify` must be left as it is"),
        ({"inputs": ["F0"], "harmonics": 10}, "`harmonics` of `identify` must be less than half"),
    ],
)
def test_what_is_not_possible_is_named(options, words):
    system = mathieu()
    values, inputs = record_of(system, 20, 20, 0.01, 0)
    with pytest.raises(InputError, match=words):
        identify(record(system, values, inputs, 20), period=system.period, **options)


@pytest.mark.slow
def test_a_measured_angle_is_followed_where_the_speed_wanders():
    periods, phases, fixed = 60, 12, mathieu()
    step, count = fixed.period / phases, periods * phases

    def angle(t):
        return 2.0 * t + 0.3 * np.sin(8.0 * np.pi * t / (count * step))  # of mean 2 over the record

    # One period as long as the record: the equations are integrated as they are.
    wandering = replace(
        fixed,
        A=lambda t: np.array([[0.0, 1.0], [-(2.0 - np.cos(angle(t))), -0.1 * np.sqrt(2.0)]]),
        period=count * step,
    )
    generator = np.random.default_rng(0)
    inputs = generator.standard_normal((1, count))
    values = wandering.response(inputs, count)
    values += 0.1 * values.std() * generator.standard_normal(values.shape)
    turned = np.degrees(angle(step * np.arange(count))) % 360.0
    channels = ["y", Channel(name="F", unit="N"), "shaft"]
    own = Record(values=np.concatenate([values, inputs, turned[None]]), sample_rate=1.0 / step, channels=channels)
    found = identify(own, azimuth="shaft", inputs=["F"])
    assert found.passed
    assert found.model.order == 2
    assert pulls(fixed, found.model).max() < 4.0
    constant = identify(own.select(["y", "F"]), period=fixed.period, inputs=["F"])
    assert not constant.passed or pulls(fixed, constant.model).max() > 5.0


@pytest.mark.parametrize(
    ("exponents", "spread", "told"),
    [
        ((-2.9 + 84.0j, -2.9 - 84.0j), 0.01, False),
        ((-10.9 + 28.2743338823j, -10.6 + 28.2743338823j), 6.0, True),
        ((-10.9, -5.0), 0.5, False),
        ((-0.01,), 0.02, False),
        ((-300.0 + 5.0j, -300.0 - 5.0j), 20.0, False),
        ((-30.0 + 5.0j, -30.0 - 5.0j), 20.0, True),
    ],
    ids=["a pair", "two that make up for one another", "two", "a slow one", "one gone at once", "a guess"],
)
def test_modes_whose_decay_is_not_determined(exponents, spread, told):
    count = len(exponents)
    model = PeriodicModel(
        exponents=exponents,
        coefficients=np.ones((count, 1, 1, 1)),
        harmonics=[0],
        period=2.0 * np.pi / 56.5486677646,
        channels=["y"],
        covariance=np.diag([spread**2] * count + [0.0] * count),
    )
    std = model.exponent_std.real
    assert is_undetermined(std, model.exponents.real, model.period).any() == told


def test_one_input_of_two_that_repeats_is_refused_by_its_name():
    system = two_masses()
    values, inputs = record_of(system, 60, 24, 0.02, 0)
    inputs[1] = np.cos(2.0 * np.pi * np.arange(inputs.shape[1]) / 24)
    with pytest.raises(IdentificationError, match="Input 'F1' repeats"):
        identify(record(system, values, inputs, 24), period=system.period, inputs=["F0", "F1"])


@pytest.mark.slow
def test_a_fit_that_ended_beside_the_least_is_made_afresh():
    """Of twenty short records of the paper's rotor one: twelve harmonics of an input made up for its phase."""
    found = identified(paper_rotor(), 32, 50, 0.02, 16, validate=False)
    assert found.model.order == 4
    assert max(len(mode.reach) for mode in found.fit.at.modes) <= 7
    assert pulls(paper_rotor(), found.model).max() < 4.0
