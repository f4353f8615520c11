"""Modes that fold onto one another within half of their mean decay: the lines that both of them have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Integers
from floquid.periodic.least_squares import PLAIN, ModeParameters
from floquid.search import NEAR


@dataclass(frozen=True, slots=True)
class Fold:
    """Two modes of one line: λ_second, conjugated for sign -1, is next to λ_first + imω, m being whole turns."""

    first: int
    second: int
    sign: int
    turns: int

    def of_first(self, band: Integers) -> Integers:
        """Ends of the band that the first mode has on the lines of a `band` of the second (2,)."""
        return np.sort(self.sign * band + self.turns)

    def of_second(self, band: Integers) -> Integers:
        """Ends of the band that the second mode has on the lines of a `band` of the first (2,)."""
        return np.sort(self.sign * (band - self.turns))

    def common(self, bands: Integers) -> Integers:
        """Harmonics of the first mode on lines that both have with these `bands` (harmonics,)."""
        other = self.of_first(bands[self.second])
        return np.arange(max(bands[self.first, 0], other[0]), min(bands[self.first, 1], other[1]) + 1)


def difference(entries: ModeParameters, first: int, second: int, sign: int) -> tuple[int, complex]:
    """Whole fundamentals m and what is left of λ_two = λ_one + imω, λ_two conjugated for sign -1."""
    value = entries.exponents[second] if sign > 0 else entries.exponents[second].conjugate()
    gap = complex(value - entries.exponents[first])
    turns = round(gap.imag / entries.fundamental)
    return turns, gap - 1j * turns * entries.fundamental


def nearest(entries: ModeParameters, first: int, second: int) -> tuple[int, int, float]:
    """Sign and whole fundamentals by which two pairs are nearest, and their distance over both decays."""
    tried = [(sign, *difference(entries, first, second, sign)) for sign in (1, -1)]
    sign, turns, gap = min(tried, key=lambda each: abs(each[2]))
    return sign, turns, abs(gap) / (abs(entries.exponents[[first, second]].real).sum() + 1e-300)


def folds(entries: ModeParameters, *, wanders: bool = False, share: float = NEAR) -> list[Fold]:
    """Pairs of modes that fold onto one another within a share of their mean decay."""
    places = np.flatnonzero(~entries.fixed & ~entries.real & (entries.factors == PLAIN))
    values, omega = entries.exponents[places], entries.fundamental
    decays = np.abs(values.real)
    found = []
    for sign, others in ((1, values), (-1, values.conj())):
        gaps = others[None, :] - values[:, None]
        turns = np.rint(gaps.imag / omega)
        near = 2.0 * np.abs(gaps - 1j * omega * turns) <= share * (decays[:, None] + decays)
        if wanders:
            near &= (turns == 0.0) & (sign > 0)
        found += [
            Fold(int(places[k]), int(places[n]), sign, int(turns[k, n])) for k, n in np.argwhere(np.triu(near, 1))
        ]
    return found


def shared_harmonics(near: Sequence[Fold], bands: Integers) -> list[int]:
    """Numbers of harmonics that a mode has on lines of others, each line counted for all modes but one."""
    widths, taken = bands[:, 1] - bands[:, 0], dict[int, set[int]]()
    for fold in near:
        lines = fold.common(bands)
        # Of a wide band and a narrow one the narrow one is beside the other.
        if (widths[fold.first], fold.first) < (widths[fold.second], fold.second):
            taken.setdefault(fold.first, set()).update(lines.tolist())
        else:
            taken.setdefault(fold.second, set()).update((fold.sign * (lines - fold.turns)).tolist())
    return [len(lines) for lines in taken.values()]


def with_all_lines(entries: ModeParameters, fold: Fold) -> ModeParameters:
    """The entries with both modes of a fold on all lines that one of them has."""
    bands = entries.bands.copy()
    both = np.stack([bands[fold.first], fold.of_first(bands[fold.second])])
    bands[fold.first] = both.min(), both.max()
    bands[fold.second] = fold.of_second(bands[fold.first])
    return replace(entries, bands=bands)
