"""States of every form: joint quantities, sums of all channels, delayed outputs, channels as they are.

Every deviation of A(t) and Φ is held against differences of `reconstruct` itself, along independent errors that make
the whole covariance; values are held against A(t) and the transition matrix integrated from it.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid import floquet
from floquid.core import PeriodicModel
from floquid.errors import IdentificationError, InputError
from floquid.reconstruction import reconstruct
from floquid.reconstruction._coordinates import Part, State
from floquid.testing import assert_exponents_close

WHOLE = 30
"""Harmonics enough to keep every term."""

TIMES = np.array([0.0, 0.31, 1.7])


def derivatives(powers):
    """Sensors of two displacements, each a sum of them or a derivative of it."""
    return [((1.0, 0.0, 0.0, 0.0), p) if k % 2 == 0 else ((0.0, 1.0, 0.0, 0.0), p) for k, p in enumerate(powers)]


@pytest.fixture(scope="module")
def exact(oracle):
    """Models with every harmonic that rounding allows."""

    def made(name, sensors, **options):
        sensors = [oracle.Sensor(*one) for one in sensors]
        return oracle.known(oracle.systems[name], sensors, **({"width": 12, "size": 1e-9} | options))

    return made


@pytest.fixture(scope="module")
def rough(exact):
    """The same with few harmonics, so that every term counts in every deviation."""

    def made(name, sensors, **options):
        return exact(name, sensors, **({"width": 2, "size": 1e-6} | options))

    return made


def is_the_system(known, found, transform=None):
    """A and Φ in coordinates x = M u of the states u of the known system."""
    m = np.eye(len(found.states)) if transform is None else transform
    back = np.linalg.inv(m)
    assert_allclose(found.system, m @ known.system.at(found.times) @ back, atol=1e-7)
    phi = floquet.transition(known.system.oracle(), known.system.period, found.times, start=found.times[0])
    assert_allclose(found.transition, m @ phi @ back, atol=1e-7)


def deviates_as_it_says(known, states, *, rtol=1e-5, **options):
    options = {"times": TIMES, "harmonics": WHOLE} | options
    found = reconstruct(known.model, states, **options)

    def both(model):
        one = reconstruct(model, states, **options)
        return np.stack([one.system, one.transition])

    whole = np.sqrt(known.variances(both, step=1e-2))
    said = np.stack([found.system_std, found.transition_std])
    assert_allclose(said, whole, rtol=rtol, atol=1e-6 * whole.max())
    return found


X, Y = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
JOINT = derivatives((0, 0, 1, 1, 2, 2))
STATES = {
    "displacement": ["c0", "c1"],
    "velocity": ["c2", "c3"],
    "acceleration": ["c4", "c5"],
    "acceleration and displacement": ["c4", "c1"],
    "joined by a sign": ["c0+c2+c4", "c1 + c3 + c5"],
    "joined by a list": [["c0", "c2"], ("c5", "c1")],
}


@pytest.mark.parametrize("states", STATES.values(), ids=STATES)
def test_any_quantities_are_exact(exact, states):
    known = exact("gyroscopic", JOINT)
    found = reconstruct(known.model, states, harmonics=WHOLE, times=TIMES)
    is_the_system(known, found)
    assert len(found.states) == 4


@pytest.mark.slow
@pytest.mark.parametrize("states", STATES.values(), ids=STATES)
def test_deviations_of_any_quantities(rough, states):
    deviates_as_it_says(rough("gyroscopic", JOINT), states)


def test_joint_quantities_are_better_than_each_alone(rough):
    """Where their errors are independent: each row has its own noise, and no exponent errs."""
    known = rough("pairs", JOINT)
    own = replace(known.estimates, slopes=0.0 * known.estimates.slopes, covariance=1e-12 * known.estimates.covariance)
    model = replace(known.model, estimates=own)
    std = {
        name: reconstruct(model, STATES[name], harmonics=WHOLE).system_std[:, 2:]
        for name in ("displacement", "velocity", "acceleration", "joined by a sign")
    }
    best = np.minimum(np.minimum(std["displacement"], std["velocity"]), std["acceleration"])
    joint = std["joined by a sign"]
    assert np.sum(joint**2) < 0.9 * np.sum(best**2)


def test_an_average_counts_most_what_says_most_at_a_rate():
    """Of displacement and acceleration, weights 1 and s⁻²: shares are those of 1/σ² and |s|⁴/σ²."""
    state = State("x", (Part(0), Part(1, 1.0, -2)), (0.3, 0.5))
    for rate in (0.2j, -0.1 + 1.5j, 40j):
        s = np.array(rate)
        precision = np.array([1 / 0.3**2, np.abs(s) ** 4 / 0.5**2])
        expected = precision / precision.sum() * np.array([1.0, s**-2.0])
        assert_allclose(state.weights(s, 2)[0], expected, rtol=1e-12)
        # Its derivative is s times that, whatever the shares are.
        assert_allclose(state.derivative().weights(s, 2)[0], s * expected, rtol=1e-12)


@pytest.mark.parametrize("part", [Part(0, 1.7, 0), Part(0, -0.4, 1, 0.3), Part(0, 2.0, -2, 0.1), Part(0, 1.0, 3)])
def test_slopes_of_weights_are_differences(part):
    s = np.array([0.3 + 1.1j, -0.5 + 4.0j])
    by = (part.weight(s + 1e-6) - part.weight(s - 1e-6)) / 2e-6
    assert_allclose(part.slope(s), by, rtol=1e-8)
    (weights, slopes), (up, _), (down, _) = (State("x", (part,)).weights(s + d, 2) for d in (0.0, 1e-6, -1e-6))
    assert_allclose(weights[:, 0], part.weight(s))
    assert_allclose(slopes, (up - down) / 2e-6, rtol=1e-8)


@pytest.mark.first(4)
@pytest.mark.parametrize("name", ["one", "locked", "overdamped", "blade", "growing", "pair and real"])
@pytest.mark.parametrize("hits", [1, 3])
def test_deviations_of_every_kind_of_mode(rough, oracle, name, hits):
    """Pairs, positive and negative multipliers, growing ones; one hit and three."""
    half = oracle.systems[name].half
    sensors = [(tuple(np.eye(2 * half)[i]), 0) for i in range(half)]
    deviates_as_it_says(rough(name, sensors, hits=hits), [f"c{i}" for i in range(half)])


@pytest.mark.parametrize(("name", "turns"), [("one", (2,)), ("locked", (1, -2)), ("overdamped", (-1, 1))])
def test_deviations_on_another_branch(rough, name, turns):
    deviates_as_it_says(rough(name, [((1.0, 0.0), 0)], turns=turns), ["c0"])


@pytest.mark.parametrize("name", ["one", "locked", "blade"])
def test_an_estimated_period_moves_the_state_matrix_at_a_phase(rough, name):
    known = rough(name, [((1.0, 0.0), 1)], free_period=True)
    found = reconstruct(known.model, ["c0"], harmonics=WHOLE, times=3)
    whole = known.variances(lambda model: reconstruct(model, ["c0"], harmonics=WHOLE, times=3).system, step=1e-2)
    assert_allclose(found.system_std, np.sqrt(whole), rtol=1e-5, atol=1e-6 * np.sqrt(whole.max()))


def test_what_is_known_has_no_deviation(rough):
    """Displacements change at their velocities; Φ begins with the identity."""
    known = rough("pairs", derivatives((0, 0)))
    found = reconstruct(known.model, ["c0", "c1"], times=TIMES, harmonics=WHOLE)
    assert_array_equal(found.system_std[:, :2], 0.0)
    assert_allclose(found.system[:, :2], np.tile(np.eye(4)[2:], (3, 1, 1)), atol=1e-9)
    assert found.transition_std[0].max() < 1e-9 * found.transition_std.max()
    assert (found.system_std[:, 2:] > 0).all()


# Channels in wildly different units.


def test_units_transform_the_state_matrix_and_its_deviations(oracle):
    system, factor = oracle.systems["pairs"], np.array([1e6, 1.0])
    plain, scaled = (oracle.known(system, oracle.displacements(2), width=2, units=units) for units in (None, factor))
    here, there = (reconstruct(one.model, ["c0", "c1"], times=5) for one in (plain, scaled))
    units = np.tile(factor, 2)
    for name in ("system", "transition", "system_std", "transition_std"):
        one = getattr(here, name)
        assert_allclose(getattr(there, name) * units / units[:, None], one, rtol=1e-6, atol=1e-8 * np.abs(one).max())


# First order: channels as they are.


MIX = np.array([[1.0, 0.2, 0.0, 0.1], [0.0, 1.0, 0.3, 0.0], [0.5, 0.0, 1.0, 0.2], [0.0, 0.4, -0.1, 1.0]])


def test_channels_as_they_are(exact):
    known = exact("gyroscopic", [(tuple(row), 0) for row in MIX])
    names = ["c0", "c1", "c2", "c3"]
    found = reconstruct(known.model, names, form="first-order", harmonics=WHOLE, times=TIMES)
    is_the_system(known, found, MIX)
    assert found.states == tuple(names)
    swap = [2, 0, 3, 1]
    other = reconstruct(known.model, [names[i] for i in swap], form="first-order", harmonics=WHOLE, times=TIMES)
    assert_allclose(other.system, found.system[:, swap][:, :, swap], atol=1e-8)
    every = reconstruct(known.model, "all", form="first-order", harmonics=WHOLE, times=TIMES)
    assert_array_equal(every.system, found.system)


@pytest.mark.slow
def test_channels_as_they_are_deviate_as_they_say(rough):
    known = rough("pair and real", [(tuple(row), 0) for row in MIX], hits=2)
    found = deviates_as_it_says(known, ["c0", "c1", "c2", "c3"], form="first-order")
    assert (found.system_std > 0).all()


def test_a_wrong_number_of_channels_as_they_are_is_refused(exact):
    known = exact("pairs", derivatives((0, 0)))
    with pytest.raises(InputError, match="must name 4 channels: 4 modes"):
        reconstruct(known.model, ["c0", "c1"], form="first-order")


# Delayed outputs.


def delayed_map(known, rows, delay, count):
    """M(t) with x = M u, x of delayed outputs, from the transition matrix of the known system."""

    def at(t):
        out = []
        for number in range(count):
            later, row = divmod(number, len(rows))
            phi = floquet.transition(known.system.oracle(), known.system.period, [t + later * delay + 1e-300], start=t)[
                0
            ]
            out.append(np.array(known.sensors[rows[row]].sees) @ phi)
        return np.array(out)

    return at


@pytest.mark.parametrize(("sensors", "rows"), [(1, [0]), (2, [0, 1]), (3, [0, 1, 2])])
def test_delayed_outputs_are_exact(exact, sensors, rows):
    """One, two and three channels for four modes; Φ is that of the state, seen at both ends through M(t)."""
    seen = [((1.0, 0.2, 0.0, 0.0), 0), ((0.0, 1.0, 0.0, 0.1), 0), ((0.3, 0.0, 1.0, 0.0), 0)][:sensors]
    known, delay = exact("gyroscopic", seen), 0.23
    names = [f"c{i}" for i in rows]
    found = reconstruct(known.model, names, form="delayed", delay=delay, harmonics=WHOLE, times=TIMES)
    seen_as = delayed_map(known, rows, delay, 4)
    maps = np.array([seen_as(t) for t in TIMES])
    phi = floquet.transition(known.system.oracle(), known.system.period, TIMES, start=TIMES[0])
    assert_allclose(found.transition, maps @ phi @ np.linalg.inv(maps[0]), atol=1e-6)
    step = 1e-4
    rate = np.array([(seen_as(t + step) - seen_as(t - step)) / (2 * step) for t in TIMES])
    expected = (rate + maps @ known.system.at(TIMES)) @ np.linalg.inv(maps)
    assert_allclose(found.system, expected, atol=1e-5 * np.abs(expected).max())
    assert len(found.states) == 4
    assert found.states[: len(names)] == tuple(names)
    assert all(f"(t + {delay:g} s)" in name for name in found.states[len(names) : 2 * len(names)])


@pytest.mark.parametrize("delay", [None, 0.23])
def test_delayed_outputs_have_the_exponents_of_the_system(exact, delay):
    """By the multipliers of Φ over a period."""
    known = exact("pairs", [(X, 0)])
    found = reconstruct(known.model, ["c0"], form="delayed", delay=delay, harmonics=WHOLE, times=[0.0, 2.0])
    exponents = np.log(np.linalg.eigvals(found.transition[1])) / 2.0
    assert_exponents_close(exponents, floquet.exponents(known.system.oracle()), 2.0, atol=1e-7)
    assert "the exponents are the same in any" in found.coordinates


@pytest.mark.first(1)
@pytest.mark.parametrize("sensors", [1, 3])
def test_delayed_outputs_deviate_as_they_say(rough, sensors):
    known = rough("pairs", [(X, 0), (Y, 0), ((0.3, 0.0, 1.0, 0.0), 0)][:sensors])
    found = deviates_as_it_says(known, [f"c{i}" for i in range(sensors)], form="delayed", delay=0.23)
    assert (found.system_std > 0).any(axis=(0, 1)).all()


@pytest.mark.slow
def test_the_delay_taken_is_nearly_the_best(exact):
    """In the condition of the result, over the delays around it that another might try."""
    known = exact("gyroscopic", [(X, 0)], width=6)
    options = {"form": "delayed", "harmonics": "model", "times": 24}
    own = reconstruct(known.model, ["c0"], **options).condition.max()
    tried = []
    for delay in np.linspace(0.03, 1.9, 60):
        try:
            tried.append(reconstruct(known.model, ["c0"], delay=delay, **options).condition.max())
        except IdentificationError:
            continue
    assert own < 1.2 * min(tried)


def test_an_odd_number_of_modes_may_be_delayed(oracle):
    constant = np.array([[-0.2, 2.0, 0.1], [-2.2, -0.3, 0.2], [0.1, 0.2, -0.8]])
    system = oracle.System(lambda t: np.broadcast_to(constant, (*np.shape(t), 3, 3)), 2.0)
    known = oracle.known(system, [oracle.Sensor((1.0, 0.0, 0.5))], width=1)
    found = reconstruct(known.model, ["c0"], form="delayed", times=3)
    assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.system[0])), np.sort_complex(np.linalg.eigvals(constant)), atol=1e-8
    )


@pytest.mark.parametrize(
    ("states", "options", "said"),
    [
        ([], {"form": "delayed"}, "must name 1 to 4 channels, but names 0"),
        (["c0"], {"form": "delayed", "delay": 0.0}, "`delay` of `reconstruct` must be positive"),
        (["c0"], {"form": "delayed", "delay": -1.0}, "`delay` of `reconstruct` must be positive"),
        (["c0", "c1"], {"delay": 0.1}, "`delay` of `reconstruct` must be None unless"),
        (["c0", "c1"], {"form": "third-order"}, "`form` of `reconstruct` must be one of"),
        (["c0", "c1"], {"harmonics": "all"}, '`harmonics` of `reconstruct` must be "auto", "model" or a whole number'),
        (["c0", "c1"], {"harmonics": -1}, "`harmonics` of `reconstruct`"),
        (["c0", "c1"], {"harmonics": 1.5}, "`harmonics` of `reconstruct`"),
        (["c0+c9", "c1"], {}, "must name channels of the record, but has 'c9'"),
        (["c0+c0", "c1"], {}, "must name each channel once, but has 'c0' twice"),
        (["c0+c1", "c1"], {}, "must name each channel once, but has 'c1' twice"),
        ([3, "c1"], {}, "must be a list of channel names"),
    ],
)
def test_what_cannot_be_is_refused(exact, states, options, said):
    known = exact("pairs", derivatives((0, 0)), width=1)
    with pytest.raises(InputError, match=said):
        reconstruct(known.model, states, **options)


def test_a_delay_that_sees_the_same_again_is_refused(exact):
    """An undamped mode seen half a turn later is itself turned round."""
    known = exact("one", [((1.0, 0.0), 0)])
    lam = known.estimates.exponents[0]
    still = PeriodicModel(
        exponents=[1j * lam.imag, -1j * lam.imag],
        coefficients=np.ones((2, 1, 1, 1)),
        harmonics=[0],
        period=2.0,
        channels=["c0"],
    )
    with pytest.raises(IdentificationError, match="linearly dependent"):
        reconstruct(still, ["c0"], form="delayed", delay=np.pi / lam.imag)


# All channels.


SEEN = np.array([[1.0, 0.1], [0.2, 1.0], [0.7, -0.6], [-0.4, 0.9], [1.1, 0.5]])


@pytest.fixture(scope="module")
def five(exact):
    """Five sensors of two displacements, of every quantity."""
    sensors = [((*row, 0.0, 0.0), p) for row, p in zip(SEEN, (0, 1, 2, 0, 1), strict=True)]
    return lambda **options: exact("gyroscopic", sensors, **options)


def chosen_rows(found):
    return [int(name.removesuffix("*")[1:]) for name in found.states[:2]]


def test_all_channels_are_exact(five):
    """Displacements are those behind two of the channels."""
    known = five()
    found = reconstruct(known.model, "all", harmonics=WHOLE, times=TIMES)
    u = SEEN[chosen_rows(found)]
    is_the_system(known, found, np.block([[u, np.zeros((2, 2))], [np.zeros((2, 2)), u]]))


def test_all_channels_are_better_than_the_two_that_they_are_scaled_by(five):
    known = five(width=2, size=1e-6)
    own = replace(known.estimates, slopes=0.0 * known.estimates.slopes, covariance=1e-12 * known.estimates.covariance)
    model = replace(known.model, estimates=own)
    every = reconstruct(model, "all", harmonics=WHOLE)
    few = reconstruct(model, [f"c{row}" for row in chosen_rows(every)], harmonics=WHOLE)
    assert np.sum(every.system_std[:, 2:] ** 2) < 0.85 * np.sum(few.system_std[:, 2:] ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_all_channels_deviate_nearly_as_they_say(five, seed):
    """The errors of their gains too."""
    deviates_as_it_says(five(width=2, size=1e-6, seed=seed), "all", rtol=2e-3)


@pytest.mark.slow
def test_all_channels_of_a_constant_system_deviate_as_they_say(oracle):
    """Two modes of one harmonic: the gains are no better known than the shapes, and make A(t) twice as uncertain."""
    system = oracle.System.second_order([[[14.0, 3.0], [3.0, 29.0]]], [[[0.2, 0.03], [0.03, 0.32]]])
    sensors = [oracle.Sensor((*row, 0.0, 0.0)) for row in np.random.default_rng(0).standard_normal((5, 2))]
    deviates_as_it_says(oracle.known(system, sensors, width=0), "all", rtol=1e-5)


def test_as_many_channels_as_displacements_are_these(exact):
    known = exact("pairs", derivatives((0, 1)))
    every = reconstruct(known.model, "all", harmonics=WHOLE, times=TIMES)
    few = reconstruct(known.model, ["c0", "c1"], harmonics=WHOLE, times=TIMES)
    assert_allclose(every.system, few.system, atol=1e-10)
    assert_allclose(every.system_std, few.system_std, rtol=1e-8)


def test_all_channels_without_noise_are_taken_by_their_size(five):
    known = five(width=12)
    silent = replace(known.model, coefficient_std=np.zeros_like(known.model.coefficient_std), estimates=None)
    found = reconstruct(silent, "all", times=TIMES)
    u = SEEN[chosen_rows(found)]
    is_the_system(known, found, np.block([[u, np.zeros((2, 2))], [np.zeros((2, 2)), u]]))


def test_channels_that_are_no_constant_combinations_are_refused(oracle, five):
    known = five(width=2, size=1e-6)
    own = known.estimates
    turned = np.where((own.harmonics == 1)[:, None] & (np.arange(5) == 2), 1.01, 1.0)
    other = replace(own, coefficients=own.coefficients * turned[:, :, None])
    with pytest.raises(IdentificationError, match="no constant combinations of 2 displacements"):
        reconstruct(oracle.model_of(other, known.model), "all")


def test_all_of_too_few_channels_is_refused(exact):
    with pytest.raises(
        InputError, match="must be at least 2 channels: half as many as there are modes, but there are 1"
    ):
        reconstruct(exact("pairs", [(X, 0)]).model, "all")


def test_a_channel_called_all_is_a_channel(exact):
    known = exact("pairs", derivatives((0, 0)))
    channels = [replace(known.model.channels[0], name="all"), known.model.channels[1]]
    model = replace(known.model, channels=channels)
    assert reconstruct(model, ["all", "c1"]).states[0] == "all"


# Very many channels.


def test_very_many_channels(exact):
    """A hundred sensors of two displacements, all of them taken."""
    generator = np.random.default_rng(0)
    rows = generator.standard_normal((100, 2))
    known = exact("pairs", [((*row, 0.0, 0.0), 0) for row in rows], width=5)
    found = reconstruct(known.model, "all", harmonics=WHOLE, times=3)
    u = rows[chosen_rows(found)]
    back = np.block([[u, np.zeros((2, 2))], [np.zeros((2, 2)), u]])
    expected = back @ known.system.at(found.times) @ np.linalg.inv(back)
    assert_allclose(found.system, expected, atol=1e-4)
    assert found.system_std.max() < 1e-4


# Sums of channels with constant weights.


E = np.array([[0.5, 1.0], [1.0, -0.3]])
SUMS = ["0.5*c0+c1", "c0 - 0.3*c1"]


@pytest.mark.parametrize("powers", [(0, 0), (0, 2)])
def test_sums_with_weights_are_a_change_of_coordinates(exact, oracle, powers):
    known = exact("gyroscopic", derivatives(powers))
    is_the_system(known, reconstruct(known.model, SUMS, harmonics=WHOLE, times=TIMES), np.kron(np.eye(2), E))


def test_sums_are_states_of_first_order_too(exact):
    known = exact("gyroscopic", [(tuple(row), 0) for row in np.eye(4)])
    names = ["2*c0", "c1+1*c0", "c2", "c3"]
    turned = np.eye(4)
    turned[0, 0], turned[1, 0] = 2.0, 1.0
    is_the_system(known, reconstruct(known.model, names, form="first-order", harmonics=WHOLE, times=TIMES), turned)


@pytest.mark.parametrize(
    ("states", "words"),
    [
        (["0.5*c0+c1", "c0+2*c1"], "must be independent combinations of channels, but only 1 of the 2 are"),
        (["0.5*q+c1", "c0"], r"must be channels, or sums of them as 0.5\*X\+Y, but has '0.5\*q\+c1'"),
        (["0.5**c0", "c1"], "must be channels, or sums of them"),
    ],
)
def test_sums_that_are_none_are_refused(exact, states, words):
    known = exact("gyroscopic", derivatives((0, 0)))
    with pytest.raises(InputError, match=words):
        reconstruct(known.model, states)
