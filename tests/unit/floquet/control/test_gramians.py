"""Gramians of stable periodic systems, and the norms that they and the Hamiltonian matrix give."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from floquid.errors import InputError
from floquid.floquet import (
    FunctionMatrix,
    HarmonicMatrix,
    HarmonicSystem,
    PeriodicSystem,
    PiecewiseMatrix,
    gramian,
    h2_norm,
    hankel_norm,
    simulate,
    transition,
)
from floquid.floquet.control._linf_norm import PeakGain, _factors, _scaled, linf_norm

T = 1.3
W = 2 * np.pi / T
KINDS = ["reachability", "observability"]


def matrix(function, period=T, breaks=()):
    return FunctionMatrix(function=function, period=period, breaks=breaks)


def constant(value, period=T):
    return HarmonicMatrix(coefficients=np.asarray(value, dtype=float)[:, :, None], harmonics=[0], period=period)


def smooth_system(D=None):
    return PeriodicSystem(
        A=matrix(lambda t: [[0, 1], [-3 - np.cos(W * t), -0.6 - 0.3 * np.sin(2 * W * t)]]),
        B=matrix(lambda t: [[0, 0.2], [1 + 0.5 * np.sin(W * t), 0]]),
        C=matrix(lambda t: [[1 + 0.2 * np.cos(W * t), 0], [0.3, 1.0], [1.0, 1.0]]),
        D=D,
    )


def jumping_system():
    A = np.stack([[[0.0, 1.0], [-4.0, -0.9]], [[0.0, 1.0], [-2.0, -0.9]]], axis=2)
    B = np.stack([[[0.0], [1.0]], [[0.5], [-1.0]]], axis=2)
    C = np.stack([[[1.0, 0.0]], [[0.0, 1.0]]], axis=2)
    return PeriodicSystem(
        A=PiecewiseMatrix(values=A, edges=[0.0, 0.7], period=T),
        B=PiecewiseMatrix(values=B, edges=[0.1, 0.55], period=T),
        C=PiecewiseMatrix(values=C, edges=[0.3, 1.0], period=T),
    )


def reference_matrices(seed=5, n=4):
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.2) * np.eye(n)
    return A, generator.normal(size=(n, 2)), generator.normal(size=(3, n)), 0.7 * generator.normal(size=(3, 2))


def turned(A, B, C, D=None, period=T):
    """A constant system seen from coordinates that turn once a period: periodic, with the same inputs and outputs."""
    n = len(A)
    rate = np.zeros((n, n))
    rate[0, 1], rate[1, 0] = 2 * np.pi / period, -2 * np.pi / period
    mixed = np.linalg.qr(np.random.default_rng(9).normal(size=(n, n)))[0]
    rate = mixed @ rate @ mixed.T
    turn = lambda t: expm(rate * t)  # noqa: E731
    return PeriodicSystem(
        A=matrix(lambda t: rate + turn(t) @ A @ turn(-t), period),
        B=matrix(lambda t: turn(t) @ B, period),
        C=matrix(lambda t: C @ turn(-t), period),
        D=D,
    )


def quadrature(bounds, panels, points=12):
    """Instants and weights of Gauss on each stretch between the bounds."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    edges = np.unique(np.concatenate([np.linspace(a, b, panels + 1) for a, b in pairwise(bounds)]))
    widths = np.diff(edges)
    times = edges[:-1, None] + 0.5 * widths[:, None] * (1 + nodes)
    return times.ravel(), 0.5 * np.outer(widths, weights).ravel()


def cantoni_sandberg():
    A = lambda t: [  # noqa: E731
        [-1 - np.sin(2 * t) ** 2, 2 - 0.5 * np.sin(4 * t)],
        [-2 - 0.5 * np.sin(4 * t), -1 - np.cos(2 * t) ** 2],
    ]
    return PeriodicSystem(A=matrix(A, np.pi), B=[[0.0], [1.0]], C=[[1.0, 1.0]], D=[[1.0]])


