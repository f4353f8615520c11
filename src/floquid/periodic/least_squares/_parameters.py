"""Modes with their bands of harmonics, as parameters of a fit: what each real parameter moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.periodic.least_squares._sample_block import PLAIN, Columns


@dataclass(frozen=True, slots=True)
class Parameters:
    """The real parameters: decays, then the turns of pairs, then the fundamental."""

    weights: Floats  # (parameters, 2 columns)
    turns: Mask  # mask of the frequencies and the fundamental (parameters,)

    def applied(self, coefficients: Floats) -> Floats:
        """The coefficients on the slopes t cos, t sin (parameters, 2 columns, channels): α, β or β, -α."""
        return self.weights[:, :, None] * np.where(self.turns[:, None, None], turned(coefficients), coefficients)


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
        What each is multiplied by beside: 1, the time, or what follows the speed (entries,).
    free_period
        Whether the fundamental is a parameter too.
    """

    exponents: Complexes
    real: Mask
    bands: Integers
    fundamental: float
    offsets: Floats
    fixed: Mask
    factors: Integers
    free_period: bool = False

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
        return Columns(self.exponents, self.offsets, self.factors, *self._members, self.fundamental)

    def sines(self) -> Mask:
        """Mask of the columns that have a sine (columns,): not a real multiplier's that does not turn."""
        modes, harmonics = self._members
        return ~(self.real[modes] & (2 * harmonics + self.half_turns[modes] == 0))

    def parameters(self) -> Parameters:
        """Real parameters: decays, frequencies of pairs, the fundamental."""
        columns = self.columns()
        own = (columns.modes == np.arange(len(self.exponents))[:, None]).astype(float)
        rows = [own[~self.fixed], own[~self.fixed & ~self.real]]
        if self.free_period:
            rows.append(columns.turns[None, :])
        weights = np.concatenate(rows)
        turns = np.arange(len(weights)) >= len(rows[0])
        return Parameters(np.concatenate([weights, weights], axis=1), turns)

    def ties(self) -> Floats:
        """Derivatives of the decays and then the frequencies of all columns (parameters, 2 columns)."""
        own = self.parameters()
        weights = own.weights[:, : own.weights.shape[1] // 2]
        return np.concatenate([weights * ~own.turns[:, None], weights * own.turns[:, None]], axis=1)

    def moved(self, step: Floats) -> ModeParameters:
        """After a step in the real parameters."""
        moved = np.zeros(len(self.exponents), complex)
        decays, pairs = np.flatnonzero(~self.fixed), np.flatnonzero(~self.fixed & ~self.real)
        moved[decays] += step[: len(decays)]
        moved[pairs] += 1j * step[len(decays) : len(decays) + len(pairs)]
        turned = float(step[-1]) if self.free_period else 0.0
        return replace(self, exponents=self.exponents + moved, fundamental=self.fundamental + turned)

    def padded(self, by: int, most: int) -> ModeParameters:
        """With bands of the modes wider `by` so many harmonics a side, but within `most` fundamentals of the axis."""
        turns = np.rint(self.exponents.imag / self.fundamental + self.offsets).astype(np.int64)
        low = np.maximum(self.bands[:, 0] - by, -most - turns)
        high = np.minimum(self.bands[:, 1] + by, most - turns)
        wider = np.stack([np.minimum(low, self.bands[:, 0]), np.maximum(high, self.bands[:, 1])], 1)
        return replace(self, bands=np.where(self.fixed[:, None], self.bands, wider))

    def picked(self, which: ArrayLike) -> ModeParameters:
        """The entries of these places, `which`, in the order given."""
        names = ("exponents", "real", "bands", "offsets", "fixed", "factors")
        return replace(self, **{name: getattr(self, name)[np.asarray(which, np.int64)] for name in names})

    def joined(self, other: ModeParameters) -> ModeParameters:
        """These and then the `other` ones."""
        names = ("exponents", "real", "bands", "offsets", "fixed", "factors")
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names}
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
        own = np.array(exponents, complex).reshape(-1)
        n = len(own)
        return ModeParameters(
            exponents=own,
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
        own = model.exponents[chosen]
        offsets = np.where(real, 0.5 * np.rint(2.0 * own.imag / model.fundamental), 0.0)
        return ModeParameters.made(np.where(real, own.real, own), bands, model.fundamental, real=real, offsets=offsets)

    @staticmethod
    def of_terms(known: Estimates, exponents: Complexes | None = None) -> ModeParameters:
        """The modes of the estimates `known`, at `exponents` or their own, with the terms that they have as bands."""
        own = known.exponents if exponents is None else exponents
        terms = [known.harmonics[known.modes == mode] for mode in range(len(own))]
        bands = [(each.min(), each.max()) for each in terms]
        rates, offsets = np.where(known.real, own.real, own), 0.5 * known.half_turns
        return ModeParameters.made(rates, bands, known.fundamental, real=known.real, offsets=offsets)


def forced_entries(turns: Sequence[float], fundamental: float, *, factor: int = 0) -> ModeParameters:
    """Fixed entries of a forced response, one for each of the turns a period."""
    own = np.asarray(turns, float)
    n = len(own)
    return ModeParameters.made(
        np.zeros(n), np.zeros((n, 2)), fundamental, real=own == 0.0, offsets=own, fixed=True, factor=factor
    )
