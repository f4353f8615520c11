"""What a model would take up without a word: other instants, other forces, and a system that is not linear."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt
from tests.driven import creeping, mathieu, pulls, record_of

from floquid import Record, identify
from floquid.checks._driving import _by_powers
from floquid.fit import SURE, chi2_limit
from floquid.inputs import Scores, bare_mode, chosen_together, samples_of, solve

PHASES, PERIODS, WARM = 20, 40, 20


def identified(values, inputs, period, **options):
    names = [f"y{number}" for number in range(len(np.atleast_2d(values)))]
    record = Record(values=np.vstack([values, inputs]), sample_rate=PHASES / period, channels=[*names, "u"])
    return identify(record, period=period, inputs=["u"], **options)


def codes(found):
    return {own.code for own in found.findings if own.severity.name != "NOTE"}


@pytest.mark.parametrize(
    ("moved", "hold", "words"), [(1, "zero", "came one sample earlier"), (0, "first", 'use `hold="zero"`')]
)
def test_inputs_at_other_instants_are_named(moved, hold, words):
    system = mathieu()
    values, inputs = record_of(system, PERIODS, PHASES, 0.02, 0)
    found = identified(values, np.roll(inputs, moved, axis=1), system.period, hold=hold)
    assert not found.passed
    assert any(words in text for text in found.warnings)


@pytest.mark.first(1)
@pytest.mark.parametrize(("moved", "seed"), [(1, 6), (-1, 1)])
def test_short_and_noisy_records_do_not_take_up_a_delay_without_a_word(moved, seed):
    system = mathieu()
    values, inputs = record_of(system, 30, PHASES, 0.05, seed)
    found = identified(values, np.roll(inputs, moved, axis=1), system.period)
    assert codes(found) == {"inputs_instants"}
    assert ("came one sample earlier" if moved > 0 else "came one sample later") in found.warnings[0]
    assert not found.passed


@pytest.mark.slow
def test_two_real_multipliers_that_may_be_a_pair_are_told():
    # From 0.0142 on both come so near each other that rounding decides whether their decays are determined.
    system = creeping(0.01415)
    assert np.isreal(system.exponents()).all()
    open_, clear = (
        identified(*record_of(creeping(own), 60, PHASES, 0.05, 0), system.period) for own in (0.01415, 0.0155)
    )
    assert codes(open_) == {"inputs_untold"}
    notes = [{finding.code for finding in own.findings} for own in (open_, clear)]
    assert ["kind_open" in own for own in notes] == [True, False]
    assert pulls(creeping(0.0155), clear.model).max() < 4.0


def test_outputs_too_noisy_to_show_the_first_samples_of_an_answer_do_not_tell_the_instants():
    system = mathieu()
    values, inputs = record_of(system, 30, PHASES, 0.5, 1)
    found = identified(values, inputs, system.period)
    assert codes(found) == {"inputs_untold"}
    assert "b would differ by" in found.warnings[0]


@pytest.mark.first(1)
@pytest.mark.parametrize("hold", ["zero", "first"])
def test_a_smooth_force_does_not_tell_what_it_is_between_the_samples(hold):
    """A direct term takes up half a sample: G was a tenth off, and nothing said so."""
    system, fine = mathieu(), 16
    force = np.random.default_rng(1).standard_normal((1, PERIODS * PHASES * fine))
    force = sosfiltfilt(butter(6, 0.5 / fine, output="sos"), force)
    values, _ = record_of(system, PERIODS, PHASES * fine, 0.01, 1, force)
    found = identified(values[:, ::fine], force[:, ::fine], system.period, hold=hold)
    told = [own.numbers for own in found.findings if own.code == "inputs_untold"]
    assert [(own["delay"], own["given"]) for own in told] == [(0, hold)]
    assert told[0]["share"] == pytest.approx(0.107, rel=0.01)  # half a sample at 1.36 rad/s
    assert any("linear between samples" in text for text in found.warnings)


@pytest.mark.first(1)
@pytest.mark.parametrize(("direct", "seed"), [(0.0, 10), (1.0, 1), (0.0, 1)])
def test_inputs_as_they_are_said_are_not(direct, seed):
    """Noise brings a direct term in at the seed 10."""
    system = mathieu(direct)
    values, inputs = record_of(system, PERIODS, PHASES, 0.02, seed)
    found = identified(values, inputs, system.period)
    assert found.passed
    assert not codes(found)


def hardening(steady, seed):
    """The response of Mathieu's equation with a spring that hardens, to the inputs beside it; a steady force, too."""
    system, spring = mathieu(), 0.02
    generator = np.random.default_rng(seed)
    inputs, step = generator.standard_normal(PERIODS * PHASES), system.period / PHASES
    state, values = np.zeros(2), []
    for number, force in enumerate(np.concatenate([np.zeros(WARM * PHASES), inputs])):
        values.append(state[0])

        def rates(t, x, force=force):
            own = steady * (1.0 + np.cos(2.0 * t) + 0.5 * np.sin(4.0 * t))
            return system.A(t) @ x + np.array([0.0, force + own - spring * x[0] ** 3])

        for t in step * (number + np.array([0.0, 0.5])):  # Runge and Kutta's steps, two a sample
            k1 = rates(t, state)
            k2 = rates(t + 0.25 * step, state + 0.25 * step * k1)
            k3 = rates(t + 0.25 * step, state + 0.25 * step * k2)
            k4 = rates(t + 0.5 * step, state + 0.5 * step * k3)
            state = state + step / 12.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    values = np.array(values[WARM * PHASES :])
    return values + 0.02 * np.std(values) * generator.standard_normal(len(values)), inputs


