r"""Spectra of finite free responses, and what one mode is on their lines, exactly.

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

from floquid._arrays import BLOCK, Complexes, Floats, Integers
from floquid.lti._poles import LARGEST_GROWTH, NEGATIVE, PAIR
from floquid.lti._types import Composites, ModalModel, TimeResponses

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
