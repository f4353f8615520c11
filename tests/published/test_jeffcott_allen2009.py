"""The rotor of Allen 2009, "Frequency-Domain Identification of Linear Time-Periodic Systems using LTI Techniques".

The numbers are the paper's (section 3, eq. 22, figure 8), with the misprints of its equation (22) put right: damping
C = c_f I, stiffness RᵀK_R R in the fixed frame. Those with more digits than the paper prints were recomputed once
with an adaptive Runge-Kutta integrator at a relative tolerance of 1e-11 or better; the isotropic support is exact.
"""

import numpy as np
import pytest

from floquid import floquet
from floquid.floquet import FunctionMatrix
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close

PERIOD = 2.0 * np.pi
ROUTES = {
    "factors": lambda rotor: floquet.exponents(rotor.system, rotor.period),
    "hill": lambda rotor: (
        floquet.hill(FunctionMatrix(function=rotor.system, period=rotor.period, vectorised=True)).exponents
    ),
}
both_routes = pytest.mark.parametrize("route", ROUTES)
PAPER = np.array([-0.002 + 0.1303357j, -0.002 + 0.2593936j])
PRINTED_DAMPING = np.array([-0.0039996 + 0.1303426j, -0.0020004 + 0.2593936j])


def with_conjugates(values):
    return np.concatenate([values, values.conj()])


def harmonics(values):
    """Fourier coefficients over the first axis, index m for harmonic m (negative ones from the end)."""
    return np.fft.fft(values, axis=0) / len(values)


def test_period_is_half_a_revolution():
    assert JeffcottRotor().period == pytest.approx(PERIOD, rel=1e-15)


@both_routes
@pytest.mark.parametrize(("form", "expected"), [("identity", PAPER), ("support", PRINTED_DAMPING)])
def test_exponents(form, expected, route):
    found = ROUTES[route](JeffcottRotor(damping_form=form))
    assert_exponents_close(found, with_conjugates(expected), PERIOD, atol=6e-8)


def test_exponents_the_paper_prints():
    found = JeffcottRotor().exponents()
    assert_exponents_close(found, with_conjugates(np.array([-0.002 + 0.13034j, -0.002 + 0.25939j])), PERIOD, atol=6e-6)


def test_branches_near_the_physical_frequencies():
    assert_exponents_close(
        JeffcottRotor().exponents(), with_conjugates(-0.002 + 1j * np.array([0.8696643, 0.7406064])), PERIOD, atol=6e-8
    )


def test_frozen_frequencies_range():
    frequencies = JeffcottRotor().frozen_frequencies(np.linspace(0.0, np.pi, 721))
    assert frequencies.min() == pytest.approx(0.70711, abs=6e-6)
    assert frequencies.max() == pytest.approx(0.92582, abs=6e-6)


def test_stiffness_at_zero_angle_is_the_springs_in_series():
    rotor = JeffcottRotor()
    assert rotor.system(0.0)[2, 0] == pytest.approx(-0.5, abs=1e-15)
    assert rotor.stiffness(0.0) == pytest.approx(np.diag([1.0 / 2.0, 3.0 / 3.5]), abs=1e-15)


def test_stiffness_over_the_angle():
    rotor = JeffcottRotor()
    angle = np.linspace(0.0, np.pi, 721)
    stiffness = rotor.stiffness(angle / rotor.speed)
    assert stiffness[:, 0, 0].min() == pytest.approx(0.5, abs=1e-14)
    assert stiffness[:, 0, 0].max() == pytest.approx(0.6, abs=1e-14)
    inside = (angle > 1e-6) & (angle < 0.5 * np.pi - 1e-6)
    assert (stiffness[inside, 0, 1] < 0.0).all()
    assert stiffness[180, 0, 1] == pytest.approx(-0.068966, abs=5e-7)
    assert stiffness[180, 0, 0] == pytest.approx(0.551724, abs=5e-7)
    assert stiffness[180, 0, 1] / stiffness[180, 0, 0] == pytest.approx(-0.125, abs=1e-12)


def test_stiffness_harmonics_fall_steeply():
    """The largest magnitude among the four elements of the coefficient matrix of harmonic m of K(t)."""
    rotor = JeffcottRotor()
    coefficients = np.abs(harmonics(rotor.stiffness(PERIOD * np.arange(64) / 64))).max(axis=(1, 2))
    assert coefficients[0] == pytest.approx(0.7603, abs=5e-5)
    assert coefficients[[1, -1]] == pytest.approx([0.0476, 0.0476], abs=5e-5)
    assert coefficients[[2, -2]] == pytest.approx([0.00082, 0.00082], abs=5e-6)
    assert coefficients[[3, -3]] == pytest.approx([0.000014, 0.000014], abs=5e-7)


