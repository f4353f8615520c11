"""A(t) fitted with a structure: exact, as uncertain as it says, refused when wrong and not when right.

The truth is A(t) itself, with modes and Φ integrated by `floquid.floquet`; the errors of the estimates are drawn from
the law that they state.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2, kstest

from floquid import floquet, identify
from floquid.core import Channel, ConstantPeriod, Record
from floquid.errors import IdentificationError, InputError
from floquid.reconstruction import Block, FirstOrder, SecondOrder, refine
from floquid.reconstruction._harmonic_balance import Mode, slopes_of, solved
from floquid.reconstruction._invariance import Seen, at, problem_of
from floquid.systems import JeffcottRotor
from floquid.systems._jeffcott import free_response
from floquid.testing import assert_exponents_close

SYMMETRIC, ANY, DIAGONAL = (Block(symmetry=s) for s in ("symmetric", "none", "diagonal"))
ONE, TWO = Block(harmonics=1), Block(harmonics=2)
WAVES = Block(harmonics=1, symmetry="symmetric")
RIGHT = {
    "pairs": SecondOrder(stiffness=WAVES, damping=SYMMETRIC),
    "gyroscopic": SecondOrder(stiffness=WAVES, damping=SYMMETRIC, gyroscopic=Block(symmetry="skew")),
    "one": SecondOrder(stiffness=ONE),
    "growing": SecondOrder(stiffness=WAVES, damping=SYMMETRIC),
    "locked": SecondOrder(stiffness=ONE),
    "overdamped": SecondOrder(stiffness=ONE),
    "blade": SecondOrder(stiffness=TWO, damping=ONE),
    "pair and real": SecondOrder(stiffness=WAVES, damping=ANY),
}
EVERY = pytest.mark.parametrize("name", RIGHT)


def names(known):
    return [channel.name for channel in known.model.channels[: known.system.half]]


def make(oracle, name, **options):
    system = oracle.systems[name]
    options = {"width": 2, "hits": 1} | options
    return oracle.known(system, oracle.displacements(system.half), **options)


def refined(known, structure, **options):
    return refine(known.model, names(known), structure, **({"times": 7} | options))


def is_exact(known, found, tolerance=1e-8):
    state, system = found.state, known.system
    assert_allclose(state.system, system.at(state.times), atol=tolerance)
    assert_allclose(state.transition, floquet.transition(system.oracle(), system.period, state.times), atol=tolerance)
    assert_exponents_close(found.exponents, floquet.exponents(system.oracle()), system.period, atol=tolerance)
    assert found.chi_square < 1e-3
    assert found.p_value > 1.0 - 1e-6
    assert found.degrees > 0
    assert (found.std > 0).all()


@pytest.mark.first(6)
@EVERY
@pytest.mark.parametrize("hits", [1, 3])
def test_it_is_exact_without_noise(oracle, name, hits):
    known = make(oracle, name, hits=hits)
    is_exact(known, refined(known, RIGHT[name]))


@pytest.mark.first(3)
@pytest.mark.parametrize("name", sorted(RIGHT, key=lambda name: name not in ("locked", "gyroscopic", "blade")))
def test_it_is_exact_when_the_period_is_estimated(oracle, name):
    known = make(oracle, name, free_period=True)
    is_exact(known, refined(known, RIGHT[name]))


CASES = {
    "no symmetry": ("pairs", SecondOrder(stiffness=ONE, damping=ANY)),
    "more harmonics than there are": ("pairs", SecondOrder(stiffness=replace(WAVES, harmonics=2), damping=SYMMETRIC)),
    "periodic damping": ("pairs", SecondOrder(stiffness=WAVES, damping=WAVES)),
    "damping that holds the gyroscopic block": ("gyroscopic", SecondOrder(stiffness=WAVES, damping=ANY)),
    "known elements": (
        "gyroscopic",
        SecondOrder(
            stiffness=replace(WAVES, known={}),
            damping=Block(known={(0, 0): 0.20, (0, 1): 0.93}),
        ),
    ),
    "a known element of a symmetric block": (
        "pairs", SecondOrder(stiffness=WAVES, damping=Block(symmetry="symmetric", known={(1, 0): 0.03}))
    ),
    "a known gyroscopic block": (
        "gyroscopic",
        SecondOrder(stiffness=WAVES, damping=SYMMETRIC, gyroscopic=Block(symmetry="skew", known={(0, 1): 0.90})),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_every_structure_that_holds_the_truth_is_exact(oracle, case):
    name, structure = CASES[case]
    known = make(oracle, name)
    found = refined(known, structure)
    is_exact(known, found)
    assert len(found.names) == len(found.parameters) == len(found.std)


def test_a_system_that_is_known_altogether_is_tested_against_the_record(oracle):
    """No parameter at all: the misfit alone says whether it is the one."""
    known = make(oracle, "one")
    structure = SecondOrder(stiffness=Block(known={(0, 0): 5.0}), damping=Block(known={(0, 0): 0.3}))
    with pytest.raises(IdentificationError, match="contradicts"):
        refined(known, structure)
    still = oracle.System.second_order([[[5.0]]], [[[0.3]]])
    constant = oracle.known(still, oracle.displacements(1), width=1)
    found = refine(constant.model, ["c0"], structure, times=3)
    assert len(found.parameters) == 0
    assert found.chi_square < 1e-6
    assert found.degrees == 2 + 2 * 3 - 2
    assert_allclose(found.state.system, still.at(found.state.times))
    assert_array_equal(found.state.system_std, 0.0)


def test_diagonal_blocks(oracle):
    """Two oscillators on their own, seen by mixed sensors of one displacement each."""
    system = oracle.System.second_order([np.diag([14.0, 29.0]), np.diag([2.0, -1.5])], [np.diag([0.2, 0.3])])
    known = oracle.known(system, oracle.displacements(2), width=2)
    diagonal = SecondOrder(stiffness=replace(DIAGONAL, harmonics=1), damping=DIAGONAL)
    is_exact(known, refined(known, diagonal))


def test_the_parameters_are_those_of_the_blocks(oracle):
    """By name, with the signs of u'' + D u' + K u = 0."""
    found = refined(make(oracle, "gyroscopic"), RIGHT["gyroscopic"])
    values = dict(zip(found.names, found.parameters, strict=True))
    expected = {
        "stiffness[0,0]": 14.0, "stiffness[0,0] cos 1": 2.0, "stiffness[0,0] sin 1": 0.5,
        "stiffness[0,1]": 3.0, "stiffness[0,1] cos 1": 0.7, "stiffness[0,1] sin 1": 1.2,
        "stiffness[1,1]": 29.0, "stiffness[1,1] cos 1": -1.5, "stiffness[1,1] sin 1": 0.4,
        "damping[0,0]": 0.20, "damping[0,1]": 0.03, "damping[1,1]": 0.32, "gyroscopic[0,1]": 0.90,
    }  # fmt: skip
    assert values.keys() == expected.keys()
    for name, value in expected.items():
        assert values[name] == pytest.approx(value, abs=1e-8)