@pytest.mark.first(1)
@pytest.mark.parametrize(("steady", "seed", "late"), [(0.0, 1, True), (1.0, 5, False), (0.0, 1, False)])
def test_a_spring_that_hardens_is_named(steady, seed, late):
    """Beside a steady response, too: its product with squares of the rest tells more than the rest alone."""
    values, inputs = hardening(steady, seed)
    found = identified(values, np.roll(inputs, -1) if late else inputs, mathieu().period)
    assert not found.passed
    assert "inputs_nonlinear" in codes(found)
    assert "inputs_noise" not in codes(found)
    assert ("inputs_instants" in codes(found)) == late


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, pytest.param(7, marks=pytest.mark.slow)])
def test_noise_on_an_input_is_told_of_many_outputs_too(seed):
    """Squares gain by chance the more the more outputs there are, and kept that noise from being told."""
    system = mathieu()
    seen = np.random.default_rng(0).standard_normal((8, 2))
    system = replace(system, C=lambda _: seen)
    values, inputs = record_of(system, PERIODS, PHASES, 0.02, seed)
    noise = 0.003 * inputs.std() * np.random.default_rng(100 + seed).standard_normal(inputs.shape)
    found = identified(values, inputs + noise, system.period)
    assert "inputs_noise" in codes(found)
    assert "inputs_nonlinear" not in codes(found)


def test_squares_of_a_steady_response_are_no_harmonics_that_were_not_kept():
    """Of a linear system, its outer harmonics left out: products of a large steady response and the rest have them."""
    system, narrow = mathieu(), np.arange(-1.0, 2.0)
    inputs = np.random.default_rng(1).standard_normal((1, PERIODS * PHASES))
    values, _ = record_of(system, PERIODS, PHASES, 0.1, 1, inputs)
    step = system.period / PHASES
    values += 20.0 * np.std(values) * np.cos(2.0 * step * np.arange(PERIODS * PHASES))
    samples = samples_of([values], [inputs], [0.0], step=step, fundamental=2.0, turns=[1.0, 2.0, 3.0, 4.0])
    bare = [bare_mode(samples, complex(system.exponents()[0]), narrow, narrow)]
    scores = Scores(samples, solve(samples, chosen_together(samples, bare, 1)), rough=False)
    gains, degrees = _by_powers(scores)
    assert gains.max() < chi2_limit(degrees, SURE)


@pytest.mark.first(1)
@pytest.mark.parametrize(("on_input", "beside"), [(0.02, 0.0), (0.0, 0.3)])
def test_what_drives_the_system_beside_the_inputs_is_named(on_input, beside):
    system = mathieu()
    generator = np.random.default_rng(2)
    force, noise = generator.standard_normal((2, 1, PERIODS * PHASES))
    values, _ = record_of(system, PERIODS, PHASES, 0.02, 102, force + beside * noise)
    found = identified(values, force + on_input * noise, system.period, validate=False)
    assert not found.passed
    assert "inputs_noise" in codes(found)
    assert any("noise on the measured inputs" in text for text in found.warnings)


@pytest.mark.first(1)
@pytest.mark.parametrize(("share", "told"), [(0.003, {"inputs_noise"}), (0.0, set())])
def test_a_little_noise_on_inputs_is_a_warning(share, told):
    system = mathieu()
    values, inputs = record_of(system, 2 * PERIODS, PHASES, 0.02, 0)
    noise = np.random.default_rng(100).standard_normal(inputs.shape)
    found = identified(values, inputs + share * np.std(inputs) * noise, system.period)
    assert found.passed
    assert codes(found) == told


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "share"), [(3, 0.2), (1, 0.1)])
def test_noise_on_inputs_is_named_first_and_no_other_instants_are(seed, share):
    """Samples of the inputs at other instants explained more of these records, too, and were named beside."""
    system = mathieu()
    values, inputs = record_of(system, 2 * PERIODS, PHASES, 0.02, seed)
    noise = np.random.default_rng(100 + seed).standard_normal(inputs.shape)
    found = identified(values, inputs + share * np.std(inputs) * noise, system.period)
    assert "noise on the measured inputs" in found.reasons[0]
    told = [own.code for own in found.findings if own.severity.name == "FAILURE"]
    assert told[0] == "inputs_noise"
    assert "inputs_instants" not in told


