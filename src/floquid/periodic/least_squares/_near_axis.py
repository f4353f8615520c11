r"""Functions of time of a pair near an axis, regular where both of its exponents are one.

.. math:: C = e^{\sigma t} \cosh \sqrt q\, t, \qquad S = e^{\sigma t} \frac{\sinh \sqrt q\, t}{\sqrt q}, \qquad
          E = \frac{\partial S}{\partial q} = \frac{t C - S}{2 q}, \qquad \frac{\partial C}{\partial q} = \frac{t S}{2}

σ is the mean of two exponents σ ± √q about an axis, 0 or half the fundamental. They are a pair of conjugates where
q < 0 and two real multipliers where q > 0; all four functions are entire in q.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.periodic.least_squares._sample_block import EVEN, ODD, ODD_SLOPE, Columns, Sums

SERIES = 1e-2
"""|q|t² below which differences are taken from their series: beyond, they lose at most three digits."""

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


def function_of_time(kind: int, times: Floats, mean: float, square: float, *, growth: float = 0.0) -> Floats:
    """Evaluate C, S, E, tS/2 or qS at `times`, all times e^{-growth}."""
    root = np.sqrt(complex(square))
    up, down = (np.exp((mean + sign * root) * times - growth) for sign in (1.0, -1.0))
    cosh = 0.5 * (up + down).real
    if kind == COSH:
        return cosh
    x = square * times**2
    near = np.abs(x) < SERIES
    base = np.exp(mean * times[near] - growth) * times[near]
    sinh = np.zeros_like(times)
    if root:
        sinh[~near] = ((up - down)[~near] / (2.0 * root)).real
    sinh[near] = base * _series(x[near], (1.0, 6.0, 120.0, 5040.0, 362880.0))
    if kind == SINH:
        return sinh
    if kind == COSH_SLOPE:
        return 0.5 * times * sinh
    if kind == SINH_SQUARE:
        return square * sinh
    slope = np.zeros_like(times)
    if square:
        slope[~near] = (times * cosh - sinh)[~near] / (2.0 * square)
    slope[near] = base * times[near] ** 2 * _series(x[near], (6.0, 60.0, 1680.0, 90720.0))
    return slope


def _series(x: Floats, divisors: tuple[float, ...]) -> Floats:
    """Σ x^k / divisor_k."""
    return np.sum([x**power / divisor for power, divisor in enumerate(divisors)], axis=0)


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
        """Functions of time of these kinds, one a term, their harmonics taken off (times, terms).

        Those of pairs near an axis alone: of plain columns it has ones. What grows is e^{-rate · growth} times that.
        """
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
