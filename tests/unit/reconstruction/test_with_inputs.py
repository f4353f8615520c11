"""A(t), B(t), C(t) and D(t) of a model with inputs: the harmonic state space of them is that of the model."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import mathieu, record_of, transfer_functions, two_masses

import floquid
from floquid import Record, reconstruct
from floquid.core import Driven, modelled
from floquid.findings import failure
from floquid.fit import covariance_root
from floquid.floquet import PeriodicSystem, SampledMatrix, harmonic_transfer, simulate

LINES = np.array([0.05, 0.13, 0.31, 0.6])
TURNS = (-2, -1, 0, 1, 2)


def analysis_of(system, outputs, periods=60, phases=24):
    values, inputs = record_of(system, periods, phases, 0.01, 1)
    names = [*outputs, *(f"F{k}" for k in range(len(inputs)))]
    record = Record(values=np.vstack([values, inputs]), sample_rate=phases / system.period, channels=names)
    return floquid.identify(record, period=system.period, inputs=names[len(outputs) :], validate=False)


def system_of(state, period):
    matrices = (state.system, state.inputs, state.outputs, state.direct)
    A, B, C, D = (SampledMatrix(values=np.moveaxis(values, 0, 2), period=period) for values in matrices)
    return PeriodicSystem(A=A, B=B, C=C, D=D)


@pytest.fixture(scope="module")
def found():
    return [
        (mathieu(direct=0.2), ["y"], analysis_of(mathieu(direct=0.2), ["y"])),
        (two_masses(), ["x", "y"], analysis_of(two_masses(), ["x", "y"])),
    ]


@pytest.fixture(scope="module")
def cases(found):
    return [(system, outputs, analysis.model) for system, outputs, analysis in found]


def test_transfer_functions_of_the_matrices_are_those_of_the_model(cases):
    for _, outputs, model in cases:
        system = system_of(reconstruct(model, outputs, harmonics="model", times=128), model.period)
        found = harmonic_transfer(system, 2.0 * np.pi * LINES)
        wanted = transfer_functions(model, LINES, TURNS).values
        places = np.searchsorted(found.harmonics, TURNS)
        got = np.moveaxis(found.values[:, :, places], 2, 0)
        assert got.shape == wanted.shape
        assert np.abs(got - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert cases[0][2].inputs.direct.any()


def test_the_comparison_sees_another_way_of_the_inputs(cases):
    _, outputs, model = cases[0]
    half = replace(model, inputs=replace(model.inputs, coefficients=0.99 * model.inputs.coefficients))
    one, other = (reconstruct(own, outputs, times=8).inputs for own in (model, half))
    assert np.allclose(other, 0.99 * one, rtol=1e-9)


def test_a_response_to_fresh_inputs_is_that_of_the_true_system(cases):
    for truth, outputs, model in cases:
        phases, periods = 24, 20
        values, inputs = record_of(truth, periods, phases, 0.0, 9)
        system = system_of(reconstruct(model, outputs, times=64), model.period)
        times = truth.period / phases * np.arange(inputs.shape[1])
        found = simulate(system, inputs, times, between="held")
        assert np.sqrt(np.mean((found - values) ** 2)) < 0.02 * values.std()


def test_the_true_matrices_are_within_their_deviations(found):
    """Of Mathieu's equation: the states of two masses, one of them seen from a frame that turns, are other ones."""
    system, outputs, analysis = found[0]
    state = analysis.reconstruct(outputs, times=8)
    assert np.array_equal(state.system, reconstruct(analysis.model, outputs, times=8).system)
    truth = [np.array([of(t) for t in state.times]) for of in (system.A, system.B)]
    # A direct term takes part in the first row of B: what the input does at once is no state.
    for value, std, right in zip(
        (state.system, state.inputs), (state.system_std, state.inputs_std), truth, strict=True
    ):
        assert (np.abs(value - right)[:, 1] < 4.0 * std[:, 1]).all()
        assert (std[:, 1] < 0.05 * np.abs(right).max()).all()
    assert not state.system_std[:, 0].any()