def lifted_gain(system, omega, n_harmonics=24):
    """The largest singular value of the truncated harmonic transfer function."""
    return np.linalg.norm(HarmonicSystem.from_system(system, n_harmonics).transfer(1j * omega), 2)


@pytest.mark.parametrize("kind", KINDS)
def test_the_gramian_solves_its_differential_equation(kind):
    system, n_phases = smooth_system(), 128
    found = gramian(system, kind, n_phases)
    times = T * np.arange(n_phases) / n_phases
    A, B, C = system.A.at(times), system.B.at(times), system.C.at(times)
    lines = 1j * W * np.arange(n_phases // 2 + 1)[:, None, None]
    rate = np.fft.irfft(lines * np.fft.rfft(found, axis=0), n=n_phases, axis=0)
    At, Bt, Ct = (m.swapaxes(1, 2) for m in (A, B, C))
    wanted = A @ found + found @ At + B @ Bt if kind == "reachability" else -(At @ found + found @ A + Ct @ C)
    assert np.abs(wanted).max() > 0.3
    assert rate == pytest.approx(wanted, abs=1e-10)
    assert np.array_equal(found, found.swapaxes(1, 2))
    assert np.linalg.eigvalsh(found).min() > 0.0


@pytest.mark.parametrize("make", [smooth_system, jumping_system])
def test_observability_by_quadrature(make):
    system = make()
    bounds = np.unique(np.concatenate([[0.0, T], system.A.breaks, system.C.breaks]))
    many = np.unique(np.add.outer(T * np.arange(80), bounds).round(12))
    times, weights = quadrature(many, 3)
    outputs = system.C.at(times) @ transition(system.A, None, times)
    wanted = np.einsum("t,tij,tik->jk", weights, outputs, outputs)
    assert gramian(system, "observability", 3)[0] == pytest.approx(wanted, abs=1e-10)


@pytest.mark.parametrize("make", [smooth_system, jumping_system])
def test_reachability_is_observability_of_the_adjoint(make):
    """P(t) of A(t), B(t) is Q(-t) of A(-t)ᵀ and C(t) = B(-t)ᵀ."""
    system = make()
    back = lambda m: FunctionMatrix(  # noqa: E731
        function=lambda t: m.at(-t).swapaxes(-1, -2), period=T, breaks=np.mod(-m.breaks, T), vectorised=True
    )
    adjoint = PeriodicSystem(A=back(system.A), C=back(system.B))
    there, here = gramian(adjoint, "observability", 10), gramian(system, "reachability", 10)
    assert here[0] == pytest.approx(there[0], abs=1e-11)
    assert here[1:] == pytest.approx(there[:0:-1], abs=1e-11)


@pytest.mark.slow
def test_a_constant_system_and_the_same_one_turning():
    A, B, C, _ = reference_matrices()
    P, Q = solve_continuous_lyapunov(A, -B @ B.T), solve_continuous_lyapunov(A.T, -C.T @ C)
    still = PeriodicSystem(A=constant(A), B=B, C=C)
    assert gramian(still, "reachability", 3) == pytest.approx(np.stack([P] * 3), rel=1e-11)
    assert gramian(still, "observability", 3) == pytest.approx(np.stack([Q] * 3), rel=1e-11)
    system = turned(A, B, C)
    norm = np.sqrt(np.trace(C @ P @ C.T))
    hankel = np.sqrt(np.linalg.eigvals(P @ Q).real.max())
    assert np.linalg.norm(gramian(system, "reachability", 7)[3]) == pytest.approx(np.linalg.norm(P), rel=1e-10)
    for one in (still, system):
        assert h2_norm(one) == pytest.approx(norm, rel=1e-10)
        assert hankel_norm(one) == pytest.approx(hankel, rel=1e-9)


@pytest.mark.parametrize("decay", [1e-3, 1e-6])
def test_slight_damping(decay):
    system = PeriodicSystem(A=constant([[0.0, 1.0], [-1.0, -2 * decay]]), B=[[0.0], [1.0]])
    assert 4 * decay * gramian(system, n_phases=2) == pytest.approx(np.stack([np.eye(2)] * 2), abs=1e-13 / decay)


def test_states_in_any_units_that_decay_at_very_different_speeds():
    A, B = np.array([[-1.0, 1e6], [0.0, -300.0]]), np.array([[1e-6], [1e-9]])
    wanted = solve_continuous_lyapunov(A, -B @ B.T)
    found = gramian(PeriodicSystem(A=constant(A, 1.0), B=B), n_phases=1)[0]
    assert np.abs(found / wanted - 1.0).max() < 1e-11


@pytest.mark.first(1)
@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_units_of_inputs_and_outputs_do_not_matter(unit):
    """With more harmonics in them than in A."""
    A, pulse = constant([[0.0, 1.0], [-3.0, -0.6]]), matrix(lambda t: [[np.exp(9 * np.cos(W * t) - 9)]])
    B, C = np.array([[0.0], [1.0]]) @ pulse, pulse @ np.array([[1.0, 0.0]])
    plain = PeriodicSystem(A=A, B=B, C=C)
    scaled = PeriodicSystem(A=A, B=B * unit, C=C * unit)
    for kind in KINDS:
        assert gramian(scaled, kind, 4) / unit**2 == pytest.approx(gramian(plain, kind, 4), rel=1e-11)
    mixed = PeriodicSystem(A=A, B=B * unit, C=C * (1.0 / unit))
    assert linf_norm(mixed).gain == pytest.approx(linf_norm(plain).gain, rel=2e-6)


@pytest.mark.slow
def test_a_gain_that_is_weak_is_not_lost():
    coupled = np.array([[-1.0, 0.0], [1e-2, -2.0]])
    system = turned(coupled, np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]]))
    assert linf_norm(system).gain == pytest.approx(0.5e-2, rel=1e-5)