@pytest.fixture(scope="module")
def first(oracle):
    """Three states of first order, a pair and a real exponent, and channels that are their sums."""
    constant = np.array([[-0.2, 2.0, 0.1], [-2.2, -0.3, 0.2], [0.1, 0.2, -0.8]])
    wave = np.array([[0.1, 0.2, -0.1], [0.3, -0.1, 0.0], [0.2, 0.1, 0.2]])

    def matrix(times):
        return constant + np.cos(np.pi * np.asarray(times, float))[..., None, None] * wave

    system = oracle.System(matrix, 2.0)
    sensors = [oracle.Sensor(tuple(row)) for row in np.eye(3)]
    return oracle.known(system, sensors, width=2, hits=2)


def test_a_first_order_system_is_exact(first):
    found = refine(first.model, ["c0", "c1", "c2"], FirstOrder(system=Block(harmonics=1)), times=7)
    is_exact(first, found)


def test_a_first_order_system_in_other_units_and_order(first):
    found = refine(first.model, ["c2", "c0", "c1"], FirstOrder(system=Block(harmonics=1)), times=7)
    straight = refine(first.model, ["c0", "c1", "c2"], FirstOrder(system=Block(harmonics=1)), times=7)
    swap = np.ix_([2, 0, 1], [2, 0, 1])
    for name in ("system", "transition", "system_std", "transition_std"):
        expected = np.array([one[swap] for one in getattr(straight.state, name)])
        assert_allclose(getattr(found.state, name), expected, rtol=1e-5, atol=1e-9 * np.abs(expected).max())


# What it says of its own errors.


