"""Models with inputs to the systems of `floquet`, to python-control, and back: the same transfer functions."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import flapping, mathieu, record_of, transfer_functions, two_masses

import floquid
from floquid import InputError, Record
from floquid.errors import IdentificationError
from floquid.exports import from_periodic_system, to_periodic_system
from floquid.floquet import (
    DiscretePeriodicSystem,
    FunctionMatrix,
    PeriodicSystem,
    discretise,
    harmonic_transfer,
    lift,
    realise,
)
from floquid.systems import JeffcottRotor

TURNS = np.arange(-2, 3)


def rotor():
    own = JeffcottRotor()
    return PeriodicSystem(
        A=FunctionMatrix(function=own.system, period=own.period, vectorised=True), B=np.eye(4, 2, -2), C=np.eye(2, 4)
    )


def system_of(driven, direct=0.0):
    """The system of tests, its matrices functions of time."""
    A, B, C = (FunctionMatrix(function=part, period=driven.period) for part in (driven.A, driven.B, driven.C))
    return PeriodicSystem(A=A, B=B, C=C, D=np.full((C.shape[0], B.shape[1]), direct))


def gap(system, model, turns=TURNS):
    """The largest difference of the harmonic state space of a system and the formula of a model, over the largest."""
    hertz = np.array([0.11, 0.23, 0.37, 0.81]) / system.period
    found = harmonic_transfer(system, 2.0 * np.pi * hertz)
    got = np.moveaxis(found.values[:, :, np.searchsorted(found.harmonics, turns)], 2, 0)
    wanted = transfer_functions(model, hertz, turns).values
    assert got.shape == wanted.shape
    return np.abs(got - wanted).max() / np.abs(wanted).max()


SYSTEMS = {
    "rotor": rotor,
    "mathieu": lambda: system_of(mathieu(), 0.2),
    "masses": lambda: system_of(two_masses()),
    "flapping": lambda: system_of(flapping()),  # two negative real multipliers
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_transfer_functions_of_the_equations_are_those_of_the_model_and_back(name):
    system = SYSTEMS[name]()
    model = from_periodic_system(system)
    assert gap(system, model) < 1e-8
    assert np.abs(model.inputs.coefficients).max() == pytest.approx(1.0)
    assert model.real.all() == (name == "flapping")
    if name == "flapping":
        assert model.exponents.imag == pytest.approx(0.5 * model.fundamental)
    again = to_periodic_system(model)
    assert gap(again, model) < 1e-8
    assert again.n_states == model.order
    names = ["y1", "y2"] if name == "rotor" else None
    if names:
        assert gap(to_periodic_system(model, names), model) < 1e-8


@pytest.mark.parametrize("name", ["rotor", "mathieu", "flapping"])
def test_a_lifted_system_of_python_control_comes_back(name):
    pytest.importorskip("control")
    model = from_periodic_system(SYSTEMS[name](), inputs=[f"F{k}" for k in range(2 if name == "rotor" else 1)])
    # Held inputs hold all of a period: more phases than harmonics, and all of it comes back.
    lifted = lift(discretise(to_periodic_system(model), 48)).to_control()
    back = from_periodic_system(realise(lifted, 48))
    assert back.order == model.order
    off = (back.exponents[:, None] - model.exponents) / model.fundamental
    assert np.abs(off - 1j * np.rint(off.imag)).min(axis=0).max() < 1e-9
    hertz = np.array([0.1, 0.4]) / model.period
    one, other = (transfer_functions(own, hertz, TURNS).values for own in (model, back))
    assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()
    assert [channel.name for channel in back.inputs.channels] == [channel.name for channel in model.inputs.channels]


def test_an_identified_model_and_its_system_have_one_response():
    truth = mathieu(direct=0.2)
    values, inputs = record_of(truth, 60, 20, 0.01, 1)
    record = Record(values=np.vstack([values, inputs]), sample_rate=20 / truth.period, channels=["y", "F"])
    model = floquid.identify(record, period=truth.period, inputs=["F"], validate=False).model
    for system in (to_periodic_system(model), to_periodic_system(model, ["y"])):
        assert gap(system, model) < 1e-8
        assert (system.inputs, system.outputs) == (("F",), ("y",))
    off = replace(model, inputs=replace(model.inputs, coefficients=0.99 * model.inputs.coefficients))
    assert gap(to_periodic_system(model), off) > 1e-3
    free = to_periodic_system(replace(model, inputs=None))
    assert (free.B, free.n_outputs) == (None, 1)


def test_a_free_response_is_that_of_its_lifted_system_to_an_initial_state():
    """By `lift`, which stacks phases, against the series of the model: one for the real part of each mode."""
    control = pytest.importorskip("control")
    rotor = JeffcottRotor()
    record = rotor.simulate(n_periods=60, samples_per_period=20, noise=0.01, seed=0)
    model = floquid.identify(record, validate=False).model
    system = to_periodic_system(model)
    lifted = lift(discretise(system, 20)).to_control()
    start = np.array([float(name.startswith("Re")) for name in system.states])

    def off(initial):
        response = control.initial_response(lifted, np.arange(60) * lifted.dt, initial).outputs
        found = response.reshape(20, 4, 60).transpose(1, 2, 0).reshape(4, 1200)
        return np.abs(found - model.response(record.times)[:, 0]).max()

    assert off(start) < 1e-11
    assert off(start + 1e-3) > 1e-4
    assert np.sort_complex(lifted.poles()) == pytest.approx(np.sort_complex(model.multipliers), abs=1e-12)
    back = from_periodic_system(realise(lifted, 20))
    off_by = (back.exponents[:, None] - model.exponents) / model.fundamental
    assert np.abs(off_by - 1j * np.rint(off_by.imag)).min(axis=0).max() < 1e-9


def test_what_has_no_such_form_is_refused():
    model = from_periodic_system(SYSTEMS["flapping"]())
    one = replace(
        model,
        exponents=model.exponents[:1],
        coefficients=model.coefficients[:1],
        inputs=replace(model.inputs, coefficients=model.inputs.coefficients[:1], initial=model.inputs.initial[:1]),
    )
    with pytest.raises(InputError, match="negative real multipliers in twos"):
        to_periodic_system(one)
    with pytest.raises(IdentificationError, match="do not tell all"):
        from_periodic_system(SYSTEMS["flapping"](), n_phases=6)
    stacks = np.broadcast_to(np.diag([0.5, 0.0]), (4, 2, 2))
    with pytest.raises(IdentificationError, match="multiplier of zero"):
        from_periodic_system(DiscretePeriodicSystem(A=stacks, dt=0.1, B=np.ones((4, 2, 1))))
    with pytest.raises(InputError, match="realise"):
        from_periodic_system(np.eye(2))
