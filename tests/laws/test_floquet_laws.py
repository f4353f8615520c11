"""Identities of Floquet theory, on random periodic A(t) of known mean."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from floquid import floquet
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close, pair_exponents

LAWS = settings(max_examples=10, deadline=None, derandomize=True)


class Trigonometric:
    """A(t) = A₀ + Σ_m (A_m cos mωt + B_m sin mωt), with entries of order one."""

    def __init__(self, n, n_harmonics, period, seed):
        generator = np.random.default_rng(seed)
        self.period = period
        self.mean = generator.uniform(-1.0, 1.0, (n, n))
        self.cosines, self.sines = 0.5 * generator.uniform(-1.0, 1.0, (2, n_harmonics, n, n))
        self.rates = 2.0 * np.pi / period * np.arange(1, n_harmonics + 1)

    def __call__(self, t):
        c, s = np.cos(self.rates * t), np.sin(self.rates * t)
        return self.mean + np.tensordot(c, self.cosines, 1) + np.tensordot(s, self.sines, 1)

    def samples(self, n_phases):
        return np.stack([self(self.period * p / n_phases) for p in range(n_phases)], axis=-1)


systems = st.builds(Trigonometric, st.integers(1, 4), st.integers(0, 3), st.floats(0.5, 3.0), st.integers(0, 2**32 - 1))


@LAWS
@given(systems)
def test_liouville(system):
    """Det Φ(T) = exp ∫ tr A, and the integral is T times the trace of the mean."""
    determinant = np.linalg.det(floquet.monodromy(system, system.period))
    assert determinant == pytest.approx(np.exp(system.period * np.trace(system.mean)), rel=1e-10)


@LAWS
@given(systems, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_transition_over_a_period_more(system, phase, offset):
    """Φ(t + T, t₀) = Φ(t, t₀) Φ(t₀ + T, t₀)."""
    start, period = offset * system.period, system.period
    phi = floquet.transition(system, period, start + period * np.array([0.0, phase, 1.0, 1.0 + phase]), start=start)
    assert phi[0] == pytest.approx(np.eye(len(phi[0])), abs=1e-15)
    assert phi[3] == pytest.approx(phi[1] @ phi[2], abs=1e-10 * np.abs(phi).max() ** 2)


@LAWS
@given(systems, st.floats(0.1, 2.5))
def test_transition_composes(system, middle):
    end = middle + 0.7
    first, whole = floquet.transition(system, system.period, [middle, end])
    second = floquet.transition(system, system.period, [end], start=middle)[0]
    assert whole == pytest.approx(second @ first, abs=1e-10 * np.abs(second).max() * np.abs(first).max())


@LAWS
@given(systems)
def test_transition_solves_the_equation(system):
    """Φ' = A Φ, by central differences of sixth order."""
    step, t = 1e-2 * system.period / (1 + len(system.rates)), 0.3 * system.period
    phi = floquet.transition(system, system.period, t + step * np.arange(-3, 4))
    rate = np.tensordot(np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * step), phi, 1)
    assert rate == pytest.approx(system(t) @ phi[3], abs=1e-5 * np.abs(phi).max())


@LAWS
@given(systems, st.floats(0.0, 1.0))
def test_multipliers_do_not_depend_on_the_phase_origin(system, offset):
    """The characteristic polynomial is compared: single multipliers may be ill conditioned."""
    start = offset * system.period
    here = floquet.monodromy(system, system.period)
    there = floquet.monodromy(system, system.period, start=start)
    assert np.poly(there) == pytest.approx(
        np.poly(here), rel=1e-8, abs=1e-8 * max(1.0, np.abs(here).max() ** len(here))
    )


@LAWS
@given(systems)
def test_samples_give_the_transition_of_the_callable(system):
    """Odd and even numbers of phases, the latter with a line at half the sampling rate."""
    exact = floquet.monodromy(system, system.period)
    for n_phases in (2 * len(system.rates) + 1, 2 * len(system.rates) + 2):
        sampled = floquet.monodromy(system.samples(n_phases), system.period)
        assert sampled == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())


