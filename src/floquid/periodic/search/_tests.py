"""Tests of a fit by one linearisation: harmonics as units (Beaton 1964), equal exponents of a mode, the period."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from floquid._arrays import Floats, Indices, Integers, Mask
from floquid.fit import HALF_DIGITS, LONGEST_STEP, ROUNDING, is_vague, scaled_inverse, score_gain
from floquid.periodic.least_squares import ModeParameters, Solution
from floquid.periodic.search._folds import folds
from floquid.periodic.search._objective import Point, SearchResult
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
        self._near, self._of = folds(point.entries, wanders=point.wanders), point.price
        self.inside = within(self._columns.modes, self._columns.harmonics, self._bands)
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
                change[inner] = (gains - self._price)[inner] + self._spared(inner, bands)
            # Of copies of a mode, which gain alike, the first: rounding does not choose.
            best = int(np.argmax(change <= change.min() + HALF_DIGITS * abs(change.min()))) if self._n else 0
            if not self._n or change[best] > -HALF_DIGITS:
                return total, bands
            mode, harmonic = int(modes[best]), int(harmonics[best])
            if self.inside[best]:
                total += change[best]
                bands[mode] += (1, 0) if harmonic == bands[mode, 0] else (0, -1)
                self._sweep(best)
                continue
            bands[mode] = min(bands[mode, 0], harmonic), max(bands[mode, 1], harmonic)
            for column in np.flatnonzero(within(modes, harmonics, bands) & (modes == mode) & ~self.inside):
                total += float(self._price[column] - self.gains()[column])
                self._sweep(int(column))

    def last(self, modes: Iterable[int]) -> Iterator[tuple[int, int, float]]:
        """The mode and the harmonic at each end of the bands of `modes`, and the change of J without it."""
        columns, bands = self._columns, self._bands
        ends = np.isin(columns.modes, sorted({*modes})) & (np.ptp(bands, axis=1) > 0)[columns.modes]
        ends &= (columns.harmonics == bands[columns.modes, 0]) | (columns.harmonics == bands[columns.modes, 1])
        changes = self.gains()[ends] - self._price[ends] + self._spared(ends, bands)
        yield from zip(columns.modes[ends].tolist(), columns.harmonics[ends].tolist(), changes.tolist(), strict=True)

    def _spared(self, last: Mask, bands: Integers) -> Floats:
        """Part of the price that goes with the last harmonics of bands beside what each costs alone (columns,)."""
        columns = np.flatnonzero(last)
        spared = np.zeros(len(columns))
        if self._near:
            for k, column in enumerate(columns):
                mode, harmonic = self._columns.modes[column], self._columns.harmonics[column]
                fewer = bands.copy()
                fewer[mode] += (1, 0) if harmonic == bands[mode, 0] else (0, -1)
                spared[k] = self._of.spared(self._near, bands) - self._of.spared(self._near, fewer)
        return spared

    def _sweep(self, column: int) -> None:
        sign = -1.0 if self.inside[column] else 1.0
        for k in (column, self._n + column):
            if self._kept[k]:
                for table in self._tables:
                    _pivoted(table, k, sign)
        self.inside[column] = not self.inside[column]


def within(modes: Integers, harmonics: Integers, bands: Integers) -> Mask:
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


def untold(point: Point) -> Indices:
    """Places of the modes whose own information is next to none, except for the last one, which stays."""
    # One that stands still for longer than the record is known if that is: its decay has no share of its own.
    free = np.flatnonzero(point.entries.leading)
    if len(free) < 2:
        return free[:0]
    std = np.sqrt(np.maximum(np.diag(point.solution.covariance()), 0.0))[: len(free)]
    lasting = 1.0 / max(block.last for block in point.blocks)
    return np.asarray(free[is_vague(std, np.maximum(np.abs(point.entries.exponents[free].real), lasting))], np.intp)


def equality(solution: Solution, entry: int, sure: Mask) -> tuple[float, int]:
    """The chi-square of the sure harmonics of a mode having one exponent, and its degrees of freedom (Rao's test)."""
    columns = np.flatnonzero((solution.entries.columns().modes == entry) & sure)
    if len(columns) < 2:
        return 0.0, 0
    gain = _gain(solution, _parted(solution.entries, columns)) - _gain(solution, solution.entries.ties())
    return max(gain, 0.0), 2 * (len(columns) - 1)


def spread_of_harmonics(solution: Solution, entry: int, sure: Mask) -> tuple[float, float]:
    r"""The weighted variance of the exponents that the sure harmonics of a mode ask for, of both parts [1/s²].

    .. math:: s^2 = \sum_m w_m (\lambda_m - \bar\lambda)^2 \Big/ \sum_m w_m, \qquad w_m = 1/\operatorname{var} \lambda_m
    """
    columns = np.flatnonzero((solution.entries.columns().modes == entry) & sure)
    gradient, _, information = solution.by_column.tied(_parted(solution.entries, columns))
    inverse, count = scaled_inverse(information, ROUNDING), len(columns)
    step, variance = inverse @ gradient, np.maximum(np.diag(inverse), 1e-300)
    variances = []
    for part in (slice(-2 * count, -count), slice(-count, None)):
        steps, weight = step[part], 1.0 / variance[part]
        mean = float(steps @ weight / weight.sum())
        variances.append(float((steps - mean) ** 2 @ weight / weight.sum()))
    return variances[0], variances[1]


def _parted(entries: ModeParameters, columns: Indices) -> Floats:
    """The ties of the other modes, then a decay of its own for each of these columns, then a frequency."""
    ties, count = entries.ties(), len(entries.columns().modes)
    rows = np.eye(ties.shape[1])
    others = ties[~ties[:, np.concatenate([columns, count + columns])].any(axis=1)]
    return np.concatenate([others, rows[columns], rows[count + columns]])


def _gain(solution: Solution, ties: Floats) -> float:
    """Reduction of the cost by a Gauss-Newton step of parameters that tie columns as given."""
    gradient, matrix, _ = solution.by_column.tied(ties)
    return score_gain(gradient, matrix, ROUNDING)


def own_step(result: SearchResult) -> tuple[float, float] | None:
    """(own period - T)/T of a result by one step, and its deviation; None where the samples do not tell it."""
    # Free residues of two modes at one exponent tell nothing.
    return result.one.period_step() if result.one is not None and result.twice else period_step(result.solution)


def period_step(solution: Solution) -> tuple[float, float] | None:
    """(own period - T)/T by one step of the fundamental as a further parameter, and its deviation; None if untold."""
    # A real multiplier that is alone on its axis may be a pair beside it, whose lines move together, or one of two,
    # whose slowest line moves alone: neither is a sign of the period.
    entries, columns = solution.entries, solution.entries.columns()
    n = len(columns.modes)
    if entries.free_period or not columns.turns.any():
        return None
    ties = [entries.ties()]
    for entry in entries.alone:
        own = np.flatnonzero(columns.modes == entry)
        slowest = int(own[np.argmin(np.abs(columns.turns[own]))])
        beside = np.zeros((3, ties[0].shape[1]))
        beside[0, n + own] = beside[1, slowest] = beside[2, n + slowest] = 1.0
        ties.append(beside)
    turned = np.zeros((1, ties[0].shape[1]))
    turned[0, n : 2 * n] = columns.turns
    gradient, _, information = solution.by_column.tied(np.concatenate([*ties, turned]))
    others = information[-1, :-1] @ scaled_inverse(information[:-1, :-1], ROUNDING)
    left = float(information[-1, -1] - others @ information[:-1, -1])
    if left <= HALF_DIGITS * information[-1, -1]:
        return None
    std = left**-0.5 / entries.fundamental
    step = float(gradient[-1] - others @ gradient[:-1]) / left
    # Beyond, one linearisation says nothing.
    return (-step / entries.fundamental, std) if 2.0 * np.pi * std < LONGEST_STEP else None
