r"""Data of a fit of modulated exponentials: blocks of samples, each of some channels of one hit.

A column is z_j = e^{λ_e t + i (m + q_e) θ(t)}, with e the entry of column j: a decay and a frequency that run in time,
and a harmonic that runs in the phase angle θ of the system, which is ωt where the period is constant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask

PLAIN, TREND, *FOLLOWS, EVEN, ODD, ODD_SLOPE = range(10)
"""Factors of entries: none; time, from -1 to 1; and what follows the speed (`followed`).

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

    @property
    def half(self) -> float:
        """Unit of trends [s]."""
        return 1.0

    def filtered(self, taps: Floats) -> Block | None:
        """The block after a filter along the record (rows, taps); None where it cannot go through one."""
        del taps
        return None

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


EXPONENTIAL, COSH, SINH, SINH_SLOPE, COSH_SLOPE, SINH_SQUARE = range(6)
"""Functions of a term: e^{λt}; C, S, E, tS/2 and qS as above."""

ADDITION = {
    EVEN: ((COSH, COSH), (SINH, SINH_SQUARE)),
    ODD: ((SINH, COSH), (COSH, SINH)),
    ODD_SLOPE: ((SINH_SLOPE, COSH), (SINH, COSH_SLOPE), (COSH_SLOPE, SINH), (COSH, SINH_SLOPE)),
}
"""Each function at the sum of two times, as a sum of products of functions of the first and of the second.

Of a derivative that is the product rule: C(t + τ) = C(t) C(τ) + q S(t) S(τ), S(t + τ) = S(t) C(τ) + C(t) S(τ).
"""


SINES = [1.0 / factorial(2 * power + 1) for power in range(10)]
"""Coefficients of sinh √x / √x in powers of x: what is left out is rounding below 1."""


def function_of_time(kind: int, times: Floats, mean: float, square: float, *, growth: float = 0.0) -> Floats:
    """Evaluate C, S, E, tS/2 or qS at `times`, all times e^{-growth}."""
    root = np.sqrt(complex(square))
    up, down = (np.exp((mean + sign * root) * times - growth) for sign in (1.0, -1.0))
    cosh = 0.5 * (up + down).real
    if kind == COSH:
        return cosh
    x = square * times**2
    near = np.abs(x) < 1.0  # differences lose digits there, and the series need few terms
    base = np.exp(mean * times[near] - growth) * times[near]
    sinh = np.zeros_like(times)
    if root:
        sinh[~near] = ((up - down)[~near] / (2.0 * root)).real
    sinh[near] = base * polyval(x[near], SINES)
    if kind == SINH:
        return sinh
    if kind == COSH_SLOPE:
        return 0.5 * times * sinh
    if kind == SINH_SQUARE:
        return square * sinh
    slope = np.zeros_like(times)
    if square:
        slope[~near] = (times * cosh - sinh)[~near] / (2.0 * square)
    slope[near] = base * times[near] ** 2 * polyval(x[near], polyder(SINES))
    return slope


KIND = {EVEN: COSH, ODD: SINH, ODD_SLOPE: SINH_SLOPE}
"""The function of an entry with each factor of a pair near an axis."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Columns at t + τ as sums of products of a function of t and one of τ: plain columns are one, others several."""

    columns: Columns
    of: Integers  # the column of each term (terms,)
    first: Integers  # the function of t of each term (terms,)
    second: Integers  # that of τ (terms,)

    @staticmethod
    def made(columns: Columns) -> Terms:
        """The terms of `columns`, those of plain columns first and in their order."""
        if not columns.paired.any():
            count = len(columns.modes)
            plain = np.zeros(count, np.int64)
            return Terms(columns, np.arange(count), plain, plain)
        rows = [
            (column, first, second)
            for column, factor in enumerate(columns.factors[columns.modes].tolist())
            for first, second in ADDITION.get(factor, ((EXPONENTIAL, EXPONENTIAL),))
        ]
        return Terms(columns, *np.array(rows, np.int64).T)

    @property
    def plain(self) -> bool:
        """True where each column is one term."""
        return not self.columns.paired.any()

    def gathered(self, sums: Sums) -> Sums:
        """Sums over the columns from those over the terms."""
        if self.plain:
            return sums
        part = np.kron(np.eye(2), np.equal.outer(self.of, np.arange(len(self.columns.modes))))
        gram, mixed, slopes = (part.T @ each @ part for each in (sums.gram, sums.mixed, sums.slopes))
        return Sums(gram, mixed, slopes, part.T @ sums.seen, part.T @ sums.late, sums.left)

    def outer(self) -> tuple[list[tuple[int, int]], Integers]:
        """The entry and the kind of each function of t that there is, and the one of each term (terms,)."""
        entries = self.columns.modes[self.of]
        if self.plain:
            return [(entry, EXPONENTIAL) for entry in range(len(self.columns.exponents))], entries
        keys = list(zip(entries.tolist(), self.first.tolist(), strict=True))
        plain = [(e, EXPONENTIAL) for e in range(len(self.columns.exponents)) if not self.columns.paired[e]]
        unique = list(dict.fromkeys([*plain, *keys]))
        place = {key: number for number, key in enumerate(unique)}
        return unique, np.array([place[key] for key in keys], np.int64)

    def at(self, kinds: Integers, times: Floats, *, growth: float = 0.0) -> Complexes:
        """Functions of time of these kinds, one a term, their harmonics taken off (times, terms)."""
        # Those of pairs near an axis alone: of plain columns it has ones. What grows is e^{-rate · growth} times that.
        columns, functions = self.columns, np.ones((len(times), len(self.of)), complex)
        known: dict[tuple[int, int], Floats] = {}
        for term, (column, kind) in enumerate(zip(self.of.tolist(), kinds.tolist(), strict=True)):
            entry = int(columns.modes[column])
            if kind == EXPONENTIAL:
                continue
            if (entry, kind) not in known:
                known[entry, kind] = entry_function(columns, entry, kind, times, growth=growth)
            functions[:, term] = known[entry, kind]
        return functions


def entry_function(columns: Columns, entry: int, kind: int, times: Floats, *, growth: float = 0.0) -> Floats:
    """The function of an entry near an axis at `times`; what grows is e^{-rate · growth} times that."""
    mean, square = float(columns.exponents[entry].real), float(columns.squares[entry])
    return function_of_time(kind, times, mean, square, growth=float(columns.growth[entry]) * growth)


def own_function(columns: Columns, entry: int, times: Floats, *, growth: float = 0.0) -> Floats:
    """The function that an entry near an axis has by its factor at `times`, scaled as above."""
    return entry_function(columns, entry, KIND[int(columns.factors[entry])], times, growth=growth)
