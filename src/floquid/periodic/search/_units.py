"""Harmonics of all modes as units of one linear problem, swept in and out of its Gram matrix (Beaton 1964)."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.fit import HALF_DIGITS
from floquid.periodic.search._objective import Point
from floquid.search import GAP


class Units:
    """Columns of a fit with wide bands, those of narrower bands among them."""

    def __init__(self, point: Point, wide: Point, bands: Integers | None = None) -> None:
        """Take columns of a `point` with `wide` bands; those in are its own, or the `bands` given."""
        entries = wide.entries
        self._columns, self._sines = entries.columns(), entries.sines()
        self._bands, self._fixed = np.array(point.entries.bands if bands is None else bands), entries.fixed
        # The other half of a real multiplier's shape is its conjugate.
        first = np.where(entries.real, -(entries.half_turns // 2), self._bands[:, 0])
        self._bands[:, 0] = np.maximum(self._bands[:, 0], first)
        self._price = point.price.harmonics(self._sines)
        self._n = len(self._sines)
        self.inside = _within(self._columns.modes, self._columns.harmonics, self._bands)
        self._weights = [1.0 / block.noise**2 for block in point.blocks]
        kept = np.concatenate([np.ones(self._n, bool), self._sines])
        first = np.flatnonzero(np.tile(self.inside, 2) & kept)
        self._tables = [_swept(part.gram, part.coefficients, kept, first) for part in wide.solution.linear]
        self._kept = kept

    def gains(self) -> Floats:
        """Fall of the misfit by each column that is out, rise by each that is in (columns,)."""
        n, total = self._n, np.zeros(self._n)
        place = np.stack([np.arange(n), n + np.arange(n)], axis=1)
        for table, weight in zip(self._tables, self._weights, strict=True):
            pivots = table[place[:, :, None], place[:, None, :]] * np.where(self.inside, -1.0, 1.0)[:, None, None]
            seen = table[:, 2 * n :][place]
            trace, determinant = pivots[:, 0, 0] + pivots[:, 1, 1], np.linalg.det(pivots)
            least = 0.5 * (trace - np.sqrt(np.maximum(trace**2 - 4.0 * determinant, 0.0)))
            safe = least > np.where(self.inside, 0.0, HALF_DIGITS)
            pivots[~safe] = np.eye(2)
            total += np.where(safe, np.einsum("jpr,jpr,r->j", seen, np.linalg.solve(pivots, seen), weight), 0.0)
        return total

    def stepwise(self, *, grow: bool, shrink: bool) -> tuple[float, Integers]:
        """The bands where no harmonic more or less lowers J to first order, and what they lower it by."""
        total, begin, bands = 0.0, self.inside.copy(), self._bands.copy()
        modes, harmonics = self._columns.modes, self._columns.harmonics
        free = ~self._fixed[modes]
        while True:
            gains, (low, high) = self.gains(), bands[modes].T
            # A band ends at its last harmonic and goes on over weak ones: those between are paid for, too.
            beyond = np.maximum(low - harmonics, harmonics - high)
            last = ((harmonics == high) | (harmonics == low)) & (low < high)
            change = np.full(self._n, np.inf)
            if grow:
                out = free & ~self.inside & ~begin & (beyond >= 1) & (beyond <= GAP + 1)
                change[out] = (beyond * self._price - gains)[out]
            if shrink:
                inner = free & self.inside & begin & last
                change[inner] = (gains - self._price)[inner]
            best = int(np.argmin(change)) if self._n else 0
            if not self._n or change[best] > -HALF_DIGITS:
                return total, bands
            mode, harmonic = int(modes[best]), int(harmonics[best])
            if self.inside[best]:
                total += change[best]
                bands[mode] += (1, 0) if harmonic == bands[mode, 0] else (0, -1)
                self._sweep(best)
                continue
            bands[mode] = min(bands[mode, 0], harmonic), max(bands[mode, 1], harmonic)
            for column in np.flatnonzero(_within(modes, harmonics, bands) & (modes == mode) & ~self.inside):
                total += float(self._price[column] - self.gains()[column])
                self._sweep(int(column))

    def _sweep(self, column: int) -> None:
        sign = -1.0 if self.inside[column] else 1.0
        for k in (column, self._n + column):
            if self._kept[k]:
                for table in self._tables:
                    _pivoted(table, k, sign)
        self.inside[column] = not self.inside[column]


def _within(modes: Integers, harmonics: Integers, bands: Integers) -> Mask:
    """Mask of the columns within bands (columns,)."""
    return (harmonics >= bands[modes, 0]) & (harmonics <= bands[modes, 1])


def _swept(gram: Floats, coefficients: Floats, kept: Mask, first: Integers) -> Floats:
    """The table of scaled normal equations with the `first` columns in (columns, columns + rows)."""
    size = np.diag(gram)
    scale = np.sqrt(np.where((size > 0.0) & kept, size, 1.0))
    matrix = gram / np.outer(scale, scale)
    matrix[~kept], matrix[:, ~kept] = 0.0, 0.0
    matrix[~kept, ~kept] = 1.0
    table = np.concatenate([matrix, matrix @ (coefficients * scale[:, None])], axis=1)
    out = np.setdiff1d(np.arange(len(gram)), first)
    inverse = np.linalg.pinv(matrix[np.ix_(first, first)], rcond=1e-12, hermitian=True)
    rows = inverse @ table[first]
    table[out] -= matrix[np.ix_(out, first)] @ rows
    table[np.ix_(out, first)] = rows[:, out].T
    table[first] = rows
    table[np.ix_(first, first)] = -inverse
    return table


def _pivoted(table: Floats, k: int, sign: float) -> None:
    """Sweep one column of a table in (+) or out (-), in place."""
    pivot, column, row = table[k, k], table[:, k].copy(), table[k].copy()
    table -= np.outer(column, row / pivot)
    table[:, k] = sign * column / pivot
    table[k] = sign * row / pivot
    table[k, k] = -1.0 / pivot


def wide_of(point: Point, most: int) -> Point:
    """The point with some harmonics more on each side of every band."""
    return point.with_entries(point.entries.padded(GAP, most))
