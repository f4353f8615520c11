"""From the settings to A(t): forms, states, structures and the output-error step, on both routes of the chain."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from floquid import identify
from floquid.core import Channel
from floquid.errors import InputError
from floquid.lti import ERA
from floquid.periodic import estimate_at
from floquid.pipeline import Settings
from floquid.reconstruction import Block, FirstOrder, SecondOrder, reconstruct, refine
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()
STRUCTURE = "stiffness 1 symmetric; damping 0"


@pytest.fixture(scope="module")
def record():
    """The paper's rotor, 2 % noise, shorter than in the paper."""
    return ROTOR.simulate(n_periods=150, samples_per_period=20, noise=0.02, seed=11)


@pytest.fixture(scope="module")
def missing(record):
    """The same record with samples missing, so that it is fitted as it was sampled."""
    values = record.values.copy()
    values[:, 1000:1007] = np.nan
    return replace(record, values=values)


@pytest.fixture(scope="module")
def structured(record, missing):
    """What is found with the structure, by route and by whether the step on the record is made."""
    given = {"lifted": record, "as sampled": missing}
    options = {"channels": ["X", "Y"], "states": ["X", "Y"], "structure": STRUCTURE, "validate": False}
    return cache(lambda route, output_error: identify(given[route], **options, output_error=output_error))


@pytest.fixture(scope="module")
def free(record):
    return identify(record, channels=["X", "Y"], states=["X", "Y"], validate=False)


def worst(state, where=np.s_[:]):
    """The largest error of A(t)."""
    return float(np.abs(state.system - ROTOR.system(state.times))[:, :, where].max())


def of_fields(one, other):
    """Whether two states have the same numbers."""
    names = ("times", "transition", "system", "condition", "system_std", "transition_std")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


