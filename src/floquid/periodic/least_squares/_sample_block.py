r"""Data of a fit of modulated exponentials: blocks of samples, each of some channels of one hit.

A column is z_j = e^{λ_e t + i (m + q_e) θ(t)}, with e the entry of column j: a decay and a frequency that run in time,
and a harmonic that runs in the phase angle θ of the system, which is ωt where the period is constant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask

PLAIN, TREND, SPEED, SPEED_SQUARED, SPEED_RATE, EVEN, ODD, ODD_SLOPE = range(8)
"""Factors of entries: none; time, from -1 to 1; the speed's deviation from its mean; its square; its rate of change.

Those of a pair near an axis, with the squared half-difference q of its exponents: cosh(√q t), even in √q;
sinh(√q t)/√q; and the derivative of that by q.
"""


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of a fit, of entries with exponents (entries,) [1/s] and offsets of their harmonics (entries,)."""

    exponents: Complexes
    offsets: Floats
    factors: Integers  # further factor of each entry, such as `PLAIN` (entries,)
    modes: Integers  # the entry of each column (columns,)
    harmonics: Integers  # m of each column (columns,)
    fundamental: float
    squares: Floats  # q of each entry, zero where it is no part of a pair near an axis (entries,)

    @property
    def growth(self) -> Floats:
        """The rate at which each entry grows, zero where it decays (entries,) [1/s]."""
        return np.maximum(self.exponents.real + np.sqrt(np.maximum(self.squares, 0.0)), 0.0)

    @property
    def paired(self) -> Mask:
        """Mask of the entries that are parts of a pair near an axis (entries,)."""
        return self.factors >= EVEN

    @property
    def turns(self) -> Floats:
        """M + q of each column (columns,)."""
        return self.harmonics + self.offsets[self.modes]

    @property
    def rates(self) -> Complexes:
        """λ + i(m + q)ω of each column (columns,) [1/s]."""
        return self.exponents[self.modes] + 1j * self.fundamental * self.turns


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over the samples of a block; the real columns are Re z, then Im z."""

    gram: Floats  # products of the columns (2 columns, 2 columns)
    mixed: Floats  # products of the columns with the columns times t
    slopes: Floats  # products of the columns times t
    seen: Floats  # products of the columns with what is left (2 columns, rows)
    late: Floats  # products of the columns times t with what is left
    left: Floats  # the sum of squares of what is left (rows,)


class Block(ABC):
    """Samples of some channels of one hit, all at the same times."""

    if TYPE_CHECKING:  # fields of those that are dataclasses, to which a property would be a default

        @property
        def hit(self) -> int:
            """Index of the hit."""

        @property
        def rows(self) -> Integers:
            """Indices of the channels (rows,)."""

        @property
        def noise(self) -> Floats:
            """The deviation of their noise (rows,)."""

    @property
    @abstractmethod
    def n_samples(self) -> int:
        """Samples of each channel."""

    @property
    @abstractmethod
    def last(self) -> float:
        """The time of the last sample after phase zero [s]."""

    @property
    @abstractmethod
    def largest(self) -> Floats:
        """The largest size of a sample (rows,)."""

    @abstractmethod
    def sums(self, columns: Columns, coefficients: Complexes) -> Sums:
        """The sums of the scaled columns, and of what the model 2 Re Σ B_j z_j leaves.

        Growing columns are counted from the end of the block, so that no power overflows: `scales` has the factors.
        """

    @abstractmethod
    def residual(self, columns: Columns, coefficients: Complexes) -> tuple[NDArray, NDArray]:
        """Times (samples,) [s] and what the model leaves at each (rows, samples)."""

    @abstractmethod
    def with_noise(self, noise: Floats) -> Block:
        """Samples with other noise (rows,)."""

    @property
    def wanders(self) -> bool:
        """True where the speed of the shaft wanders."""
        return False

    def gain(self, rates: Complexes, *, slope: bool = False) -> Complexes:
        """Gain at e^{st} of the filter that the samples went through, or its slope (rows, rates)."""
        return np.full((len(self.rows), len(rates)), 0j if slope else 1.0 + 0j)

    def scales(self, columns: Columns) -> Complexes:
        """Factors that make z of the scaled columns (columns,)."""
        growth = np.where(columns.paired, columns.growth, np.where(columns.exponents.real > 0, columns.exponents, 0.0))
        return np.asarray(np.exp(growth * self.last)[columns.modes], np.complex128)


def complex_of(coefficients: Floats) -> Complexes:
    """B with 2 Re B z = α Re z + β Im z."""
    n = len(coefficients) // 2
    return 0.5 * (coefficients[:n] - 1j * coefficients[n:])


def reals_of(coefficients: Complexes) -> Floats:
    """α and β with 2 Re B z = α Re z + β Im z (2 columns, rows)."""
    return 2.0 * np.concatenate([coefficients.real, -coefficients.imag])


def real_products(straight: Complexes, crossed: Complexes) -> Floats:
    """Products of the real columns from Σ z̄_i z_j and Σ z_i z_j (2 columns, 2 columns)."""
    n = len(straight)
    products = np.empty((2 * n, 2 * n))
    both, beside = straight + crossed, crossed - straight
    products[:n, :n], products[:n, n:], products[n:, :n], products[n:, n:] = (
        both.real,
        both.imag,
        beside.imag,
        -beside.real,
    )
    products *= 0.5
    return products
