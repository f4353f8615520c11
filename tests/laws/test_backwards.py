"""Systems built backwards from chosen exponents and shapes: both routes must give the exponents back.

The error of an exponent is that of the logarithm of its multiplier, |Δλ| T, which is the relative error of the
multiplier however small it is.
"""

import numpy as np
import pytest
from benchmarks.truth import system_with_exponents
from hypothesis import given, settings
from hypothesis import strategies as st

from floquid import floquet
from floquid.errors import InputError
from floquid.testing import pair_exponents

LAWS = settings(max_examples=10, deadline=None, derandomize=True)
PERIOD = 1.3
FUNDAMENTAL = 2.0 * np.pi / PERIOD


def chosen(n, spread, seed):
    """Return n exponents of every kind with multipliers from 1 down to `spread`, not one of them alike."""
    generator = np.random.default_rng(seed)
    growth = np.log(spread) / PERIOD * np.append(np.sort(generator.uniform(0.0, 1.0, n - 2)), [0.0, 1.0])
    out = []
    left = list(growth)
    while left:
        kind = generator.integers(3) if len(left) > 1 else 0
        a = left.pop()
        if kind == 0:
            out.append(a)
        elif kind == 1:
            left.pop(0)
            b = generator.uniform(0.05, 0.45) * FUNDAMENTAL
            out += [a + 1j * b, a - 1j * b]
        else:
            out += [a + 0.5j * FUNDAMENTAL, left.pop(0) + 0.5j * FUNDAMENTAL]
    return np.array(out, dtype=complex)


def worst(found, truth):
    return np.abs(pair_exponents(found, truth, PERIOD).differences).max() * PERIOD


@LAWS
@given(st.integers(2, 8), st.sampled_from([1e-1, 1e-5, 1e-12, 1e-30]), st.integers(0, 2**32 - 1))
def test_factors_give_every_exponent_back(n, spread, seed):
    truth = chosen(n, spread, seed)
    found = floquet.exponents(system_with_exponents(truth, PERIOD, seed=seed))
    assert worst(found, truth) < 1e-9


@LAWS
@given(st.integers(2, 8), st.sampled_from([1e-1, 1e-5, 1e-12, 1e-30]), st.integers(0, 2**32 - 1))
def test_hill_gives_every_exponent_back(n, spread, seed):
    truth = chosen(n, spread, seed)
    assert worst(floquet.hill(system_with_exponents(truth, PERIOD, seed=seed)).exponents, truth) < 1e-9


def test_a_formed_product_does_not():
    """The mutant: eigenvalues of the monodromy matrix itself."""
    truth = chosen(6, 1e-30, 3)
    formed = np.linalg.eigvals(floquet.monodromy(system_with_exponents(truth, PERIOD, seed=3)))
    assert worst(np.log(formed.astype(complex)) / PERIOD, truth) > 1.0


@LAWS
@given(st.integers(2, 6), st.sampled_from([1e-1, 1e-8, 1e-30]), st.integers(0, 2**32 - 1))
def test_modes_solve_the_equation(n, spread, seed):
    """The shapes of small multipliers too: p' + λp = A p at instants between the phases they were found at."""
    truth = chosen(n, spread, seed)
    system = system_with_exponents(truth, PERIOD, seed=seed)
    modes = floquet.modes(system)
    times = PERIOD * np.array([0.013, 0.37, 0.61, 0.88])
    p = modes.shapes(times)
    rate = modes.coefficients @ (
        1j * FUNDAMENTAL * modes.harmonics[:, None] * np.exp(1j * FUNDAMENTAL * np.outer(modes.harmonics, times))
    )
    a = system(times)
    residual = rate + modes.exponents[:, None, None] * p - np.einsum("tij,rjt->rit", a, p)
    scale = np.abs(p).max(axis=(1, 2)) * np.abs(a).max()
    assert (np.abs(residual).max(axis=(1, 2)) / scale).max() < 1e-7
    assert worst(modes.exponents, truth) < 1e-9


@LAWS
@given(st.integers(2, 5), st.sampled_from([1e-1, 1e-8, 1e-20]), st.integers(0, 2**32 - 1))
def test_lyapunov_transform_is_periodic_and_makes_the_system_constant(n, spread, seed):
    truth = chosen(n, spread, seed)
    system = system_with_exponents(truth, PERIOD, seed=seed)
    found = floquet.floquet_lyapunov(system, n_phases=128)
    lines = np.fft.fft(found.transform, axis=0)
    orders = np.fft.fftfreq(len(lines), 1.0 / len(lines))[:, None, None]
    rate = np.fft.ifft(2j * np.pi / found.period * orders * lines, axis=0).real
    residual = rate + found.transform @ found.constant - system(found.times) @ found.transform
    columns = np.abs(found.transform).max(axis=(0, 1))
    assert np.abs(residual / columns).max() < 1e-6 * (1.0 + np.abs(found.constant).max())
    negative = (np.abs(truth.imag) > 0.49 * FUNDAMENTAL).any()
    assert found.period == pytest.approx(2 * PERIOD if negative else PERIOD)


@pytest.mark.parametrize(
    ("exponents", "message"),
    [
        ([0.1 + 1j], "must hold the conjugate"),
        ([0.5j * FUNDAMENTAL], "even number of real negative multipliers"),
    ],
)
def test_impossible_exponents_are_refused(exponents, message):
    with pytest.raises(InputError, match=message):
        system_with_exponents(exponents, PERIOD)
