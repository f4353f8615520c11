"""Harmonics end at the Nyquist frequency, and the response of a real multiplier is real between the samples too."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import floquid as fq

PERIOD, CYCLES = 1.0, 60
OMEGA = 2.0 * np.pi / PERIOD


def record_of(turns, coefficients, phases):
    """A mode at `turns` turns a period with a decay of 0.05 a period, harmonics -1, 0, 1."""
    times = np.arange(phases * CYCLES) * PERIOD / phases
    exponent = -0.05 + 1j * turns * OMEGA
    shape = np.tensordot(coefficients, np.exp(1j * OMEGA * np.outer([-1, 0, 1], times)), 1)
    values = (shape * np.exp(exponent * times)).real
    return fq.Record(
        values=values, sample_rate=phases / PERIOD, channels=["a", "b"], clock=fq.ConstantPeriod(period=PERIOD)
    )


def complex_response(model, times):
    return np.einsum("rchn,rn->chn", model.shapes(times), np.exp(np.multiply.outer(model.exponents, times)))[:, 0]


@pytest.mark.first(2)
@pytest.mark.parametrize(("turns", "phases"), [(1.9, 4), (3.7, 8), (1.2, 3), (0.3, 2), (1.3, 5)])
def test_a_branch_above_the_nyquist_frequency_is_never_reported(turns, phases):
    found = fq.identify(record_of(turns, np.array([[0, 1.0, 0], [0, 0.5j, 0]]), phases), validate=False).model
    assert_allclose(np.abs(found.exponents.imag), turns * OMEGA, rtol=1e-8)


@pytest.mark.first(4)
@pytest.mark.parametrize("turns", [0.0, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("phases", [1, 2, 3, 4, 6, 7, 8, 16])
@pytest.mark.parametrize("harmonics", [None, 0, 2])
def test_the_response_of_a_real_multiplier_is_real(turns, phases, harmonics):
    if harmonics is not None and 2 * harmonics >= phases:
        pytest.skip("more harmonics than samples a period allow")
    record = record_of(turns, np.array([[0.1, 1.0, 0.2], [0.3, 0.5, 0.1]]), phases)
    model = fq.identify(record, order=1, harmonics=harmonics, validate=False).model
    response = complex_response(model, np.linspace(0.0, 5.0, 333))
    assert np.abs(response.imag).max() < 1e-12 * np.abs(response).max()
    if harmonics is None:
        assert_allclose(complex_response(model, record.times).real, record.values, atol=1e-7)


def beside_line(turns, phases, first):
    """A mode in noise of 0.01 beside a line of so many turns a period; it starts `first` samples after phase zero."""
    record = record_of(0.3, np.array([[0.1, 1.0, 0.2], [0.3, 0.5, 0.1]]), phases)
    times = np.arange(record.n_samples)
    noise = 0.01 * np.random.default_rng(0).standard_normal(record.values.shape)
    line = 0.4 * np.array([[1.0], [-0.5]]) * np.cos(2.0 * np.pi * turns / phases * times)
    clock = fq.ConstantPeriod(period=PERIOD, origin=-first * PERIOD / phases)
    return fq.Record(values=record.values + noise + line, sample_rate=phases / PERIOD, channels=["a", "b"], clock=clock)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("phases", "first", "drift"),
    [
        *((8, 3.0, 0.01), (8, 0.5, 0.0), (40, 0.0, 0.01)),
        *((8, 0.0, 0.0), (8, 0.3, 0.0), (8, 3.0, 0.0), (40, 0.0, 0.0)),
        *((8, 0.0, 0.01), (8, 0.3, 0.01), (8, 0.5, 0.01)),
    ],
)
def test_a_forced_line_at_half_the_sampling_rate_is_fitted(phases, first, drift):
    given = beside_line(phases // 2, phases, first)
    given = replace(given, values=given.values + drift * given.times)
    found = fq.identify(given, validate=False).fit
    assert found.model.order == 2
    assert_allclose(found.noise, 0.01, rtol=0.15)
    assert found.forced.harmonics.tolist() == [phases // 2]
    # The samples see one phase of it: the other is left at zero.
    assert_allclose(found.forced.amplitudes[:, 0, 0], [0.4, 0.2], atol=0.01)
    angles = OMEGA * (given.times[:4] + first * PERIOD / phases)
    line = found.forced.response(angles)[:, 0] - found.forced.offset
    assert_allclose(line, [[0.4, -0.4, 0.4, -0.4], [-0.2, 0.2, -0.2, 0.2]], atol=0.01)


def test_a_forced_line_between_the_last_harmonic_and_half_the_sampling_rate_is_fitted():
    """With two periods a revolution, 5 samples a period show 2.5 turns."""
    found = fq.identify(beside_line(2.5, 5, 0.0), periods_per_revolution=2.0, validate=False).fit
    assert found.forced.harmonics.tolist() == [5]
    assert_allclose(found.noise, 0.01, rtol=0.15)
