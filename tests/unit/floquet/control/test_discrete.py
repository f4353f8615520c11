"""Discrete periodic systems: from continuous ones, their multipliers, and time-invariant systems in their place."""

import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import cont2discrete, dlsim

from floquid.errors import InputError
from floquid.floquet import (
    DiscretePeriodicSystem,
    FunctionMatrix,
    HarmonicMatrix,
    PeriodicSystem,
    PiecewiseMatrix,
    discretise,
    lift,
    multipliers,
    realise,
)


def random_discrete(seed, n_phases=5, n=3, n_inputs=2, n_outputs=2):
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n_phases, n, n)) / np.sqrt(n)
    B, C, D = (
        generator.normal(size=(n_phases, *shape)) for shape in ((n, n_inputs), (n_outputs, n), (n_outputs, n_inputs))
    )
    return DiscretePeriodicSystem(A=A, B=B, C=C, D=D, dt=0.02)


def recurrence(system, inputs, state, first_phase):
    """The definition, sample by sample."""
    outputs = []
    for k, u in enumerate(inputs.T):
        at = (first_phase + k) % system.n_phases
        outputs.append(system.C[at] @ state + system.D[at] @ u)
        state = system.A[at] @ state + system.B[at] @ u
    return np.array(outputs).T


def assert_same_set(found, expected, tolerance):
    """Two sets of numbers, paired by assignment."""
    from scipy.optimize import linear_sum_assignment

    assert len(found) == len(expected)
    distance = np.abs(np.subtract.outer(np.asarray(found), np.asarray(expected)))
    pairs = linear_sum_assignment(distance)
    assert distance[pairs].max() <= tolerance


@pytest.mark.parametrize(
    ("n_phases", "n", "n_inputs", "n_outputs", "first_phase"),
    [(5, 3, 2, 2, 0), (5, 3, 2, 1, 3), (1, 2, 1, 3, 0), (4, 1, 3, 2, 1), (2, 4, 1, 1, 1)],
)
def test_lifted_responses_are_the_periodic_ones(n_phases, n, n_inputs, n_outputs, first_phase):
    """Sample by sample, by scipy and by python-control."""
    control = pytest.importorskip("control", reason="it is in the dependency group `peers`")
    system, generator = random_discrete(2, n_phases, n, n_inputs, n_outputs), np.random.default_rng(3)
    inputs, initial = generator.normal(size=(n_inputs, 6 * n_phases)), generator.normal(size=n)
    expected = recurrence(system, inputs, initial, first_phase)
    lifted = lift(system, first_phase=first_phase)
    stacked = lifted.stack(inputs)
    _, by_scipy, _ = dlsim(lifted.to_scipy(), stacked.T, x0=initial)
    assert lifted.unstack(by_scipy.T) == pytest.approx(expected, abs=1e-11)
    response = control.forced_response(lifted.to_control(), inputs=stacked, initial_state=initial, squeeze=False)
    assert lifted.unstack(response.outputs) == pytest.approx(expected, abs=1e-11)
    assert response.time[1] == pytest.approx(system.period)


@pytest.mark.parametrize("first_phase", [0, 2])
@pytest.mark.parametrize("seed", range(4))
def test_poles_of_the_lifted_are_the_multipliers(seed, first_phase):
    system = random_discrete(seed)
    found = system.multipliers()
    assert_same_set(lift(system, first_phase=first_phase).poles(), found, 1e-12)
    assert np.exp(system.exponents() * system.period) == pytest.approx(found, rel=1e-12)
    assert np.abs(system.exponents().imag).max() <= np.pi / system.period * (1.0 + 1e-15)


def test_small_multipliers_are_not_lost():
    """Of 1, 1e-20 and 1e-30 the plain product has rounding alone for two."""
    generator = np.random.default_rng(0)
    chosen = np.array([1.0, -1e-20, 1e-30])
    bases = np.linalg.qr(generator.normal(size=(10, 3, 3)))[0]
    steps = np.abs(chosen) ** 0.1 * np.ones((10, 3))
    steps[4, 1] *= -1.0
    A = np.stack([np.roll(bases, -1, axis=0)[k] @ np.diag(steps[k]) @ bases[k].T for k in range(10)])
    found = DiscretePeriodicSystem(A=A, dt=0.1).multipliers()
    assert found == pytest.approx(np.array([1.0, 1e-30, -1e-20]), rel=1e-11, abs=0.0)


@pytest.mark.parametrize("rank", [1, 0])
def test_multipliers_of_zero(rank):
    """A step that forgets: the state is not reversible, and the exponent has no floor."""
    A = np.array(random_discrete(5).A)
    A[2] = np.diag([1.0, 0.0, 0.0]) * rank
    system = DiscretePeriodicSystem(A=A, dt=0.1)
    sizes = np.sort(np.abs(system.multipliers()))
    whole = np.linalg.multi_dot(A[::-1])
    assert sizes[:2] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert sizes[2] == pytest.approx(abs(np.trace(whole)), rel=1e-10, abs=1e-15)
    assert (system.exponents().real < 0.0).sum() >= 2


