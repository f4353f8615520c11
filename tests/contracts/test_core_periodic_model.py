"""Identities of the periodic model, over random models.

Equation numbers are those of Allen (2009).
"""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from floquid.core import PeriodicModel

TIMES = np.linspace(0.0, 7.0, 41)


@st.composite
def models(draw):
    """Conjugate pairs and real modes, up to order 5, with coefficients that make the response real."""
    n_pairs, n_real = draw(st.tuples(st.integers(0, 2), st.integers(0, 1)).filter(any))
    width, n_channels, n_hits = draw(st.integers(0, 3)), draw(st.integers(1, 3)), draw(st.integers(1, 2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def shape(n):
        size = (n, n_channels, n_hits, 2 * width + 1)
        return rng.standard_normal(size) + 1j * rng.standard_normal(size)

    pairs, singles = shape(n_pairs), shape(n_real)
    upper = rng.uniform(-0.5, 0.2, n_pairs) + 1j * rng.uniform(-20.0, 20.0, n_pairs)
    lone = rng.uniform(-0.5, 0.2, n_real)
    return PeriodicModel(
        exponents=np.concatenate([upper, upper.conj(), lone]),
        coefficients=np.concatenate([pairs, pairs[..., ::-1].conj(), singles + singles[..., ::-1].conj()]),
        harmonics=np.arange(-width, width + 1),
        period=draw(st.floats(0.05, 20.0)),
        channels=[f"c{i}" for i in range(n_channels)],
    )


def moved(model, mode, turns):
    """The model with one mode's exponent moved by `turns` iω and the indices of its harmonics by -`turns`."""
    margin = abs(turns)
    harmonics = np.arange(model.harmonics[0] - margin, model.harmonics[-1] + margin + 1)
    coefficients = np.pad(model.coefficients, [(0, 0)] * 3 + [(margin, margin)])
    coefficients[mode] = np.roll(coefficients[mode], -turns, axis=-1)
    exponents = model.exponents.copy()
    exponents[mode] += 1j * turns * model.fundamental
    return PeriodicModel(
        exponents=exponents,
        coefficients=coefficients,
        harmonics=harmonics,
        period=model.period,
        channels=model.channels,
    )


def complex_response(model):
    """Equation 12 term by term, with no matrix product and nothing cut off: (channels, hits, times)."""
    total = np.zeros((*model.coefficients.shape[1:3], len(TIMES)), dtype=complex)
    for r, exponent in enumerate(model.exponents):
        for i, m in enumerate(model.harmonics):
            wave = np.exp((exponent + 1j * m * model.fundamental) * TIMES)
            total += model.coefficients[r, :, :, i, None] * wave
    return total


@given(models())
def test_response_is_equation_12(model):
    response, sums = model.response(TIMES), complex_response(model)
    assert response.shape == sums.shape
    assert_allclose(response, sums.real, atol=1e-10 * abs(sums).max())


@given(models())
def test_conjugate_pairs_make_the_response_real(model):
    sums = complex_response(model)
    assert abs(sums.imag).max() <= 1e-10 * max(abs(sums).max(), abs(model.coefficients).max())


@given(models(), st.integers(0, 4), st.integers(-3, 3).filter(bool))
def test_a_mode_may_be_moved_along_its_class(model, mode, turns):
    mode %= model.order
    other = moved(model, mode, turns)
    scale = abs(model.coefficients).sum() * np.exp(0.2 * TIMES[-1])
    assert_allclose(other.response(TIMES), model.response(TIMES), atol=1e-10 * scale)
    assert_allclose(other.multipliers, model.multipliers, atol=1e-9 * abs(model.multipliers).max())
    # The shape itself does change: by the phase of `turns` harmonics.
    turning = np.exp(-1j * turns * model.fundamental * TIMES)
    assert_allclose(other.shapes(TIMES)[mode], model.shapes(TIMES)[mode] * turning, atol=1e-10 * scale)


@given(models())
def test_shapes_are_periodic(model):
    assert_allclose(model.shapes(TIMES + model.period), model.shapes(TIMES), atol=1e-9 * abs(model.coefficients).sum())


@given(models())
def test_multipliers_advance_a_mode_by_one_period(model):
    for r in range(model.order):
        alone = PeriodicModel(
            exponents=model.exponents[[r]],
            coefficients=model.coefficients[[r]],
            harmonics=model.harmonics,
            period=model.period,
            channels=model.channels,
        )
        now, later = (alone.shapes(t) * np.exp(alone.exponents[0] * t) for t in (TIMES, TIMES + model.period))
        assert_allclose(later, model.multipliers[r] * now, atol=1e-9 * abs(later).max())


@given(models())
def test_principal_is_in_the_strip_and_in_the_class(model):
    principal, half = model.principal(), model.fundamental / 2
    assert (principal.imag > -half * (1 + 1e-9)).all()
    assert (principal.imag <= half * (1 + 1e-9)).all()
    assert_allclose(principal.real, model.exponents.real)
    turns = (model.exponents - principal).imag / model.fundamental
    assert_allclose(turns, np.round(turns), atol=1e-9)


@pytest.mark.parametrize("turns", [-1.5, -0.5, 0.5, 2.5])
def test_the_edge_of_the_strip_is_its_upper_one(turns):
    model = PeriodicModel(
        exponents=[-0.1 + 1j * turns * 2.0],
        coefficients=np.ones((1, 1, 1, 1)),
        harmonics=[0],
        period=np.pi,
        channels=["X"],
    )
    assert_allclose(model.principal(), [-0.1 + 1j], rtol=1e-12)


@given(st.floats(-0.99, 0.99), st.floats(0.1, 100.0))
def test_frequency_and_damping_of_an_oscillator(ratio, omega):
    """λ = -ζω₀ ± iω₀√(1 - ζ²); a negative ratio grows."""
    exponent = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
    assume(abs(exponent) > 0)
    model = PeriodicModel(
        exponents=[exponent], coefficients=np.ones((1, 1, 1, 1)), harmonics=[0], period=1.0, channels=["X"]
    )
    assert_allclose(model.frequencies_hz, [omega / (2 * np.pi)], rtol=1e-12)
    assert_allclose(model.damping_ratios, [ratio], atol=1e-12)


def test_a_mode_at_rest_has_no_damping_ratio_to_divide_by():
    model = PeriodicModel(
        exponents=[0.0], coefficients=np.ones((1, 1, 1, 1)), harmonics=[0], period=1.0, channels=["X"]
    )
    assert model.damping_ratios == 0.0
    assert_allclose(model.response([0.0, 3.0]), [[[1.0, 1.0]]])


def test_one_instant_needs_no_list():
    model = PeriodicModel(exponents=[-1.0], coefficients=[[[[2.0]]]], harmonics=[0], period=1.0, channels=["X"])
    assert_allclose(model.response(1.0), [[[2.0 * np.exp(-1.0)]]])
    assert_allclose(model.shapes(1.0), [[[[2.0]]]])