@pytest.mark.slow
@pytest.mark.parametrize("name", ["one", "locked", "overdamped", "blade"])
@pytest.mark.parametrize("free_period", [False, True])
def test_deviations_are_those_of_the_fit_by_differences(oracle, name, free_period):
    """The fit redone for every independent error of the estimates."""
    known = make(oracle, name, free_period=free_period)
    found = refined(known, RIGHT[name], times=3)
    half = known.system.half

    def parts(one):
        return [one.parameters, one.exponents.real, one.exponents.imag,
                one.state.system[:, half:].ravel(), one.state.transition[1:].ravel()]  # fmt: skip

    def all_of(model):
        return np.concatenate(parts(refine(model, names(known), RIGHT[name], times=3)))

    lengths = np.cumsum([len(one) for one in parts(found)])[:-1]
    whole = np.split(np.sqrt(known.variances(all_of, step=1.0)), lengths)
    # A(t) and Φ are at instants: what an estimated period does to the phase of an instant is left out.
    exact = whole[:3] if free_period else whole
    state = found.state
    said = [found.std, found.exponent_std.real, found.exponent_std.imag,
            state.system_std[:, half:].ravel(), state.transition_std[1:].ravel()]  # fmt: skip
    for one, other in zip(said[: len(exact)], exact, strict=True):
        if other is whole[2] and found.exponent_std.imag.max() == 0.0:
            continue  # A real multiplier's imaginary part is half the fundamental, or nothing.
        assert_allclose(one, other, rtol=1e-4, atol=1e-6 * other.max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyroscopic", "pair and real"])
def test_errors_and_their_deviations_agree_over_draws(oracle, name):
    known, generator = make(oracle, name, hits=2), np.random.default_rng(5)
    truth, half = refined(known, RIGHT[name], times=3), known.system.half
    pulls, left = [], []
    for _ in range(12):
        found = refine(known.drawn(generator), names(known), RIGHT[name], times=truth.state.times)
        pulls.append(np.concatenate([
            (found.parameters - truth.parameters) / found.std,
            ((found.state.system - truth.state.system)[:, half:] / found.state.system_std[:, half:]).ravel(),
            ((found.state.transition - truth.state.transition)[1:] / found.state.transition_std[1:]).ravel(),
        ]))  # fmt: skip
        error = found.parameters - truth.parameters
        left.append(error @ np.linalg.solve(found.covariance, error))
    mean = np.sum(np.square(pulls), axis=0)
    low, high = chi2.ppf([1e-3 / (2 * mean.size), 1.0 - 1e-3 / (2 * mean.size)], 12)
    assert mean.min() > low
    assert mean.max() < high
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 12 * len(truth.parameters))
    assert low < np.sum(left) < high


@pytest.mark.slow
@pytest.mark.parametrize(("name", "options"), [
    ("one", {}), ("locked", {"free_period": True}), ("blade", {"hits": 3}), ("pairs", {"width": 1}),
])  # fmt: skip
def test_p_values_of_the_right_structure_are_uniform(oracle, name, options):
    known, generator = make(oracle, name, **options), np.random.default_rng(11)
    found = [refine(known.drawn(generator), names(known), RIGHT[name], times=1, refuse=1e-12) for _ in range(40)]
    assert kstest([one.p_value for one in found], "uniform").pvalue > 0.01
    total, degrees = sum(one.chi_square for one in found), sum(one.degrees for one in found)
    low, high = chi2.ppf([0.005, 0.995], degrees)
    assert low < total < high


def test_degrees_of_freedom_are_numbers_less_unknowns(oracle):
    """A pair, five harmonics, two hits: 2 + 2·5·2 numbers, less 4 parameters and 2 amplitudes a hit."""
    found = refined(make(oracle, "one", hits=2), RIGHT["one"])
    assert found.degrees == 2 + 20 - 4 - 4
    # Two negative multipliers: 1 number each for the exponent, forward harmonics (3 of 5), one amplitude.
    known = make(oracle, "locked", free_period=True)
    terms = len(known.estimates.modes)
    assert refined(known, RIGHT["locked"]).degrees == 3 + 2 * terms - 4 - 2 - 1


def test_a_real_coefficient_is_one_number(oracle):
    known = make(oracle, "overdamped")
    own = known.estimates
    numbers = 2 * len(own.modes) - int((~own.turning).sum())
    assert (~own.turning).sum() == 2
    assert refined(known, RIGHT["overdamped"]).degrees == 2 + numbers - 4 - 2


# What it refuses.

WRONG = {
    "too few harmonics": ("blade", SecondOrder(stiffness=ONE, damping=ONE)),
    "no harmonics": ("pairs", SecondOrder(stiffness=SYMMETRIC, damping=SYMMETRIC)),
    "constant damping": ("blade", SecondOrder(stiffness=TWO)),
    "gyroscopic left out": ("gyroscopic", SecondOrder(stiffness=WAVES, damping=SYMMETRIC)),
    "diagonal": ("pairs", SecondOrder(stiffness=replace(DIAGONAL, harmonics=1), damping=SYMMETRIC)),
    "diagonal damping": ("pairs", SecondOrder(stiffness=WAVES, damping=DIAGONAL)),
    "a wrong known element": ("pairs", SecondOrder(stiffness=WAVES, damping=Block(known={(0, 0): 0.21}))),
    "a wrong known zero": ("pairs", SecondOrder(stiffness=replace(WAVES, known={(0, 1): 0.0}), damping=SYMMETRIC)),
}