def test_labels_say_phase_and_name():
    control = pytest.importorskip("control", reason="it is in the dependency group `peers`")
    generator = np.random.default_rng(0)
    A, B, C = generator.normal(size=(3, 2, 2)), generator.normal(size=(3, 2, 1)), generator.normal(size=(3, 1, 2))
    system = DiscretePeriodicSystem(A=A, B=B, C=C, dt=0.1, states=["x", "v"], inputs=["force"], outputs=["tip"])
    lifted = lift(system, first_phase=1)
    assert lifted.states == ((1, "x"), (1, "v"))
    assert lifted.inputs == ((1, "force"), (2, "force"), (0, "force"))
    assert lifted.outputs == ((1, "tip"), (2, "tip"), (0, "tip"))
    assert lifted.dt == pytest.approx(0.3)
    # The output at phase 0, two steps on, owes to the input at phase 1 what goes through A at phase 2.
    assert lifted.D[2, 0] == pytest.approx((C[0] @ A[2] @ B[1])[0, 0])
    assert lifted.D[0].tolist() == [0.0, 0.0, 0.0]
    model = lifted.to_control()
    assert isinstance(model, control.StateSpace)
    assert model.dt == pytest.approx(0.3)
    assert model.input_labels == ["force[1]", "force[2]", "force[0]"]
    assert model.output_labels == ["tip[1]", "tip[2]", "tip[0]"]
    assert model.state_labels == ["x[1]", "v[1]"]


@pytest.mark.parametrize(
    ("n_phases", "n", "n_inputs", "n_outputs", "first_phase"),
    [(5, 3, 2, 2, 0), (5, 3, 2, 1, 3), (1, 2, 1, 3, 0), (4, 1, 3, 2, 1), (2, 4, 1, 1, 1)],
)
def test_there_and_back_by_python_control(n_phases, n, n_inputs, n_outputs, first_phase):
    """In other coordinates, of the same multipliers and responses, from every phase on."""
    control = pytest.importorskip("control", reason="it is in the dependency group `peers`")
    system, generator = random_discrete(2, n_phases, n, n_inputs, n_outputs), np.random.default_rng(3)
    lifted = lift(system, first_phase=first_phase).to_control()
    turn = generator.normal(size=(n, n))
    turned = control.ss(
        np.linalg.solve(turn, lifted.A @ turn), np.linalg.solve(turn, lifted.B), lifted.C @ turn, lifted.D, lifted.dt
    )
    found = realise(turned, n_phases, first_phase=first_phase)
    assert (found.n_states, found.n_phases, found.dt) == (n, n_phases, pytest.approx(system.dt))
    assert_same_set(found.multipliers(), system.multipliers(), 1e-10)
    inputs = generator.normal(size=(n_inputs, 4 * n_phases))
    for phase in range(n_phases):
        expected = recurrence(system, inputs, np.zeros(system.n_states), phase)
        assert recurrence(found, inputs, np.zeros(found.n_states), phase) == pytest.approx(expected, abs=1e-10)
    initial = generator.normal(size=n)
    expected = recurrence(system, inputs, turn @ initial, first_phase)
    assert recurrence(found, inputs, initial, first_phase) == pytest.approx(expected, abs=1e-10)
    kept = realise(lifted, n_phases, first_phase=first_phase)
    assert (kept.inputs, kept.outputs) == (system.inputs, system.outputs)


def test_a_controller_designed_on_the_lifted_system_is_periodic_again():
    """A static gain on the lifted state is more than one on the state at each phase: it needs states of its own."""
    control = pytest.importorskip("control", reason="it is in the dependency group `peers`")
    generator = np.random.default_rng(5)
    D = np.kron(np.tril(np.ones((3, 3)), -1), np.ones((1, 1))) * generator.normal(size=(3, 3))
    lifted = control.ss([[0.5]], generator.normal(size=(1, 3)), generator.normal(size=(3, 1)), D, 0.3)
    found = realise(lifted, 3)
    assert found.n_states == 2
    inputs = generator.normal(size=(3, 5))
    response = control.forced_response(lifted, inputs=inputs, squeeze=False)
    assert recurrence(found, inputs.T.reshape(1, -1), np.zeros(found.n_states), 0) == pytest.approx(
        response.outputs.T.reshape(1, -1), abs=1e-12
    )


