"""Structures: which elements there are, that they are affine in their parameters, and the one that is found.

The equation of motion is written out here by loops.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.errors import IdentificationError, InputError
from floquid.reconstruction import Block, FirstOrder, SecondOrder, refine
from floquid.reconstruction._inference import hidden_share
from floquid.reconstruction._invariance import _tried
from floquid.reconstruction._refine import _Fit

N = 3
COUNTS = {"none": 9, "symmetric": 6, "skew": 3, "diagonal": 3}


@pytest.mark.parametrize("symmetry", COUNTS)
def test_elements_of_a_symmetry(symmetry):
    """Every matrix that they make has the symmetry, and there are as many as it has numbers."""
    elements, generator = Block(symmetry=symmetry).elements(N), np.random.default_rng(0)
    assert len(elements) == COUNTS[symmetry]
    matrix = np.zeros((N, N))
    for places in elements:
        value = generator.standard_normal()
        for i, j, sign in places:
            matrix[i, j] += sign * value
    expected = {
        "none": matrix,
        "symmetric": matrix.T,
        "skew": -matrix.T,
        "diagonal": np.diag(np.diag(matrix)),
    }[symmetry]
    assert_array_equal(matrix, expected)
    assert (np.abs(matrix) > 0).sum() == {"none": 9, "symmetric": 9, "skew": 6, "diagonal": 3}[symmetry]


@pytest.mark.parametrize(
    ("symmetry", "place", "mirror"),
    [("none", (0, 1), None), ("symmetric", (1, 0), 0.7), ("skew", (1, 0), -0.7), ("diagonal", (1, 1), None)],
)
def test_known_elements_are_taken_out_with_their_mirror_images(symmetry, place, mirror):
    block = Block(symmetry=symmetry, known={place: 0.7})
    assert len(block.elements(N)) == COUNTS[symmetry] - 1
    expected = np.zeros((N, N))
    expected[place] = 0.7
    if mirror is not None:
        expected[place[::-1]] = mirror
    assert_array_equal(block.constant(N), expected)
    for places in block.elements(N):
        assert place not in {(i, j) for i, j, _ in places}
        assert mirror is None or place[::-1] not in {(i, j) for i, j, _ in places}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"harmonics": -1}, "`harmonics` of `Block`"),
        ({"harmonics": 1.5}, "`harmonics` of `Block`"),
        ({"symmetry": "hermitian"}, "`symmetry` of `Block` must be one of"),
        ({"known": {0: 1.0}}, "`known` of `Block` must have pairs"),
        ({"known": {(0, 1, 2): 1.0}}, "`known` of `Block` must have pairs"),
        ({"known": {(0, -1): 1.0}}, "`known` of `Block`"),
        ({"known": {(0, 0): np.nan}}, "`known` of `Block` must be a finite number"),
    ],
)
def test_blocks_that_cannot_be_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        Block(**options)


def test_a_known_element_outside_the_block_is_refused():
    with pytest.raises(InputError, match=r"must name elements of a block of 2 rows and columns, but has \(0, 2\)"):
        SecondOrder(stiffness=Block(known={(0, 2): 1.0})).basis(2)


def test_a_gyroscopic_block_is_skew_and_stands_beside_one_that_is_not():
    with pytest.raises(InputError, match="`gyroscopic` of `SecondOrder` must be skew"):
        SecondOrder(damping=Block(symmetry="symmetric"), gyroscopic=Block())
    for symmetry in ("none", "skew"):
        with pytest.raises(InputError, match="`damping` of `SecondOrder` must be symmetric or diagonal"):
            SecondOrder(damping=Block(symmetry=symmetry), gyroscopic=Block(symmetry="skew"))
    SecondOrder(damping=Block(symmetry="diagonal"), gyroscopic=Block(symmetry="skew"))


STRUCTURES = {
    "second order": SecondOrder(
        stiffness=Block(harmonics=2, symmetry="symmetric", known={(0, 1): -0.4}), damping=Block(harmonics=1)
    ),
    "gyroscopic": SecondOrder(
        stiffness=Block(harmonics=1),
        damping=Block(symmetry="diagonal", known={(1, 1): 0.2}),
        gyroscopic=Block(harmonics=1, symmetry="skew"),
    ),
    "first order": FirstOrder(system=Block(harmonics=2, known={(0, 0): 0.3})),
}


def written_out(structure, values: dict[str, float], turn: float) -> np.ndarray:
    """A at one angle, element by element from the names of the parameters."""
    second = isinstance(structure, SecondOrder)
    blocks = {name: np.zeros((N, N)) for name in ("stiffness", "damping", "gyroscopic", "system")}
    for name, block, _ in structure.blocks():
        for (i, j), value in block.known.items():
            blocks[name][i, j] = value
            if block.symmetry in ("symmetric", "skew"):
                blocks[name][j, i] = value if block.symmetry == "symmetric" else -value
        for key, value in values.items():
            head, _, wave = key.partition("]")
            if not head.startswith(name):
                continue
            i, j = (int(one) for one in head.split("[")[1].split(","))
            size = value
            if wave:
                kind, k = wave.split()
                size *= {"cos": np.cos, "sin": np.sin}[kind](int(k) * turn)
            blocks[name][i, j] += size
            if i != j and block.symmetry == "symmetric":
                blocks[name][j, i] += size
            if i != j and block.symmetry == "skew":
                blocks[name][j, i] -= size
    if not second:
        return blocks["system"]
    whole = np.zeros((2 * N, 2 * N))
    whole[:N, N:] = np.eye(N)
    whole[N:, :N] = -blocks["stiffness"]
    whole[N:, N:] = -blocks["damping"] - blocks["gyroscopic"]
    return whole


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_basis_is_the_equation_of_motion(name):
    structure, turns = STRUCTURES[name], np.array([0.0, 0.4, 2.9])
    basis = structure.basis(N)
    assert len(set(basis.names)) == len(basis.names) == len(basis.matrices)
    parameters = np.random.default_rng(1).standard_normal(len(basis.names))
    values = dict(zip(basis.names, parameters, strict=True))
    known, slopes = basis.in_time(turns)
    found = known + np.tensordot(parameters, slopes, 1)
    assert_allclose(found, [written_out(structure, values, turn) for turn in turns], atol=1e-14)
    # The same by its Fourier coefficients, which are those of a real matrix.
    lines = basis.at(parameters)
    assert_allclose(lines[:, ::-1].conj(), lines, atol=1e-15)
    waves = np.exp(1j * np.multiply.outer(turns, basis.harmonics))
    rows = found[:, -N:].reshape(len(turns), N, structure.degree, N)
    assert_allclose(np.einsum("tk,pkij->tipj", waves, lines), rows, atol=1e-14)


TURNING = SecondOrder(
    damping=Block(symmetry="symmetric", known={(0, 1): 0.1, (2, 2): 0.4}),
    gyroscopic=Block(harmonics=1, symmetry="skew"),
)
"""Its gyroscopic block has more harmonics than its damping, and an element where that is known."""


def numbers(structure) -> int:
    return len(structure.basis(N).names)


@pytest.mark.parametrize(
    "structure",
    [
        *STRUCTURES.values(),
        SecondOrder(stiffness=Block(symmetry="symmetric"), damping=Block(symmetry="symmetric")),
        TURNING,
    ],
    ids=[*STRUCTURES, "symmetric", "turning"],
)
def test_wider_structures_hold_the_one_they_widen(structure):
    """More parameters, and every A(t) of the narrower one is one of the wider."""
    turns = np.linspace(0.0, 6.0, 11)
    parameters = np.random.default_rng(2).standard_normal(numbers(structure))
    known, slopes = structure.basis(N).in_time(turns)
    target = (known + np.tensordot(parameters, slopes, 1)).ravel()
    hiding = [one for ways in structure.hiding() for one in ways]
    for ways in (structure.wider(), hiding):
        assert len({words for words, _ in ways}) == len(ways)
    for _, other in [*structure.wider(), *hiding]:
        assert numbers(other) > numbers(structure)
        known, slopes = other.basis(N).in_time(turns)
        flat = slopes.reshape(len(slopes), -1).T
        found = np.linalg.lstsq(flat, target - known.ravel(), rcond=None)[0]
        assert_allclose(known.ravel() + flat @ found, target, atol=1e-10)


def test_the_words_of_a_structure():
    assert STRUCTURES["second order"].words() == (
        "symmetric stiffness with 2 harmonics, 1 elements known; damping with 1 harmonic"
    )
    assert SecondOrder().words() == "stiffness with 2 harmonics; damping constant"
    assert FirstOrder().words() == "system with 2 harmonics"


# The structure that is found.


WAVES = Block(harmonics=1, symmetry="symmetric")
FOUND = {
    "pairs": SecondOrder(stiffness=WAVES, damping=Block()),
    "one": SecondOrder(stiffness=replace(WAVES)),
    "locked": SecondOrder(stiffness=WAVES),
    "blade": SecondOrder(stiffness=replace(WAVES, harmonics=2), damping=Block(harmonics=1)),
}


def found_in(oracle, name, seed, **options):
    system = oracle.systems[name]
    known = oracle.known(system, oracle.displacements(system.half), width=2, **options)
    states = [channel.name for channel in known.model.channels]
    return known, refine(known.drawn(np.random.default_rng(seed)), states, times=5)


@pytest.mark.first(2)
@pytest.mark.parametrize("name", ["one", "locked", "blade"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_right_structure_is_found(oracle, name, seed):
    _, found = found_in(oracle, name, seed)
    assert found.structure == FOUND[name]
    assert found.reasons[0] == f"Structure found: {FOUND[name].words()}."


@pytest.mark.slow
def test_the_right_structure_of_two_displacements_is_found(oracle):
    known, found = found_in(oracle, "pairs", 0)
    assert found.structure == FOUND["pairs"]
    assert_allclose(found.state.system, known.system.at(found.state.times), atol=1e-3)


@pytest.mark.slow
def test_an_unsymmetric_stiffness_is_found(oracle):
    system = oracle.System.second_order([[[14.0, 3.2], [2.8, 29.0]]], [[[0.2, 0.0], [0.0, 0.3]]])
    known = oracle.known(system, oracle.displacements(2), width=1)
    found = refine(known.drawn(np.random.default_rng(0)), ["c0", "c1"], times=3)
    assert found.structure == SecondOrder(stiffness=Block(), damping=Block())
    assert "Stiffness that is not symmetric: chi-square from" in found.reasons[1]


def test_a_constant_system_is_found_to_be_one(oracle):
    system = oracle.System.second_order([[[14.0, 3.0], [3.0, 29.0]]], [[[0.2, 0.9], [-0.9, 0.3]]])
    known = oracle.known(system, oracle.displacements(2), width=1)
    found = refine(known.drawn(np.random.default_rng(0)), ["c0", "c1"], times=3)
    assert found.structure == SecondOrder(stiffness=Block(symmetry="symmetric"), damping=Block())
    assert found.reasons[0] == f"Structure found: {found.structure.words()}."
    tested = ("stiffness with 1 harmonic and damping with 1 harmonic", 14), ("stiffness that is not symmetric", 1)
    assert tuple((own.numbers["name"], own.numbers["more"]) for own in found.findings[1:]) == tested
    assert {own.code for own in found.findings[1:]} == {"structure_tested"}
    assert found.conditional_on == ()


# What a structure that is found could hide.


def small(oracle, size):
    """A damping that swings by so much, which is left out at 2e-5 and seen at 1e-4."""
    system = oracle.System.second_order([[[14.0]], [[3.0]], [[1.0]]], [[[0.3]], [[size]], [[0.5 * size]]])
    return oracle.known(system, oracle.displacements(1), width=2)


def pulls(known, structure="auto", seeds=range(16)):
    """Errors of A(t) over their deviations, and the structures (seeds,)."""
    found = [refine(known.drawn(np.random.default_rng(seed)), ["c0"], structure, times=8) for seed in seeds]
    off = [(own.state.system - known.system.at(own.state.times))[:, 1] / own.state.system_std[:, 1] for own in found]
    return np.abs(off), [own.structure for own in found]


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-5, 2e-5, 1e-4])
def test_deviations_hold_where_a_small_damping_is_left_out(oracle, size):
    """Given as constant, which it is not, its intervals hold the truth in less than two thirds."""
    known = small(oracle, size)
    off, structures = pulls(known)
    assert np.mean(off < 1.96) > 0.85
    assert off.max() < 4.5
    narrow = SecondOrder(stiffness=WAVES, damping=Block())
    assert sum(own == narrow for own in structures) > 12 if size < 1e-4 else narrow not in structures
    if size < 1e-4:
        assert np.mean(pulls(known, narrow)[0] < 1.96) < 0.66


def test_little_is_hidden_by_a_structure_that_is_right(oracle):
    """The deviations lie between those of the structure itself and those of all that is wider, given."""
    known = small(oracle, 0.0)
    structure = SecondOrder(stiffness=WAVES, damping=Block())
    wide = SecondOrder(stiffness=Block(harmonics=2), damping=Block(harmonics=1))
    model = known.drawn(np.random.default_rng(3))
    found, given, most = (refine(model, ["c0"], own, times=8) for own in ("auto", structure, wide))
    assert found.structure == structure
    assert_allclose(found.parameters, given.parameters, rtol=1e-6)
    for name in ("system_std", "transition_std"):
        own, least, largest = (getattr(each.state, name)[1:, 1] for each in (found, given, most))
        assert (own > least).all()
        assert own.mean() < largest.mean()
    assert (found.state.system_std[:, 1, 1] < 0.8 * most.state.system_std[:, 1, 1]).all()
    assert (found.std > given.std).all()
    assert (found.exponent_std.real >= given.exponent_std.real).all()
    assert given.conditional_on == (structure.words(),)


@pytest.mark.first(1)
@pytest.mark.parametrize("options", [{"free_period": True}, {"hits": 2}])
def test_gains_and_an_estimated_period_have_their_place_in_what_is_hidden(oracle, options):
    """With all channels, as with those of the states: same parameters, larger deviations, and errors within them."""
    sensors = [*oracle.displacements(1), oracle.Sensor((0.6, 0.0)), oracle.Sensor((-1.3, 0.0))]
    known = oracle.known(oracle.systems["one"], sensors, width=2, **options)
    model = known.drawn(np.random.default_rng(1))
    found = refine(model, "all", times=8)
    given = refine(model, "all", found.structure, times=8)
    assert_allclose(found.parameters, given.parameters, rtol=1e-9)
    assert len(found.names) == 6
    assert (found.std >= given.std).all()
    assert (found.std[:4] > 1.001 * given.std[:4]).all()
    sees = {"c0": 1.0, "c1": 0.6, "c2": -1.3}
    pairs = [name.split(" per ") for name in found.names[4:]]
    truth = [sees[channel] / sees[state] for channel, state in pairs]
    assert (np.abs(found.parameters[4:] - truth) < 5.0 * found.std[4:]).all()


def test_deviations_are_those_of_the_wider_structure_where_it_is_far_from_none():
    """Weights of the shares of noise: none of a gain of nothing is far from B = 1, of a large one all is at zero."""
    for more in (1, 2, 12):
        left = [hidden_share(gain, more)[0] for gain in (0.0, 1.0 * more, 10.0 * more, 1e4 * more)]
        # The mean of 1 - B of the density B^((n - 1)/2) is 2/(n + 3).
        assert left[0] == pytest.approx(2.0 / (more + 3), abs=1e-3)
        assert left == sorted(left)
        assert left[-1] > 0.999


@pytest.mark.slow
def test_what_a_record_does_not_tell_is_said_to_be_taken_for_granted(oracle):
    """Of a response without a harmonic beside the mode's own, none tells a small stiffness that swings from none."""
    known = oracle.known(oracle.System.second_order([[[14.0]]], [[[0.3]]]), oracle.displacements(1), width=0)
    found = refine(known.drawn(np.random.default_rng(0)), ["c0"], times=3)
    assert found.structure == SecondOrder(stiffness=Block(symmetry="symmetric"), damping=Block())
    assert found.conditional_on == ("no stiffness with 1 harmonic and damping with 1 harmonic",)
    words = "This record cannot tell stiffness with 1 harmonic and damping with 1 harmonic from none: the deviations"
    assert words in found.reasons[1]