@pytest.mark.first(1)
@pytest.mark.parametrize("case", WRONG)
def test_a_structure_that_is_wrong_in_one_way_is_refused(oracle, case):
    name, structure = WRONG[case]
    known = make(oracle, name)
    with pytest.raises(IdentificationError, match="The structure contradicts the data"):
        refined(known, structure)


@pytest.mark.slow
def test_an_unsymmetric_stiffness_is_not_fitted_by_a_symmetric_one(oracle):
    system = oracle.System.second_order([[[14.0, 3.2], [2.8, 29.0]], [[2.0, 0.7], [0.7, -1.5]]], [[[0.2, 0], [0, 0.3]]])
    known = oracle.known(system, oracle.displacements(2), width=2)
    with pytest.raises(IdentificationError, match="The structure contradicts the data"):
        refined(known, RIGHT["pairs"])
    is_exact(known, refined(known, SecondOrder(stiffness=ONE, damping=SYMMETRIC)))


@pytest.mark.slow
def test_a_refusal_names_what_would_fit(oracle):
    with pytest.raises(IdentificationError, match=r"damping that is not symmetric leaves [0-9.e-]+ for \d+"):
        refined(make(oracle, "gyroscopic"), WRONG["gyroscopic left out"][1])


def test_a_refusal_can_be_put_off(oracle):
    """At a probability of zero nothing is refused; the p-value says it all the same."""
    found = refined(make(oracle, "blade"), SecondOrder(stiffness=TWO), refuse=0.0)
    assert found.p_value < 1e-5


def test_more_parameters_than_the_response_shows_are_refused(oracle):
    known = make(oracle, "one", width=0)
    with pytest.raises(IdentificationError, match="does not determine every parameter"):
        refined(known, SecondOrder(stiffness=Block(harmonics=2), damping=Block(harmonics=2)))


def test_two_hits_on_equal_oscillators_do_not_tell_their_blocks(oracle):
    """One mode seen in two displacements: not enough for a full stiffness."""
    system = oracle.systems["one"]
    sensors = [oracle.Sensor((1.0, 0.0)), oracle.Sensor((0.4, 0.0))]
    known = oracle.known(system, sensors, width=2)
    with pytest.raises(InputError, match="must name 1 channels: 2 modes"):
        refine(known.model, ["c0", "c1"], RIGHT["pairs"])


# What must not matter.


def same(first, second, *, rtol=2e-5):
    assert second.chi_square == pytest.approx(first.chi_square, rel=1e-4, abs=1e-6)
    assert second.degrees == first.degrees
    for name in ("system", "transition", "system_std", "transition_std"):
        one, other = getattr(first.state, name), getattr(second.state, name)
        assert_allclose(other, one, rtol=rtol, atol=1e-8 * np.abs(one).max())


@pytest.fixture(scope="module")
def noisy(oracle):
    """The pairs with an error, as many hits as are asked for."""
    return make(oracle, "pairs", hits=2)


def test_units_of_the_channels_transform_the_state_matrix(oracle, noisy):
    """One displacement in micrometres: A and its deviations are transformed, nothing else changes."""
    factor = np.array([1e6, 1.0])
    drawn = noisy.drawn(np.random.default_rng(0))
    own = drawn.estimates
    scaled = replace(
        own,
        coefficients=own.coefficients * factor[:, None],
        slopes=own.slopes * factor[:, None, None],
        scales=own.scales * factor[:, None],
    )
    free = SecondOrder(stiffness=ONE, damping=ANY)
    here = refine(drawn, ["c0", "c1"], free, times=5)
    there = refine(oracle.model_of(scaled, drawn), ["c0", "c1"], free, times=5)
    assert there.chi_square == pytest.approx(here.chi_square, rel=1e-6)
    units = np.tile(factor, 2)
    back = units / units[:, None]
    for name in ("system", "transition", "system_std", "transition_std"):
        one = getattr(here.state, name)
        assert_allclose(getattr(there.state, name) * back, one, rtol=1e-4, atol=1e-7 * np.abs(one).max())


def test_the_order_of_the_states_is_that_asked_for(noisy):
    drawn, swap = noisy.drawn(np.random.default_rng(0)), np.ix_([1, 0, 3, 2], [1, 0, 3, 2])
    here = refine(drawn, ["c0", "c1"], RIGHT["pairs"], times=5)
    there = refine(drawn, ["c1", "c0"], RIGHT["pairs"], times=5)
    assert there.chi_square == pytest.approx(here.chi_square, rel=1e-6)
    assert there.state.states == ("c1", "c0", "d/dt c1", "d/dt c0")
    for name in ("system", "transition", "system_std", "transition_std"):
        one = np.array([m[swap] for m in getattr(here.state, name)])
        assert_allclose(getattr(there.state, name), one, rtol=1e-4, atol=1e-7 * np.abs(one).max())