def test_a_direction_that_is_not_reached():
    system = PeriodicSystem(A=constant([[-1.0, 0.0], [0.0, -2.0]]), B=[[1.0], [0.0]], C=[[0.0, 1.0]])
    assert gramian(system, n_phases=1)[0] == pytest.approx(np.diag([0.5, 0.0]), abs=1e-14)
    assert hankel_norm(system) == 0.0
    assert h2_norm(system) == 0.0
    assert linf_norm(system).gain == 0.0
    spun = turned(np.diag([-1.0, -2.0]), np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]]), [[0.3]])
    assert hankel_norm(spun) == 0.0  # its Gramians' product is rounding alone
    assert linf_norm(spun).gain == pytest.approx(0.3, rel=1e-6)


@pytest.mark.first(1)
@pytest.mark.parametrize("make", [smooth_system, jumping_system])
def test_h2_norm_is_the_energy_of_impulse_responses(make):
    system = make()
    bounds = np.unique(np.concatenate([[0.0, T], *(m.breaks for m in (system.A, system.B, system.C))]))
    instants, shares = quadrature(bounds, 2, points=8)
    energy = 0.0
    for instant, share in zip(instants, shares, strict=True):
        jumps = np.add.outer(T * np.arange(30), bounds).ravel()
        jumps = np.unique(np.concatenate([[instant], jumps[jumps > instant]]).round(12))
        times, weights = quadrature(jumps, 2)
        for column in system.B.at(instant).T:
            outputs = simulate(system, None, np.append(instant, times), initial=column)[:, 1:]
            energy += share * np.sum(outputs**2 @ weights)
    assert h2_norm(system) == pytest.approx(np.sqrt(energy / T), rel=1e-7)


def test_h2_norm_by_observability():
    system, n_phases = smooth_system(), 64
    B = system.B.at(T * np.arange(n_phases) / n_phases)
    trace = np.einsum("tij,tik,tkj->t", B, gramian(system, "observability", n_phases), B)
    assert h2_norm(system) == pytest.approx(np.sqrt(trace.mean()), rel=1e-11)


