"""Floquet exponents of systems from the literature, modulo i2π/T.

Exact or closed form: Zhou and Hagiwara; Vinograd; Colaneri; Bittanti and Colaneri; Mathieu's equation on its
characteristic curves (`scipy.special.mathieu_a`, `mathieu_b`); flapping of a rotor blade in hover. The others
(Meissner, Mathieu, its damped and lossy forms, a near-degenerate pair, flapping in forward flight with linear
aerodynamics and no reversed flow) were recomputed once with an adaptive integrator at 1e-11 or better.

Each is held against both routes, which share no code: the eigenvalues of the factors of Φ(T), and Hill's problem.
"""

import numpy as np
import pytest
from benchmarks.literature import literature
from numpy import cos, pi, sin
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from floquid import floquet
from floquid.testing import assert_exponents_close


def zhou_hagiwara(t):
    return [[-1 - sin(2 * t) ** 2, 2 - 0.5 * sin(4 * t)], [-2 - 0.5 * sin(4 * t), -1 - cos(2 * t) ** 2]]


def vinograd(t):
    s, c = sin(6 * t), cos(6 * t)
    return [[-1 - 9 * c**2 + 12 * s * c, 12 * c**2 + 9 * s * c], [-12 * s**2 + 9 * s * c, -1 - 9 * s**2 - 12 * s * c]]


def colaneri(t):
    return [[0, 1], [-10 * cos(t), -24 - 10 * sin(t)]]


def bittanti_colaneri(t):
    return [[-1 + sin(t), 0], [1 - cos(t), -3]]


def meissner(zeta):
    """Return A(t) of x'' + 2ζx' + (1 - 0.2ψ)x = 0, ψ = 1 in the first third of T = π, else -1."""
    return lambda t: [[0, 1], [-(1 - 0.2 * (1 if t % pi < pi / 3 else -1)), -2 * zeta]]


def mathieu(a, q, zeta=0.0):
    return lambda t: [[0, 1], [-(a - 2 * q * cos(2 * t)), -2 * zeta]]


def lossy_mathieu(t):
    return [[0, 1], [-0.5 * (1 - 0.4 * cos(2 * t)), -0.1]]


def close_pair(b):
    return lambda t: [[0, 1], [-(4 + b * cos(t)), -0.005]]


def flapping(gamma, mu):
    def system(t):
        damping = gamma / 8 * (1 + 4 / 3 * mu * sin(t))
        stiffness = 1 + gamma / 8 * (4 / 3 * mu * cos(t) + mu**2 * sin(2 * t))
        return [[0, 1], [-stiffness, -damping]]

    return system


ROUTES = {
    "factors": floquet.exponents,
    "hill": lambda *args, **keywords: floquet.hill(*args, **keywords).exponents,
}
both_routes = pytest.mark.parametrize("route", ROUTES)


CASES = {
    "Zhou and Hagiwara": (zhou_hagiwara, pi, [-1, -2], 1e-11),
    "Zhou and Hagiwara, half the period": (zhou_hagiwara, pi / 2, [-1 + 2j, -2 + 2j], 1e-11),
    "Vinograd": (vinograd, pi / 3, [2, -13], 1e-11),
    "Colaneri": (colaneri, 2 * pi, [0, -24], 1e-11),
    "Bittanti and Colaneri": (bittanti_colaneri, 2 * pi, [-1, -3], 1e-11),
    "Mathieu (1, 0.1)": (mathieu(1, 0.1), pi, [0.0499415702 + 1j, -0.0499415702 + 1j], 6e-11),
    "Mathieu (2, 0.5)": (mathieu(2, 0.5), pi, [0.6304914303j, -0.6304914303j], 6e-11),
    "Mathieu (3, 1)": (mathieu(3, 1), pi, [0.3284189108j, -0.3284189108j], 6e-11),
    "lossy Mathieu": (lossy_mathieu, pi, [-0.05 + 0.7124490252j, -0.05 - 0.7124490252j], 6e-11),
    "near-degenerate, b > 0": (close_pair(0.2), 2 * pi, [-0.0025 + 3.351501e-4j, -0.0025 - 3.351501e-4j], 6e-11),
    "near-degenerate, b < 0": (close_pair(-0.2), 2 * pi, [-0.0025 + 3.351501e-4j, -0.0025 - 3.351501e-4j], 6e-11),
    "flapping 6, 0.3": (flapping(6, 0.3), 2 * pi, [-0.375 + 0.0796775j, -0.375 - 0.0796775j], 6e-8),
    "flapping 12, 0.3": (flapping(12, 0.3), 2 * pi, [-0.8896271 + 0.5j, -0.6103729 + 0.5j], 6e-8),
}


@both_routes
@pytest.mark.parametrize("name", CASES)
def test_exponents(name, route):
    system, period, expected, atol = CASES[name]
    assert_exponents_close(ROUTES[route](system, period), expected, period, atol=atol)


