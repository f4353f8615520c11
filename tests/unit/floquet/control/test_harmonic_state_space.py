"""The harmonic state space, the harmonic transfer function and the response to a sine."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from floquid.errors import InputError
from floquid.floquet import (
    FunctionMatrix,
    HarmonicMatrix,
    PeriodicSystem,
    PiecewiseMatrix,
    harmonic_transfer,
    hill,
)
from floquid.floquet.hill_method import block_toeplitz, speeds
from floquid.floquet.matrices import fourier

T = 2.0
W = 2 * np.pi / T


def matrix(function, breaks=()):
    return FunctionMatrix(function=function, period=T, breaks=breaks)


def smooth_system():
    return PeriodicSystem(
        A=matrix(lambda t: [[0, 1], [-3 - np.cos(W * t), -0.9 - 0.3 * np.sin(2 * W * t)]]),
        B=matrix(lambda t: [[0, 0.2], [1 + 0.5 * np.sin(W * t), 0]]),
        C=matrix(lambda t: [[1 + 0.2 * np.cos(W * t), 0], [0, 1.0], [1.0, 1.0]]),
        D=matrix(lambda t: [[0.1, 0], [0, 0.3 * np.cos(W * t)], [0, 0]]),
        states=["x", "v"],
        inputs=["force", "base"],
        outputs=["a", "b", "c"],
    )


def jumping_system():
    values = np.stack([[[0.0, 1.0], [-4.0, -0.9]], [[0.0, 1.0], [-2.0, -0.9]]], axis=2)
    return PeriodicSystem(A=PiecewiseMatrix(values=values, edges=[0.0, 0.7], period=T), B=[[0.0], [1.0]])


def lifted(system, count):
    """The harmonic state space cut off at `count`: A less i k ω on its diagonal, B, C and D, harmonic by harmonic."""
    found = [block_toeplitz(fourier(m, 2 * count), count) for m in (system.A, system.B, system.C, system.D)]
    found[0] -= np.diag(speeds(system.n_states, count, 2 * np.pi / system.period))
    return found


def truncated(system, count, s):
    """The transfer function at s of a system cut off at `count` (outputs, inputs, harmonic out, harmonic in)."""
    a, b, c, d = lifted(system, count)
    found = c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d
    size = 2 * count + 1
    return found.reshape(size, system.n_outputs, size, system.n_inputs).transpose(1, 3, 0, 2)


def simulated(system, omega, amplitude, times):
    """The outputs at `times` of the first period when all else has died away: a period later they are e^{iΩT} times."""
    n = system.n_states
    waves = lambda t: amplitude * np.exp(1j * omega * t)  # noqa: E731
    whole, seen = np.eye(n, n + 1, dtype=complex), []
    for a, b in pairwise(np.unique([0.0, T, *times, *np.asarray(system.A.breaks)])):
        middle = 0.5 * (a + b)

        def rate(t, x, middle=middle):
            inside = middle + (t - middle) * (1 - 1e-12)  # the side of a jump on which the step lies
            moved = system.A.at(inside) @ x.reshape(n, n + 1)
            moved[:, n] += system.B.at(t) @ waves(t)
            return moved.ravel()

        seen += [whole] * (a in times)
        ends = solve_ivp(rate, (a, b), whole.ravel(), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        whole = ends.reshape(n, n + 1)
    start = np.linalg.solve(np.exp(1j * omega * T) * np.eye(n) - whole[:, :n], whole[:, n])
    states = np.array(seen) @ np.append(start, 1.0)
    outputs = [system.C.at(t) @ x + system.D.at(t) @ waves(t) for t, x in zip(times, states, strict=True)]
    return np.array(outputs).real.T


def steady(found, amplitude, times):
    """The response to Re(U e^{iΩt}) by the transfer at its line (outputs, times)."""
    waves = np.exp(1j * np.multiply.outer(found.omega[0] + W * found.harmonics, np.asarray(times)))
    return np.einsum("oih,i,ht->ot", found.values[..., 0], amplitude, waves).real


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("omega", "amplitude"), [(1.3, [1 + 0.5j, -0.4]), (W, [1.0, 0.3j]), (-0.4, [0.0, 1j]), (0.0, [1, 1])]
)
def test_the_transfer_of_a_sine_is_what_is_left_of_a_simulation(omega, amplitude):
    system, column = smooth_system(), np.array(amplitude, dtype=complex)
    found = harmonic_transfer(system, [omega], tolerance=1e-10)
    times = [0.1, 0.5, 0.9, 1.4, 1.9]
    values = simulated(system, omega, column, times)
    assert np.abs(values).max() > 0.1
    assert steady(found, column, times) == pytest.approx(values, abs=1e-10)
    assert found.error.max() < 1e-10


@pytest.mark.slow
def test_transfer_of_a_system_that_jumps():
    """The harmonics are those of a simulation; their sum converges slowly, the velocity having kinks."""
    system = jumping_system()
    found = harmonic_transfer(system, [1.3], tolerance=1e-10)
    assert found.error.max() < 1e-10
    times = [0.1, 0.35, 0.6]
    values = simulated(system, 1.3, np.ones(1), times)
    assert steady(found, np.ones(1), times)[0] == pytest.approx(values[0], abs=2e-6)
    assert steady(found, np.ones(1), times)[1] == pytest.approx(values[1], abs=5e-4)
    exact = truncated(system, 250, 1.3j)[:, 0, 248:253, 250]  # at -2..2, to 1e-9
    assert found.values[:, 0, found.harmonics.size // 2 + np.arange(-2, 3), 0] == pytest.approx(exact, abs=2e-9)


def test_transfers_of_several_lines_are_those_of_each():
    system = smooth_system()
    found = harmonic_transfer(system, [0.0, 1.3, 7.0], n_harmonics=6, tolerance=1e-12)
    assert found.values.shape == (3, 2, 13, 3)
    assert found.inputs == ("force", "base")
    for number, omega in enumerate(found.omega):
        one = harmonic_transfer(system, [omega], n_harmonics=6, tolerance=1e-12)
        assert found.values[..., number] == pytest.approx(one.values[..., 0], abs=1e-12)


def test_transfer_repeats_with_the_fundamental():
    """The lifted matrix at s + iω is that at s with rows and columns moved by a harmonic."""
    here = truncated(smooth_system(), 25, 0.4 + 1j * W)[:, :, 22:29, 22:29]
    there = truncated(smooth_system(), 25, 0.4)[:, :, 23:30, 23:30]
    assert np.abs(here).max() > 0.1
    assert here == pytest.approx(there, abs=1e-12)


def test_constant_system_answers_at_the_input_frequency_alone():
    a, b, c = np.array([[0.0, 1.0], [-4.0, -0.2]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    system = PeriodicSystem(A=HarmonicMatrix(coefficients=a[:, :, None], harmonics=[0], period=T), B=b, C=c, D=[[0.5]])
    omega = np.array([0.3, 2.0, 9.0])
    found = harmonic_transfer(system, omega, n_harmonics=2)
    exact = 1 / (4 - omega**2 + 0.2j * omega) + 0.5
    assert found.values[0, 0, 2] == pytest.approx(exact, abs=1e-13)
    assert np.abs(found.values[0, 0, [0, 1, 3, 4]]).max() < 1e-15


def test_eigenvalues_of_the_lifted_state_matrix_are_the_exponents():
    system = smooth_system()
    values = np.linalg.eigvals(lifted(system, 20)[0])
    for exponent in hill(system.A).exponents:
        assert np.abs(values - exponent).min() < 1e-12


def test_error_says_how_far_the_values_have_settled():
    system = jumping_system()
    exact = harmonic_transfer(system, [1.3], n_harmonics=4, tolerance=1e-12)
    coarse = harmonic_transfer(system, [1.3], n_harmonics=4, tolerance=1e-3)
    off = np.abs(coarse.values - exact.values).max(axis=(2, 3))
    assert coarse.n_harmonics < exact.n_harmonics
    assert (off > 0).all()
    assert (off <= coarse.error).all()


@pytest.mark.slow
def test_unnamed_jumps_are_refused_or_reported():
    values = np.asarray(jumping_system().A.values)
    unnamed = matrix(lambda t: values[..., 0] if t % T < 0.7 else values[..., 1])
    system = PeriodicSystem(A=unnamed, B=[[0.0], [1.0]])
    with pytest.raises(InputError, match=r"have a response that settles to 1e-13.*\n.*name the jumps"):
        harmonic_transfer(system, [1.3], n_harmonics=2, tolerance=1e-13)
    found = harmonic_transfer(system, [1.3], n_harmonics=2, tolerance=1e-13, raises=False)
    exact = harmonic_transfer(jumping_system(), [1.3], n_harmonics=2, tolerance=1e-12)
    off = np.abs(found.values - exact.values).max()
    assert 1e-12 < off < 2 * found.error.max() < 1e-7


def oscillator(damping):
    a = [[0.0, 1.0], [-2.2, -damping]]
    swing = [[[0.0], [0.0]], [[0.1], [0.0]]]
    return PeriodicSystem(
        A=HarmonicMatrix.from_cosines(a, swing, np.zeros((2, 2, 1)), period=T), B=[[0.0], [1.0]], C=[[1.0, 0.0]]
    )


@pytest.mark.parametrize("turns", [-2, 0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_sine_at_an_undamped_exponent_is_refused(turns, sign):
    natural = abs(hill(oscillator(0.0).A).exponents[0].imag)
    with pytest.raises(InputError, match="keep off the undamped exponents"):
        harmonic_transfer(oscillator(0.0), [sign * natural + turns * W])
    beside = harmonic_transfer(oscillator(0.0), [sign * natural + turns * W + 1e-3])
    assert np.abs(beside.values).max() > 0.01
    assert harmonic_transfer(oscillator(0.01), [natural]).error.max() < 1e-6
    assert harmonic_transfer(oscillator(-0.1), [0.5]).error.max() < 1e-8


@pytest.mark.parametrize("turns", [-1, 0, 2])
def test_a_transfer_function_at_an_undamped_exponent_is_refused(turns):
    """Rounding alone would make it 4e15 there."""
    natural = abs(hill(oscillator(0.0).A).exponents[0].imag)
    with pytest.raises(InputError, match=r"`omega` of `floquet.harmonic_transfer` must keep off the undamped exp"):
        harmonic_transfer(oscillator(0.0), [0.2, natural + turns * W])
    assert harmonic_transfer(oscillator(0.0), [natural + 1e-3]).error.max() < 1e-3
    assert np.isfinite(harmonic_transfer(oscillator(0.01), [natural]).values).all()


def scalar(mean, swing=0.0, line=10):
    return HarmonicMatrix.from_cosines([[mean]], [[[swing]]], [[[0.0]]], period=T, harmonics=[line])


@pytest.mark.parametrize("line", [7, 10, 33])
def test_harmonics_of_the_inputs_and_outputs_are_met(line):
    """The output of x' = -x + b(t) u, y = c(t) x + d(t) u by hand."""
    omega, b, c, d = 0.3, 5.0, 3.0, 2.0
    system = PeriodicSystem(A=scalar(-1.0), B=scalar(1, b, line), C=scalar(1, c, line), D=scalar(0, d, line))
    lag = {k: 1 / (1j * (omega + k * line * W) + 1) for k in (-1, 0, 1)}
    exact = {
        0: lag[0] + b * c / 4 * (lag[-1] + lag[1]),
        line: b / 2 * lag[1] + c / 2 * lag[0] + d / 2,
        -line: b / 2 * lag[-1] + c / 2 * lag[0] + d / 2,
        2 * line: b * c / 4 * lag[1],
        -2 * line: b * c / 4 * lag[-1],
    }
    found = harmonic_transfer(system, [omega])
    values = dict(zip(found.harmonics.tolist(), found.values[0, 0, :, 0], strict=True))
    for k, value in exact.items():
        assert values.pop(k) == pytest.approx(value, abs=1e-12)
    assert max(map(abs, values.values())) < 1e-12
    few = harmonic_transfer(system, [omega], n_harmonics=line)
    assert few.values[0, 0, [0, line, -1], 0] == pytest.approx([exact[-line], exact[0], exact[line]], abs=1e-12)


