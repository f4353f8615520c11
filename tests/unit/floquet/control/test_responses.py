"""Responses of a periodic system in time."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import StateSpace, lsim, step

from floquid.errors import InputError
from floquid.floquet import (
    FunctionMatrix,
    HarmonicMatrix,
    PeriodicSystem,
    PiecewiseMatrix,
    discretise,
    harmonic_transfer,
    simulate,
    transition,
)

T = 1.3
W = 2 * np.pi / T


def matrix(function, period=T, breaks=(), **options):
    return FunctionMatrix(function=function, period=period, breaks=breaks, **options)


def constant(value, period=T):
    return HarmonicMatrix(coefficients=np.asarray(value, dtype=float)[:, :, None], harmonics=[0], period=period)


def smooth_system():
    return PeriodicSystem(
        A=matrix(lambda t: [[0, 1], [-3 - np.cos(W * t), -0.4 - 0.3 * np.sin(2 * W * t)]]),
        B=matrix(lambda t: [[0, 0.2], [1 + 0.5 * np.sin(W * t), 0]]),
        C=matrix(lambda t: [[1 + 0.2 * np.cos(W * t), 0], [0, 1.0], [1.0, 1.0]]),
        D=matrix(lambda t: [[0.1, 0], [0, 0.3 * np.cos(W * t)], [0, 0]]),
    )


def jumping_system():
    A = np.stack([[[0.0, 1.0], [-4.0, -0.9]], [[0.0, 1.0], [-2.0, -0.9]]], axis=2)
    B = np.stack([[[0.0], [1.0]], [[0.5], [-1.0]]], axis=2)
    return PeriodicSystem(
        A=PiecewiseMatrix(values=A, edges=[0.0, 0.7], period=T),
        B=PiecewiseMatrix(values=B, edges=[0.1, 0.55], period=T),
    )


def integrated(system, signal, times, initial, stops=()):
    """By a Runge-Kutta method from stop to stop, each seen from the side on which the step lies."""
    turns = T * np.arange(np.floor(times[0] / T), np.ceil(times[-1] / T) + 1)
    jumps = [np.add.outer(turns, np.asarray(m.breaks)).ravel() for m in (system.A, system.B)]
    ends = np.unique(np.concatenate([times, *jumps, stops]))
    ends = ends[(ends >= times[0]) & (ends <= times[-1])]
    states = {ends[0]: np.asarray(initial, dtype=float)}
    for left, right in pairwise(ends):
        middle = 0.5 * (left + right)

        def rate(t, x, middle=middle):
            inside = middle + (t - middle) * (1 - 1e-12)
            return system.A.at(inside) @ x + system.B.at(inside) @ signal(inside)

        states[right] = solve_ivp(rate, (left, right), states[left], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return np.array([states[t] for t in times])


def outputs(system, states, inputs, times):
    """The outputs (outputs, times) of states (times, n) and inputs (inputs, times)."""
    values = np.einsum("tij,tj->it", system.C.at(times), states)
    return values + np.einsum("tij,jt->it", system.D.at(times), inputs)


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


def random_times(count=40):
    return np.sort(np.random.default_rng(0).uniform(-3.0, 9.0, count))


@pytest.mark.first(1)
@pytest.mark.parametrize("make", [smooth_system, jumping_system])
@pytest.mark.parametrize("between", ["linear", "held"])
def test_samples_at_any_instants_are_that_function_of_time(make, between):
    system, times = make(), random_times(25)
    samples = np.random.default_rng(1).normal(size=(system.n_inputs, 25))

    def signal(t):
        if between == "linear":
            return np.array([np.interp(t, times, row) for row in samples])
        return samples[:, np.searchsorted(times, t, side="right") - 1]

    found = simulate(system, samples, times, initial=[1.0, 1.0], between=between)
    states = integrated(system, signal, times, [1.0, 1.0], stops=times)
    assert found == pytest.approx(outputs(system, states, samples, times), abs=1e-10)


def test_samples_in_steps_that_all_but_divide_the_period():
    """Phases that are near each other are not one."""
    system, times = smooth_system(), T / 20 * (1 + 1e-6) * np.arange(60)
    samples = np.random.default_rng(1).normal(size=(2, 60))
    signal = lambda t: samples[:, np.searchsorted(times, t, side="right") - 1]  # noqa: E731
    found = simulate(system, samples, times, between="held")
    states = integrated(system, signal, times, [0.0, 0.0], stops=times)
    assert found == pytest.approx(outputs(system, states, samples, times), abs=1e-10)


@pytest.mark.parametrize("between", ["linear", "held"])
@pytest.mark.parametrize("make", [lambda *m: PeriodicSystem(A=constant(m[0]), B=m[1], C=m[2], D=m[3]), turned])
def test_a_constant_system_and_the_same_one_turning(make, between):
    A, B = np.array([[0.0, 1.0, 0.0], [-4.0, -0.5, 1.0], [0.0, 0.0, -3.0]]), np.array([[0.0], [1.0], [2.0]])
    C, D = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]), np.array([[0.2], [0.0]])
    times = np.linspace(0.0, 8.0, 161)
    samples = np.random.default_rng(2).normal(size=(1, 161))
    wanted = lsim((A, B, C, D), samples[0], times, interp=between == "linear")[1]
    assert simulate(make(A, B, C, D), samples, times, between=between) == pytest.approx(wanted.T, abs=1e-10)


def test_the_response_to_a_step():
    A, B, C, D = np.array([[0.0, 1.0], [-9.0, -0.6]]), np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))
    times = np.linspace(0.0, 5.0, 60)
    wanted = step(StateSpace(A, B, C, D), T=times)[1]
    found = simulate(turned(A, B, C), np.ones((1, 60)), times, between="held")
    assert found == pytest.approx(wanted.T, abs=1e-10)


def test_a_long_record_in_steps_of_the_period():
    """Against the discrete system, sample by sample; gaps of one phase are integrated once."""
    calls = []

    def varying(times):
        calls.append(len(times))
        out = np.zeros((len(times), 2, 2))
        out[:, 0, 1], out[:, 1, 0], out[:, 1, 1] = 1.0, -3.0 - np.cos(W * times), -0.4
        return out

    system = PeriodicSystem(A=matrix(varying, vectorised=True, breaks=[0.4]), B=[[0.0], [1.0]])
    samples = np.random.default_rng(3).normal(size=(1, 8000))
    times = T * np.arange(8000) / 40
    simulate(system, samples[:, :80], times[:80], between="held")
    once = sum(calls)
    found = simulate(system, samples, times, between="held")
    assert sum(calls) < 2.1 * once  # and not a hundred times
    steps, state, wanted = discretise(system, 40), np.zeros(2), []
    for k, u in enumerate(samples.T):
        wanted.append(state)  # the outputs are the states
        state = steps.A[k % 40] @ state + steps.B[k % 40] @ u
    assert found == pytest.approx(np.array(wanted).T, abs=1e-9)


def test_what_is_left_after_long_is_the_steady_response():
    system, omega, amplitude = smooth_system(), 2.2, np.array([1.0 + 0.5j, -0.7])
    # The inputs as two more states, a cosine and a sine: u = Re(a) cos - Im(a) sin.
    by_wave, wave = np.array([amplitude.real, -amplitude.imag]).T, np.array([[0.0, -omega], [omega, 0.0]])
    driven = PeriodicSystem(
        A=matrix(lambda t: np.block([[system.A.at(t), system.B.at(t) @ by_wave], [np.zeros((2, 2)), wave]])),
        C=matrix(lambda t: np.hstack([system.C.at(t), system.D.at(t) @ by_wave])),
    )
    times = np.concatenate([[0.0], np.linspace(100.0 * T, 101.0 * T, 17)])
    found = simulate(driven, None, times, initial=[0.0, 0.0, 1.0, 0.0])
    transfer = harmonic_transfer(system, [omega], tolerance=1e-10)
    waves = np.exp(1j * np.multiply.outer(omega + W * transfer.harmonics, times[1:]))
    steady = np.einsum("oih,i,ht->ot", transfer.values[..., 0], amplitude, waves).real
    assert found[:, 1:] == pytest.approx(steady, abs=1e-8)


@pytest.mark.parametrize("inputs", [None, np.zeros((2, 12))])
def test_without_inputs_it_is_the_transition(inputs):
    system, times = smooth_system(), np.linspace(-1.0, 6.0, 12)
    wanted = system.C.at(times) @ transition(system.A, None, times, start=-1.0) @ np.array([0.5, 2.0])
    assert simulate(system, inputs, times, initial=[0.5, 2.0]) == pytest.approx(wanted.T, abs=1e-11)
    alone = PeriodicSystem(A=system.A, C=system.C)
    assert simulate(alone, None, times, initial=[0.5, 2.0]) == pytest.approx(wanted.T, abs=1e-11)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_units_of_states_and_inputs_do_not_matter(unit):
    plain, change = smooth_system(), np.diag([1.0, unit])
    back = np.linalg.inv(change)
    system = PeriodicSystem(A=back @ plain.A @ change, B=back @ plain.B @ np.diag([unit, 1.0]), C=plain.C @ change)
    plain = PeriodicSystem(A=plain.A, B=plain.B, C=plain.C)
    times, samples = random_times(), np.random.default_rng(4).normal(size=(2, 40))
    wanted = simulate(plain, samples, times)
    assert simulate(system, samples / [[unit], [1.0]], times) == pytest.approx(wanted, rel=1e-9, abs=1e-10)


def test_one_instant_and_one_twice():
    system = smooth_system()
    assert simulate(system, np.ones((2, 1)), [0.3], initial=[1.0, 2.0]).shape == (3, 1)
    samples = np.array([[1.0, 2.0, 5.0], [0.0, 1.0, 1.0]])
    found = simulate(system, samples, [0.0, 0.5, 0.5], initial=[1.0, 2.0])
    states = np.linalg.solve(system.C.at(0.5)[:2], found[:2, 1:] - system.D.at(0.5)[:2] @ samples[:, 1:])
    assert states[:, 0] == pytest.approx(states[:, 1], abs=1e-12)


def test_outputs_at_a_jump_are_those_after_it():
    """Whatever rounding makes of the phase of an instant."""
    times, at = T * np.arange(60) / 20, np.arange(60) % 20
    for index in range(1, 20):
        C = PiecewiseMatrix(values=np.array([[[1.0, 2.0]]]), edges=[0.0, index * T / 20], period=T)
        found = simulate(PeriodicSystem(A=[[0.0]], C=C), None, times, initial=[1.0])
        assert found[0].tolist() == np.where(at < index, 1.0, 2.0).tolist()


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda s: simulate(s.A, None, [0.0]), "`system` of `floquet.simulate` must be a PeriodicSystem"),
        (lambda s: simulate(s, np.ones((2, 3)), [0.0, 1.0]), r"`inputs` of .* must have shape \(2, 2\)"),
        (lambda s: simulate(s, None, [1.0, 0.0]), "`times` of .* must ascend"),
        (lambda s: simulate(s, None, []), "`times` of .* must ascend and hold one"),
        (lambda s: simulate(s, None, [0.0], initial=[1.0]), r"`initial` of .* must have shape \(2,\)"),
        (lambda s: simulate(s, None, [0.0], between="cubic"), '`between` of .* must be "linear" or "held"'),
        (lambda s: simulate(s, np.sin, [0.0, 1.0]), r"`inputs` of .* must be an array of numbers of shape \(2, 2\)"),
        (lambda s: simulate(PeriodicSystem(A=s.A), np.ones((1, 1)), [0.0]), r"`inputs` of .* shape \(0, 1\)"),
        (
            lambda s: simulate(PeriodicSystem(A=constant([[900.0]])), None, [0.0, 1.0], initial=[1.0]),
            "`times` of .* must end before the response leaves",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(attempt, message):
    with pytest.raises(InputError, match=message):
        attempt(smooth_system())
