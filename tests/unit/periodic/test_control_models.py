"""Periodic models to and from python-control: its impulse response is the free response, and the modes come back."""

import sys

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from floquid.core import Channel, PeriodicModel
from floquid.errors import InputError
from floquid.floquet import FunctionMatrix, PeriodicSystem, discretise, lift
from floquid.periodic import from_control, to_control
from floquid.systems import JeffcottRotor

CHANNELS = (Channel(name="x", unit="mm", location="disc"), Channel(name="y.2 [odd]", unit="m/s"))


def model(exponents, *, period=2.0, n_channels=2, n_hits=1, width=2, seed=0, rank=1):
    """Modes of the exponents above the real axis or with a real multiplier, with shapes that make the response real.

    Of several hits the shapes are multiples of each other (rank 1), as they are of a system, or have nothing in common.
    """
    rng = np.random.default_rng(seed)

    def shape(*size):
        return rng.standard_normal(size) + 1j * rng.standard_normal(size)

    omega = 2.0 * np.pi / period
    harmonics = np.arange(-width - 1, width + 2)
    lam, coefficients = [], []
    for exponent in exponents:
        own = shape(n_channels, n_hits, len(harmonics))
        if rank == 1:
            own = shape(n_channels, 1, len(harmonics)) * shape(1, n_hits, 1)
        own[..., [0, -1]] = 0.0  # room for mirror images
        half_turns = 2.0 * exponent.imag / omega
        if abs(half_turns - round(half_turns)) > 1e-9:
            lam += [exponent, np.conj(exponent)]
            coefficients += [own, own[..., ::-1].conj()]
            continue
        # A real multiplier: harmonic m and its mirror image -κ - m are conjugates.
        if rank == 1:
            own = shape(n_channels, 1, len(harmonics)) * rng.standard_normal((1, n_hits, 1))
            own[..., [0, -1]] = 0.0
        mirrored = np.zeros_like(own)
        for place, m in enumerate(harmonics):
            where = np.flatnonzero(harmonics == -round(half_turns) - m)
            if len(where):
                mirrored[..., where[0]] = own[..., place].conj()
        lam.append(exponent)
        coefficients.append(own + mirrored)
    channels = (CHANNELS * 2)[:n_channels] if n_channels <= 2 else [f"c{k}" for k in range(n_channels)]
    return PeriodicModel(
        exponents=lam, coefficients=coefficients, harmonics=harmonics, period=period, channels=channels
    )


OMEGA = np.pi  # of a period of 2 s
CASES = {
    "a pair": ([-0.1 + 0.3j * OMEGA], {}),
    "two pairs": ([-0.1 + 0.3j * OMEGA, -0.2 + 1.2j * OMEGA], {}),
    "one channel": ([-0.1 + 0.3j * OMEGA], {"n_channels": 1}),
    "growing": ([0.4 + 0.3j * OMEGA, -0.2 + 0.1j * OMEGA], {}),
    "on the unit circle": ([0.3j * OMEGA], {}),
    "real, positive": ([-0.3 + 0j], {}),
    "real, negative": ([-0.3 + 0.5j * OMEGA], {}),
    "two real ones": ([-0.3 + 0.5j * OMEGA, -0.9 + 0.5j * OMEGA, -0.5 + 0j], {}),
    "three hits": ([-0.1 + 0.3j * OMEGA, -0.3 + 0.5j * OMEGA], {"n_hits": 3}),
    "hits that have nothing in common": ([-0.1 + 0.3j * OMEGA, -0.5 + 0j], {"n_hits": 2, "rank": 2}),
    "other period": ([-0.001 + 0.4j], {"period": 7.3}),
    "fast decay": ([-8.0 + 0.3j * OMEGA, -0.1 + 0.2j * OMEGA], {}),
}
EVERY_CASE = pytest.mark.parametrize(("exponents", "options"), CASES.values(), ids=CASES)


