"""Discrete flapping of ten phases, example 21 of the PBSID toolbox (van Wingerden): the fit on input that is fresh.

A_k = A1 + (cos(2πk/10) + 0.2) A2, white input, white noise of 0.1 on the output, 500 periods.
"""

from dataclasses import replace

import numpy as np
import pytest

from floquid import Record, identify
from floquid.inputs import linearise

PHASES, PERIODS, SEEDS = 10, 500, 8
A1 = np.array([[0.0, 0.0734], [-6.5229, -0.4997]])
A2 = np.array([[-0.0021, 0.0], [-0.0138, 0.5196]])
B, C = np.array([-0.7221, -9.6277]), np.array([1.0, 0.0])
MULTIPLIER = 0.02508163 + 0.00122721j


def response(inputs):
    state, found = np.zeros(2), []
    for number, own in enumerate(inputs):
        found.append(C @ state)
        state = (A1 + (np.cos(2.0 * np.pi * number / PHASES) + 0.2) * A2) @ state + B * own
    return np.array(found)


@pytest.mark.slow
def test_fresh_input_is_predicted_and_multipliers_lie_within_their_deviations():
    fits, trace, product = [], [], []
    for seed in range(SEEDS):
        generator = np.random.default_rng(seed)
        inputs, fresh = generator.standard_normal((2, PHASES * PERIODS))
        values = response(inputs) + 0.1 * generator.standard_normal(PHASES * PERIODS)
        record = Record(values=np.array([values, inputs]), sample_rate=1.0, channels=["y", "u"])
        found = identify(record, period=float(PHASES), inputs=["u"])
        assert found.passed
        assert found.model.order == 2
        at, samples = found.fit.at, found.fit.samples
        # The same samples with other inputs, from rest, without the offset.
        again = replace(samples, inputs=fresh[None], known=0.0 * samples.known)
        columns = linearise(again, [replace(mode, initial=0.0 * mode.initial) for mode in at.modes], at.direct).columns
        truth = response(fresh)
        fits.append(100.0 * (1.0 - np.var(truth - at.coefficients[:, 0] @ columns) / np.var(truth)))
        multipliers, std = found.model.multipliers, PHASES * np.abs(found.model.multipliers) * found.model.exponent_std
        # Two that are nearly one are known by their sum and product better than alone.
        trace.append((multipliers.sum().real / 2.0 - MULTIPLIER.real) / std.real.max())
        product.append(np.log(multipliers.prod().real / abs(MULTIPLIER) ** 2))
        gap = multipliers - np.where(multipliers.imag < 0.0, MULTIPLIER.conjugate(), MULTIPLIER)
        if not found.model.real.any():
            assert (np.abs(gap.real) < 3.0 * std.real).all()
            assert (np.abs(gap.imag) < 3.0 * std.imag).all()
    assert min(fits) > 99.99
    assert np.abs(trace).max() < 3.0
    assert np.abs(product).max() < 0.1
