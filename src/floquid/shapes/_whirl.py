r"""Whirl of modes: how much of the motion in a plane turns with the rotor, and how much against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers
from floquid._checks import Sealed
from floquid.core import Shape
from floquid.shapes._arguments import Pair
from floquid.shapes._shares import Energies, Share

CLEAR = 0.2
"""The index beyond which all of an interval is where a mode whirls one way. A circle has 1, a straight line 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whirl(Sealed):
    r"""The whirl of a mode in pairs of channels x and y, from x to y being the sense of rotation.

    .. math:: f_m = \tfrac14 |B_x + i B_y|^2, \quad b_m = \tfrac14 |B_x - i B_y|^2, \quad
              W = \frac{\sum_m (f_m - b_m)}{\sum_m (f_m + b_m)}

    f and b exchanged at lines of negative frequency.

    Parameters
    ----------
    index, std, interval
        W from -1 (backward circles) to 1 (forward circles), what noise adds being taken off, its deviation, and a 95 %
        interval, which is no multiple of that next to a circle; None if not estimated.
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
    interval: tuple[float, float] | None
    strongest: float
    by_pair: Floats
    word: str
    axis: float | None = None


def whirl_of(shape: Shape, exponent: complex, fundamental: float, pairs: Sequence[Pair]) -> Whirl:
    """The whirl of a `shape` in `pairs` of its channels, lines at Im λ + mω by its `exponent` and `fundamental`."""
    signs = np.where(exponent.imag + fundamental * shape.harmonics < 0.0, -1.0, 1.0)
    rows = np.array([[pair.x, pair.y] for pair in pairs])
    whole = _index(shape, signs, rows)
    parts = [_index(shape, signs, row[None]) for row in rows]
    x, y = shape.values[rows[:, 0]], shape.values[rows[:, 1]]
    energy = 0.5 * (np.abs(x) ** 2 + np.abs(y) ** 2)
    line = int(energy.sum(axis=0).argmax())
    turning = (-signs * (x.conj() * y).imag).sum(axis=0)
    strongest = float(turning[line] / (energy[:, line].sum() or 1.0))
    word, axis = _side(whole), None
    sides = {_side(part) for part in parts}
    if {"forward", "backward"} <= sides:
        word = "mixed, differs along the shaft"
    elif word == "mixed" and abs(strongest) < CLEAR and energy[:, line].sum() > 0.5 * energy.sum():
        word, axis = "mixed (planar)", _axis(x[:, line], y[:, line])
    return Whirl(
        index=whole.value,
        std=whole.std,
        interval=whole.interval,
        strongest=strongest,
        by_pair=np.array([part.value for part in parts]),
        word=word,
        axis=axis,
    )


def _index(shape: Shape, signs: Floats, rows: Indices) -> Share:
    """W over pairs of rows (pairs, 2), with deviation and interval: twice the share that turns forward, less one."""
    lines = np.arange(len(shape.harmonics))
    to = np.zeros((len(rows), 2, len(lines), *shape.values.shape), complex)
    for pair, (x, y) in enumerate(rows):
        to[pair, :, lines, x, lines] = 0.5
        to[pair, 0, lines, y, lines], to[pair, 1, lines, y, lines] = 0.5j * signs, -0.5j * signs
    forward = np.tile(np.repeat([True, False], len(lines)), len(rows))
    found = Energies.of(shape, to.reshape(-1, *shape.values.shape)).share(forward)
    std = None if found.std is None else 2.0 * found.std
    low, high = (2.0 * end - 1.0 for end in found.interval or (found.value, found.value))
    return Share(2.0 * found.value - 1.0, std, None if found.interval is None else (low, high))


def sense_of(low: Floats, high: Floats) -> Integers:
    """1 where all of an interval of W is forward, -1 where all is backward, else 0; of its ends `low` and `high`."""
    return (low > CLEAR).astype(np.int64) - (high < -CLEAR)


def _side(index: Share) -> str:
    low, high = index.interval or (index.value, index.value)
    return {1: "forward", -1: "backward"}.get(int(sense_of(np.array(low), np.array(high))), "mixed")


def _axis(x: Complexes, y: Complexes) -> float:
    """The angle of the long axis of the largest of several ellipses, from x towards y [rad], in [0, π)."""
    largest = int((np.abs(x) ** 2 + np.abs(y) ** 2).argmax())
    ahead, back = x[largest] + 1j * y[largest], np.conj(x[largest] - 1j * y[largest])
    return float(0.5 * np.angle(ahead * back) % np.pi)