def lifted_response(one, n_phases, n_periods, first_phase=0.0):
    """The free response by its definition, ordered as the outputs are (outputs, hits, periods)."""
    times = (first_phase + np.arange(n_phases * n_periods) / n_phases) * one.period
    response = one.response(times).reshape(len(one.channels), one.n_hits, n_periods, n_phases)
    return response.transpose(0, 3, 1, 2).reshape(-1, one.n_hits, n_periods)


def close(found, expected):
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    return found == pytest.approx(expected, abs=1e-9 * float(np.abs(expected).max()))


@EVERY_CASE
@pytest.mark.parametrize("first_phase", [0.0, 0.3])
def test_the_impulse_response_is_the_free_response(exponents, options, first_phase):
    one = model(exponents, **options)
    system = to_control(one, 8, first_phase=first_phase)
    found = control.impulse_response(system, T=np.arange(6) * one.period, squeeze=False)
    # Of a system in discrete time python-control's impulse is of area 1, which is 1/dt in height.
    expected = lifted_response(one, 8, 6, first_phase)
    assert close(found.outputs * one.period, expected)
    inputs = np.zeros((one.n_hits, 6))
    inputs[-1, 0] = 1.0
    forced = control.forced_response(system, inputs=inputs, squeeze=False)
    assert close(forced.outputs, expected[:, -1])
    assert forced.time[1] == one.period


@EVERY_CASE
def test_the_poles_are_the_multipliers_and_the_matrices_are_real_and_small(exponents, options):
    one = model(exponents, **options)
    system = to_control(one, 8)
    assert all(np.asarray(matrix).dtype == np.float64 for matrix in (system.A, system.B, system.C, system.D))
    assert system.dt == one.period
    repeats = min(options.get("rank", 1), one.n_hits)
    assert system.nstates == one.order * repeats
    assert_same_set(system.poles(), np.repeat(one.multipliers, repeats))


def assert_same_set(found, expected):
    assert len(found) == len(expected)
    distance = np.abs(np.subtract.outer(found, expected))
    pairs = linear_sum_assignment(distance)
    assert distance[pairs].max() <= 1e-9 * np.abs(expected).max()


def assert_same_model(found, expected):
    """Exponents by assignment modulo i·fundamental, and coefficients with the harmonics moved along with them."""
    assert found.period == expected.period
    assert found.channels == expected.channels
    off = np.subtract.outer(found.exponents, expected.exponents)
    turns = np.rint(off.imag / expected.fundamental)
    distance = np.abs(off - 1j * turns * expected.fundamental)
    rows, columns = linear_sum_assignment(distance)
    assert found.order == expected.order
    assert distance[rows, columns].max() < 1e-8
    for row, column in zip(rows, columns, strict=True):
        shift = int(turns[row, column])
        largest = np.abs(expected.coefficients[column]).max()
        for place, m in enumerate(expected.harmonics):
            there = np.flatnonzero(found.harmonics == m - shift)
            value = found.coefficients[row][..., there[0]] if len(there) else 0.0
            assert np.abs(value - expected.coefficients[column][..., place]).max() < 1e-8 * largest


@EVERY_CASE
@pytest.mark.parametrize("first_phase", [0.0, 0.3])
def test_there_and_back(exponents, options, first_phase):
    one = model(exponents, **options)
    system = to_control(one, 16, first_phase=first_phase)
    assert_same_model(from_control(system, one.channels, first_phase=first_phase), one)


@given(seed=st.integers(0, 2**32 - 1))
def test_in_whichever_coordinates_and_order(seed):
    """A similarity of the states and a permutation of the outputs, which their names undo, change nothing."""
    rng = np.random.default_rng(seed)
    one = model([-0.1 + 0.3j * OMEGA, -0.3 + 0.5j * OMEGA, -0.5 + 0j], n_hits=2, seed=seed)
    system = to_control(one, 12)
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0] * rng.uniform(0.5, 2.0, 4)
    order = rng.permutation(system.noutputs)
    A, B, C = np.linalg.solve(turn, system.A @ turn), np.linalg.solve(turn, system.B), system.C @ turn
    labels = [system.output_labels[k] for k in order]
    shuffled = control.ss(A, B, C[order], system.D[order], system.dt, outputs=labels)
    assert_same_model(from_control(shuffled, one.channels), one)


