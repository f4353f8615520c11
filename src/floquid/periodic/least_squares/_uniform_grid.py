"""Columns at evenly spaced times: a short piece of each, and what each piece begins with.

Over K steps Δ, z_j(t_c + kΔ) = d_cj e_kj with d_cj = z_j(t_c) and e_kj = exp((λ_j + i(m + q)ω) kΔ): K + N / K
exponentials stand for N, and sums over the samples of products of two columns are
Σ_ck z_i z_j = (Σ_c d_ci d_cj)(Σ_k e_ki e_kj), so that no sample is touched but to multiply the data. A column that runs
with time besides is the sum of two such products: (u_c + u_k) d_cj e_kj = (u_c d_cj) e_kj + d_cj (u_k e_kj).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats, Integers
from floquid.lti import LARGEST_GROWTH
from floquid.periodic.least_squares._sample_block import FOLLOWS, TREND, Columns, Sums, Terms, real_products

UNEVEN = 8.0 * np.finfo(float).eps  # the share of the largest time by which evenly spaced times may be off


def step_of(times: Floats) -> float | None:
    """The step of evenly spaced times (samples,) [s], None where they are not."""
    n = len(times)
    if n < 2:
        return None
    step = float(times[-1] - times[0]) / (n - 1)
    off = np.abs(times - (times[0] + step * np.arange(n))).max()
    return step if off <= UNEVEN * np.abs(times[[0, -1]]).max() else None


def _piece(n_samples: int) -> int:
    """Samples of a piece: about as many as there are pieces."""
    return int(2 ** np.ceil(0.5 * np.log2(max(n_samples, 1))))


@dataclass(frozen=True, slots=True)
class Pieces:
    """Some pieces of a block, of equal length."""

    slots: slice  # places of their samples in the block
    own: Complexes  # e (samples of a piece, products)
    first: Complexes  # d (pieces, products)
    times: Floats  # the time of each piece [s]: where it begins (pieces,)
    later: Floats  # the time after that of its samples [s] (samples of a piece,)


@dataclass(frozen=True, slots=True)
class EvenColumns:
    """Columns on a steady shaft, plain or with a trend, at the times `first` + k `step` (samples,) [s]."""

    columns: Columns
    first: float
    step: float
    n_samples: int
    middle: float  # time at which the trend is zero [s]
    half: float  # unit of the trend [s]
    last: float  # time from which what grows is counted [s]

    @classmethod
    def of(
        cls, columns: Columns, times: Floats, step: float | None, *, middle: float, half: float, last: float
    ) -> EvenColumns | None:
        """Columns on the grid; None where they cannot be had in pieces."""
        if step is None or np.isin(columns.factors, FOLLOWS).any():
            return None
        growth = float(columns.growth.max(initial=0.0))
        if growth * step * _piece(len(times)) > LARGEST_GROWTH:
            return None
        return cls(columns, float(times[0]), step, len(times), middle, half, last)

    def pieces(self) -> Iterator[Pieces]:
        """All samples, in groups of whole pieces, and what is left at the end."""
        length = _piece(self.n_samples)
        group = max(BLOCK // (length * (1 + len(self.columns.modes))), 1) * length
        whole = self.n_samples - self.n_samples % length
        for begin in range(0, whole, group):
            end = min(begin + group, whole)
            yield self._pieces(begin, end, length)
        if whole < self.n_samples:
            yield self._pieces(whole, self.n_samples, self.n_samples - whole)

    def _pieces(self, begin: int, end: int, length: int) -> Pieces:
        times = self.first + self.step * np.arange(begin, end, length, dtype=np.float64)
        later = self.step * np.arange(length, dtype=np.float64)
        terms = self._terms
        within = self._exponentials(later, later[-1])[:, terms.of]
        first = self._exponentials(times, self.last - later[-1])[:, terms.of]
        if not terms.plain:
            within = within * terms.at(terms.second, later, growth=later[-1])
            first = first * terms.at(terms.first, times, growth=self.last - later[-1])
        trend = self.columns.factors[self.columns.modes[terms.of]] == TREND
        within = np.concatenate([within, within[:, trend] * (later / self.half)[:, None]], axis=1)
        first = np.concatenate([first, first[:, trend]], axis=1)
        first[:, : len(trend)][:, trend] *= ((times - self.middle) / self.half)[:, None]
        return Pieces(slice(begin, end), within, first, times, later)

    @property
    def _terms(self) -> Terms:
        """The terms of the columns at the time of a piece, and after that."""
        return Terms.made(self.columns)

    def _exponentials(self, times: Floats, last: float) -> Complexes:
        """The columns without factors (times, columns): what grows is counted from the last."""
        columns = self.columns
        grows, plain = columns.exponents.real > 0, np.where(columns.paired, 0.0, columns.exponents)
        grows &= ~columns.paired
        decays = np.exp(np.multiply.outer(times, np.where(grows, 0j, plain)))
        decays[:, grows] = np.exp(np.multiply.outer(times - last, plain[grows]))
        turns, where = np.unique(columns.turns, return_inverse=True)
        turned = np.exp(1j * columns.fundamental * np.multiply.outer(times, turns))
        z: Complexes = decays[:, columns.modes] * turned[:, where]
        return z

    def _stands_for(self) -> Integers:
        """The column of each product (products,)."""
        of = self._terms.of
        return np.concatenate([of, of[self.columns.factors[self.columns.modes[of]] == TREND]])

    def residual(self, values: Floats, coefficients: Complexes) -> Floats:
        """Residual of the values beside the model 2 Re Σ B_j z_j (rows, samples)."""
        remaining, coefficients = np.empty_like(values), coefficients[self._stands_for()]
        for pieces in self.pieces():
            remaining[:, pieces.slots] = _rest(pieces, values, coefficients).reshape(len(values), -1)
        return remaining

    def sums(self, values: Floats, coefficients: Complexes) -> Sums:
        """The sums of `Block.sums`."""
        stands_for, rows = self._stands_for(), len(values)
        coefficients, n = coefficients[stands_for], 2 * len(stands_for)
        gram, mixed, slopes = np.zeros((3, n, n))
        seen, late, squares = np.zeros((n, rows)), np.zeros((n, rows)), np.zeros(rows)
        for pieces in self.pieces():
            for total, part in zip((gram, mixed, slopes), _products(pieces), strict=True):
                total += part
            residual = _rest(pieces, values, coefficients)
            squares += np.einsum("rck,rck->r", residual, residual)
            for total, part in zip((seen, late), _met(pieces, residual), strict=True):
                total += part
        of = np.eye(len(self.columns.modes))[stands_for]
        both = np.kron(np.eye(2), of)
        gram, mixed, slopes = (both.T @ each @ both for each in (gram, mixed, slopes))
        return Sums(gram, mixed, slopes, both.T @ seen, both.T @ late, squares)


def _rest(pieces: Pieces, values: Floats, coefficients: Complexes) -> Floats:
    """Residual (rows, pieces, samples of a piece)."""
    shape = (len(values), len(pieces.times), len(pieces.later))
    weights = 2.0 * coefficients.T[:, None, :] * pieces.first
    within = np.concatenate([pieces.own.real, -pieces.own.imag], axis=1)
    model = np.concatenate([weights.real, weights.imag], axis=-1) @ within.T
    return values[:, pieces.slots].reshape(shape) - model


def _met(pieces: Pieces, residual: Floats) -> tuple[Floats, Floats]:
    """Sums of the products with what is left, and of the products times t (2 products, rows)."""
    n = pieces.own.shape[1]
    timed = pieces.own * pieces.later[:, None]
    products = residual @ np.concatenate([pieces.own.real, pieces.own.imag, timed.real, timed.imag], axis=1)
    plain, moved = (
        products[..., :n] + 1j * products[..., n : 2 * n],
        products[..., 2 * n : 3 * n] + 1j * products[..., 3 * n :],
    )
    seen = np.einsum("rcj,cj->jr", plain, pieces.first)
    late = np.einsum("rcj,cj->jr", moved + pieces.times[:, None] * plain, pieces.first)
    return np.concatenate([seen.real, seen.imag]), np.concatenate([late.real, late.imag])


def _products(pieces: Pieces) -> tuple[Floats, ...]:
    """Sums of the products with each other, times t, and times t² (2 products, 2 products)."""
    sums = []
    for of in (np.conj, np.asarray):  # with the conjugates, and with the products themselves
        within, first = of(pieces.own).T, of(pieces.first).T
        inner = [within @ (pieces.own * pieces.later[:, None] ** power) for power in range(3)]
        outer = [first @ (pieces.first * pieces.times[:, None] ** power) for power in range(3)]
        sums.append(
            (
                inner[0] * outer[0],
                inner[0] * outer[1] + inner[1] * outer[0],
                inner[0] * outer[2] + 2.0 * inner[1] * outer[1] + inner[2] * outer[0],
            )
        )
    return tuple(real_products(*both) for both in zip(*sums, strict=True))