def alone(model):
    """A model that says nothing of harmonics beyond its own."""
    return replace(model, unselected=None)


def test_deviations_are_those_of_the_joint_errors(found):
    """Four times the noise are four times the deviations; those of the errors of one channel alone are less."""
    _, outputs, analysis = found[1]

    def with_noise(by):
        own = replace(analysis.fit, at=replace(analysis.fit.at, noise=analysis.fit.at.noise * by))
        model = alone(own.model(analysis.model.channels, analysis.inputs, analysis.provenance))
        return reconstruct(model, outputs, harmonics="model", times=3)

    one, four, less = (with_noise(by) for by in (1.0, 4.0, np.array([1.0, 1e-6])))
    for name in ("system_std", "transition_std", "inputs_std"):
        assert np.allclose(getattr(four, name), 4.0 * getattr(one, name), rtol=1e-6, atol=1e-12)
        assert (getattr(less, name) <= getattr(one, name) + 1e-9).all()
        assert (getattr(less, name) < 0.9 * getattr(one, name)).any()


@pytest.mark.slow
def test_deviations_are_those_of_differences_along_the_errors(found):
    """What parameters and amplitudes do to A, Φ and B, one error after another, by a model rebuilt for each."""
    _, outputs, analysis = found[1]
    state = reconstruct(alone(analysis.model), outputs, harmonics="model", times=3)
    own = analysis.model.estimates
    variances = dict.fromkeys(("system", "transition", "inputs"), 0.0)
    steps = [(column, None) for column in covariance_root(own.covariance).T]
    for channel in range(len(outputs)):
        steps += [
            (np.zeros(len(own.covariance)), (channel, column))
            for column in covariance_root(own.noise_covariance(channel, 0)).T
        ]
    for by, noise in steps:
        up, down = (
            reconstruct(_moved(alone(analysis.model), sign * by, noise, sign), outputs, harmonics="model", times=3)
            for sign in (0.1, -0.1)
        )
        variances = {
            name: variance + ((getattr(up, name) - getattr(down, name)) / 0.2) ** 2
            for name, variance in variances.items()
        }
    for name, variance in variances.items():
        std, right = getattr(state, f"{name}_std"), np.sqrt(variance)
        right[:, : len(outputs)] *= name != "system"
        assert np.allclose(std, right, rtol=0.02, atol=1e-6 * std.max())


def _moved(model, step, noise, sign):
    own, coefficients = model.estimates, model.estimates.coefficients + model.estimates.slopes @ step
    if noise is not None:
        channel, column = noise
        both = sign * column
        coefficients[:, channel, 0] += both[: len(own.modes)] + 1j * both[len(own.modes) :]
    moved = replace(
        own,
        exponents=own.exponents + own.exponent_slopes @ step,
        coefficients=coefficients,
        gains=replace(own.gains, coefficients=own.gains.coefficients + own.gains.slopes @ step),
    )
    driven = Driven(
        channels=model.inputs.channels,
        direct=model.inputs.direct,
        direct_harmonics=model.inputs.direct_harmonics,
        initial=np.zeros((len(own.exponents), 1)),
        begins=np.zeros(1),
    )
    return modelled(moved, channels=model.channels, provenance=model.provenance, driven=driven)


def test_a_model_that_fails_has_no_deviations(found):
    _, outputs, analysis = found[1]
    wrong = replace(analysis, findings=(*analysis.findings, failure("undetermined")))
    good, bad = (own.reconstruct(outputs, times=3) for own in (analysis, wrong))
    assert np.array_equal(good.system, bad.system)
    assert (bad.system_std, bad.transition_std, bad.inputs_std) == (None, None, None)
    assert good.inputs_std is not None


def test_delayed_states_of_one_channel_have_the_same_multipliers(found):
    system, _, analysis = found[1]
    state = analysis.reconstruct(["x"], form="delayed", times=np.linspace(0.0, system.period, 3))
    assert state.system_std.max() > 0.0
    monodromy = np.linalg.eigvals(state.transition[-1])
    wanted = analysis.model.multipliers
    assert np.abs(monodromy[:, None] - wanted).min(axis=0).max() < 1e-8
