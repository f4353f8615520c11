"""Patterns of modes over the blades of a rotor: multi-blade coordinates of the lines of a shape, of any blade count."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt
from floquid.core import Shape
from floquid.shapes._shares import Energies, Family

Words: TypeAlias = Literal["en", "openfast", "hawc"]

WORDS: dict[Words, tuple[str, str, str]] = {
    "en": ("collective", "backward", "forward"),
    "openfast": ("collective", "regressive", "progressive"),
    "hawc": ("SYM", "BW", "FW"),
}
"""Words for patterns that do not turn, that turn against the rotor and with it, by the program that uses them."""

CLEAR, SECOND = 0.6, 0.5
"""Least share of the whole that gives a mode its name, and the most that the second may have of the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternShare:
    """The share of one pattern in the motion of a mode.

    Parameters
    ----------
    family
        The group of blades, or the channel in the fixed frame.
    wave
        The space harmonic n, above zero against the rotation and below zero with it; None of a fixed channel.
    word
        The direction in words; empty for a fixed channel.
    share, std
        Its share of the energy, and its deviation; None if not estimated.
    """

    family: str
    wave: int | None
    word: str
    share: float
    std: float | None

    @property
    def name(self) -> str:
        """Family and direction."""
        return f"{self.family} {self.word}".strip()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BladePattern(Rebuilt):
    r"""The pattern of a mode over the blades.

    .. math:: \beta_{n,m} = \frac{1}{N} \sum_{j=1}^{N} B_{j,m}\, e^{-2\pi i n (j-1)/N}

    the space harmonic n at the harmonic m of the rotor, a line at Im λ + (m - n)ω in the fixed frame.

    Parameters
    ----------
    branch
        The harmonic k = m - n of the fixed frame that has the most energy.
    line
        The harmonic with that frequency: the branch; of a reactionless pattern its strongest line on the blades, for it
        stands in the turning frame, and has two lines of one size in the fixed frame.
    frequency
        The frequency there, above zero [rad/s].
    shares
        Shares of patterns on that branch, the largest first: of all motion where `is_compared`, else of each family.
    leak, leak_std, leak_interval
        The share of motion off that branch, zero of an isotropic rotor, what noise adds on average being taken off; its
        deviation, and a 95 % interval, which is no multiple of that next to zero. None if not estimated.
    is_compared
        True where families are of one unit, or were scaled: shares are then of all motion.
    waves, tables
        n (waves,) and β (waves, harmonics) by family; both fixed channels and blades.
    harmonics
        The integers m (harmonics,).
    """

    branch: int
    line: int
    frequency: float
    shares: tuple[PatternShare, ...]
    leak: float
    leak_std: float | None
    leak_interval: tuple[float, float] | None
    is_compared: bool
    waves: Mapping[str, Integers] = field(repr=False)
    tables: Mapping[str, Complexes] = field(repr=False)
    harmonics: Integers = field(repr=False)

    def __post_init__(self) -> None:
        for name in ("waves", "tables"):
            arrays = dict(getattr(self, name))
            for array in arrays.values():
                array.flags.writeable = False
            object.__setattr__(self, name, MappingProxyType(arrays))

    def coordinates(self, family: str) -> dict[str, complex]:
        r"""The multi-blade coordinates of a `family` in the line of the branch: mean, cos 1, sin 1, …, alternating.

        .. math:: a_c = \beta_n + \beta_{-n}, \qquad a_s = i (\beta_n - \beta_{-n})
        """
        waves = self.waves[family].tolist()
        lines = {
            wave: complex(self.tables[family][row, self.harmonics - wave == self.branch].sum())
            for row, wave in enumerate(waves)
        }
        found = {"mean": lines[0]}
        for wave in (wave for wave in waves if wave > 0):
            if -wave in lines:
                found[f"cos {wave}"] = lines[wave] + lines[-wave]
                found[f"sin {wave}"] = 1j * (lines[wave] - lines[-wave])
            else:
                found["alternating"] = lines[wave]
        return found

    @property
    def is_sure(self) -> bool:
        """True where the first pattern has most of the motion by two deviations of its share."""
        first = self.shares[0]
        return first.std is not None and first.share - 2.0 * first.std > CLEAR

    @property
    def is_mixed(self) -> bool:
        """True where no pattern has most of the motion: the name is of several."""
        shares = [pattern.share for pattern in self.shares]
        return shares[0] < CLEAR or (len(shares) > 1 and shares[1] > SECOND * shares[0])

    @property
    def words(self) -> str:
        """The name without an ordinal: one pattern, or those that are mixed with their shares; of each family alone."""
        if self.is_compared:
            return _words(self.shares)
        families = dict.fromkeys(pattern.family for pattern in self.shares)
        parts = [[pattern for pattern in self.shares if pattern.family == family] for family in families]
        return "; ".join(_words(part) for part in parts)


def _words(shares: Sequence[PatternShare]) -> str:
    first = shares[0]
    if first.share >= CLEAR and not (len(shares) > 1 and shares[1].share > SECOND * first.share):
        return first.name
    named = [pattern for pattern in shares[:3] if pattern.share > 0.5 * SECOND * first.share]
    return "mixed: " + ", ".join(f"{pattern.name} {pattern.share:.2f}" for pattern in named)


