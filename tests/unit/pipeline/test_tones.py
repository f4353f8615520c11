"""Steady tones of records whose excitation goes on: found, taken off and said, and nothing else is one."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter
from tests.driven import mathieu, record_of

from floquid import Record, identify
from floquid.preparation._lines import tones_of

FUNDAMENTAL = 0.047


def found(values, inputs=None):
    known = np.ones((1, values.shape[1]))
    return tones_of(values, np.zeros((0, values.shape[1])) if inputs is None else inputs, known, FUNDAMENTAL)


@pytest.mark.parametrize("frequency", [0.0731, 0.25, 0.41007])
def test_tones_are_found_between_the_lines(frequency):
    """Within four deviations of the bound of a tone in white noise (Rife and Boorstyn 1974)."""
    count, generator = 3000, np.random.default_rng(2)
    ticks, size = np.arange(count), np.array([[0.7], [0.2]])
    values = size * np.cos(2.0 * np.pi * frequency * ticks + 0.3) + generator.standard_normal((2, count))
    values += 0.5 * np.cos(2.0 * np.pi * 0.17 * ticks)
    first, second = sorted(found(values), key=lambda tone: abs(tone.frequency - frequency))
    bound = np.sqrt(12.0 / (np.sum(size**2) / 2.0) / 2.0 / count**3) / (2.0 * np.pi)
    assert abs(first.frequency - frequency) < 4.0 * bound
    assert_allclose(first.amplitudes, size[:, 0], atol=4.0 * np.sqrt(2.0 / count))
    assert abs(second.frequency - 0.17) < 4.0 * bound


def test_noise_and_modes_that_are_driven_all_along_are_no_tones():
    """Of 40 draws with a mode that loses 3 nepers in the record, none."""
    generator = np.random.default_rng(5)
    for _ in range(40):
        count = 2000
        pole = np.exp(-3.0 / count + 2j * np.pi * generator.uniform(0.05, 0.45))
        driven = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], generator.standard_normal((2, count)), axis=1)
        assert found(driven + 0.1 * generator.standard_normal(driven.shape)) == ()


def test_what_an_input_has_is_no_tone_nor_what_it_has_some_turns_away():
    count = 2000
    ticks, noise = np.arange(count), np.random.default_rng(1).standard_normal((3, count))
    line, moved = (np.cos(2.0 * np.pi * own * ticks) for own in (0.083, 0.083 + FUNDAMENTAL))
    values = np.array([line, moved]) + 0.05 * noise[:2]
    assert len(found(values)) == 2
    assert found(values, line[None] + 0.01 * noise[2:]) == ()


@pytest.mark.parametrize("harmonic", [1, 2, 4])
def test_a_line_beside_a_harmonic_is_none_since_the_period_may_be_wrong(harmonic):
    """An orbit of the true period was taken off, and outputs alone passed with a period 0.2 % off."""
    noise = np.random.default_rng(harmonic).standard_normal((1, 6000))
    line = np.cos(2.0 * np.pi * 1.002 * harmonic * FUNDAMENTAL * np.arange(6000))
    assert found(line + 0.1 * noise) == ()


def test_a_hum_beside_inputs_is_taken_off_and_said():
    system = mathieu()
    outputs, inputs = record_of(system, 60, 20, 0.02, 3)
    hum = 0.3 * outputs.std() * np.cos(2.0 * np.pi * 1.437 * system.period / 20 * np.arange(outputs.shape[1]))
    names = [f"y{number}" for number in range(len(outputs))] + ["u"]

    def identified(values, **options):
        record = Record(values=np.concatenate([values, inputs]), sample_rate=20 / system.period, channels=names)
        return identify(record, period=system.period, inputs=["u"], **options)

    clean, beside = identified(outputs, validate=False), identified(outputs + hum)
    assert beside.passed
    assert beside.model.order == clean.model.order
    assert_allclose(beside.model.exponents, clean.model.exponents, atol=1e-3)
    (said,) = beside.interference
    assert said.numbers["frequency"] == pytest.approx(1.437, abs=1e-3)
    assert said.numbers["amplitude"] == pytest.approx(0.3 * outputs.std(), rel=0.05)
    assert "taken off" in beside.summary()
    assert not clean.interference