@pytest.mark.slow
def test_hankel_norm_between_the_phases():
    system = smooth_system()
    product = gramian(system, "reachability", 4096) @ gramian(system, "observability", 4096)
    values = np.sqrt(np.linalg.eigvals(product).real.max(axis=1))
    assert np.ptp(values) > 0.02
    assert hankel_norm(system) == pytest.approx(values.max(), rel=1e-7)
    assert hankel_norm(system) >= values.max() * (1 - 1e-12)


@pytest.mark.first(1)
@pytest.mark.parametrize("direct", [0.0, 1.0])
def test_gain_of_a_constant_system_and_of_the_same_one_turning(direct):
    A, B, C, D = reference_matrices()
    gain = lambda w: np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(4) - A, B) + direct * D, 2)  # noqa: E731
    grid = np.linspace(0.0, 10.0, 401)
    best = grid[np.argmax([gain(w) for w in grid])]
    peak = minimize_scalar(
        lambda w: -gain(w), bounds=(max(best - 0.1, 0.0), best + 0.1), method="bounded", options={"xatol": 1e-10}
    )
    for system in (PeriodicSystem(A=constant(A), B=B, C=C, D=direct * D), turned(A, B, C, direct * D)):
        found = linf_norm(system, tolerance=1e-9)
        assert found.gain == pytest.approx(-peak.fun, rel=1e-8)
        assert abs(found.gain + peak.fun) <= found.error
        assert found.omega == pytest.approx(abs((peak.x + W / 2) % W - W / 2), abs=1e-3)


def test_gain_of_cantoni_and_sandberg():
    """Cantoni and Sandberg 2009, Automatica 45: 1.7639, from a system of Zhou and Hagiwara.

    Below the norm there are gains at which the Hamiltonian matrix has no multiplier on the unit circle, as at 1.5:
    a bisection on that alone ends at 1.41.
    """
    found = linf_norm(cantoni_sandberg(), tolerance=1e-9)
    assert found.gain == pytest.approx(1.7639, abs=1e-4)
    assert found.gain == pytest.approx(lifted_gain(cantoni_sandberg(), 0.0), rel=1e-8)
    assert found.omega == pytest.approx(0.0, abs=1e-3)


@pytest.mark.first(1)
@pytest.mark.parametrize("D", [None, [[0.4, 0.0], [0.0, -0.3], [0.1, 0.0]]])
def test_gain_against_the_harmonic_transfer_function(D):
    system = smooth_system(D)
    found = linf_norm(system)
    assert lifted_gain(system, found.omega) == pytest.approx(found.gain, rel=1e-6)
    assert max(lifted_gain(system, omega) for omega in np.linspace(0.0, W / 2, 41)) <= found.gain + found.error


def test_gain_where_the_system_jumps():
    """The harmonics of jumps fall off slowly: the truncated gain comes closer from below."""
    system = jumping_system()
    found = linf_norm(system)
    near, nearer = (1 - lifted_gain(system, found.omega, count) / found.gain for count in (20, 80))
    assert 0.0 < nearer < 0.4 * near < 0.01


def test_no_input_has_a_larger_gain_and_one_has_nearly_it():
    system = smooth_system([[0.4, 0.0], [0.0, -0.3], [0.1, 0.0]])
    found = linf_norm(system)
    times = T * np.arange(40 * 200) / 200
    noise = np.random.default_rng(6).normal(size=(2, len(times)))
    gains = []
    lifted = HarmonicSystem.from_system(system, 12)
    column = np.linalg.svd(lifted.transfer(1j * found.omega))[2][0].conj()
    waves = np.array(
        [
            column[[index == (name, k) for index in lifted.inputs].index(True)]
            for name in ("u1", "u2")
            for k in range(-12, 13)
        ]
    ).reshape(2, 25)
    window = np.sin(np.pi * times / times[-1])
    tuned = np.real(waves @ np.exp(1j * np.outer(found.omega + W * np.arange(-12, 13), times))) * window
    for inputs in (noise, tuned):
        outputs = simulate(system, inputs, times)
        gains.append(np.linalg.norm(outputs) / np.linalg.norm(inputs))
    assert max(gains) <= found.gain
    assert gains[1] > 0.97 * found.gain > 1.3 * gains[0]


