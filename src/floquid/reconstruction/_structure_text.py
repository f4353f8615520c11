"""Structures as a line of text, for the command line and for files: `stiffness 2 symmetric; damping 0`."""

from __future__ import annotations

from typing import Literal, get_args

from floquid._checks import input_error
from floquid.reconstruction._structure import AbstractStructure, Block, FirstOrder, SecondOrder, Symmetry

OF = "structure_of"

AUTO: Literal["auto"] = "auto"

EXAMPLES = 'Write e.g. "auto", "stiffness 2 symmetric; damping 0", "system 2", or "... damping 0 known 0,1=0 1,0=0".'

SECOND = ("stiffness", "damping", "gyroscopic")
FIRST = ("system",)


def structure_of(text: str) -> AbstractStructure | Literal["auto"]:
    r"""The structure that a text says.

    .. math:: \text{text} = \text{"auto"} \;|\; \text{block}\,(\text{"; "}\ \text{block})^*, \qquad
              \text{block} = \text{name}\ H\ [\text{symmetry}]\ [\text{"known"}\ (i\text{","}j\text{"="}value)^+]

    Returns `SecondOrder` or `FirstOrder`; "auto" for the one that the data do not contradict. A block of the text is
    its name (stiffness, damping and gyroscopic, or system alone for first order), the number of its harmonics, its
    symmetry (none, symmetric, skew, diagonal; none when left out, gyroscopic is always skew) and its known elements,
    rows and columns from zero: "stiffness 1 symmetric; damping 0 known 0,1=0 1,0=0". Without damping there is a
    constant one; "damping 0 diagonal known 0,0=0 1,1=0" says that there is none.

    Raises InputError where the text says no structure.
    """
    if not isinstance(text, str) or not text.strip():
        raise input_error("text", OF, "say a structure", f"is {text!r:.60}", EXAMPLES)
    if text.strip() == AUTO:
        return AUTO
    blocks: dict[str, Block] = {}
    for clause in text.split(";"):
        name, block = _block(clause)
        if name in blocks:
            raise input_error("text", OF, "say each block once", f"says {name} twice", EXAMPLES)
        blocks[name] = block
    if set(blocks) == set(FIRST):
        return FirstOrder(system=blocks["system"])
    if not set(blocks) <= set(SECOND):
        must = "be of second order (stiffness, damping, gyroscopic) or of first order (system alone)"
        raise input_error("text", OF, must, f"says {', '.join(blocks)}", EXAMPLES)
    if "stiffness" not in blocks:
        raise input_error("text", OF, "say the stiffness", f"says {', '.join(blocks)} alone", EXAMPLES)
    return SecondOrder(**blocks)


def text_of(structure: AbstractStructure | str) -> str:
    """The text of a structure, one line, which `structure_of` reads back to the same structure.

    Raises InputError where the structure is neither `SecondOrder` nor `FirstOrder` nor "auto".
    """
    if isinstance(structure, str) and structure == AUTO:
        return AUTO
    if not isinstance(structure, (SecondOrder, FirstOrder)):
        must, got = 'be SecondOrder, FirstOrder or "auto"', f"is {structure!r:.60}"
        raise input_error("structure", "text_of", must, got)
    return "; ".join(_clause(name, block) for name, block, _ in structure.blocks())


def _clause(name: str, block: Block) -> str:
    words = [name, str(int(block.harmonics))]
    if block.symmetry != ("skew" if name == "gyroscopic" else "none"):
        words.append(block.symmetry)
    if block.known:
        words.append("known")
        # repr, since that of a float is read back as the same float.
        words += [f"{i},{j}={float(value)!r}" for (i, j), value in sorted(block.known.items())]
    return " ".join(words)


def _block(clause: str) -> tuple[str, Block]:
    """One block and its name."""
    words = clause.split()
    names = (*SECOND, *FIRST)
    if not words or words[0] not in names:
        got = f"has {words[0]!r}" if words else "has an empty one"
        raise input_error("text", OF, f"have blocks that begin with {', '.join(names)}", got, EXAMPLES)
    name, rest = words[0], words[1:]
    if not rest or not rest[0].isdecimal():
        got = f"has {clause.strip()!r}"
        raise input_error("text", OF, "say how many harmonics a block has, 0 for a constant one", got, EXAMPLES)
    harmonics, rest = int(rest[0]), rest[1:]
    symmetry: Symmetry = "skew" if name == "gyroscopic" else "none"
    if rest and rest[0] in get_args(Symmetry):
        symmetry, rest = rest[0], rest[1:]  # type: ignore[assignment]
    if not rest:
        return name, Block(harmonics=harmonics, symmetry=symmetry)
    if rest[0] != "known" or len(rest) == 1:
        must = f"go on with one of {', '.join(get_args(Symmetry))}, or with known and elements, after the harmonics"
        raise input_error("text", OF, must, f"has {clause.strip()!r}", EXAMPLES)
    known: dict[tuple[int, int], float] = {}
    for word in rest[1:]:
        place, value = _element(word)
        if place in known:
            raise input_error("text", OF, "say each known element once", f"has {clause.strip()!r}", EXAMPLES)
        known[place] = value
    return name, Block(harmonics=harmonics, symmetry=symmetry, known=known)


def _element(word: str) -> tuple[tuple[int, int], float]:
    """A known element: 0,1=0.5."""
    place, _, value = word.partition("=")
    row, _, column = place.partition(",")
    try:
        if not (row.isdecimal() and column.isdecimal()):
            raise ValueError
        return (int(row), int(column)), float(value)
    except ValueError:
        must = "give known elements as row,column=value without blanks, rows and columns from zero"
        raise input_error("text", OF, must, f"has {word!r}", EXAMPLES) from None