@pytest.mark.parametrize("reference", literature(), ids=lambda reference: reference.name)
def test_reference_systems(reference):
    """Those that the package offers, of which the docs make a table."""
    atol = reference.error or 1e-11
    for route in ROUTES.values():
        assert_exponents_close(route(reference.system), reference.exponents, reference.system.period, atol=atol)


def test_vinograd_is_unstable_though_frozen_eigenvalues_are_constant_and_stable():
    for t in np.linspace(0.0, pi / 3, 7):
        assert np.sort(np.linalg.eigvals(vinograd(t)).real) == pytest.approx([-10.0, -1.0], abs=1e-12)
    assert floquet.exponents(vinograd, pi / 3).real.max() == pytest.approx(2.0, abs=1e-10)


def test_half_period_gives_real_negative_multipliers_on_the_upper_edge_of_the_strip():
    found = floquet.exponents(zhou_hagiwara, pi / 2)
    assert found.imag == pytest.approx([2.0, 2.0], abs=1e-12)
    assert found.real == pytest.approx([-1.0, -2.0], abs=1e-11)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_colaneri_keeps_the_small_multiplier(angle):
    """The second exponent is -24, and its multiplier of 3e-66 is far below the rounding error of the first.

    In states turned by a constant angle the eigenvalue of a monodromy matrix that is formed comes out as some 1e-15,
    which would pass for an exponent of -6.
    """
    turn = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])

    def system(t):
        return turn @ colaneri(t) @ turn.T

    assert floquet.exponents(system, 2 * pi) == pytest.approx([0.0, -24.0], abs=1e-12)
    assert floquet.multipliers(system, 2 * pi) == pytest.approx([1.0, np.exp(-48.0 * pi)], rel=1e-11)
    formed = np.sort(np.abs(np.linalg.eigvals(floquet.monodromy(system, 2 * pi))))
    assert np.abs(np.log(formed[0] + 1e-300) / (2 * pi) + 24.0) > 10.0


@both_routes
@pytest.mark.parametrize(
    ("zeta", "expected"),
    [(0.0, [0.0413797447 + 1j, -0.0413797447 + 1j]), (0.2, [-0.1479830793 + 1j, -0.2520169207 + 1j])],
)
def test_meissner_with_its_jumps_named(zeta, expected, route):
    found = ROUTES[route](meissner(zeta), pi, breaks=[0.0, pi / 3])
    assert_exponents_close(found, expected, pi, atol=6e-11)


@pytest.mark.parametrize("q", [0.3, 2.0])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_multipliers_on_mathieu_characteristic_curves(q, order):
    """Both multipliers are (-1)^order there, a defective pair: the half trace is what is well conditioned."""
    for a in (mathieu_a(order, q), mathieu_b(order, q)):
        multipliers = floquet.multipliers(mathieu(a, q), pi)
        assert 0.5 * multipliers.sum().real == pytest.approx((-1.0) ** order, abs=1e-8)
        assert np.abs(multipliers - (-1.0) ** order).max() < 1e-3


def test_meissner_with_its_jumps_not_named():
    found = floquet.exponents(meissner(0.2), pi)
    assert_exponents_close(found, [-0.1479830793 + 1j, -0.2520169207 + 1j], pi, atol=6e-11)


@both_routes
@pytest.mark.parametrize(("zeta", "q"), [(0.05, 0.1000546711), (0.1, 0.2004369763), (0.2, 0.4034834834)])
def test_damped_mathieu_threshold(zeta, q, route):
    found = brentq(lambda x: ROUTES[route](mathieu(1, x, zeta), pi).real.max(), 0.95 * q, 1.05 * q, xtol=1e-12)
    assert found == pytest.approx(q, abs=6e-11)


@both_routes
@pytest.mark.parametrize("gamma", [4.0, 6.0, 12.0])
def test_flapping_in_hover(gamma, route):
    exact = -gamma / 16 + 1j * np.sqrt(1 - (gamma / 16) ** 2)
    assert_exponents_close(ROUTES[route](flapping(gamma, 0.0), 2 * pi), [exact, exact.conjugate()], 2 * pi, atol=1e-11)


@both_routes
@pytest.mark.parametrize("mu", [0.1, 0.3, 0.6])
def test_flapping_exponents_sum_to_the_mean_trace(mu, route):
    assert ROUTES[route](flapping(6.0, mu), 2 * pi).real.sum() == pytest.approx(-6.0 / 8, abs=1e-11)


@both_routes
def test_flapping_stability_boundary(route):
    found = brentq(lambda mu: ROUTES[route](flapping(12.0, mu), 2 * pi).real.max(), 1.40, 1.42, xtol=1e-9)
    assert found == pytest.approx(1.41174, abs=6e-6)