@pytest.mark.parametrize("name", ["pairs", "locked", "blade", "pair and real"])
def test_the_branch_of_an_exponent_does_not_matter(oracle, name):
    """The same terms under another name: harmonics and exponents moved against one another."""
    known = make(oracle, name)
    here = refined(known, RIGHT[name])
    own, turns = known.estimates, np.array([1, -1, 2])[: len(known.estimates.exponents)]
    turns = np.where(own.real, np.abs(turns), turns)
    moved = replace(
        own,
        exponents=own.exponents + 1j * own.fundamental * turns,
        harmonics=own.harmonics - turns[own.modes],
    )
    there = refine(oracle.model_of(moved, known.model), names(known), RIGHT[name], times=7)
    same(here, there)
    assert_exponents_close(there.exponents, here.exponents, known.system.period, atol=1e-10)


def test_the_sizes_of_hits_do_not_matter(oracle, noisy):
    drawn = noisy.drawn(np.random.default_rng(1))
    own, factor = drawn.estimates, np.array([1.0, 250.0])
    louder = replace(
        own,
        coefficients=own.coefficients * factor,
        slopes=own.slopes * factor[:, None],
        scales=own.scales * factor,
    )
    same(
        refine(drawn, ["c0", "c1"], RIGHT["pairs"]),
        refine(oracle.model_of(louder, drawn), ["c0", "c1"], RIGHT["pairs"]),
    )


def test_a_second_hit_makes_it_less_uncertain(oracle):
    """Of the same shape of errors: half the variance at most where the second hit is as loud as the first."""
    one, two = (refined(make(oracle, "one", hits=hits), RIGHT["one"]) for hits in (1, 2))
    assert (two.std < one.std).all()


# Several quantities of one motion.


@pytest.fixture(scope="module")
def mixed(oracle):
    """Displacement, velocity and acceleration of each of two displacements."""
    return oracle.known(oracle.systems["pairs"], oracle.displacements(2, (0, 1, 2)), width=2)


QUANTITIES = {
    "displacement": ["c0", "c1"],
    "velocity": ["c2", "c3"],
    "acceleration": ["c4", "c5"],
    "mixed": ["c4", "c1"],
    "joint": ["c0+c2+c4", ["c1", "c3", "c5"]],
}


@pytest.mark.parametrize("states", QUANTITIES.values(), ids=QUANTITIES)
def test_any_quantity_is_exact(mixed, states):
    is_exact(mixed, refine(mixed.model, states, RIGHT["pairs"], times=7))


def test_joint_quantities_are_better_than_each_alone(mixed):
    """And their numbers all count: three times the coefficients, one set of parameters and amplitudes."""
    found = {name: refine(mixed.model, states, RIGHT["pairs"], times=7) for name, states in QUANTITIES.items()}
    for name in ("displacement", "velocity", "acceleration"):
        assert (found["joint"].std < found[name].std).all()
    terms = len(mixed.estimates.modes)
    assert found["joint"].degrees - found["displacement"].degrees == 4 * 2 * terms


@pytest.mark.slow
def test_joint_quantities_that_agree_are_not_refused(mixed):
    generator = np.random.default_rng(2)
    found = [refine(mixed.drawn(generator), QUANTITIES["joint"], RIGHT["pairs"], times=1) for _ in range(12)]
    assert kstest([one.p_value for one in found], "uniform").pvalue > 0.01


def test_joint_quantities_that_disagree_are_refused(oracle, mixed):
    """A velocity channel with a gain that is off by a hundredth of a percent, a hundred deviations."""
    own = mixed.estimates
    gain = np.array([1.0, 1.0, 1.0001, 1.0, 1.0, 1.0])
    off = replace(own, coefficients=own.coefficients * gain[:, None])
    with pytest.raises(IdentificationError, match="contradicts"):
        refine(oracle.model_of(off, mixed.model), QUANTITIES["joint"], RIGHT["pairs"])


# The step on the record, and callers' mistakes.


def test_the_record_linearised_anew_takes_the_place_of_the_estimates(oracle):
    known = make(oracle, "one")
    drawn, other = (known.drawn(np.random.default_rng(seed)) for seed in (0, 1))
    first = refine(drawn, ["c0"], RIGHT["one"])
    asked = []

    def again(exponents):
        asked.append(exponents)
        return other.estimates

    found = refine(drawn, ["c0"], RIGHT["one"], again=again)
    expected = refine(other, ["c0"], RIGHT["one"])
    assert_allclose(asked[0], first.exponents[drawn.exponents.imag > 0], rtol=1e-10)
    assert_allclose(found.parameters, expected.parameters, rtol=1e-9)
    assert_allclose(found.covariance, expected.covariance, rtol=1e-4)