@pytest.mark.first(2)
@pytest.mark.parametrize("route", ["lifted", "as sampled"])
@pytest.mark.parametrize("output_error", [False, True])
def test_a_structure_is_fitted_on_both_routes(structured, free, route, output_error):
    found = structured(route, output_error)
    assert ("Fitted at the original sampling times" in " ".join(found.synchronisation)) == (route == "as sampled")
    assert found.refinement.state is found.state
    assert found.refinement.structure == SecondOrder(stiffness=Block(harmonics=1, symmetry="symmetric"))
    assert found.refinement.p_value > 1e-3
    error, std = found.state.system - ROTOR.system(found.state.times), found.state.system_std
    assert (np.abs(error)[:, 2:] < 4.5 * std[:, 2:]).all()
    assert worst(found.state) < worst(free.state)
    assert worst(found.state, np.s_[2:]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("route", ["lifted", "as sampled"])
def test_the_output_error_step_is_made_on_the_record(record, structured, route):
    """It moves the parameters by far less than their deviations, and not by nothing."""
    without, found = (structured(route, step) for step in (False, True))
    stepped, std = found.refinement, without.refinement.std
    moved = np.abs(stepped.parameters - without.refinement.parameters) / std
    assert 1e-7 < moved.max() < 0.05
    assert stepped.chi_square == pytest.approx(without.refinement.chi_square, rel=0.02)
    # It is the step that one makes by hand, and not the same fit once more.
    data = {"lifted": found.lifted}
    if route == "as sampled":
        data = {"records": found.fit.free, "clocks": [record.clock], "noise": found.noise, "forced": found.fit.forced}
    by_hand = refine(found.model, ["X", "Y"], stepped.structure, again=lambda at: estimate_at(found.model, at, **data))
    idle = refine(found.model, ["X", "Y"], stepped.structure, again=lambda _: found.model.unselected)
    assert np.abs(stepped.parameters - by_hand.parameters).max() < 1e-9 * std.min()
    assert np.abs((stepped.parameters - idle.parameters) / std).max() > 1e-7


def test_the_free_state_has_deviations_and_the_automatic_harmonics(free):
    assert free.refinement is None
    assert of_fields(free.state, reconstruct(free.model, ["X", "Y"]))
    assert (free.state.system_std[:, 2:] > 0.0).all()
    wide = identify(free.records, states=["X", "Y"], harmonics=3, validate=False)
    assert of_fields(wide.state, reconstruct(wide.model, ["X", "Y"], harmonics="model"))
    assert not of_fields(wide.state, reconstruct(wide.model, ["X", "Y"]))


@pytest.mark.slow
def test_auto_finds_the_structure_and_says_how(record, free):
    told = []
    found = identify(
        record, channels=["X", "Y"], states=["X", "Y"], structure="auto", validate=False, report=told.append
    )
    direct = refine(free.model, ["X", "Y"])
    assert found.refinement.reasons == direct.reasons != ()
    assert np.array_equal(found.refinement.parameters, direct.parameters)
    assert found.settings.structure == "auto"
    assert "rebuilding the state matrix" in told
    assert "fitting the structured state matrix" in told


def without_state(found, words):
    """The modes are there, A(t) is not, and a warning says why."""
    assert (found.model.order, found.state, found.refinement) == (4, None, None)
    assert [own for own in found.warnings if own.startswith("A(t) was not rebuilt") and words in own]


@pytest.mark.slow
def test_a_structure_that_contradicts_the_record_is_refused(record):
    found = identify(record, channels=["X", "Y"], states=["X", "Y"], structure="stiffness 0", validate=False)
    without_state(found, "The structure contradicts the data")


def test_states_that_cannot_span_the_modes_leave_these(record):
    without_state(
        identify(record, states=["X"], validate=False), "Argument `states` of `identify` must name 2 channels: 4 modes"
    )


def test_without_joint_covariance_there_is_nothing_to_fit_to(record):
    options = {"states": ["X", "Y"], "structure": "auto", "identifier": ERA(), "order": 4, "harmonics": 2}
    found = identify(record, validate=False, **options)
    without_state(found, "needs the joint covariance of the coefficients")


def test_delayed_states_of_one_channel(record):
    found = identify(record, channels=["X", "Y"], states=["X"], form="delayed", delay=1.5)
    assert found.state.states == ("X", "X(t + 1.5 s)", "X(t + 3 s)", "X(t + 4.5 s)")
    assert found.state.coordinates.startswith("delayed outputs")
    assert "A(t)" not in " ".join(found.reasons)
    assert found.validation.metrics["multipliers"] < found.validation.criteria["multipliers"].limit


def test_first_order_and_all_channels(record):
    four = ["X", "Y", "X_tt", "Y_tt"]
    options = {"form": "first-order", "validate": False, "constrained": False}
    first = identify(record, states=four, **options)
    assert first.state.states == tuple(four)
    every = identify(record, states=["all"], **options)
    assert of_fields(every.state, first.state)
    known = [*record.channels[:3], Channel(name="all")]
    found = identify(replace(record, channels=known), states=["all"], **options)
    without_state(found, "Argument `states` of `identify` must name 4 channels")


@pytest.mark.slow
def test_all_channels_are_weighed_together(record):
    both = record.select(["X", "Y"])
    mixed = np.concatenate([both.values, [[1.0, 2.0], [-1.0, 0.5]] @ both.values])
    noisy = mixed + 0.01 * np.random.default_rng(5).standard_normal(mixed.shape)
    wide = replace(record, values=noisy)
    every, two = (identify(wide, states=states, validate=False).state for states in (["all"], ["X", "Y"]))
    assert every.coordinates != two.coordinates
    assert every.system_std[:, 2:].mean() < 0.95 * two.system_std[:, 2:].mean()


@pytest.mark.slow
def test_several_channels_of_one_motion(record):
    """A velocity beside its displacement: both in one state."""
    both = record.select(["X", "Y"])
    dense = ROTOR.simulate(n_periods=150, samples_per_period=200, noise=0.0)
    speed = np.gradient(dense.values[0], dense.times)[::10]
    values = np.concatenate([both.values, [speed + 0.02 * np.random.default_rng(3).standard_normal(len(speed))]])
    channels = [*both.channels, Channel(name="vx", quantity="velocity", unit="m/s")]
    three = replace(record, values=values, channels=channels)
    found, without = (identify(three, states=[first, "Y"], validate=False).state for first in ("X + vx", "X"))
    assert found.coordinates == "second-order form from X+vx, Y"
    assert found.states == ("X", "Y", "d/dt X", "d/dt Y")
    assert found.system_std[:, 2].mean() < without.system_std[:, 2].mean()
    assert (np.abs(found.system - ROTOR.system(found.times))[:, 2:] < 6.0 * found.system_std[:, 2:] + 1e-4).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"states": ["X+Z", "Y"]}, "Argument `states` of `identify` must name channels .* but has 'Z'"),
        ({"states": ["X+Y"], "form": "delayed"}, "Argument `states` of `identify` .* but has 'X.Y'"),
        ({"states": ["X", "all"]}, "Argument `states` of `identify` .* but has 'all'"),
        ({"states": ["X+X", "Y"]}, "Argument `states` of `identify`"),
        (
            {"states": ["X", "Y"], "structure": "stiffness 1 known 2,0=0"},
            "Argument `structure` of `identify` must name elements of a block of 2 rows",
        ),
    ],
)
def test_states_that_cannot_be_are_refused_before_any_long_work(record, missing, options, words):
    for given in (record, missing):
        told = []
        with pytest.raises(InputError, match=words):
            identify(given, report=told.append, **options)
        assert set(told) <= {"cutting into periods"}


def test_a_structure_is_kept_as_text():
    one = SecondOrder(stiffness=Block(harmonics=2, known={(0, 1): 0.1}))
    assert Settings(states=("X", "Y"), structure=one).structure == "stiffness 2 known 0,1=0.1; damping 0"
    assert Settings(states=("X", "Y"), structure=" stiffness  2 ").structure == "stiffness 2; damping 0"
    assert Settings(states=("X", "Y"), structure=" ").structure == ""
    first = FirstOrder(system=Block(harmonics=3))
    assert Settings(states=("X",), form="first-order", structure=first).structure == "system 3"


@pytest.mark.parametrize(
    ("options", "argument", "words"),
    [
        ({"form": "delayed", "structure": "stiffness 1"}, "structure", 'come with the form "second-order"'),
        ({"form": "first-order", "structure": "auto"}, "structure", 'come with the form "second-order"'),
        ({"constrained": False, "structure": "auto"}, "structure", "come with `constrained=True`"),
        ({"structure": "", "output_error": True}, "output_error", "come with a structure"),
        ({"form": "first-order", "delay": 0.1}, "delay", 'be None unless the form is "delayed"'),
        ({"form": "delayed", "delay": 0.0}, "delay", "be positive"),
    ],
)
def test_options_that_do_not_go_together(options, argument, words):
    with pytest.raises(InputError, match=f"^Argument `{argument}` of `Settings` must {words}"):
        Settings(states=("X", "Y"), **options)