def test_residue_harmonics_of_y_in_mode_1():
    """After the unit impulse at 45 degrees, on the branch 0.8696643; the larger of ±2, of which -2 is all but zero."""
    rotor = JeffcottRotor()
    n_phases = 64
    times = PERIOD * np.arange(n_phases + 1) / n_phases
    phi = floquet.transition(rotor.system, PERIOD, times)
    multipliers, vectors = np.linalg.eig(phi[-1])
    mode = int(np.abs(multipliers - np.exp((-0.002 + 0.8696643j) * PERIOD)).argmin())
    exponent = np.log(multipliers[mode]) / PERIOD + 1j
    assert exponent.imag == pytest.approx(0.8696643, abs=6e-8)
    participation = np.linalg.solve(vectors, np.array([0.0, 0.0, 1.0, 1.0]) / np.sqrt(2.0))[mode]
    t = times[:-1]
    residue = (rotor.outputs(t) @ phi[:-1] @ vectors[:, mode]) * np.exp(-exponent * t)[:, None] * participation
    y = np.abs(harmonics(residue)[:, 1])
    assert y[0] == pytest.approx(0.389, abs=5e-4)
    assert sorted(y[[1, -1]]) == pytest.approx([0.0069, 0.0245], abs=5e-5)
    assert max(y[[2, -2]]) == pytest.approx(0.00007, abs=5e-6)


@both_routes
@pytest.mark.parametrize(("lower", "upper"), [(0.7212, 0.7558), (0.7849, 0.8252), (0.8483, 0.9018)])
def test_instability_bands(lower, upper, route):
    """The edges are given to four digits, so they are approached to one unit of the fourth."""

    def growth(speed):
        return ROUTES[route](JeffcottRotor(speed=speed)).real.max()

    assert growth(lower - 1e-4) < 0.0 < growth(lower + 1e-4)
    assert growth(upper + 1e-4) < 0.0 < growth(upper - 1e-4)


@both_routes
@pytest.mark.parametrize("speed", [0.5, 0.74, 1.3])
def test_isotropic_support_is_a_constant_system_in_the_turning_frame(speed, route):
    """Multipliers over half a revolution are -exp(λ_rot π/Ω): half a turn changes the sign of turning coordinates."""
    rotor = JeffcottRotor(support_x=1.0, support_y=1.0, speed=speed, damping=0.05)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    stiffness = np.diag([0.5, 0.6]) - speed**2 * np.eye(2) + 0.05 * speed * turn
    damping = 0.05 * np.eye(2) + 2.0 * speed * turn
    turning = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])
    expected = -np.exp(np.linalg.eigvals(turning) * np.pi / speed)
    assert_exponents_close(ROUTES[route](rotor), np.log(expected) * speed / np.pi, rotor.period, atol=1e-11)


@both_routes
@pytest.mark.parametrize(
    ("speed", "unstable"),
    [(0.5**0.5 - 1e-4, False), (0.5**0.5 + 1e-4, True), (0.6**0.5 - 1e-4, True), (0.6**0.5 + 1e-4, False)],
)
def test_isotropic_undamped_instability_band(speed, unstable, route):
    growth = ROUTES[route](JeffcottRotor(support_y=1.0, damping=0.0, speed=speed)).real.max()
    assert (growth > 1e-4) if unstable else (growth < 1e-9)


def test_simulated_thousand_periods_on_isotropic_support_are_exact():
    """Undamped, against the constant turning-frame system in closed form, turned back to the fixed frame."""
    speed = 0.5
    record = JeffcottRotor(support_y=1.0, damping=0.0, speed=speed).simulate(
        n_periods=1000, samples_per_period=10, noise=0.0
    )
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    stiffness = np.diag([0.5, 0.6]) - speed**2 * np.eye(2)
    turning = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -2.0 * speed * turn]])
    values, vectors = np.linalg.eig(turning)
    weights = np.linalg.solve(vectors, np.array([0.0, 0.0, 1.0, 1.0]) / np.sqrt(2.0))
    t = record.times
    xi, eta = ((vectors[:2] * weights) @ np.exp(np.multiply.outer(values, t))).real
    c, s = np.cos(speed * t), np.sin(speed * t)
    expected = np.stack([c * xi - s * eta, s * xi + c * eta])
    assert record.values[:2] == pytest.approx(expected, abs=2e-11 * np.abs(expected).max())
