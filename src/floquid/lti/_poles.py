r"""Poles of a real response, and what each of them is on the lines of its spectrum, exactly.

The transform of N samples of one mode is the finite sum

.. math:: \sum_{k=0}^{N-1} \mu^k z^{-k} = \frac{1 - \mu^N z^{-N}}{1 - \mu z^{-1}}, \qquad z = e^{i\theta}

and z^N = 1 on the DFT's own lines θ = 2πl/N (Allen 2009, eq. 10, without its approximation). With δ = ln μ - iθ it is
expm1(Nδ)/expm1(δ), which stays exact for a pole on a line.

Lines are kept in a weighted form: divided by the noise and √N, and by 1/√2 except at θ = 0 and π, so that real and
imaginary parts of white noise have unit variance and a sum of squares over the lines is the one over the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats, Integers, Mask
from floquid.lti._types import Composites, ModalModel, TimeResponses

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


ON_A_LINE = float(np.finfo(float).eps ** 0.25)
"""|Nδ| below which the finite sum and its slope are taken from their series: their errors are alike there."""


@dataclass(frozen=True, slots=True)
class Block:
    """The inputs of one length: their numbers, N, weighted lines (lines, outputs, inputs), noise (outputs, inputs)."""

    inputs: Integers
    samples: int
    values: Complexes
    noise: Floats

    @property
    def angles(self) -> Floats:
        """θ of the lines (lines,) [rad/sample]."""
        return 2.0 * np.pi * np.arange(len(self.values)) / self.samples

    @property
    def weights(self) -> Floats:
        """√2 on all lines but the ends (lines,)."""
        return line_weights(self.samples)


def line_weights(samples: int) -> Floats:
    """Weight of a line (lines,): √2 stands for its mirror image too, which the ends do not have."""
    weights = np.full(samples // 2 + 1, np.sqrt(2.0))
    weights[0] = 1.0
    if samples % 2 == 0:
        weights[-1] = 1.0
    return weights


def spectra(data: TimeResponses) -> tuple[Block, ...]:
    """The weighted lines of all responses, one block a distinct length, the longest first."""
    blocks = []
    for length in np.unique(data.lengths)[::-1]:
        inputs = np.flatnonzero(data.lengths == length)
        scaled = data.values[:, inputs, :length] / (data.noise[:, inputs, None] * np.sqrt(length))
        lines = np.fft.rfft(scaled, axis=2) * line_weights(int(length))
        blocks.append(Block(inputs, int(length), np.ascontiguousarray(np.moveaxis(lines, 2, 0)), data.noise[:, inputs]))
    return tuple(blocks)


def finite_sum(s: complex, angles: Floats, samples: int) -> tuple[Complexes, Complexes]:
    """Σ_k μ^k z^-k and Σ_k k μ^k z^-k at the lines (lines,); of a growing mode, both over μ^(N-1)."""
    delta = s - 1j * angles
    delta = delta.real + 1j * (np.mod(delta.imag + np.pi, 2.0 * np.pi) - np.pi)
    growing = s.real > 0
    if growing and s.real * samples > LARGEST_GROWTH:
        below = np.expm1(delta)
        total = (np.exp(s) - np.exp(-(samples - 1) * s)) / below
        # Σ k x^k = (N x^N - x (x^N - 1)/(x - 1)) / (x - 1), everything over x^(N-1); z^N = 1 on the lines.
        return total, (samples * np.exp(s) - np.exp(delta) * total) / below
    shrink = np.exp(-(samples - 1) * s) if growing else 1.0
    near = np.abs(delta) * samples < ON_A_LINE
    safe = np.asarray(np.where(near, -1.0, delta), dtype=np.complex128)
    below = np.expm1(safe)
    total = np.asarray(np.expm1(samples * safe) / below, dtype=np.complex128)
    slope = np.asarray((samples * np.exp(samples * safe) - np.exp(safe) * total) / below, dtype=np.complex128)
    if near.any():
        n, d = float(samples), delta[near]
        total[near] = n + n * (n - 1.0) / 2.0 * d * (1.0 + (2.0 * n - 1.0) * d / 6.0)
        slope[near] = n * (n - 1.0) / 2.0 * (1.0 + (2.0 * n - 1.0) * d / 3.0 + n * (n - 1.0) * d**2 / 4.0)
    return total * shrink, slope * shrink


def mode_columns(s: complex, kind: int, angles: Floats, samples: int, weights: Floats) -> tuple[Complexes, Complexes]:
    """The weighted lines of a mode's real columns, Re and Im μ^k (lines, 1 or 2), and those of k times the columns."""
    scale = weights / np.sqrt(samples)
    if kind != PAIR:
        total, slope = finite_sum(complex(s.real, np.pi if kind == NEGATIVE else 0.0), angles, samples)
        return (scale * total)[:, None], (scale * slope)[:, None]
    upper, lower = finite_sum(s, angles, samples), finite_sum(s.conjugate(), angles, samples)
    pairs = [np.stack([0.5 * (u + v), -0.5j * (u - v)], axis=1) for u, v in zip(upper, lower, strict=True)]
    return scale[:, None] * pairs[0], scale[:, None] * pairs[1]


WHITE = float(np.sqrt(np.pi) / 2.0)
"""The mean magnitude of a spectral line of white noise of unit variance: |z| of a complex normal z with E|z|² = 1."""


def composites(data: TimeResponses, model: ModalModel) -> Composites:
    r"""The composites of the responses in `data`, of their `model` and of the difference.

    .. math:: c(\theta_l) = \frac1{OI} \sum_{o,i} \frac1{\sigma_{oi} \sqrt{N_i}}
              \Big| \sum_{k=0}^{N_i-1} y_{oi}[k]\, e^{-i\theta_l k} \Big|

    With this scale white noise has √π/2 on every line. The model is summed over the same finite record; a shorter
    input is followed by zeros in both. (Allen 2009, section 3.1 and figure 5; Allen and Ginsberg 2006.)
    """
    outputs, inputs, samples = data.values.shape
    lines = samples // 2 + 1
    powers = model.multipliers[:, None] ** np.arange(samples)
    sums = np.zeros((3, lines))
    step = max(1, BLOCK // samples)
    for i, length in enumerate(data.lengths):
        basis = np.fft.fft(powers[:, :length], n=samples)[:, :lines]
        for start in range(0, outputs, step):
            block = slice(start, start + step)
            scale = 1.0 / (data.noise[block, i, None] * np.sqrt(length))
            measured = np.fft.rfft(data.values[block, i, :length], n=samples) * scale
            modelled = (model.residues[:, block, i].T @ basis) * scale
            sums += np.abs([measured, modelled, measured - modelled]).sum(axis=1)
    sums /= outputs * inputs
    return Composites(angles=2.0 * np.pi * np.arange(lines) / samples, data=sums[0], model=sums[1], difference=sums[2])