@LAWS
@given(systems)
def test_exponents_lie_in_the_strip_and_are_logarithms_of_the_multipliers(system):
    found = floquet.exponents(system, system.period)
    edge = np.pi / system.period
    assert ((found.imag > -edge) & (found.imag <= edge * (1.0 + 1e-15))).all()
    assert np.exp(found * system.period) == pytest.approx(floquet.multipliers(system, system.period), rel=1e-12)


@LAWS
@given(st.integers(1, 4), st.floats(0.5, 3.0), st.integers(0, 2**32 - 1))
def test_constant_matrix_gives_the_exponential(n, period, seed):
    system = Trigonometric(n, 0, period, seed)
    times = period * np.array([0.0, 0.4, 1.7])
    expected = np.stack([expm(system.mean * t) for t in times])
    assert floquet.transition(system, period, times) == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


@LAWS
@given(systems, st.integers(-100, 100))
def test_scaling_a_state_leaves_the_spectrum(system, power):
    """Units may be however far apart."""
    scale = np.ones(len(system.mean))
    scale[0] = 2.0**power
    scaled = floquet.multipliers(lambda t: system(t) * scale[:, None] / scale[None, :], system.period)
    plain = floquet.multipliers(system, system.period)
    assert np.poly(scaled) == pytest.approx(np.poly(plain), abs=1e-7 * max(1.0, np.abs(np.poly(plain)).max()))


@LAWS
@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(-49, 49)), min_size=1, max_size=8, unique=True), st.data())
def test_pairing_undoes_permutation_and_branch(parts, data):
    """Exponents on a grid of 0.1 by 0.1, in a strip ten wide: perturbations of 0.01 can not change the pairing."""
    truth = np.array([0.1 * re + 0.1j * im for re, im in parts])
    period = 2.0 * np.pi / 10.0
    order = np.array(data.draw(st.permutations(range(len(truth)))))
    turns = np.array(data.draw(st.lists(st.integers(-3, 3), min_size=len(truth), max_size=len(truth))))
    shift = 0.01 * np.exp(1j * np.arange(len(truth)))
    moved = (truth + shift)[order] + 10j * turns
    permutation, differences = pair_exponents(moved, truth, period)
    assert (order[permutation] == np.arange(len(truth))).all()
    assert differences == pytest.approx(shift, abs=1e-10)
    assert_exponents_close(moved, truth, period, atol=0.01 + 1e-9)
    with pytest.raises(AssertionError, match=r"over 0\.001"):
        assert_exponents_close(moved, truth, period, atol=0.001)


@LAWS
@given(st.floats(0.2, 2.0), st.floats(0.3, 3.0), st.floats(0.3, 3.0), st.floats(0.0, 0.2))
def test_isotropic_rotor_has_the_exponents_of_its_turning_frame(speed, rotor_x, rotor_y, damping):
    """Multipliers over half a revolution are -exp(λπ/Ω), λ of a constant system: half a turn changes signs.

    Compared as characteristic polynomials, since exponents meet at the edges of instability.
    """
    rotor = JeffcottRotor(rotor_x=rotor_x, rotor_y=rotor_y, support_x=1.0, support_y=1.0, speed=speed, damping=damping)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    springs = np.diag([rotor_x / (1.0 + rotor_x), rotor_y / (1.0 + rotor_y)])
    stiffness = springs - speed**2 * np.eye(2) + damping * speed * turn
    turning = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping * np.eye(2) - 2.0 * speed * turn]])
    exact = np.poly(-expm(turning * rotor.period))
    size = max(1.0, np.abs(exact).max())
    for found in (
        floquet.multipliers(rotor.system, rotor.period),
        np.exp(floquet.hill(rotor.system, rotor.period, raises=False).exponents * rotor.period),
    ):
        assert np.poly(found) == pytest.approx(exact, abs=1e-9 * size)


@LAWS
@given(systems)
def test_the_two_routes_agree(system):
    """The characteristic polynomial of the multipliers: they share no code."""
    factors = floquet.multipliers(system, system.period)
    hill = np.exp(floquet.hill(system, system.period, raises=False).exponents * system.period)
    assert np.poly(hill) == pytest.approx(np.poly(factors), abs=1e-8 * max(1.0, np.abs(np.poly(factors)).max()))
