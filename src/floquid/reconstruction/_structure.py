"""The known form of a state matrix (its elements, their harmonics, which are equal), and that as a line of text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, get_args

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, counted, finite, input_error, integer, wrong_value
from floquid._show import Brief

Symmetry = Literal["none", "symmetric", "skew", "diagonal"]

HIDDEN = 2  # harmonics of a block that a structure may hide: a series often has every second one alone


@dataclass(frozen=True, slots=True, kw_only=True)
class Block(Rebuilt):
    r"""One block of a state matrix, a matrix that is periodic in time.

    .. math:: M(t) = M_0 + \sum_{k=1}^{H} M_k^c \cos k\omega t + M_k^s \sin k\omega t

    Raises InputError where a value is not possible.

    Parameters
    ----------
    harmonics
        H; zero for a constant block.
    symmetry
        "none"; "symmetric", M = Mᵀ; "skew", M = -Mᵀ; "diagonal".
    known
        Elements that are known to be constant, and their values, by row and column from zero: {(0, 1): 0.0}. With a
        symmetry, their mirror images are known too.
    """

    harmonics: int = 0
    symmetry: Symmetry = "none"
    known: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        integer(self.harmonics, "harmonics", "Block", at_least=0)
        if self.symmetry not in get_args(Symmetry):
            words = ", ".join(f'"{one}"' for one in get_args(Symmetry))
            raise wrong_value("symmetry", "Block", f"be one of {words}", self.symmetry)
        for place, value in self.known.items():
            if not (isinstance(place, tuple) and len(place) == 2):
                got = f"has the key {place!r}"
                raise input_error("known", "Block", "have pairs (row, column) as keys", got, "Pass e.g. {(0, 1): 0.0}.")
            for index in place:
                integer(index, "known", "Block", at_least=0)
            finite(value, "known", "Block")

    def elements(self, n: int) -> list[list[tuple[int, int, float]]]:
        """The unknown elements of a block of n rows: each the places that share it, with signs."""
        found = []
        for i in range(n):
            for j in range(n):
                if (i, j) in self._fixed(n):
                    continue
                if self.symmetry == "none" or (self.symmetry != "skew" and i == j):
                    found.append([(i, j, 1.0)])
                elif self.symmetry in ("symmetric", "skew") and i < j:
                    found.append([(i, j, 1.0), (j, i, 1.0 if self.symmetry == "symmetric" else -1.0)])
        return found

    def constant(self, n: int) -> Floats:
        """The known elements (n, n)."""
        matrix = np.zeros((n, n))
        for (i, j), value in self._fixed(n).items():
            matrix[i, j] = value
        return matrix

    def _fixed(self, n: int) -> dict[tuple[int, int], float]:
        found = {}
        for (i, j), value in self.known.items():
            if max(i, j) >= n:
                must, got = f"name elements of a block of {n} rows and columns", f"has ({i}, {j})"
                raise input_error("known", "Block", must, got, "Rows and columns count from zero.")
            found[i, j] = float(value)
            if self.symmetry in ("symmetric", "skew"):
                found[j, i] = float(value) if self.symmetry == "symmetric" else -float(value)
        return found


@dataclass(frozen=True, slots=True)
class Basis:
    r"""The coefficient matrices of the equation of motion, affine in the parameters.

    .. math:: x^{(d)} = \sum_{p<d} A^{(p)}(t)\, x^{(p)}, \qquad
              A^{(p)}(t) = \sum_k \Big(A^{(p)}_{0,k} + \sum_j \theta_j E^{(p)}_{j,k}\Big) e^{ik\omega t}
    """

    matrices: Complexes  # E (parameters, d, harmonics, n, n), k from -H to H
    known: Complexes  # (d, harmonics, n, n)
    names: tuple[str, ...]  # the meaning of each parameter

    @property
    def harmonics(self) -> Integers:
        """K (harmonics,)."""
        most = self.known.shape[1] // 2
        return np.arange(-most, most + 1)

    @property
    def degree(self) -> int:
        """The order d of the highest derivative."""
        return self.known.shape[0]

    def at(self, parameters: Floats) -> Complexes:
        """The coefficient matrices (d, harmonics, n, n)."""
        return self.known + np.tensordot(parameters, self.matrices, axes=1)

    def in_time(self, turns: Floats) -> tuple[Floats, Floats]:
        """The state matrix with no parameter, and its slopes, at these angles ωt."""
        phases = np.exp(1j * np.multiply.outer(turns, self.harmonics))
        d, n = self.degree, self.known.shape[-1]
        whole, slopes = np.zeros((len(turns), d * n, d * n)), np.zeros((len(self.names), len(turns), d * n, d * n))
        for p in range(d):
            if p:
                whole[:, (p - 1) * n : p * n, p * n : (p + 1) * n] = np.eye(n)
            place = np.s_[..., (d - 1) * n :, p * n : (p + 1) * n]
            whole[place] = np.einsum("tk,kij->tij", phases, self.known[p]).real
            slopes[place] = np.einsum("tk,qkij->qtij", phases, self.matrices[:, p]).real
        return whole, slopes


class AbstractStructure(ABC):
    """The form of an equation of motion."""

    degree: ClassVar[int]
    """The order of the highest derivative of the states."""
    sign: ClassVar[float]
    """The factor of the blocks on the right-hand side."""

    @abstractmethod
    def blocks(self) -> tuple[tuple[str, Block, int], ...]:
        """Each block with its name and the derivative of the states that it multiplies."""

    @abstractmethod
    def less_symmetric(self) -> list[tuple[str, AbstractStructure]]:
        """Structures that hold this one and have one symmetry less, with a word for each."""

    def wider(self) -> list[tuple[str, AbstractStructure]]:
        """Structures that hold this one and a little more: harmonics of a block, or one symmetry less.

        Two harmonics at once, too: an orbit of even harmonics has none in between.
        """
        blocks = [name for name, _, _ in self.blocks()]
        return [self._longer([name], more) for more in (1, HIDDEN) for name in blocks] + self.less_symmetric()

    def hiding(self) -> list[list[tuple[str, AbstractStructure]]]:
        """Structures that hold this one and what it may hide: harmonics of every block, or one symmetry less.

        Of all blocks at once: where the inertia varies, what stiffness and damping leave out goes together. Where a
        record does not determine the first of several, the next one is meant.
        """
        every = [name for name, _, _ in self.blocks()]
        return [[self._longer(every, more) for more in (HIDDEN, 1)], *([one] for one in self.less_symmetric())]

    def _longer(self, names: Sequence[str], more: int) -> tuple[str, AbstractStructure]:
        """Some blocks with more harmonics, and a word for that."""
        blocks = {name: block for name, block, _ in self.blocks() if name in names}
        longer = {name: replace(block, harmonics=block.harmonics + more) for name, block in blocks.items()}
        words = [f"{name} with {counted(block.harmonics, 'harmonic')}" for name, block in longer.items()]
        return " and ".join(words), replace(self, **longer)  # type: ignore[type-var]

    def words(self) -> str:
        """The structure in words."""
        said = []
        for name, block, _ in self.blocks():
            kind = "" if block.symmetry == "none" else f"{block.symmetry} "
            size = f"with {counted(block.harmonics, 'harmonic')}" if block.harmonics else "constant"
            known = f", {len(block.known)} elements known" if block.known else ""
            said.append(f"{kind}{name} {size}{known}")
        return "; ".join(said)

    def basis(self, n: int) -> Basis:
        """The coefficient matrices for n displacements, or states of first order."""
        blocks = self.blocks()
        most = max(block.harmonics for _, block, _ in blocks)
        known = np.zeros((self.degree, 2 * most + 1, n, n), complex)
        matrices, names = [], []
        for name, block, power in blocks:
            known[power, most] += self.sign * block.constant(n)
            for places in block.elements(n):
                for k in range(block.harmonics + 1):
                    for kind in ("",) if k == 0 else (f" cos {k}", f" sin {k}"):
                        one = np.zeros_like(known)
                        for i, j, value in places:
                            size = self.sign * value * (1.0 if k == 0 else 0.5)
                            turned = size * (-1j if kind.startswith(" sin") else 1.0)
                            one[power, most + k, i, j] = turned
                            one[power, most - k, i, j] = np.conj(turned)
                        matrices.append(one)
                        i, j, _ = places[0]
                        names.append(f"{name}[{i},{j}]{kind}")
        stacked = np.array(matrices).reshape(len(matrices), *known.shape)
        return Basis(stacked, known, tuple(names))


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondOrder(Brief, AbstractStructure):
    r"""A second-order system in the displacements u.

    .. math:: \ddot u + (D(t) + G(t))\, \dot u + K(t)\, u = 0

    Raises InputError where the gyroscopic block is not skew, or stands beside a damping block that could hold it.

    Parameters
    ----------
    stiffness
        K, over the mass.
    damping
        D, over the mass.
    gyroscopic
        G, skew, over the mass; None where there is none, or where `damping` has no symmetry and so holds it.
    """

    degree: ClassVar[int] = 2
    sign: ClassVar[float] = -1.0
    stiffness: Block = Block(harmonics=2)
    damping: Block = Block()
    gyroscopic: Block | None = None

    def __post_init__(self) -> None:
        if self.gyroscopic is None:
            return
        if self.gyroscopic.symmetry != "skew":
            got = f'has the symmetry "{self.gyroscopic.symmetry}"'
            raise input_error("gyroscopic", "SecondOrder", "be skew", got, 'Pass Block(symmetry="skew").')
        if self.damping.symmetry not in ("symmetric", "diagonal"):
            must, got = "be symmetric or diagonal beside a gyroscopic block", "is not: it could hold that block itself"
            raise input_error("damping", "SecondOrder", must, got, 'Pass Block(symmetry="symmetric").')

    def less_symmetric(self) -> list[tuple[str, AbstractStructure]]:
        """Symmetric blocks without that, diagonal ones symmetric."""
        found: list[tuple[str, AbstractStructure]] = []
        for name, block, _ in self.blocks():
            if block.symmetry in ("symmetric", "diagonal"):
                free = replace(block, symmetry="none" if block.symmetry == "symmetric" else "symmetric")
                both = self.gyroscopic is not None and name == "damping" and free.symmetry == "none"
                other = self._merged(free) if both else replace(self, **{name: free})
                found.append((f"{name} that is {'not ' if free.symmetry == 'none' else ''}symmetric", other))
        return found

    def _merged(self, damping: Block) -> SecondOrder:
        """A damping block without symmetry that holds the gyroscopic one too."""
        assert self.gyroscopic is not None
        known = {(i, j): value for (i, j), value in damping.known.items() if i == j}
        most = max(damping.harmonics, self.gyroscopic.harmonics)
        return replace(self, damping=replace(damping, harmonics=most, known=known), gyroscopic=None)

    def blocks(self) -> tuple[tuple[str, Block, int], ...]:
        """Stiffness, damping, gyroscopic."""
        both = (("stiffness", self.stiffness, 0), ("damping", self.damping, 1))
        return both if self.gyroscopic is None else (*both, ("gyroscopic", self.gyroscopic, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder(Brief, AbstractStructure):
    r"""A system of first order in the states x.

    .. math:: \dot x = A(t)\, x

    Parameters
    ----------
    system
        A.
    """

    degree: ClassVar[int] = 1
    sign: ClassVar[float] = 1.0
    system: Block = Block(harmonics=2)

    def blocks(self) -> tuple[tuple[str, Block, int], ...]:
        """A alone."""
        return (("system", self.system, 0),)

    def less_symmetric(self) -> list[tuple[str, AbstractStructure]]:
        """None: its block has no symmetry to lose."""
        return []


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
        raise wrong_value("text", OF, "say a structure", text, EXAMPLES)
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
        raise wrong_value("structure", "text_of", 'be SecondOrder, FirstOrder or "auto"', structure)
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