def test_unselected_estimates_are_preferred(oracle):
    known = make(oracle, "one", width=3)
    few = known.estimates.picked(terms=np.abs(known.estimates.harmonics) <= 1)
    model = replace(oracle.model_of(few, known.model), unselected=known.estimates)
    assert refine(model, ["c0"], RIGHT["one"]).degrees == refined(known, RIGHT["one"]).degrees
    assert refine(replace(model, unselected=None), ["c0"], RIGHT["one"]).degrees == 2 + 2 * 3 - 4 - 2


def test_progress_is_told(oracle):
    told = []
    refined(make(oracle, "one"), RIGHT["one"], report=told.append)
    assert "fitting the structured state matrix" in told


def test_a_model_without_estimates_is_refused(oracle):
    bare = replace(make(oracle, "one").model, coefficient_std=None)
    with pytest.raises(InputError, match=r"`model` of `refine` must have the joint covariance.*but has none"):
        refine(bare, ["c0"], RIGHT["one"])


@pytest.mark.parametrize("wrong", [1.0, 1.5, -0.1, np.nan])
def test_a_probability_that_is_none_is_refused(oracle, wrong):
    with pytest.raises(InputError, match="`refuse` of `refine` must be"):
        refined(make(oracle, "one"), RIGHT["one"], refuse=wrong)


@pytest.mark.parametrize("wrong", ["automatic", None, 2, Block()])
def test_what_is_no_structure_is_refused(oracle, wrong):
    words = "have blocks that begin with stiffness" if wrong == "automatic" else '`refine` must be "auto", a structure'
    with pytest.raises(InputError, match=words):
        refined(make(oracle, "one"), wrong)


def test_all_channels_are_exact_and_better_than_some(mixed):
    """The gains of the others are found too; that costs little beside what they say."""
    found = refine(mixed.model, "all", RIGHT["pairs"], times=7)
    swap = [int(name[1]) % 2 for name in found.state.states[:2]]
    order = np.ix_(range(7), [*swap, *(2 + i for i in swap)], [*swap, *(2 + i for i in swap)])
    assert_allclose(found.state.system, mixed.system.at(found.state.times)[order], atol=1e-8)
    few = refine(mixed.model, QUANTITIES["displacement"], RIGHT["pairs"], times=7)
    assert (found.state.system_std[:, 2:] < few.state.system_std[order][:, 2:]).all()


def test_a_channel_cannot_be_two_states(mixed):
    with pytest.raises(InputError, match="must name each channel once, but has 'c0' twice"):
        refine(mixed.model, ["c0+c2", "c1+c0"], RIGHT["pairs"])


def test_the_result_is_read_only_and_says_what_it_is(oracle):
    found = refined(make(oracle, "one"), RIGHT["one"])
    for name in ("parameters", "covariance", "exponents", "exponent_std"):
        assert not getattr(found, name).flags.writeable
    assert "stiffness with 1 harmonic; damping constant" in found.state.provenance.steps[-1]
    assert found.structure is RIGHT["one"]
    assert found.reasons == ()
    assert_array_equal(found.state.system_std[:, :1], 0.0)


# The slopes that everything rests on.


def perturbed(basis, parameters, mode, anchor, fundamental):
    found, jacobian = solved(basis.at(parameters), mode, anchor, fundamental)
    return found, jacobian


@pytest.mark.parametrize("structure", [
    SecondOrder(stiffness=TWO, damping=ONE),
    FirstOrder(system=Block(harmonics=1)),
])  # fmt: skip
def test_slopes_of_harmonic_balance_are_differences(structure):
    """Of λ and of every coefficient by every parameter, and by ω."""
    n = 2 if structure.degree == 2 else 3
    basis, generator = structure.basis(n), np.random.default_rng(3)
    parameters = 0.2 * generator.standard_normal(len(basis.names))
    start = (
        np.array([[14.0, 1.0], [1.0, 27.0]]) if n == 2 else np.array([[-0.1, 3.0, 0], [-3.0, -0.1, 0], [0, 0, -1.0]])
    )
    for i, j in np.ndindex(n, n):
        parameters[basis.names.index(f"{'stiffness' if n == 2 else 'system'}[{i},{j}]")] = start[i, j]
    width, omega = 8, 3.3
    still = basis.at(parameters)[:, basis.harmonics == 0][:, 0]
    companion = np.block([[np.zeros((n, n)), np.eye(n)], [still[0], still[1]]]) if n == 2 else still[0]
    values, vectors = np.linalg.eig(companion)
    upper = int(np.argmax(values.imag))
    shape = np.zeros((2 * width + 1, n), complex)
    shape[width] = vectors[:n, upper]
    anchor = shape / np.linalg.norm(shape)
    mode, jacobian = perturbed(basis, parameters, Mode(complex(values[upper]), anchor), anchor, omega)
    slopes = slopes_of(basis.matrices, basis.at(parameters), mode, jacobian, omega)
    for number in range(len(parameters) + 1):
        step = np.zeros(len(parameters) + 1)
        step[number] = 1e-6
        up, down = (
            perturbed(basis, parameters + sign * step[:-1], mode, anchor, omega + sign * step[-1])[0]
            for sign in (1.0, -1.0)
        )
        assert_allclose(slopes.exponent[number], (up.exponent - down.exponent) / 2e-6, atol=1e-7)
        assert_allclose(slopes.coefficients[number], (up.coefficients - down.coefficients) / 2e-6, atol=1e-7)


