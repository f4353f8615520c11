"""A set of poles of a real response: conjugate pairs, positive and negative real multipliers, each its own kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask

PAIR, POSITIVE, NEGATIVE = 0, 1, -1  # kinds by the sign of a real multiplier

FASTEST = (-3.0, 2.0)
"""Logarithms of the fastest decay and growth a sample at which a mode differs from a blow to a single sample."""

LARGEST_GROWTH = -0.5 * float(np.log(np.finfo(float).tiny))
"""Logarithm of the growth over a record beyond which squares leave the range of floating point."""


@dataclass(frozen=True, slots=True)
class PoleSet:
    """Logarithms s of the multipliers μ = e^s: `s` (k,) with 0 ≤ Im s ≤ π, and the `kind` (k,) of each.

    A pair stands for s and its conjugate; a positive multiplier has Im s = 0, a negative one Im s = π.
    """

    s: Complexes
    kind: Integers

    @staticmethod
    def empty() -> PoleSet:
        """No poles."""
        return PoleSet(np.zeros(0, complex), np.zeros(0, np.int64))

    @staticmethod
    def from_multipliers(multipliers: Complexes, *, tolerance: float = 1e-9) -> PoleSet:
        """The upper half of a conjugate-symmetric set of multipliers; within `tolerance` of the axis one is real."""
        upper = multipliers[(multipliers.imag >= -tolerance * np.abs(multipliers)) & (np.abs(multipliers) > 0)]
        real = np.abs(upper.imag) <= tolerance * np.abs(upper)
        kind = np.where(real, np.where(upper.real > 0, POSITIVE, NEGATIVE), PAIR)
        s = np.log(np.where(real, upper.real, upper))
        return PoleSet.of(s, kind)

    @staticmethod
    def of(s: Complexes, kind: Integers) -> PoleSet:
        """The set brought to 0 ≤ Im s ≤ π (a pair reflected is the same pair), exact for the real kinds."""
        imag = np.abs(np.mod(s.imag + np.pi, 2.0 * np.pi) - np.pi)
        imag = np.where(kind == POSITIVE, 0.0, np.where(kind == NEGATIVE, np.pi, imag))
        return PoleSet(s.real + 1j * imag, kind.astype(np.int64))

    def __len__(self) -> int:
        return len(self.s)

    @property
    def order(self) -> int:
        """The number of complex poles, one by one; also that of real parameters."""
        return len(self.kind) + int((self.kind == PAIR).sum())

    @property
    def sizes(self) -> Integers:
        """The number of complex poles behind each entry (k,)."""
        return np.where(self.kind == PAIR, 2, 1)

    def full(self) -> Complexes:
        """All logarithms (order,)."""
        return self.with_conjugates(self.s)

    def with_conjugates(self, values: Complexes) -> Complexes:
        """Numbers of the entries (k,) as numbers of the poles (order,): a pair's is followed by its conjugate."""
        parts = [[v, v.conjugate()] if k == PAIR else [v] for v, k in zip(values, self.kind, strict=True)]
        return np.concatenate(parts or [np.zeros(0)]).astype(complex)

    def multipliers(self) -> Complexes:
        """All multipliers (order,), conjugates next to each other; those of real kinds exactly real."""
        mu = np.exp(self.full())
        return np.where(np.repeat(self.kind, self.sizes) == PAIR, mu, np.real(mu))

    def parameter_map(self) -> Complexes:
        """The derivative of `full()` with respect to the real parameters (order, order): Re s, Im s of a pair; Re s."""
        pair, single = np.array([[1.0, 1.0j], [1.0, -1.0j]]), np.array([[1.0 + 0.0j]])
        out = np.zeros((self.order, self.order), complex)
        at = 0
        for kind in self.kind:
            block = pair if kind == PAIR else single
            out[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        return out

    def covariance_of_all(self, own: Floats) -> Floats:
        """The covariance of Re s, then Im s, of all poles (2 order, 2 order), from that of the real parameters."""
        map_ = self.parameter_map()
        stacked = np.concatenate([map_.real, map_.imag])
        return stacked @ own @ stacked.T

    def moved(self, step: Floats) -> PoleSet:
        """The set after a step in its real parameters (order,)."""
        return PoleSet.of(self.s + (self.parameter_map() @ step)[self.starts()], self.kind)

    def starts(self) -> Integers:
        """The position of each entry in `full()` (k,)."""
        return np.cumsum(self.sizes) - self.sizes

    def columns(self) -> tuple[Integers, Integers]:
        """For each position in `full()`, those of the first and of the last pole of its entry (order,) each."""
        starts = self.starts()
        return np.repeat(starts, self.sizes), np.repeat(starts + self.sizes - 1, self.sizes)

    def without(self, index: int) -> PoleSet:
        """The set less one entry."""
        return PoleSet(np.delete(self.s, index), np.delete(self.kind, index))

    def keep(self, mask: Mask) -> PoleSet:
        """The entries where `mask` holds."""
        return PoleSet(self.s[mask], self.kind[mask])

    def plus(self, other: PoleSet) -> PoleSet:
        """The union, entries in order."""
        return PoleSet(np.concatenate([self.s, other.s]), np.concatenate([self.kind, other.kind]))

    def plausible(self) -> PoleSet:
        """The poles that could be seen: those within `FASTEST`."""
        return self.keep((self.s.real > FASTEST[0]) & (self.s.real < FASTEST[1]))

    def normalised(self, shares: Complexes) -> tuple[Complexes, Integers]:
        """Participations in the inputs (k, inputs), the largest of each 1 and those of real poles real; and where."""
        largest = np.argmax(np.abs(shares), axis=1)
        shares = shares / shares[np.arange(len(shares)), largest][:, None]
        return np.where(self.kind[:, None] == PAIR, shares, shares.real), largest


def moved_pole(s: complex, kind: int, step: Floats) -> complex:
    """One pole after a step in its real parameters, brought back to 0 ≤ Im s ≤ π."""
    change = complex(step[0], step[1] if kind == PAIR else 0.0)
    return complex(PoleSet.of(np.array([s + change]), np.array([kind])).s[0])
