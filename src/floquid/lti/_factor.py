r"""Factors of the Gram matrix over time: all that separable least squares needs of the data.

With unit noise and free residues the cost of a set of poles is tr((I - P) Y Yᵀ), one column of Y a response
(`errata.md`, "What makes it scale"). A factor F with F Fᵀ = Y Yᵀ stands for Y: Y itself where it has few columns, and
otherwise a triangular one, from a Gram matrix that is summed over blocks of outputs. No whole copy of the data is made.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.lti._types import TimeResponses

BLOCK = 2**20
"""The most numbers that are scaled at once."""

LARGEST = 2**22
"""The most numbers that a factor may hold; beyond, it is made of leading directions."""

LEADING = 192
"""How many leading directions then."""

SAFE = 1e-4
"""The share of the noise that rounding in a squared matrix may reach before the triangular factor is made by
orthogonal steps, which cost four times as much."""


@dataclass(frozen=True, slots=True)
class Factor:
    """One block of responses of equal length: `values` F (samples, rank) with F Fᵀ = Y Yᵀ, from `columns` responses."""

    values: NDArray[np.float64]
    columns: int
    energy: float
    triangular: bool = False

    @staticmethod
    def of(values: NDArray[np.float64], columns: int, *, triangular: bool = False) -> Factor:
        """The block with its energy ||F||²."""
        return Factor(values, columns, float(np.einsum("ij,ij->", values, values)), triangular)

    def cut(self, samples: int) -> Factor:
        """The same block's first samples."""
        if samples >= len(self.values):
            return self
        rank = samples if self.triangular else self.values.shape[1]
        part = Factor.of(self.values[:samples, :rank], self.columns, triangular=self.triangular)
        # What leading directions leave out is noise, as much at one time as at another.
        left_out = self.energy - float(np.einsum("ij,ij->", self.values, self.values))
        return replace(part, energy=part.energy + left_out * samples / len(self.values))


def scaled_blocks(data: TimeResponses, inputs: NDArray[np.int64], samples: int) -> Iterator[NDArray[np.float64]]:
    """The first `samples` of these inputs over their noise (outputs, samples), some outputs at a time."""
    step = max(1, BLOCK // samples)
    for i in inputs:
        for start in range(0, data.n_outputs, step):
            part = slice(start, start + step)
            yield data.values[part, i, :samples] / data.noise[part, i, None]


def energies(data: TimeResponses) -> NDArray[np.float64]:
    """The sum of squares over the noise at each sample (samples,)."""
    total = np.zeros(data.values.shape[2])
    for i, length in enumerate(data.lengths):
        for block in scaled_blocks(data, np.array([i]), int(length)):
            total[:length] += np.einsum("ok,ok->k", block, block)
    return total


def factors(data: TimeResponses, samples: int | None = None) -> tuple[Factor, ...]:
    """One factor for each length, of at most `samples` samples, the longest first."""
    ends = np.minimum(data.lengths, samples or data.values.shape[2])
    return tuple(_factor(data, np.flatnonzero(ends == end), int(end)) for end in np.unique(ends)[::-1])


def factor(responses: NDArray[np.float64]) -> Factor:
    """The factor of responses Y (samples, columns) of unit noise."""
    return factors(TimeResponses(values=responses.T[:, None], dt=1.0))[0]


def _factor(data: TimeResponses, inputs: NDArray[np.int64], samples: int) -> Factor:
    columns = data.n_outputs * len(inputs)
    if min(columns, samples) * samples > LARGEST:
        return _leading(data, inputs, samples)
    if columns <= samples:
        whole = np.empty((samples, columns))
        at = 0
        for block in scaled_blocks(data, inputs, samples):
            whole[:, at : at + len(block)] = block.T
            at += len(block)
        return Factor.of(whole, columns)
    gram = np.zeros((samples, samples))
    for block in scaled_blocks(data, inputs, samples):
        gram += block.T @ block
    if samples * np.finfo(float).eps * np.trace(gram) < SAFE * columns:
        try:
            return Factor.of(np.asarray(np.linalg.cholesky(gram), np.float64), columns, triangular=True)
        except np.linalg.LinAlgError:
            pass
    right = np.zeros((0, samples))
    for block in scaled_blocks(data, inputs, samples):
        right = np.asarray(np.linalg.qr(np.concatenate([right, block]), mode="r"))
    return Factor.of(np.ascontiguousarray(right.T), columns, triangular=True)


def _leading(data: TimeResponses, inputs: NDArray[np.int64], samples: int) -> Factor:
    """The leading directions of responses too many and too long to be held twice, by a randomised range finder.

    N. Halko, P. G. Martinsson and J. A. Tropp, "Finding structure with randomness", SIAM Review 53(2), 2011, algorithm
    4.4, one power iteration. What is left out holds noise; its energy is counted all the same.
    """
    columns = data.n_outputs * len(inputs)
    rank = min(LEADING, samples, columns)
    generator = np.random.default_rng(0)
    sketch, energy = np.zeros((samples, rank)), 0.0
    for block in scaled_blocks(data, inputs, samples):
        sketch += block.T @ generator.standard_normal((len(block), rank))
        energy += float(np.einsum("ok,ok->", block, block))
    q, _ = np.linalg.qr(sketch)
    powered = np.zeros((samples, rank))
    for block in scaled_blocks(data, inputs, samples):
        powered += block.T @ (block @ q)
    q, _ = np.linalg.qr(powered)
    inner = np.zeros((rank, rank))
    for block in scaled_blocks(data, inputs, samples):
        seen = block @ q
        inner += seen.T @ seen
    values, vectors = np.linalg.eigh(inner)
    return Factor(q @ (vectors * np.sqrt(np.maximum(values, 0.0))), columns, energy)