def test_far_harmonics_of_the_state_matrix_are_met():
    swing = np.zeros((2, 2, 1))
    swing[1, 0] = -8.0
    a = HarmonicMatrix.from_cosines([[0, 1], [-25, -0.2]], swing, 0 * swing, period=2 * np.pi, harmonics=[10])
    system = PeriodicSystem(A=a, B=[[0.0], [1.0]])
    found = harmonic_transfer(system, [0.3])
    exact = truncated(system, 100, 0.3j)[:, 0, :, 100]
    reach = found.harmonics[-1]
    assert np.abs(exact[:, [90, 110]]).min() > 1e-4
    assert found.values[:, 0, :, 0] == pytest.approx(exact[:, 100 - reach : 101 + reach], abs=1e-8)


def test_harmonics_that_do_not_fit_are_refused():
    system = PeriodicSystem(A=scalar(-1.0), B=scalar(1.0, 1.0, 2000), C=[[1.0]])
    with pytest.raises(
        InputError, match=r"`system` of `floquet.harmonic_transfer` must keep \(2 N \+ 1\) n within 2500"
    ):
        harmonic_transfer(system, [0.3])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: harmonic_transfer(s.A, [1.0]), "`system` of `floquet.harmonic_transfer` must be a PeriodicSystem"),
        (lambda s: harmonic_transfer(PeriodicSystem(A=s.A), [1.0]), "must have inputs, but has none"),
        (lambda s: harmonic_transfer(s, 1.0), r"must have shape \(lines,\)"),
        (lambda s: harmonic_transfer(s, [1.0], n_harmonics=600), r"604 harmonics of 2 states"),
        (
            lambda s: harmonic_transfer(s, [1.0], tolerance=1.0),
            "`tolerance` of `floquet.harmonic_transfer` must lie in",
        ),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call(smooth_system())


def test_no_lines_give_no_values():
    assert harmonic_transfer(smooth_system(), []).values.shape[3] == 0