def test_a_mode_of_harmonic_balance_is_a_floquet_mode(oracle):
    """Exponent and shape of the blade's, a real multiplier with its own mirror image."""
    system = oracle.systems["blade"]
    basis = SecondOrder(stiffness=TWO, damping=ONE).basis(1)
    values = {"stiffness[0,0]": 1.0, "stiffness[0,0] cos 1": 0.6, "stiffness[0,0] sin 2": 0.135,
              "damping[0,0]": 1.5, "damping[0,0] sin 1": 0.6}  # fmt: skip
    parameters = np.array([values.get(name, 0.0) for name in basis.names])
    shape = np.zeros((25, 1), complex)
    shape[12], shape[11] = 1.0, 1.0
    found, _ = solved(basis.at(parameters), Mode(-0.9 + 0.5j, shape), shape / np.sqrt(2.0), 1.0)
    expected = floquet.exponents(system.oracle())
    assert np.abs(expected - found.exponent).min() < 1e-10
    assert found.exponent.imag == pytest.approx(0.5, abs=1e-12)


@pytest.mark.first(2)
@pytest.mark.parametrize("name", ["one", "blade", "pair and real"])
@pytest.mark.parametrize("free_period", [False, True])
def test_slopes_of_the_differences_are_differences(oracle, name, free_period):
    """Of every whitened number by every unknown: parameters, ω, amplitudes; delays and derivatives seen."""
    known = make(oracle, name, hits=2, free_period=free_period)
    own, half = known.estimates, known.system.half
    truth = refined(known, RIGHT[name])
    width = 8
    modes = []
    for mode in range(len(own.exponents)):
        rows = np.flatnonzero(known.model.modes_of(own) >= 0)[mode]
        shape = np.zeros((2 * width + 1, half), complex)
        inner = known.model.coefficients[known.model.modes_of(own)[rows], :, 0].T
        shape[known.model.harmonics + width] = inner
        modes.append(Mode(complex(own.exponents[mode]), shape / np.linalg.norm(shape)))
    seen = tuple(Seen(c, 1.3, p, d, c) for c, p, d in zip(range(half), (1, 0), (0.1, 0.0), strict=False))
    problem = problem_of(own, seen, RIGHT[name].basis(half), [mode.coefficients for mode in modes])
    here = at(problem, truth.parameters, None, own.fundamental, tuple(modes))
    n, omega = len(truth.parameters), int(free_period)
    pairs = np.flatnonzero(~own.real)
    for unknown in range(here.slopes.shape[1]):
        step = np.zeros(here.slopes.shape[1])
        step[unknown] = 1e-6
        move = step[n + omega :].reshape(2, -1)
        amplitudes = move[:, : len(own.exponents)].T.astype(complex)
        amplitudes[pairs] += 1j * move[:, len(own.exponents) :].T
        up, down = (
            at(problem, truth.parameters + sign * step[:n], here.amplitudes + sign * amplitudes,
               own.fundamental + sign * step[n] * omega, here.modes).rest
            for sign in (1.0, -1.0)
        )  # fmt: skip
        by = -(up - down) / 2e-6
        assert_allclose(here.slopes[:, unknown], by, rtol=1e-4, atol=1e-6 * np.abs(by).max())


# From records, through the whole chain.


