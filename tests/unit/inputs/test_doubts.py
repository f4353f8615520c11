"""What a model would take up without a word: other instants, other forces, and a system that is not linear."""

import numpy as np
import pytest
from tests.driven import mathieu, record_of

from floquid import Record, identify_driven

PHASES, PERIODS = 20, 40


def identified(values, inputs, period, **options):
    record = Record(values=np.vstack([values, inputs]), sample_rate=PHASES / period, channels=["y", "u"])
    return identify_driven(record, period=period, inputs=["u"], **options)


def codes(found):
    return {own.code for own in found.findings if own.severity.name != "NOTE"}


@pytest.mark.parametrize(
    ("moved", "hold", "words"),
    [
        (1, "zero", "came one sample earlier"),
        (-1, "zero", "came one sample later"),
        (0, "first", 'Use hold="zero"'),
    ],
)
def test_inputs_at_other_instants_are_named(moved, hold, words):
    system = mathieu()
    values, inputs = record_of(system, PERIODS, PHASES, 0.02, 0)
    found = identified(values, np.roll(inputs, moved, axis=1), system.period, hold=hold)
    assert not found.passed
    assert any(words in text for text in found.warnings)


@pytest.mark.parametrize(("moved", "seed"), [(1, 6), (-1, 1)])
def test_short_and_noisy_records_do_not_take_up_a_delay_without_a_word(moved, seed):
    system = mathieu()
    values, inputs = record_of(system, 30, PHASES, 0.05, seed)
    found = identified(values, np.roll(inputs, moved, axis=1), system.period)
    assert codes(found) == {"inputs_instants"}
    assert not found.passed


def test_outputs_too_noisy_to_show_the_first_samples_of_an_answer_do_not_tell_the_instants():
    system = mathieu()
    values, inputs = record_of(system, 30, PHASES, 0.5, 1)
    found = identified(values, inputs, system.period)
    assert codes(found) == {"inputs_untold"}
    assert "b would differ by" in found.warnings[0]


@pytest.mark.parametrize(("direct", "seed"), [(0.0, 1), (1.0, 1), (0.0, 10)])
def test_inputs_as_they_are_said_are_not(direct, seed):
    """Noise brings a direct term in at the last of these."""
    system = mathieu(direct)
    values, inputs = record_of(system, PERIODS, PHASES, 0.02, seed)
    found = identified(values, inputs, system.period)
    assert found.passed
    assert not codes(found)


def test_a_spring_that_hardens_is_named():
    system, spring = mathieu(), 0.02
    generator = np.random.default_rng(1)
    inputs, step = generator.standard_normal(PERIODS * PHASES), system.period / PHASES
    state, values = np.zeros(2), []
    for number, force in enumerate(inputs):
        values.append(state[0])

        def rates(t, x, force=force):
            return system.A(t) @ x + np.array([0.0, force - spring * x[0] ** 3])

        for t in step * (number + np.array([0.0, 0.5])):  # Runge and Kutta's steps, two a sample
            k1 = rates(t, state)
            k2 = rates(t + 0.25 * step, state + 0.25 * step * k1)
            k3 = rates(t + 0.25 * step, state + 0.25 * step * k2)
            k4 = rates(t + 0.5 * step, state + 0.5 * step * k3)
            state = state + step / 12.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    values = np.array(values) + 0.02 * np.std(values) * generator.standard_normal(len(values))
    found = identified(values, inputs, system.period)
    assert not found.passed
    assert "inputs_nonlinear" in codes(found)


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


def test_what_rounding_leaves_is_no_noise_that_drives():
    """Inputs written to six digits, and no noise: what is left has the colour of the modes, and is no noise."""
    system = mathieu()
    values, inputs = record_of(system, PERIODS, PHASES, 0.0, 5)
    found = identified(values, np.round(inputs, 6), system.period, validate=False)
    assert not found.fit.at.heard.any()
    assert not codes(found)