def test_a_wider_fit_that_goes_astray_is_made_again_from_the_narrower(oracle):
    """It leaves no more than the structure within it."""
    known = oracle.known(oracle.systems["one"], oracle.displacements(1), width=2)
    model = known.drawn(np.random.default_rng(0))
    fit = _Fit.made(model, ["c0"], 2, model.estimates)
    right = fit.at(FOUND["one"], None)
    wide = replace(FOUND["one"], damping=Block(harmonics=1))

    def astray(structure, near):
        """A fit from the free model that ends elsewhere."""
        point, basis = fit.at(structure, near)
        return (point if near else replace(point, rest=10.0 * point.rest)), basis

    trial = _tried(astray, wide, right)
    assert trial[0].cost <= right[0].cost < astray(wide, None)[0].cost


def test_nothing_found_is_told(oracle):
    """Channels whose gains turn with the period at many harmonics: no second-order form of few."""
    known = oracle.known(oracle.systems["one"], oracle.displacements(1), width=0)
    own = known.estimates
    blind = replace(own, coefficients=0.0 * own.coefficients + 1.0, spread=own.spread * 1e30)
    with pytest.raises(IdentificationError, match=r"does not determine|No second-order form"):
        refine(oracle.model_of(blind, known.model), ["c0"], SecondOrder(stiffness=Block(harmonics=3)))
