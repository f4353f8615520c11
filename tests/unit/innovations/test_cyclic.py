"""What repeats in products of a response, against the probabilities at which noise passes for it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from floquid.innovations import _cyclic, left_over, turned_records
from floquid.inputs import samples_of


def response_of(generator, count):
    """The response of a constant oscillator to white noise, and that noise (1, samples)."""
    drive = generator.standard_normal((1, count))
    return lfilter([1.0], [1.0, -1.2, 0.8], drive), drive


def samples_in(*records):
    """Records of eight samples a period, without inputs."""
    inputs = [np.zeros((0, own.shape[1])) for own in records]
    return samples_of(list(records), inputs, [0.0] * len(records), step=0.125, fundamental=2.0 * np.pi)


@pytest.mark.slow
def test_innovations_turn_with_the_past_as_often_as_the_probability_says(monkeypatch):
    monkeypatch.setattr(_cyclic, "SURE", 0.5)
    values, drive = response_of(np.random.default_rng(0), 4000)
    frequencies = np.random.default_rng(1).uniform(1.0, 20.0, 200)
    told = [left_over(samples_in(values), drive, frequency) for frequency in frequencies.tolist()]
    assert np.mean(told) == pytest.approx(0.5, abs=0.12)


def test_noise_does_not_tell_that_a_record_is_half_a_period_off():
    generator = np.random.default_rng(0)
    for _ in range(20):
        assert not turned_records(samples_in(*(response_of(generator, 1000)[0] for _ in range(3))))