def test_what_is_no_lifted_system_is_refused():
    control = pytest.importorskip("control", reason="it is in the dependency group `peers`")
    lifted = lift(random_discrete(2)).to_control()
    matrices = (lifted.A, lifted.B, lifted.C, lifted.D)
    swapped = control.ss(lifted.A, lifted.B[:, ::-1], lifted.C, lifted.D[:, ::-1], 0.1)
    for system, n_phases, words in (
        (control.ss(*matrices), 5, "in steps of the period"),
        (control.ss(*matrices, True), 5, "in steps of the period"),
        (lifted, 3, "as many inputs and outputs at each phase"),
        (lifted, 0, "`n_phases` .* at least 1"),
        (swapped, 5, "be causal within a period"),
        (matrices, 5, "be a control.StateSpace"),
    ):
        with pytest.raises(InputError, match=words):
            realise(system, n_phases)


def test_python_control_takes_names_with_a_full_stop():
    """Which it forbids itself."""
    pytest.importorskip("control", reason="it is in the dependency group `peers`")
    system = random_discrete(2)
    named = DiscretePeriodicSystem(A=system.A, dt=system.dt, outputs=["ED.1", "b", "c"])
    assert lift(named).to_control().output_labels[:2] == ["ED·1[0]", "b[0]"]


def test_python_control_is_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(
        InputError, match=r"`to_control` works with the package control.*\n.*pip install .floquid.control"
    ):
        lift(random_discrete(0)).to_control()


def continuous(kind):
    """A system of two states and inputs, and of three outputs, in the form named."""
    T = 1.3
    mean = np.array([[0.0, 1.0], [-9.0, -0.4]])
    if kind == "harmonics":
        A = HarmonicMatrix.from_cosines(mean, [[[0.0], [0.0]], [[4.0], [0.3]]], [[[0.2], [0.0]]] * 2, period=T)
        B = HarmonicMatrix.from_cosines(np.eye(2), [[[0.5], [0.0]], [[0.1], [1.0]]], np.ones((2, 2, 1)), period=T)
    elif kind == "pieces":
        values = np.stack([mean, 0.5 * mean, mean - np.eye(2)], axis=2)
        A = PiecewiseMatrix(values=values, edges=[0.1, 0.45, 0.9], period=T)
        B = PiecewiseMatrix(values=np.stack([np.eye(2), [[0.0, 1.0], [2.0, 0.0]]], axis=2), edges=[0.0, 0.7], period=T)
    else:
        turn = 2.0 * np.pi / T
        A = FunctionMatrix(function=lambda t: mean * (1.0 + 0.3 * np.exp(np.cos(turn * t))), period=T)
        B = FunctionMatrix(
            function=lambda t: np.array([[1.0, np.cos(turn * t)], [2.0 if 0.2 <= t % T < 0.5 else -1.0, 0.0]]),
            period=T,
            breaks=[0.2, 0.5],
        )
    C = HarmonicMatrix.from_cosines(np.ones((3, 2)), np.ones((3, 2, 1)), np.zeros((3, 2, 1)), period=T)
    return PeriodicSystem(A=A, B=B, C=C, D=np.arange(6.0).reshape(3, 2))


@pytest.mark.parametrize("kind", ["harmonics", "pieces", "function"])
def test_discretisation_is_exact_for_a_held_input(kind):
    """Against a general integrator, that starts anew at every step and jump."""
    system, n_phases, samples = continuous(kind), 7, 17
    found = discretise(system, n_phases)
    generator = np.random.default_rng(0)
    inputs, state = generator.normal(size=(2, samples)), np.array([0.3, -1.0])
    outputs = recurrence(found, inputs, state, 0)
    breaks = np.unique(np.concatenate([np.asarray(system.A.breaks), np.asarray(system.B.breaks)]))
    jumps = np.add.outer(system.period * np.arange(4), breaks).ravel()
    for k in range(samples):
        begin, end = k * found.dt, (k + 1) * found.dt
        u = inputs[:, k]
        wanted = system.C.at(begin) @ state + system.D.at(begin) @ u
        assert outputs[:, k] == pytest.approx(wanted, abs=1e-9)
        inside = jumps[(jumps > begin + 1e-9) & (jumps < end - 1e-9)]
        for left, right in np.lib.stride_tricks.sliding_window_view([begin, *inside, end], 2):
            inner = lambda t, left=left, right=right: min(max(t, left + 1e-12), right - 1e-12)  # noqa: E731
            solution = solve_ivp(
                lambda t, x, inner=inner, u=u: system.A.at(inner(t)) @ x + system.B.at(inner(t)) @ u,
                (left, right),
                state,
                method="DOP853",
                rtol=1e-12,
                atol=1e-12,
            )
            state = solution.y[:, -1]
    assert found.states == system.states
    assert_same_set(found.multipliers(), multipliers(system.A), 1e-10)


