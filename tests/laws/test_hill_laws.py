"""Laws of Hill's method, on random systems: against the other oracle, and built backwards from their exponents."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from floquid import floquet
from floquid.floquet import HarmonicMatrix, PiecewiseMatrix, hill
from floquid.testing import pair_exponents

LAWS = settings(max_examples=5, deadline=None, derandomize=True)


def trigonometric(n, n_harmonics, period, seed):
    generator = np.random.default_rng(seed)
    mean = generator.uniform(-1.0, 1.0, (n, n))
    cosines, sines = 0.5 * generator.uniform(-1.0, 1.0, (2, n, n, n_harmonics))
    return HarmonicMatrix.from_cosines(mean, cosines, sines, period=period)


def pieces(n, edges, period, seed):
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, (n, n, len(edges)))
    return PiecewiseMatrix(values=values, edges=period * np.sort(edges), period=period)


seeds, periods = st.integers(0, 2**32 - 1), st.floats(0.5, 3.0)
smooth = st.builds(trigonometric, st.integers(1, 4), st.integers(0, 3), periods, seeds)
jumping = st.builds(
    pieces, st.integers(1, 3), st.sampled_from([(0.0, 0.4), (0.1, 0.25, 0.7), (0.05, 0.5, 0.6, 0.9)]), periods, seeds
)


@LAWS
@given(st.one_of(smooth, jumping))
def test_agrees_with_the_other_oracle(system):
    """The difference allowed is what a matrix's rounding does to exponents as ill conditioned as these."""
    found = hill(system)
    other = floquet.exponents(system)
    apart = np.abs(pair_exponents(found.exponents, other, system.period).differences)
    assert (apart < 1e-9 + 100 * found.change.max()).all()
    assert found.exponents.real.sum() == pytest.approx(other.real.sum(), abs=1e-9)


@pytest.mark.parametrize("off", [0.0, 1e-6, 0.1])
@LAWS
@given(st.builds(trigonometric, st.integers(2, 4), st.integers(0, 3), periods, seeds))
def test_exponents_beside_known_modes_are_those_of_the_truncated_problem(off, system):
    """Known exponents that are wrong by `off` are found to be wrong by that; mixed shapes are no way to them."""
    plain, known = hill(system), floquet.modes(system)
    signs = np.array([1.0, -1.0, 0.0, 0.0])[: known.order]
    wrong = replace(known, exponents=known.exponents + off * signs)  # of the same sum
    mixed = replace(known, coefficients=known.coefficients + off * known.coefficients[::-1])
    for found in (hill(system, known=wrong), hill(system, known=mixed)):
        assert found.converged
        apart = np.abs(pair_exponents(found.exponents, plain.exponents, system.period).differences)
        assert (apart < 1e-9 + 100 * plain.change.max()).all()


@LAWS
@given(smooth, st.integers(-60, 60))
def test_units_do_not_matter(system, power):
    """Shapes in other units are the same shapes, and the truncation needed is the same."""
    scale = np.ones(system.shape[0])
    scale[0] = 2.0**power
    scaled = HarmonicMatrix(
        coefficients=np.asarray(system.coefficients) * (scale[:, None] / scale)[:, :, None],
        harmonics=system.harmonics,
        period=system.period,
    )
    plain, other = hill(system), hill(scaled)
    apart = np.abs(pair_exponents(other.exponents, plain.exponents, system.period).differences)
    assert (apart < 1e-9 + 100 * plain.change.max()).all()
    assert abs(plain.n_harmonics - other.n_harmonics) <= plain.n_harmonics


@LAWS
@given(smooth, st.floats(0.0, 1.0))
def test_moving_the_origin_turns_the_harmonics(system, fraction):
    """Harmonic m of a shape is multiplied by e^{imωτ}, and the exponents stay."""
    delay = fraction * system.period
    turns = np.exp(2j * np.pi * np.asarray(system.harmonics) * fraction)
    moved = HarmonicMatrix(
        coefficients=np.asarray(system.coefficients) * turns, harmonics=system.harmonics, period=system.period
    )
    here, there = hill(system), hill(moved)
    order, apart = pair_exponents(there.exponents, here.exponents, system.period)
    assert np.abs(apart).max() < 1e-9 + 100 * here.change.max()
    times = system.period * np.array([0.0, 0.3])
    for index, other in enumerate(order):
        alone = np.abs(here.exponents - here.exponents[index]) > 1e-3
        if alone.sum() != len(order) - 1 or here.condition[index] > 1e3:
            continue
        first = (here.shapes(times + delay)[index] * np.exp(here.exponents[index] * times)).ravel()
        second = (there.shapes(times)[other] * np.exp(there.exponents[other] * times)).ravel()
        together = abs(np.vdot(first, second)) / np.linalg.norm(first) / np.linalg.norm(second)
        assert together == pytest.approx(1.0, abs=1e-8)


@LAWS
@given(st.integers(2, 6), st.sampled_from([3.0, 10.0, 30.0]), periods, seeds)
def test_built_backwards(n, decades, period, seed):
    """The smallest multiplier is down to 1e-30; the relative error does not grow with it."""
    generator = np.random.default_rng(seed)
    fundamental = 2 * np.pi / period
    R = np.zeros((n, n))
    growth = -np.linspace(0.01, decades * np.log(10.0) / period, (n + 1) // 2)
    for pair, real in enumerate(growth):
        first = 2 * pair
        R[first, first] = real
        if first + 1 < n:
            speed = generator.uniform(0.1, 3.0) * fundamental
            R[first : first + 2, first : first + 2] = [[real, speed], [-speed, real]]
    cosines, sines = 0.2 / np.sqrt(n) * generator.uniform(-1.7, 1.7, (2, 2, n, n))
    middle, m = np.linalg.qr(generator.normal(size=(n, n)))[0], fundamental * np.array([1.0, 2.0])

    def system(t):
        p = middle + np.tensordot(np.cos(m * t), cosines, 1) + np.tensordot(np.sin(m * t), sines, 1)
        slope = np.tensordot(-m * np.sin(m * t), cosines, 1) + np.tensordot(m * np.cos(m * t), sines, 1)
        return np.linalg.solve(p.T, (slope + p @ R).T).T

    found, exact = hill(system, period), np.linalg.eigvals(R)
    apart = np.abs(pair_exponents(found.exponents, exact, period).differences)
    assert (apart < 1e-12 * np.maximum(np.abs(exact), fundamental)).all()
