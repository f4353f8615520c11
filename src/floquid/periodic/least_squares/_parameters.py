"""Modes with their bands of harmonics, as parameters of a fit: what each real parameter moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.periodic.least_squares._sample_block import EVEN, ODD, ODD_SLOPE, PLAIN, Columns


@dataclass(frozen=True, slots=True)
class Parameters:
    """The real parameters: decays, then the turns of pairs, then the fundamental."""

    weights: Floats  # (parameters, 2 columns)
    turns: Mask  # mask of the frequencies and the fundamental (parameters,)

    def applied(self, coefficients: Floats) -> Floats:
        """The coefficients on the slopes t cos, t sin (parameters, 2 columns, channels): α, β or β, -α."""
        return self.weights[:, :, None] * np.where(self.turns[:, None, None], turned(coefficients), coefficients)


BY_ENTRY = ("exponents", "real", "bands", "offsets", "fixed", "factors")  # fields that have a value an entry


@dataclass(frozen=True, slots=True)
class Rows:
    """Derivatives of the response that a fit is linearised by, each a function of time with coefficients of a column.

    Functions are the columns times t, then the derivatives by q of odd columns. A row of a frequency has the
    coefficients of its column turned: β, -α for α, β.
    """

    functions: Integers  # (rows,)
    columns: Integers  # the column whose coefficients a row has (rows,)
    factors: Floats  # factors of the functions (rows,)
    turned: Mask  # mask of the rows of frequencies (rows,)

    def of_coefficients(self, count: int) -> tuple[Integers, Floats]:
        """Places among 2 `count` coefficients, α then β, of both parts of each row, and their factors (rows, 2)."""
        straight, opposite = self.columns, count + self.columns
        place = np.stack([np.where(self.turned, opposite, straight), np.where(self.turned, straight, opposite)], axis=1)
        signs = np.stack([np.ones(len(self.columns)), np.where(self.turned, -1.0, 1.0)], axis=1)
        return place, signs * self.factors[:, None]


def turned(coefficients: Floats) -> Floats:
    """The coefficients of a slope by frequency from those of the slope by decay: β, -α for α, β (2 columns, …)."""
    n = len(coefficients) // 2
    return np.concatenate([coefficients[n:], -coefficients[:n]])


@dataclass(frozen=True)
class ModeParameters:
    """Modes of a real response, a conjugate pair once, and what is beside them: exponents (entries,), and bands.

    Of a real multiplier, with harmonics m + κ/2, harmonic m is the conjugate of harmonic -κ - m, and those with
    m + κ/2 ≥ 0 are parameters.

    Parameters
    ----------
    exponents
        λ of pairs, the decay alone of real multipliers (entries,) [1/s].
    real
        Whose multiplier is real (entries,).
    bands
        The lowest and highest harmonic of each (entries, 2).
    fundamental
        ω [rad/s].
    offsets
        What is added to the harmonics of each: κ/2 of real multipliers (entries,).
    fixed
        Whose exponents stay: those of the forced response (entries,).
    factors
        What each is multiplied by beside: 1, the time, what follows the speed, or an even or odd function of a pair
        near an axis (entries,). Of such a pair the odd entry follows the even one.
    free_period
        Whether the fundamental is a parameter too.
    squares
        q, the squared half-difference of the exponents of a pair near an axis, the same in both of its entries, zero
        of all others (entries,) [1/s²]; None for no such pair.
    """

    exponents: Complexes
    real: Mask
    bands: Integers
    fundamental: float
    offsets: Floats
    fixed: Mask
    factors: Integers
    free_period: bool = False
    squares: Floats | None = None

    @property
    def all_squares(self) -> Floats:
        """Values of q of all entries, zero of those that are no part of a pair near an axis (entries,)."""
        return np.zeros(len(self.exponents)) if self.squares is None else self.squares

    @property
    def even(self) -> Mask:
        """Mask of the even entries of pairs near an axis (entries,)."""
        return self.factors == EVEN

    @property
    def leading(self) -> Mask:
        """Mask of the entries whose decay is a parameter: of a pair near an axis the even one (entries,)."""
        return ~self.fixed & (self.factors != ODD)

    @cached_property
    def half_turns(self) -> Integers:
        """κ of each real entry, zero for pairs (entries,)."""
        return np.where(self.real, np.rint(2.0 * self.offsets), 0).astype(np.int64)

    @cached_property
    def _members(self) -> tuple[Integers, Integers]:
        """The entry and the harmonic of each column."""
        low, high = self.bands.T
        low = np.where(self.real, np.maximum(low, -(self.half_turns // 2)), low)
        widths = np.maximum(high + 1 - low, 0)
        modes = np.repeat(np.arange(len(low)), widths)
        return modes, np.arange(len(modes)) + (low - np.cumsum(widths) + widths)[modes]

    def columns(self) -> Columns:
        """The columns of the fit."""
        return Columns(self.exponents, self.offsets, self.factors, *self._members, self.fundamental, self.all_squares)

    def with_slopes(self) -> Columns:
        """The columns of the fit, and behind them those that derivatives by q need beside, which are none of the fit.

        Those are the derivatives of the odd columns, and odd columns of harmonics that the even entry alone has.
        """
        plain = self.columns()
        if not self.even.any():
            return plain
        entries, harmonics, factors = plain.modes, plain.harmonics, self.factors[plain.modes]
        odd, beside = np.flatnonzero(factors == ODD), self._even_alone
        count = len(self.exponents)
        both = np.concatenate([entries[odd], entries[beside] + 1])
        return Columns(
            np.concatenate([plain.exponents, plain.exponents]),
            np.concatenate([plain.offsets, plain.offsets]),
            np.concatenate([plain.factors, np.where(plain.factors == ODD, ODD_SLOPE, plain.factors)]),
            np.concatenate([entries, both[: len(odd)] + count, both[len(odd) :]]),
            np.concatenate([harmonics, harmonics[odd], harmonics[beside]]),
            plain.fundamental,
            np.concatenate([plain.squares, plain.squares]),
        )

    @cached_property
    def _even_alone(self) -> Integers:
        """Even columns whose odd entry does not have the harmonic (columns,)."""
        modes, harmonics = self._members
        odd = set(zip(modes.tolist(), harmonics.tolist(), strict=True))
        return np.array(
            [k for k in np.flatnonzero(self.even[modes]) if (int(modes[k]) + 1, int(harmonics[k])) not in odd], np.int64
        )

    @cached_property
    def rows(self) -> Rows:
        """Rows of the linearisation: the decay of each column, the frequency of each, and q of those near an axis."""
        modes, harmonics = self._members
        n, factors = len(modes), self.factors[modes]
        even, odd, beside = np.flatnonzero(factors == EVEN), np.flatnonzero(factors == ODD), self._even_alone
        # ∂C/∂q is half of tS: the odd column of the same harmonic, one of the fit or one beside.
        place = {(int(modes[k]), int(harmonics[k])): int(k) for k in odd}
        place |= {(int(modes[k]) + 1, int(harmonics[k])): n + len(odd) + b for b, k in enumerate(beside)}
        half = np.array([place[int(modes[k]) + 1, int(harmonics[k])] for k in even], np.int64)
        return Rows(
            functions=np.concatenate([np.arange(n), np.arange(n), half, n + np.arange(len(odd))]),
            columns=np.concatenate([np.arange(n), np.arange(n), even, odd]),
            factors=np.concatenate([np.ones(2 * n), np.full(len(even), 0.5), np.ones(len(odd))]),
            turned=np.repeat([False, True, False], [n, n, len(even) + len(odd)]),
        )

    def sines(self) -> Mask:
        """Mask of the columns that have a sine (columns,): not a real multiplier's that does not turn."""
        modes, harmonics = self._members
        return ~(self.real[modes] & (2 * harmonics + self.half_turns[modes] == 0))

    def parameters(self) -> Parameters:
        """Real parameters of a fit without pairs near an axis: decays, frequencies of pairs, the fundamental."""
        columns = self.columns()
        members = (columns.modes == np.arange(len(self.exponents))[:, None]).astype(float)
        rows = [members[~self.fixed], members[~self.fixed & ~self.real]]
        if self.free_period:
            rows.append(columns.turns[None, :])
        weights = np.concatenate(rows)
        turns = np.arange(len(weights)) >= len(rows[0])
        return Parameters(np.concatenate([weights, weights], axis=1), turns)

    @property
    def order(self) -> int:
        """The number of complex poles, conjugates one by one."""
        return int(2 * (~self.fixed).sum() - (~self.fixed & self.real).sum())

    @property
    def alone(self) -> list[int]:
        """Real multipliers without another one on their axis."""
        own = np.flatnonzero(self.leading & self.real & (self.factors == PLAIN))
        axes = self.half_turns[own] % 2
        return [int(k) for k, axis in zip(own, axes, strict=True) if np.sum(axes == axis) == 1]

    def ties(self) -> Floats:
        """Derivatives of `rows` by the parameters (parameters, rows).

        Parameters are decays, frequencies of pairs, q of pairs near an axis, and the fundamental.
        """
        columns = self.columns()
        members = (columns.modes == np.arange(len(self.exponents))[:, None]).astype(float)
        members[:-1][self.even[:-1]] += members[1:][self.even[:-1]]  # both entries of a pair near an axis move together
        n, rows = members.shape[1], len(self.rows.columns)
        squares = members[self.even][:, self.rows.columns[2 * n :]]
        parts = [(members[self.leading], 0), (members[~self.fixed & ~self.real], n), (squares, 2 * n)]
        if self.free_period:
            parts.append((columns.turns[None, :], n))
        derivatives = np.zeros((sum(len(part) for part, _ in parts), rows))
        place = 0
        for part, first in parts:
            derivatives[place : place + len(part), first : first + part.shape[1]] = part
            place += len(part)
        return derivatives

    def moved(self, step: Floats) -> ModeParameters:
        """After a step in the real parameters."""
        moved = np.zeros(len(self.exponents), complex)
        leading, pairs, even = np.flatnonzero(self.leading), np.flatnonzero(~self.fixed & ~self.real), self.even
        decays, turns, near, rest = np.split(step, np.cumsum([len(leading), len(pairs), int(even.sum())]))
        moved[leading] += decays
        moved[pairs] += 1j * turns
        moved[1:][even[:-1]] = moved[:-1][even[:-1]]
        squares = self.squares
        if squares is not None:
            squares = squares.copy()
            squares[even] += near
            squares[1:][even[:-1]] = squares[:-1][even[:-1]]
        turned = float(rest[0]) if self.free_period else 0.0
        return replace(self, exponents=self.exponents + moved, fundamental=self.fundamental + turned, squares=squares)

    def longest(self, step: Floats) -> float:
        """The most that a step moves an exponent, or half a difference of two, over one period."""
        near = np.zeros(len(step), bool)
        first = int(self.leading.sum()) + int((~self.fixed & ~self.real).sum())
        near[first : first + int(self.even.sum())] = True
        size = np.where(near, np.sqrt(np.abs(step)), np.abs(step)).max(initial=0.0)
        return float(size) * 2.0 * np.pi / self.fundamental

    def padded(self, by: int, most: int) -> ModeParameters:
        """With bands of the modes wider `by` harmonics a side, but within `most` fundamentals of the axis."""
        turns = np.rint(self.exponents.imag / self.fundamental + self.offsets).astype(np.int64)
        low = np.maximum(self.bands[:, 0] - by, -most - turns)
        high = np.minimum(self.bands[:, 1] + by, most - turns)
        wider = np.stack([np.minimum(low, self.bands[:, 0]), np.maximum(high, self.bands[:, 1])], 1)
        return replace(self, bands=np.where(self.fixed[:, None], self.bands, wider))

    def picked(self, which: ArrayLike) -> ModeParameters:
        """The entries of these places, `which`, in the order given."""
        places = np.asarray(which, np.int64)
        squares = None if self.squares is None else self.squares[places]
        return replace(self, **{name: getattr(self, name)[places] for name in BY_ENTRY}, squares=squares)

    def joined(self, other: ModeParameters) -> ModeParameters:
        """Join these parameters and then the `other` ones."""
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in BY_ENTRY}
        if self.squares is not None or other.squares is not None:
            both["squares"] = np.concatenate([self.all_squares, other.all_squares])
        return replace(self, **both)

    @staticmethod
    def made(
        exponents: ArrayLike,
        bands: ArrayLike,
        fundamental: float,
        *,
        real: ArrayLike = False,
        offsets: ArrayLike = 0.0,
        fixed: bool = False,
        factor: int = PLAIN,
    ) -> ModeParameters:
        """Mode parameters from `exponents`, `bands` and the `fundamental`, as in the class.

        One pair of ends stands for all bands; `real` and `offsets` may be one for all, `fixed` and `factor` are.
        """
        values = np.array(exponents, complex).reshape(-1)
        n = len(values)
        return ModeParameters(
            exponents=values,
            real=np.broadcast_to(np.asarray(real, bool), n).copy(),
            bands=np.broadcast_to(np.array(bands, np.int64).reshape(-1, 2), (n, 2)).copy(),
            fundamental=fundamental,
            offsets=np.broadcast_to(np.asarray(offsets, float), n).copy(),
            fixed=np.full(n, fixed),
            factors=np.full(n, factor),
        )

    @staticmethod
    def of(model: PeriodicModel) -> ModeParameters:
        """The modes of a `model`, with the bands that it keeps."""
        chosen = list(model.upper_modes)
        real = model.real[chosen]
        kept = (model.coefficients != 0).any(axis=(1, 2))[chosen]
        bands = [(model.harmonics[row][0], model.harmonics[row][-1]) if row.any() else (0, 0) for row in kept]
        values = model.exponents[chosen]
        offsets = np.where(real, 0.5 * np.rint(2.0 * values.imag / model.fundamental), 0.0)
        return ModeParameters.made(
            np.where(real, values.real, values), bands, model.fundamental, real=real, offsets=offsets
        )

    @staticmethod
    def of_terms(known: Estimates, exponents: Complexes | None = None) -> ModeParameters:
        """The modes of the estimates `known`, at `exponents` or their own, with the terms that they have as bands."""
        values = known.exponents if exponents is None else exponents
        terms = [known.harmonics[known.modes == mode] for mode in range(len(values))]
        bands = [(each.min(), each.max()) for each in terms]
        rates, offsets = np.where(known.real, values.real, values), 0.5 * known.half_turns
        return ModeParameters.made(rates, bands, known.fundamental, real=known.real, offsets=offsets)


def forced_entries(turns: Sequence[float], fundamental: float, *, factor: int = 0) -> ModeParameters:
    """Fixed entries of a forced response, one for each of the turns a period."""
    values = np.asarray(turns, float)
    n = len(values)
    return ModeParameters.made(
        np.zeros(n), np.zeros((n, 2)), fundamental, real=values == 0.0, offsets=values, fixed=True, factor=factor
    )