def test_a_constant_system_is_that_of_scipy():
    A, B = np.array([[0.0, 1.0], [-40.0, -0.8]]), np.array([[0.0], [3.0]])
    matrix = HarmonicMatrix(coefficients=A[:, :, None], harmonics=[0], period=1.0)
    found = discretise(PeriodicSystem(A=matrix, B=B), 8)
    wanted = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), 1.0 / 8.0, method="zoh")
    for stack, constant in zip((found.A, found.B), wanted[:2], strict=True):
        assert stack == pytest.approx(np.broadcast_to(constant, (8, *constant.shape)), abs=1e-12)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_units_of_inputs_and_states_do_not_matter(unit):
    """Forces in newtons and displacements in nanometres are as good as any: a small input is not small change."""

    def entry(t):
        return np.array([[1.0, 0.0], [0.3, 1.0 / (1.1 + np.cos(2.0 * np.pi * t / 1.3))]])  # of many harmonics

    A = continuous("harmonics").A
    state, inputs = np.diag([1.0, unit]), np.diag([unit**1.5, unit**-1.5])
    back, undo = np.linalg.inv(state), np.linalg.inv(inputs)
    B = FunctionMatrix(function=entry, period=A.period)
    changed = FunctionMatrix(function=lambda t: back @ entry(t) @ inputs, period=A.period)
    found, wanted = (
        discretise(system, 6) for system in (PeriodicSystem(A=back @ A @ state, B=changed), PeriodicSystem(A=A, B=B))
    )
    assert state @ found.A @ back == pytest.approx(wanted.A, rel=1e-10)
    assert state @ found.B @ undo == pytest.approx(wanted.B, rel=1e-10, abs=1e-15)


def test_a_system_without_inputs():
    system = PeriodicSystem(A=continuous("pieces").A)
    found = discretise(system, 4)
    assert found.B.shape == (4, 2, 0)
    start = np.array([1.0, -2.0])
    free = recurrence(found, np.empty((0, 9)), start, 0)
    assert free[:, 0].tolist() == start.tolist()
    assert free[:, 4] == pytest.approx(np.linalg.multi_dot(found.A[::-1]) @ start, abs=1e-12)
    lifted = lift(found)
    assert np.array_equal(lifted.to_scipy().A, lifted.A)
    pieces = system.A
    lengths = [0.1, 0.35, 0.45, 0.4]
    wanted = np.eye(2)
    for piece, length in zip([2, 0, 1, 2], lengths, strict=True):
        wanted = expm(np.asarray(pieces.values)[..., piece] * length) @ wanted
    assert np.linalg.multi_dot(found.A[::-1]) == pytest.approx(wanted, abs=1e-11)


def test_outputs_at_a_jump_are_those_after_it():
    """A step begins with what holds during it, whatever rounding makes of 3 * 0.1."""
    C = PiecewiseMatrix(values=np.array([[[1.0, 2.0]]]), edges=[0.0, 3 * 0.1], period=1.0)
    found = discretise(PeriodicSystem(A=[[-1.0]], C=C), 10)
    assert found.C[:, 0, 0].tolist() == [1.0] * 3 + [2.0] * 7


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda: DiscretePeriodicSystem(A=np.ones((4, 2, 3)), dt=1.0), r"`A` of .* must be square \(phases, n, n\)"),
        (lambda: DiscretePeriodicSystem(A=np.eye(2), dt=1.0), r"must have shape \(phases, n, n\).*\n.*broadcast_to"),
        (lambda: DiscretePeriodicSystem(A=np.ones((4, 2, 2)), B=np.ones((2, 1)), dt=1.0), r"\(4, 2, inputs\)"),
        (lambda: DiscretePeriodicSystem(A=np.ones((4, 2, 2)), C=np.ones((4, 1, 3)), dt=1.0), r"\(4, outputs, 2\)"),
        (lambda: DiscretePeriodicSystem(A=np.ones((4, 2, 2)), dt=-1.0), "`dt` of `DiscretePeriodicSystem` must be pos"),
        (lambda: lift(random_discrete(0), first_phase=5), "`first_phase` of .* must be below the number of phases, 5"),
        (lambda: lift(random_discrete(0)).stack(np.ones((2, 7))), "must be whole periods of 5 samples, but hold 7"),
        (lambda: lift(random_discrete(0)).unstack(np.ones((2, 7))), r"must have shape \(10, steps\)"),
        (lambda: discretise(continuous("harmonics").A, 4), r"`system` of `floquet.discretise` must be a Periodic.*\n"),
        (lambda: discretise(continuous("harmonics"), 0), "`n_phases` of `floquet.discretise` must be an integer"),
        (lambda: discretise(continuous("harmonics"), 4, tolerance=1.0), "`tolerance` of `floquet.discretise` must lie"),
    ],
)
def test_what_cannot_be_is_refused(attempt, message):
    with pytest.raises(InputError, match=message):
        attempt()