def test_gain_of_a_direct_term_that_no_frequency_attains():
    """G = d(t) - 0.5/(s + 1), with the largest d at an instant: the states only take from it."""
    D = matrix(lambda t: [[3 + np.cos(W * t)]])
    system = PeriodicSystem(A=constant([[-1.0]]), B=[[1.0]], C=[[-0.5]], D=D)
    found = linf_norm(system)
    assert found.gain == pytest.approx(4.0, rel=1e-6)
    assert found.omega == np.inf
    # Close to the gain of D the equation is quick, and its steps have to be short: no more than a radian each.
    steps = _factors(_scaled(system, 4.0), 4.0 * (1 + 1e-6))
    assert np.abs(steps - np.eye(2)).sum(axis=2).max() < np.exp(1.3) - 1


def test_gain_under_slight_damping():
    decay = 1e-5
    A, B = constant([[0.0, 1.0], [-1.0, -2 * decay]]), [[0.0], [1.0]]
    found = linf_norm(PeriodicSystem(A=A, B=B, C=[[1.0, 0.0]]))
    wanted = 0.5 / (decay * np.sqrt(1 - decay**2))
    assert abs(found.gain - wanted) <= found.error < 2e-6 * wanted


def test_hankels_norm_is_below_the_gain():
    system = smooth_system()
    assert hankel_norm(system) < linf_norm(system).gain


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda: gramian(constant([[-1.0]])), "`system` of `floquet.gramian` must be a PeriodicSystem"),
        (lambda: gramian(smooth_system(), "reach"), '`kind` of .* must be "reachability" or "observability"'),
        (lambda: gramian(smooth_system(), n_phases=0), "`n_phases` of .* must be an integer of at least 1"),
        (lambda: gramian(PeriodicSystem(A=constant([[-1.0]]))), "`system` of .* must have inputs"),
        (
            lambda: gramian(PeriodicSystem(A=constant([[0.25]])), "observability"),
            "must be stable.*\n?.*exponent of real part 0.25",
        ),
        (lambda: gramian(PeriodicSystem(A=constant([[0.0, 1.0], [-1.0, 0.0]]), B=np.eye(2))), "must be stable"),
        (
            lambda: linf_norm(PeriodicSystem(A=constant([[0.1]]), B=[[1.0]])),
            "`system` of `floquet.linf_norm` must be s",
        ),
        (lambda: linf_norm(smooth_system(), tolerance=1e-12), "`tolerance` of `floquet.linf_norm` must lie"),
        (lambda: h2_norm(cantoni_sandberg()), "must have no direct term.*\n.*linf_norm"),
        (lambda: h2_norm(PeriodicSystem(A=constant([[-1.0]]))), "`system` of `floquet.h2_norm` must have inputs"),
        (
            lambda: h2_norm(
                PeriodicSystem(
                    A=constant([[-1.0]]),
                    B=[[1.0]],
                    C=FunctionMatrix(function=lambda t: [[(t % T > 0.4) + 1.0]], period=T),
                )
            ),
            "must have a mean of C P Cᵀ that is found",
        ),
        (lambda: hankel_norm(PeriodicSystem(A=constant([[0.1]]), B=[[1.0]])), "`floquet.hankel_norm` must be stable"),
        (lambda: PeakGain(gain=np.inf, error=0.0, omega=0.0), "`gain` of `PeakGain` must be a finite number"),
    ],
)
def test_what_does_not_exist_is_refused(attempt, message):
    with pytest.raises(InputError, match=message):
        attempt()