@pytest.mark.slow
def test_what_rounding_leaves_is_no_noise_that_drives():
    """Inputs written to six digits, and no noise: what is left has the colour of the modes, and is no noise."""
    system = mathieu()
    values, inputs = record_of(system, PERIODS, PHASES, 0.0, 5)
    found = identified(values, np.round(inputs, 6), system.period, validate=False)
    assert not found.fit.at.heard.any()
    assert not codes(found)


@pytest.mark.slow
def test_one_blow_does_not_tell_how_the_input_reaches_the_modes():
    system = mathieu()
    forces = np.zeros((1, PERIODS * PHASES))
    forces[0, 7] = 1.0
    response = system.response(forces, PHASES)
    noise = np.random.default_rng(0).standard_normal(response.shape)
    found = identified(response + 0.01 * response.std() * noise, forces, system.period)
    assert codes(found) == {"inputs_poor"}
    assert pulls(system, found.model).max() < 4.0
    assert "F" not in found.warnings[0]
    assert "u" in found.warnings[0]


@pytest.mark.parametrize("late", [True, False])
def test_inputs_measured_from_later_on_alone_are_told(late):
    """The force acts all the time, or from then on; the response rings from the begin in both."""
    system, first = mathieu(), 15 * PHASES
    forces = np.random.default_rng(1).standard_normal((1, PERIODS * PHASES))
    measured = forces.copy()
    measured[0, :first] = 0.0
    values = system.response(forces if late else measured, PHASES, start=[1.0, 0.0])
    values += 0.02 * values.std() * np.random.default_rng(2).standard_normal(values.shape)
    record = Record(values=np.vstack([values, measured]), sample_rate=PHASES / system.period, channels=["y", "u"])
    told = [own for own in identify(record, period=system.period, inputs=["u"]).findings if own.code == "inputs_began"]
    assert [own.numbers["record"] for own in told] == [1] * late


def test_a_blow_after_a_rest_came_in_time():
    system, first = mathieu(), 8 * PHASES
    forces = np.zeros((1, PERIODS * PHASES))
    forces[0, first] = 1.0
    values = system.response(forces, PHASES)
    values += 0.02 * values.std() * np.random.default_rng(2).standard_normal(values.shape)
    record = Record(values=np.vstack([values, forces]), sample_rate=PHASES / system.period, channels=["y", "u"])
    found = identify(record, period=system.period, inputs=["u"])
    assert "inputs_began" not in codes(found)


@pytest.mark.slow
def test_an_input_of_a_constant_system_is_told():
    """Its one b is the scale of the mode, and has no deviation."""
    system = mathieu()
    generator = np.random.default_rng(3)
    forces, decay = generator.standard_normal((1, PERIODS * PHASES)), np.exp((-0.1 + 1.4j) * system.period / PHASES)
    values = lfilter([0.0, 1.0], [1.0, -2.0 * decay.real, abs(decay) ** 2], forces)
    values += 0.02 * values.std() * generator.standard_normal(values.shape)
    assert "inputs_poor" not in codes(identified(values, forces, system.period))
    assert "inputs_poor" not in codes(identified(values, forces, system.period, harmonics=0))


@pytest.mark.first(1)
@pytest.mark.parametrize(("shift", "code"), [(2, "records_phase"), (PHASES // 2, "records_phase"), (0, None)])
def test_a_driven_record_at_another_phase_than_the_first_is_named(shift, code):
    system = mathieu()
    both = [record_of(system, 60, PHASES, 0.05, seed) for seed in (0, 1)]
    records = [
        Record(values=np.vstack(own)[:, first:], sample_rate=PHASES / system.period, channels=["y", "u"])
        for own, first in zip(both, (0, shift), strict=True)
    ]
    found = identify(records, period=system.period, inputs=["u"], validate=False)
    told = [own.numbers["record"] for own in found.findings if own.code == code]
    assert told == ([2] if code else [])
    assert found.failed == bool(code)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "seed"), [(0.05, 1), (0.15, 0)])
def test_inputs_that_were_measured_from_later_on_alone_fail(share, seed):
    """What drove the system before came out as modes that no input reaches, and passed."""
    system = mathieu()
    values, inputs = record_of(system, 60, PHASES, 0.05, seed)
    late = np.where(np.arange(inputs.shape[1]) < share * inputs.shape[1], 0.0, inputs)
    found = identified(values, late, system.period)
    assert not found.passed
    assert "inputs_began" in codes(found)


@pytest.mark.slow
def test_inputs_that_begin_late_after_rest_pass():
    system = mathieu()
    inputs = np.random.default_rng(30).standard_normal((1, 60 * PHASES))
    inputs[:, : 10 * PHASES] = 0.0
    values, _ = record_of(system, 60, PHASES, 0.02, 3, inputs)
    assert identified(values, inputs, system.period).passed
