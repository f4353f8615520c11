"""The search for modes of outputs alone."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import Driven, ambient_of, parted, pulls, two_masses

from floquid import ConstantPeriod, IdentificationError, Record, identify
from floquid.innovations import first_innovations
from floquid.innovations._covariance import whitening_of
from floquid.innovations._mode import Mode
from floquid.inputs import candidates, samples_of

OUTPUTS = 64


def many(periods, phases=20, noise=0.02):
    """Samples of 64 outputs of two masses, in units of their rms."""
    system, generator = two_masses(), np.random.default_rng(0)
    still, turning = generator.standard_normal((2, OUTPUTS, 4)) * [1.0, 1.0, 0.0, 0.0]
    wide = Driven(A=system.A, B=system.B, C=lambda t: still + 0.3 * turning * np.cos(t), period=system.period)
    values = ambient_of(wide, periods, phases, noise, 1)
    values /= values.std(axis=1, keepdims=True)
    nothing = np.zeros((0, values.shape[1]))
    return wide, samples_of([values], [nothing], [0.0], step=wide.period / phases, fundamental=1.0)


@pytest.mark.slow
def test_a_real_multiplier_that_grows_has_its_partner():
    """Without it what was left looked white, and the growth was 3.2 of its deviations off."""
    system = parted()
    values = ambient_of(system, 300, 16, 0.02, 8, warm=40)
    record = Record(values=values, sample_rate=800.0, channels=["x", "z"], clock=ConstantPeriod(period=0.02))
    model = identify(record, validate=False, excitation="ambient").model
    assert model.order == 4
    assert pulls(system, model).max() < 2.5


@pytest.mark.slow
def test_of_many_outputs_there_are_candidates():
    """More than fifteen had none: six block rows of the past were one too many for what they tell."""
    system, samples = many(400)
    poles, _ = candidates(replace(samples, inputs=first_innovations(samples), hold="none"), samples.moving)
    assert len(poles)
    gap = np.concatenate([poles, poles.conj()])[:, None] - system.exponents()
    gap = np.abs(gap.real + 1j * (gap.imag - np.rint(gap.imag)))
    assert (gap.min(axis=0) < 1.5 * np.abs(system.exponents().real)).all()


@pytest.mark.slow
def test_many_outputs_in_a_short_record_are_predicted_by_less_of_the_past():
    """Four samples of the past were too many: innovations were zero, their correlations no numbers."""
    _, samples = many(100)
    first = first_innovations(samples)
    left, response = (np.sqrt(np.mean(own[:, 8:] ** 2)) for own in (first, samples.moving))
    assert 0.0 < left < 0.7 * response
    assert np.isfinite(whitening_of(samples, first)[:]).all()


def test_too_many_outputs_for_a_record_are_refused_in_words():
    system, samples = many(50)
    record = Record(
        values=samples.values,
        sample_rate=1.0 / samples.step,
        channels=[f"y{number}" for number in range(OUTPUTS)],
        clock=ConstantPeriod(period=system.period),
    )
    with pytest.raises(IdentificationError, match=r"1000 samples of 64 channels.*at least 1280"):
        identify(record, excitation="ambient")


def test_shares_of_other_channels_are_not_as_many_as_samples():
    """The matrix of thirteen columns a channel was singular where there were fewer samples."""
    _, samples = many(15)
    assert np.isfinite(whitening_of(samples, np.random.default_rng(2).standard_normal(samples.values.shape))[:]).all()


@pytest.mark.parametrize(
    ("band", "wider"), [([1, 2, 3, 4], [-1, 0, 1, 2, 3, 4]), ([5, 6], [3, 4, 5, 6]), ([-4, -3], [-4, -3, -2, -1])]
)
def test_a_band_beyond_the_highest_harmonic_keeps_what_it_has(band, wider):
    """On another branch a band goes further; without its end the linearisation had other parameters than the fit."""
    turns, values = np.array(band, float), np.ones((2, len(band)), complex)
    mode = Mode(exponent=-0.1 + 0.3j, real=False, turns=turns, shape=values, reach=turns, gains=values)
    padded = mode.padded(2.0, 3.0)
    assert padded.turns.tolist() == padded.reach.tolist() == wider
    assert np.count_nonzero(padded.shape) == np.count_nonzero(padded.gains) == values.size