def test_outputs_without_our_names_are_by_channel_then_phase():
    one = model([-0.1 + 0.3j * OMEGA])
    system = to_control(one, 12)
    assert system.output_labels[:2] == ["x[0]", "x[1]"]
    assert system.input_labels == ["hit1"]
    plain = control.ss(system.A, system.B, system.C, system.D, system.dt)
    assert_same_model(from_control(plain, one.channels), one)


def test_an_identified_response_of_python_controls_own_realisation():
    """Its eigensystem realisation of simulated responses, whose modes are those of the simulated system."""
    rotor = JeffcottRotor()
    record = rotor.simulate(n_periods=40, samples_per_period=10, noise=0.0)
    lifted = record.values.reshape(-1, 40, 10).transpose(0, 2, 1).reshape(-1, 40)
    # Of a step other than 1 s python-control scales its B and not its D: the step is given afterwards.
    realised, _ = control.eigensys_realization(lifted[:, None, :], 4)
    channels = [channel.name for channel in record.channels]
    found = from_control(control.ss(realised.A, realised.B, realised.C, realised.D, rotor.period), channels)
    assert_same_set(found.multipliers, np.exp(rotor.exponents() * rotor.period))
    assert np.abs(found.response(record.times)[:, 0] - record.values).max() < 1e-7


def test_the_first_period_of_a_noisy_realisation_may_be_off_by_as_much_as_said():
    one = model([-0.1 + 0.3j * OMEGA])
    system = to_control(one, 12)
    rng = np.random.default_rng(0)
    noisy = control.ss(system.A, system.B, system.C, system.D * (1 + 1e-3 * rng.normal(size=(24, 1))), system.dt)
    with pytest.raises(InputError, match="has a D that is off by"):
        from_control(noisy, one.channels)
    assert_same_model(from_control(noisy, one.channels, tolerance=0.01), one)


def test_the_noise_of_channels_weights_them():
    """The branch is that of the largest energy, and which that is depends on the channel that is believed."""
    one = PeriodicModel(
        exponents=[-0.1 + 0.3j * OMEGA, -0.1 - 0.3j * OMEGA],
        coefficients=np.array([[[[0, 1, 0]], [[0, 0, 1]]], [[[0, 1, 0]], [[1, 0, 0]]]], complex),
        harmonics=[-1, 0, 1],
        period=2.0,
        channels=["a", "b"],
    )
    system = to_control(one, 12)
    near = from_control(system, ["a", "b"], noise=[0.01, 1.0]).exponents.imag.max()
    far = from_control(system, ["a", "b"], noise=[1.0, 0.01]).exponents.imag.max()
    assert (near, far) == (pytest.approx(0.3 * OMEGA), pytest.approx(1.3 * OMEGA))


