"""Structures: which elements there are, that they are affine in their parameters, and the one that is found.

The equation of motion is written out here by loops.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.errors import IdentificationError, InputError
from floquid.reconstruction import Block, FirstOrder, SecondOrder, refine

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
    wider = structure.wider()
    assert len({words for words, _ in wider}) == len(wider)
    for _, other in wider:
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


@pytest.mark.first(4)
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", ["one", "locked", "blade"])
def test_the_right_structure_is_found(oracle, name, seed):
    _, found = found_in(oracle, name, seed)
    assert found.structure == FOUND[name]
    assert found.reasons[0] == f"Structure found: {FOUND[name].words()}."


def test_the_right_structure_of_two_displacements_is_found(oracle):
    known, found = found_in(oracle, "pairs", 0)
    assert found.structure == FOUND["pairs"]
    assert_allclose(found.state.system, known.system.at(found.state.times), atol=1e-3)


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
    assert found.reasons == (f"Structure found: {found.structure.words()}.",)


def test_nothing_found_is_told(oracle):
    """Channels whose gains turn with the period at many harmonics: no second-order form of few."""
    known = oracle.known(oracle.systems["one"], oracle.displacements(1), width=0)
    own = known.estimates
    blind = replace(own, coefficients=0.0 * own.coefficients + 1.0, spread=own.spread * 1e30)
    with pytest.raises(IdentificationError, match=r"does not determine|No second-order form"):
        refine(oracle.model_of(blind, known.model), ["c0"], SecondOrder(stiffness=Block(harmonics=3)))
