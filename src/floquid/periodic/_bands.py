"""Modes with their bands of harmonics, as parameters of a fit: what each real parameter moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.periodic._sums import Columns


@dataclass(frozen=True, slots=True)
class Parameters:
    """The real parameters: decays, then the turns of pairs.

    A parameter multiplies the coefficient on each column by its weight; a turn also takes the cosine to the sine.
    """

    weights: NDArray[np.float64]
    """(parameters, 2 columns)."""
    turns: NDArray[np.bool_]
    """Which of them turn (parameters,)."""

    def applied(self, coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        """The coefficients on the slopes t cos, t sin (parameters, 2 columns, channels): α, β or β, -α."""
        turned = _turned(coefficients)
        return self.weights[:, :, None] * np.where(self.turns[:, None, None], turned, coefficients)

    def spread(self, curvature: NDArray[np.float64], inverse: NDArray[np.float64]) -> NDArray[np.float64]:
        """What noise on the coefficients, of covariance `inverse`, adds to the Gauss-Newton matrix."""
        total = np.zeros((len(self.turns), len(self.turns)))
        half = {False: inverse, True: _turned(inverse)}
        for one in (False, True):
            for other in (False, True):
                both = half[one] if not other else _turned(half[one].T).T
                rows, columns = self.turns == one, self.turns == other
                total[np.ix_(rows, columns)] = self.weights[rows] @ (curvature * both) @ self.weights[columns].T
        return total


def _turned(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    cosines, sines = np.split(coefficients, 2)
    return np.concatenate([sines, -cosines])


@dataclass(frozen=True, slots=True)
class Entries:
    """Modes of a real response, a conjugate pair once: exponents (entries,), whether real, and bands.

    Of a real multiplier, on the branch of κ half fundamentals, harmonic m is the conjugate of harmonic -κ - m, and
    those with m + κ/2 ≥ 0 are parameters.
    """

    exponents: NDArray[np.complex128]
    real: NDArray[np.bool_]
    bands: NDArray[np.int64]
    """The lowest and highest harmonic of each (entries, 2)."""
    fundamental: float

    @property
    def half_turns(self) -> NDArray[np.int64]:
        """κ of each real entry, zero for pairs (entries,)."""
        return np.where(self.real, np.rint(2.0 * self.exponents.imag / self.fundamental), 0).astype(np.int64)

    def _members(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The entry and the harmonic of each column."""
        modes, harmonics = [], []
        for entry, (low, high) in enumerate(self.bands):
            band = np.arange(low, high + 1)
            if self.real[entry]:
                band = band[2 * band + self.half_turns[entry] >= 0]
            modes.append(np.full(len(band), entry))
            harmonics.append(band)
        empty = [np.zeros(0, np.int64)]
        return np.concatenate(modes or empty), np.concatenate(harmonics or empty)

    def columns(self) -> Columns:
        """The columns of the fit."""
        return Columns(self.exponents, *self._members())

    def sines(self) -> NDArray[np.bool_]:
        """Which columns have a sine (columns,): not a real multiplier's that does not turn."""
        modes, harmonics = self._members()
        return ~(self.real[modes] & (2 * harmonics + self.half_turns[modes] == 0))

    def parameters(self) -> Parameters:
        """What the real parameters move."""
        modes, _ = self._members()
        own = (modes == np.arange(len(self.exponents))[:, None]).astype(float)
        weights = np.concatenate([own, own[~self.real]])
        turns = np.arange(len(weights)) >= len(own)
        return Parameters(np.concatenate([weights, weights], axis=1), turns)

    def moved(self, step: NDArray[np.float64]) -> Entries:
        """After a step in the real parameters."""
        n = len(self.exponents)
        turned = np.zeros(n)
        turned[~self.real] = step[n:]
        return replace(self, exponents=self.exponents + step[:n] + 1j * turned)

    def padded(self, by: int, most: int) -> Entries:
        """With wider bands, but within half the samples of a period of the axis."""
        turns = np.rint(self.exponents.imag / self.fundamental).astype(np.int64)
        low = np.maximum(self.bands[:, 0] - by, -most - turns)
        high = np.minimum(self.bands[:, 1] + by, most - turns)
        return replace(self, bands=np.stack([np.minimum(low, self.bands[:, 0]), np.maximum(high, self.bands[:, 1])], 1))

    @staticmethod
    def of(model: PeriodicModel) -> Entries:
        """Those of a model, with the bands that it keeps."""
        chosen = upper(model)
        real = np.array([is_real(model, r) for r in chosen], bool)
        kept = (model.coefficients != 0).any(axis=(1, 2))[chosen]
        bands = [(model.harmonics[row][0], model.harmonics[row][-1]) if row.any() else (0, 0) for row in kept]
        return Entries(model.exponents[chosen], real, np.array(bands, np.int64).reshape(-1, 2), model.fundamental)


def is_real(model: PeriodicModel, mode: int) -> bool:
    """Whether a mode is its own conjugate: its multiplier is real, and it is listed once."""
    twice = 2.0 * model.exponents[mode].imag / model.fundamental
    alone = not (np.delete(model.exponents, mode) == model.exponents[mode].conj()).any()
    return alone and abs(twice - round(twice)) < 1e-9


def upper(model: PeriodicModel) -> list[int]:
    """One mode of each pair, that of positive imaginary part, and all real ones."""
    return [r for r in range(model.order) if is_real(model, r) or model.exponents[r].imag > 0]
