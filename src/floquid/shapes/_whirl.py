r"""Whirl of modes: how much of the motion in a plane turns with the rotor, and how much against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Sealed
from floquid.core import Shape
from floquid.shapes._arguments import Pair

CLEAR = 0.2
"""The index from which a mode whirls one way, by two deviations; without unit. A circle has 1, a straight line 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whirl(Sealed):
    r"""The whirl of a mode in pairs of channels x and y, from x to y being the sense of rotation.

    .. math:: f_m = \tfrac14 |B_x + i B_y|^2, \quad b_m = \tfrac14 |B_x - i B_y|^2, \quad
              W = \frac{\sum_m (f_m - b_m)}{\sum_m (f_m + b_m)}

    f and b exchanged at lines of negative frequency.

    Parameters
    ----------
    index, std
        W from -1 (backward circles) to 1 (forward circles), and its deviation; None if not estimated.
    strongest
        W of the strongest line alone.
    by_pair
        W of each pair (pairs,).
    word
        "forward", "backward" or "mixed", "mixed (planar)" where the strongest line is nearly straight, "mixed, differs
        along the shaft" where pairs whirl against each other.
    axis
        The angle of the straight line from x towards y [rad] where it is planar; else None.
    """

    index: float
    std: float | None
    strongest: float
    by_pair: Floats
    word: str
    axis: float | None = None


def whirl_of(shape: Shape, exponent: complex, fundamental: float, pairs: Sequence[Pair]) -> Whirl:
    """The whirl of a `shape` in `pairs` of its channels, lines at Im λ + mω by its `exponent` and `fundamental`."""
    signs = np.where(exponent.imag + fundamental * shape.harmonics < 0.0, -1.0, 1.0)
    rows = np.array([[pair.x, pair.y] for pair in pairs])
    whole = _ratio(shape, signs, rows)
    parts = [_ratio(shape, signs, row[None]) for row in rows]
    index, std = whole.value, whole.std
    x, y = shape.values[rows[:, 0]], shape.values[rows[:, 1]]
    energy = 0.5 * (np.abs(x) ** 2 + np.abs(y) ** 2)
    line = int(energy.sum(axis=0).argmax())
    turning = (-signs * (x.conj() * y).imag).sum(axis=0)
    strongest = float(turning[line] / energy[:, line].sum())
    word, axis = _side(index, std), None
    sides = {_side(part.value, part.std) for part in parts}
    if {"forward", "backward"} <= sides:
        word = "mixed, differs along the shaft"
    elif word == "mixed" and abs(strongest) < CLEAR and energy[:, line].sum() > 0.5 * energy.sum():
        word, axis = "mixed (planar)", _axis(x[:, line], y[:, line])
    return Whirl(
        index=index,
        std=std,
        strongest=strongest,
        by_pair=np.array([part.value for part in parts]),
        word=word,
        axis=axis,
    )


def _ratio(shape: Shape, signs: Floats, rows: Floats) -> Ratio:
    """W over pairs of rows (pairs, 2), with what it moves by."""
    x, y = shape.values[rows[:, 0]], shape.values[rows[:, 1]]
    by_part, by_whole = np.zeros((2, *shape.values.shape), complex)
    by_part[rows[:, 0]], by_part[rows[:, 1]] = -1j * signs * y.conj(), 1j * signs * x.conj()
    by_whole[rows[:, 0]], by_whole[rows[:, 1]] = x.conj(), y.conj()
    noise = 0.0 if shape.std is None else 0.5 * float(np.sum(np.abs(shape.std[rows]) ** 2))
    part = float(-(signs * (x.conj() * y).imag).sum())
    return Ratio.of(shape, part, 0.5 * float(np.sum(np.abs(x) ** 2 + np.abs(y) ** 2)), by_part, by_whole, noise)


def _side(index: float, std: float | None) -> str:
    sure = abs(index) - 2.0 * (std or 0.0) > CLEAR
    return "mixed" if not sure else "forward" if index > 0.0 else "backward"


def _axis(x: Complexes, y: Complexes) -> float:
    """The angle of the long axis of the largest of several ellipses, from x towards y [rad], in [0, π)."""
    largest = int((np.abs(x) ** 2 + np.abs(y) ** 2).argmax())
    ahead, back = x[largest] + 1j * y[largest], np.conj(x[largest] - 1j * y[largest])
    return float(0.5 * np.angle(ahead * back) % np.pi)


@dataclass(frozen=True, slots=True)
class Ratio:
    """Part over whole."""

    value: float
    std: float | None

    @staticmethod
    def of(shape: Shape, part: float, whole: float, by_part: Complexes, by_whole: Complexes, noise: float) -> Ratio:
        """The ratio of two quadratic forms of the lines of a `shape`, and its deviation.

        `by_part` and `by_whole` are their slopes (channels, harmonics). `noise`, what errors add to the whole on
        average, counts too: at a bound, a circle or a share of nothing, there is no slope.
        """
        if not whole > 0.0:
            return Ratio(0.0, None)
        value = part / whole
        variance = shape.variance(((by_part - value * by_whole) / whole)[None])
        return Ratio(value, None if variance is None else float(np.hypot(np.sqrt(variance[0]), noise / whole)))
