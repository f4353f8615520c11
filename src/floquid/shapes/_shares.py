r"""Shares of energy in a shape: how much of it is in some of its amplitudes, with deviations and intervals.

Leak, whirl, patterns over blades and participation are all such shares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Mask
from floquid.core import Shape
from floquid.fit import SURE, WITHIN, chi2_limit

INSIDE = 0.95  # the probability that an interval holds its share


@dataclass(frozen=True, slots=True)
class Share:
    """A share of energy, what noise adds on average being taken off; deviation and interval None if not estimated."""

    value: float
    std: float | None = None
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Energies:
    r"""Amplitudes of a mode over the root of all their energy, and their covariance.

    .. math:: v = z / \sqrt{E}, \qquad E = |z|^2 - \mathrm{tr}\, \Sigma_z, \qquad
              \Sigma_v = (I - v v^T)\, \Sigma_z\, (I - v v^T) / E

    z are real parts, then imaginary parts of the amplitudes.
    """

    v: Floats  # (2 amplitudes,)
    covariance: Floats | None  # (2 amplitudes, 2 amplitudes)
    noise: Floats  # what noise adds to the square of each, over E (2 amplitudes,)
    dropped: float = 0.0  # energy of harmonics that the model does not keep, at most, over E
    is_known: bool = True  # the shape is that of one mode, and its energy more than noise

    @staticmethod
    def of(shape: Shape, to: Complexes) -> Energies:
        """The energies of amplitudes, sums of the lines of a `shape` by `to` (amplitudes, channels, harmonics)."""
        amplitudes = np.tensordot(to, shape.values, axes=2)
        z, covariance = np.concatenate([amplitudes.real, amplitudes.imag]), shape.covariance(to)
        noise = np.zeros_like(z) if covariance is None else np.diag(covariance)
        seen, whole = max(float(z @ z), 1e-300), float(z @ z - noise.sum())
        if covariance is None:
            return Energies(z / np.sqrt(seen), None, noise, is_known=bool(z.any()))
        spread = np.sqrt(2.0 * float(np.sum(covariance**2)) + 4.0 * float(z @ covariance @ z))
        known = whole > WITHIN * spread and not shape.is_mixture
        whole = whole if whole > 0.0 else seen
        v = z / np.sqrt(whole)
        along = np.outer(v, covariance @ v)
        moved = covariance - along - along.T + (v @ covariance @ v) * np.outer(v, v)
        dropped = min(1.0, _dropped(shape) * float(noise.sum()) / whole)
        return Energies(v, moved / whole, noise / whole, dropped, known)

    def share(self, inside: Mask) -> Share:
        r"""The share of some amplitudes, `inside` (amplitudes,).

        Of the energy q = \|v\|² of these, or of the others where that is less, mean and variance are known where its
        expected value is a²:

        .. math:: a^2 + \mathrm{tr}\, \Sigma_v, \qquad 2\, \mathrm{tr}\, \Sigma_v^2 + 4 a^2\, u^T \Sigma_v u

        with u the direction seen. The interval holds each a² for which a multiple of a χ² with this mean and variance
        has the energy seen within its middle 95 %. An energy below its expectation under noise alone counts as that.
        """
        kept = np.tile(inside, 2)
        parts = [float(np.sum(self.v[own] ** 2 - self.noise[own])) for own in (kept, ~kept)]
        value = min(max(parts[0], 0.0), 1.0)
        if not self.is_known:  # without motion, half is neither
            return Share(value if self.v.any() else 0.5, None, (0.0, 1.0))
        if self.covariance is None:
            return Share(value)
        turned = parts[1] < parts[0]
        own = ~kept if turned else kept
        v, covariance = self.v[own], self.covariance[np.ix_(own, own)]
        seen, square, across = float(v @ v), float(np.sum(covariance**2)), float(v @ covariance @ v)
        variance = max(2.0 * square, 4.0 * across)  # v holds its own noise: a little on the safe side
        low, high = _interval(seen, float(np.trace(covariance)), square, across / max(seen, 1e-300))
        low, high = min(low, 1.0), min(high, 1.0)
        low, high = (1.0 - high, 1.0 - low) if turned else (low, high)
        interval = low * (1.0 - self.dropped), high + self.dropped * (1.0 - high)
        return Share(value, float(np.sqrt(variance)), interval)


def _dropped(shape: Shape) -> float:
    """The energy that a model may lack at most, over that of the noise of its harmonics: one at either end of them.

    A harmonic is kept where noise alone hardly has as much.
    """
    numbers = 2 * len(shape.channels)
    kept = int((shape.values != 0.0).any(axis=0).sum())
    return 2.0 * chi2_limit(numbers, SURE) / numbers / max(kept, 1)


def _interval(seen: float, noise: float, square: float, across: float) -> tuple[float, float]:
    """Ends of a² for which the energy `seen` is within the middle of its distribution."""
    from scipy.optimize import brentq
    from scipy.special import gammainc

    if not noise > 0.0:
        return seen, seen
    energy = max(seen, noise)

    def below(expected: float, probability: float) -> float:
        mean, variance = expected + noise, 2.0 * square + 4.0 * expected * across
        return float(gammainc(mean**2 / variance, energy * mean / variance)) - probability

    ends = []
    for probability in (0.5 + 0.5 * INSIDE, 0.5 - 0.5 * INSIDE):
        far = energy
        while below(far, probability) > 0.0:
            far *= 2.0
        ends.append(brentq(below, 0.0, far, args=(probability,)) if below(0.0, probability) > 0.0 else 0.0)
    return ends[0], ends[1]
