"""A structure as a line of text: what it means, that it comes back, and what is refused."""

import itertools

import pytest

from floquid.errors import InputError
from floquid.reconstruction import AbstractStructure, Block, FirstOrder, SecondOrder, structure_of, text_of

MEANT = {
    "stiffness 2": SecondOrder(stiffness=Block(harmonics=2)),
    "stiffness 2 symmetric; damping 0": SecondOrder(stiffness=Block(harmonics=2, symmetry="symmetric")),
    "stiffness 0 none; damping 1 diagonal": SecondOrder(
        stiffness=Block(), damping=Block(harmonics=1, symmetry="diagonal")
    ),
    "stiffness 1; damping 0 symmetric; gyroscopic 0": SecondOrder(
        stiffness=Block(harmonics=1), damping=Block(symmetry="symmetric"), gyroscopic=Block(symmetry="skew")
    ),
    "gyroscopic 2 skew known 0,1=-1e-3; damping 0 diagonal; stiffness 1": SecondOrder(
        stiffness=Block(harmonics=1),
        damping=Block(symmetry="diagonal"),
        gyroscopic=Block(harmonics=2, symmetry="skew", known={(0, 1): -1e-3}),
    ),
    "system 2": FirstOrder(system=Block(harmonics=2)),
    "system 11 known 0,0=0 1,12=.5": FirstOrder(system=Block(harmonics=11, known={(0, 0): 0.0, (1, 12): 0.5})),
    " stiffness  3 ;damping 0   known 0,1=0 1,0=0 ": SecondOrder(
        stiffness=Block(harmonics=3), damping=Block(known={(0, 1): 0.0, (1, 0): 0.0})
    ),
}


@pytest.mark.parametrize("text", MEANT)
def test_what_a_text_means(text):
    assert structure_of(text) == MEANT[text]


@pytest.mark.parametrize("text", MEANT)
def test_one_line_for_one_structure(text):
    """However it was typed, it is kept in one way, which means the same."""
    once = text_of(structure_of(text))
    assert structure_of(once) == MEANT[text]
    assert text_of(structure_of(once)) == once


def test_every_structure_comes_back_exactly():
    blocks = [
        Block(harmonics=h, symmetry=symmetry, known=known)
        for h, symmetry, known in itertools.product(
            (0, 12), ("none", "symmetric", "diagonal"), ({}, {(1, 0): 0.1 + 0.2, (0, 1): 5e-324, (10, 2): -1e300})
        )
    ]
    structures = [FirstOrder(system=block) for block in blocks]
    for stiffness, damping in itertools.product(blocks, blocks):
        structures.append(SecondOrder(stiffness=stiffness, damping=damping))
        if damping.symmetry != "none":
            gyroscopic = Block(harmonics=1, symmetry="skew", known=stiffness.known)
            structures.append(SecondOrder(stiffness=stiffness, damping=damping, gyroscopic=gyroscopic))
    texts = [text_of(structure) for structure in structures]
    assert [structure_of(text) for text in texts] == structures
    assert len(set(texts)) == len(structures)


def test_auto_is_to_be_found():
    assert structure_of(" auto ") == text_of("auto") == "auto"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "say a structure, but is ''"),
        (None, "say a structure, but is None"),
        ("mass 2", "begin with stiffness, damping, gyroscopic, system, but has 'mass'"),
        ("stiffness 2;", "but has an empty one"),
        ("stiffness", "how many harmonics a block has, 0 for a constant one, but has 'stiffness'"),
        ("stiffness two", "how many harmonics"),
        ("stiffness -1", "how many harmonics"),
        ("stiffness 2 symetric; damping 0", "none, symmetric, skew, diagonal, .* but has 'stiffness 2 symetric'"),
        ("stiffness 2 symmetric skew", "or with known and elements"),
        ("stiffness 2 known", "or with known and elements"),
        ("stiffness 2; stiffness 1", "each block once, but says stiffness twice"),
        ("damping 0", "say the stiffness, but says damping alone"),
        ("stiffness 1; system 1", "of first order .system alone., but says stiffness, system"),
        ("stiffness 1 known 0=1", "row,column=value"),
        ("stiffness 1 known 0,1", "row,column=value"),
        ("stiffness 1 known 0,-1=2", "row,column=value"),
        ("stiffness 1 known 0,1 =2", "row,column=value"),
        ("stiffness 1 known 0,1=x", "row,column=value"),
        ("stiffness 1 known 0,1=0 0,1=1", "each known element once"),
    ],
)
def test_what_says_no_structure_is_refused(text, words):
    with pytest.raises(InputError, match=rf"^Argument `text` of `structure_of` must .*{words}") as caught:
        structure_of(text)
    assert str(caught.value).split("\n  ")[1].startswith('Write e.g. "auto"')


def test_what_no_structure_can_be_is_refused_as_by_the_structure_itself():
    with pytest.raises(InputError, match="Argument `damping` of `SecondOrder`"):
        structure_of("stiffness 1; gyroscopic 0")
    with pytest.raises(InputError, match="Argument `known` of `Block` must be a finite number"):
        structure_of("stiffness 1 known 0,1=nan")


def test_another_structure_has_no_text():
    class Other(AbstractStructure):
        blocks = degree = sign = less_symmetric = None

    for wrong in (Other(), "stiffness 1", None):
        with pytest.raises(InputError, match="Argument `structure` of `text_of` must be SecondOrder, FirstOrder"):
            text_of(wrong)