GOOD = to_control(model([-0.1 + 0.3j * OMEGA]), 12)
JORDAN = control.ss([[0.5, 1.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], 2.0)
DELAY = control.ss([[0.0, 0.0], [1.0, 0.5]], [[1.0], [0.0]], [[0.0, 1.0]], [[0.0]], 2.0)
REFUSED = {
    "continuous": (
        control.ss(GOOD.A, GOOD.B, GOOD.C, GOOD.D),
        ["a", "b"],
        {},
        "in steps of the period .* continuous time",
    ),
    "no step": (control.ss(GOOD.A, GOOD.B, GOOD.C, GOOD.D, True), ["a", "b"], {}, "of no stated step"),
    "transfer function": (control.tf([1.0], [1.0, 0.5], 2.0), ["a"], {}, "be a control.StateSpace"),
    "channels": (GOOD, ["a", "b", "c", "d", "e"], {}, "as many outputs in each channel"),
    "no channels": (GOOD, [], {}, "as many outputs in each channel"),
    "tolerance": (GOOD, ["a", "b"], {"tolerance": 0.0}, "`tolerance` .* must be positive"),
    "noise": (GOOD, ["a", "b"], {"noise": [1.0, 0.0]}, "`noise` .* must be positive"),
    "noise of others": (GOOD, ["a", "b"], {"noise": [1.0]}, "`noise` .* must have shape"),
    "fewer eigenvectors": (JORDAN, ["a"], {}, "as many eigenvectors of A as states"),
    "a delay": (DELAY, ["a"], {}, "poles that an exponent belongs to"),
    "nothing seen": (control.ss([[0.5]], [[1.0]], [[0.0]], [[0.0]], 2.0), ["a"], {}, "have a mode that is seen"),
    "another D": (control.ss(GOOD.A, GOOD.B, GOOD.C, 0.0 * GOOD.D, 2.0), ["a", "b"], {}, "D that is off"),
    "no input": (
        control.ss(GOOD.A, GOOD.B[:, :0], GOOD.C, GOOD.D[:, :0], 2.0),
        ["a", "b"],
        {},
        "an output and an input",
    ),
}


@pytest.mark.parametrize(("system", "channels", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_free_response_is_refused(system, channels, options, words):
    with pytest.raises(InputError, match=words):
        from_control(system, channels, **options)


def test_too_few_phases_for_the_harmonics_are_refused():
    """Six phases tell frequencies up to three fundamentals, but not the fourth harmonic below one of 2.3."""
    one = PeriodicModel(
        exponents=[-0.1 + 2.3j * OMEGA, -0.1 - 2.3j * OMEGA],
        coefficients=np.array([[[[0.3, 1.0, 0.0]]], [[[0.0, 1.0, 0.3]]]]),
        harmonics=[-4, 0, 4],
        period=2.0,
        channels=["a"],
    )
    with pytest.raises(InputError, match=r"has 6 a period, which leave out 0\.\d+ of the largest value"):
        from_control(to_control(one, 6), ["a"])
    assert_same_model(from_control(to_control(one, 12), ["a"]), one)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((3, 8), "`model` .* must be a PeriodicModel"),
        ((model([-0.3 + 0j]), 0), "`n_phases` .* must be an integer of at least 1"),
    ],
    ids=["model", "phases"],
)
def test_impossible_arguments_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        to_control(*arguments)


def test_a_library_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    for call in (lambda: to_control(model([-0.3 + 0j]), 8), lambda: from_control(GOOD, ["a"])):
        with pytest.raises(
            InputError, match=r'the package control, .*\n  Install it: pip install "floquid\[control\]"'
        ):
            call()


def test_the_free_response_of_a_known_system():
    """What `floquet` has for the same rotor: a hit is its initial state, and the poles are its multipliers."""
    rotor = JeffcottRotor()
    discrete = discretise(PeriodicSystem(A=FunctionMatrix(function=rotor.system, period=rotor.period)), 12)
    lifted = lift(discrete).to_control()
    start = np.array([0.3, -0.2, 0.5, 0.1])
    free = control.forced_response(lifted, timepts=np.arange(5) * rotor.period, initial_state=start, squeeze=False)
    found = from_control(
        control.ss(
            lifted.A,
            lifted.A @ start[:, None],
            lifted.C,
            lifted.C @ start[:, None],
            rotor.period,
            outputs=lifted.output_labels,
        ),
        discrete.outputs,
    )
    response = lifted_response(found, 12, 5)[:, 0]
    order = [lifted.output_labels.index(f"{name}[{phase}]") for name in discrete.outputs for phase in range(12)]
    assert close(response, free.outputs[order])