def records_of(system, sensors, noise, n_cycles, n_phases, *, hits=1, seed=0, coloured=False, missing=False):
    """Free responses by transition matrices, each hit begun at another phase, and noise of a share of each channel."""
    generator, period = np.random.default_rng(seed), system.period
    step, found = period / n_phases, []
    outputs = np.array([one.sees for one in sensors])
    powers = np.array([one.derivative for one in sensors])

    def seen(times):
        matrix = system.at(times)
        whole = np.stack([np.broadcast_to(outputs, (len(times), *outputs.shape)), outputs @ matrix])
        return whole[powers, :, np.arange(len(powers))].swapaxes(0, 1)

    for hit in range(hits):
        first = hit % n_phases
        initial = np.concatenate([np.zeros(system.half), generator.uniform(0.5, 1.5, system.half)])
        values = free_response(
            system.matrix,
            seen,
            initial,
            period=period,
            n_periods=n_cycles,
            samples_per_period=n_phases,
            start=first * step,
        )
        rest = generator.standard_normal((len(values), values.shape[1] + 1))
        rest = (rest[:, 1:] + 0.6 * rest[:, :-1]) / np.hypot(1.0, 0.6) if coloured else rest[:, 1:]
        values = values + noise * np.abs(values).max(axis=1, keepdims=True) * rest
        if missing:
            values[:, 7:9] = np.nan
        quantities = ("displacement", "velocity")
        found.append(
            Record(
                values=values,
                sample_rate=1.0 / step,
                start=first * step,
                channels=[Channel(name=f"c{i}", quantity=quantities[p]) for i, p in enumerate(powers)],
                clock=ConstantPeriod(period=period),
            )
        )
    return found


CHAINS = {
    "lifted": ("pairs", {"n_cycles": 40}, {}),
    "few cycles": ("pairs", {"n_cycles": 14}, {}),
    "three hits at different phases": ("pairs", {"n_cycles": 25, "hits": 3}, {}),
    "as sampled": ("pairs", {"n_cycles": 30, "missing": True}, {}),
    "period estimated": ("pairs", {"n_cycles": 30, "noise": 0.002}, {"estimate_period": True}),
    "coloured noise": ("one", {"n_cycles": 60, "coloured": True}, {}),
    "growing": ("growing", {"n_cycles": 30}, {}),
    "one channel": ("one", {"n_cycles": 30}, {}),
    "positive real multipliers": ("slow", {"n_cycles": 30, "noise": 1e-3, "hits": 2}, {"order": 2}),
    "locked at half the fundamental": ("locked", {"n_cycles": 14, "noise": 1e-3}, {"order": 2}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHAINS)
def test_a_record_is_refined_within_its_errors(oracle, name):
    """The chi-square of what is left, that of the parameters' errors, and A(t), over draws of the noise."""
    case, made, options = CHAINS[name]
    slow = oracle.System.second_order([[[0.04]], [[0.012]], [[0.01]]], [[[0.6]]])
    system = slow if case == "slow" else oracle.systems[case]
    structure = RIGHT["one" if case == "slow" else case]
    sensors = oracle.displacements(system.half)
    clean = oracle.known(system, sensors, width=3)
    truth = refined(clean, structure, times=4)
    misfits, errors, degrees = 0.0, 0.0, 0
    for seed in range(2):
        records = records_of(system, sensors, **({"noise": 0.01, "n_phases": 16, "seed": seed} | made))
        model = identify(records, validate=False, **options).model
        found = refine(model, names(clean), structure, times=truth.state.times, refuse=0.0)
        off = found.parameters - truth.parameters
        errors += off @ np.linalg.solve(found.covariance, off)
        misfits, degrees = misfits + found.chi_square, degrees + found.degrees
        assert (np.abs(found.state.system - truth.state.system) <= 6.0 * found.state.system_std + 1e-12).all()
    assert chi2.sf(errors, 2 * len(truth.parameters)) > 1e-3
    assert chi2.sf(misfits, degrees) > 1e-3


def test_velocity_and_displacement_of_a_record_are_better_than_each(oracle):
    system = oracle.systems["pairs"]
    (record,) = records_of(system, oracle.displacements(2, (0, 1)), 0.01, 30, 16)
    model = identify(record, validate=False).model
    found = [refine(model, states, RIGHT["pairs"]) for states in (["c0+c2", "c1+c3"], ["c0", "c1"], ["c2", "c3"])]
    assert (found[0].std < np.minimum(found[1].std, found[2].std)).all()
    assert min(one.p_value for one in found) > 1e-3


def test_a_structure_is_taken_as_text():
    record = JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=11)
    model = identify(record, validate=False).model
    text = refine(model, ["X", "Y"], "stiffness 1 symmetric; damping 0")
    given = SecondOrder(stiffness=Block(harmonics=1, symmetry="symmetric"), damping=Block(harmonics=0))
    assert_allclose(text.parameters, refine(model, ["X", "Y"], given).parameters)
    with pytest.raises(InputError, match="structure"):
        refine(model, ["X", "Y"], "stiffness of two")