@dataclass(frozen=True, slots=True)
class _Lines:
    """One family seen in a mode: β with the weight of its energy, which lines count, and the branch of each."""

    family: Family
    beta: Complexes  # (waves, harmonics)
    weight: float
    counted: Mask
    branch: Integers  # k = m - n (waves, harmonics)

    @property
    def energy(self) -> Floats:
        """Energy of each line that counts (waves, harmonics)."""
        return np.where(self.counted, self.weight * np.abs(self.beta) ** 2, 0.0)

    def to(self, shape: Shape) -> Complexes:
        """Factors by which the lines of a `shape` make these amplitudes (waves · harmonics, channels, harmonics)."""
        rows, lines = self.family.rows, np.arange(len(shape.harmonics))
        turned = np.exp(-2j * np.pi * np.outer(self.family.waves, np.arange(len(rows))) / len(rows))
        to = np.zeros((*self.beta.shape, *shape.values.shape), complex)
        to[:, lines[:, None], rows, lines[:, None]] = np.sqrt(self.weight) / len(rows) * turned[:, None]
        return (to * self.counted[:, :, None, None]).reshape(-1, *shape.values.shape)


def pattern_of(
    shape: Shape,
    exponent: complex,
    fundamental: float,
    families: Sequence[Family],
    *,
    is_real: bool,
    is_compared: bool,
    words: Words,
) -> BladePattern:
    """The pattern of a `shape` over `families`, lines at Im λ + kω by its `exponent` and the rotor's `fundamental`."""
    parts = [_lines(shape, exponent, fundamental, family, is_real, is_compared) for family in families]
    branches = np.unique(np.concatenate([part.branch.ravel() for part in parts]))
    sums = [sum(float(part.energy[part.branch == k].sum()) for part in parts) for k in branches]
    branch = int(branches[int(np.argmax(sums))])
    turned = exponent.imag + branch * fundamental < 0.0
    to = [part.to(shape) for part in parts]
    whole = Energies.of(shape, np.concatenate(to))
    shares: list[PatternShare] = []
    before = 0
    for part, own in zip(parts, to, strict=True):
        energies, first = (whole, before) if is_compared else (Energies.of(shape, own), 0)
        shares += _shares(part, branch, energies, first, turned, words)
        before += len(own)
    shares.sort(key=lambda pattern: -pattern.share)
    leak = whole.share(np.concatenate([part.branch.ravel() for part in parts]) != branch)
    line = _line_of(shares[0], parts, branch, shape)
    return BladePattern(
        branch=branch,
        line=line,
        frequency=abs(exponent.imag + line * fundamental),
        shares=tuple(shares),
        leak=leak.value,
        leak_std=leak.std,
        leak_interval=leak.interval,
        is_compared=is_compared,
        waves={part.family.name: part.family.waves for part in parts},
        tables={part.family.name: part.beta for part in parts},
        harmonics=shape.harmonics,
    )


def _lines(
    shape: Shape, exponent: complex, fundamental: float, family: Family, is_real: bool, is_compared: bool
) -> _Lines:
    """The lines of one family; where families are not compared, in units of its noise, or of its own size."""
    count, values = len(family.rows), shape.values[family.rows]
    beta = np.exp(-2j * np.pi * np.outer(family.waves, np.arange(count)) / count) @ values / count
    branch = shape.harmonics - family.waves[:, None]
    counted = np.ones(beta.shape, bool)
    if is_real:
        counted = exponent.imag + branch * fundamental > -1e-6 * fundamental
    scale = family.scale
    if not is_compared:
        size = np.sqrt(np.mean(np.abs(values if shape.std is None else shape.std[family.rows]) ** 2))
        scale = 1.0 / size if size > 0.0 else 1.0
    return _Lines(family, np.asarray(beta, np.complex128), count * scale**2, counted, branch)


def _shares(
    part: _Lines, branch: int, energies: Energies, first: int, turned: bool, words: Words
) -> Iterator[PatternShare]:
    """The share of each space harmonic of one family on a branch; `turned` where its frequency is below zero."""
    for row, wave in enumerate(part.family.waves.tolist()):
        inside = np.zeros(len(energies.v) // 2, bool)
        inside[first + row * part.branch.shape[1] : first + (row + 1) * part.branch.shape[1]] = (
            part.branch[row] == branch
        )
        share = energies.share(inside)
        wave = -wave if turned and 2 * wave != len(part.beta) else wave
        yield PatternShare(
            family=part.family.name,
            wave=None if part.family.is_fixed else wave,
            word="" if part.family.is_fixed else _word(wave, len(part.beta), words),
            share=share.value,
            std=share.std,
        )


def _line_of(first: PatternShare, parts: Sequence[_Lines], branch: int, shape: Shape) -> int:
    """The line of a mode in the fixed frame; of a reactionless pattern its strongest one on the blades."""
    part = next(part for part in parts if part.family.name == first.family)
    count = len(part.beta)
    if first.wave is not None and count % 2 == 0 and abs(first.wave) == count // 2:
        return int(shape.harmonics[part.energy[-1].argmax()])
    return branch


def _word(wave: int, count: int, words: Words) -> str:
    """The direction of a space harmonic of `count` blades, in words."""
    collective, backward, forward = WORDS[words]
    if wave == 0:
        return collective
    if count % 2 == 0 and abs(wave) == count // 2:
        return "differential" if count == 2 else "reactionless"
    side = backward if wave > 0 else forward
    return side if abs(wave) == 1 else f"{side} {abs(wave)}"
