"""Ratios of energies of lines, with deviations to first order and what noise alone adds to the energies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes
from floquid.core import Shape


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
