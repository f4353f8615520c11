r"""Fewer numbers that say the same: factors of the Gram matrix over time, and principal responses.

With unit noise and free residues the cost of a set of poles is tr((I - P) Y Yᵀ), one column of Y a response.
A factor F with F Fᵀ = Y Yᵀ stands for Y: Y itself where it has few columns, and
otherwise a triangular one, from a Gram matrix that is summed over blocks of outputs. No whole copy of the data is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import BLOCK, Floats, Integers
from floquid.fit import ROUNDING
from floquid.lti._types import TimeResponses

Rows = Callable[[], Iterator[Floats]]  # the rows of a matrix W (rows, width), some at a time, as often as it is asked

LARGEST = 2**22  # the most numbers that a factor may hold; beyond, it is made of leading directions
LEADING = 192  # number of leading directions then

SHORT = 600
"""Samples up to which a record is looked at whole: enough to tell white noise, few enough for a Gram matrix."""


@dataclass(frozen=True, slots=True)
class Factor:
    """One block of responses of equal length: `values` F (samples, rank) with F Fᵀ = Y Yᵀ, from `columns` responses.

    `taken` are functions of time that were taken off the responses (samples, functions), if any were.
    """

    values: Floats
    columns: int
    energy: float
    triangular: bool = False
    taken: Floats | None = None

    @staticmethod
    def of(values: Floats, columns: int, *, triangular: bool = False) -> Factor:
        """The block with its energy ||F||²."""
        return Factor(values, columns, float(np.einsum("ij,ij->", values, values)), triangular)

    @property
    def left_out(self) -> float:
        """Energy beside the leading directions: that of noise, as much at one time as at another."""
        return self.energy - float(np.einsum("ij,ij->", self.values, self.values))

    def cut(self, samples: int) -> Factor:
        """First samples of the block."""
        if samples >= len(self.values):
            return self
        rank = samples if self.triangular else self.values.shape[1]
        part = Factor.of(self.values[:samples, :rank], self.columns, triangular=self.triangular)
        taken = None if self.taken is None else self.taken[:samples]
        return replace(part, energy=part.energy + self.left_out * samples / len(self.values), taken=taken)


def scaled_blocks(data: TimeResponses, inputs: Integers, samples: int) -> Iterator[Floats]:
    """The first `samples` of these inputs over their noise (outputs, samples), some outputs at a time."""
    step = max(1, BLOCK // samples)
    for i in inputs:
        for start in range(0, data.n_outputs, step):
            part = slice(start, start + step)
            yield data.values[part, i, :samples] / data.noise[part, i, None]


def weighted_blocks(data: TimeResponses) -> Iterator[Floats]:
    """The responses in `data` over their noise, the inputs side by side (outputs, Σ lengths), part by part."""
    step = max(1, BLOCK // int(data.lengths.sum()))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield np.concatenate(
            [data.values[part, i, :length] / data.noise[part, i, None] for i, length in enumerate(data.lengths)], axis=1
        )


def energies(data: TimeResponses) -> Floats:
    """The sum of squares over the noise at each sample (samples,)."""
    total = np.zeros(data.values.shape[2])
    for i, length in enumerate(data.lengths):
        for block in scaled_blocks(data, np.array([i]), int(length)):
            total[:length] += np.einsum("ok,ok->k", block, block)
    return total


def energetic_length(energy: Floats, data: TimeResponses) -> int:
    """The samples to look at first: all of a short record; of a long one, those before the energy meets its floor."""
    whole = len(energy)
    if whole <= SHORT:
        return whole
    width = whole // 20
    blocks = energy[: width * 20].reshape(20, width).mean(axis=1)
    columns = data.n_outputs * data.n_inputs
    quiet = blocks < blocks.min() * (1.0 + 6.0 * np.sqrt(2.0 / (width * columns))) * 1.02
    loud = np.flatnonzero(~quiet)
    return min(whole, max(SHORT, int(np.ceil(1.5 * width * (loud[-1] + 1))))) if len(loud) else whole


def product_noise(noise: Floats) -> Floats:
    """The product of one number an output and one an input nearest to `noise` (outputs, inputs), in logarithms."""
    logs = np.log(noise)
    return np.exp(logs.mean(axis=1, keepdims=True) + logs.mean(axis=0) - logs.mean())


def factors(data: TimeResponses, samples: int | None = None) -> tuple[Factor, ...]:
    """One factor for each length, of at most `samples` samples, the longest first."""
    ends = np.minimum(data.lengths, samples or data.values.shape[2])
    found = (_factor(data, np.flatnonzero(ends == end), int(end)) for end in np.unique(ends)[::-1])
    return tuple(replace(each, taken=None if data.taken is None else data.taken[: len(each.values)]) for each in found)


def factor(responses: Floats) -> Factor:
    """The factor of responses Y (samples, columns) of unit noise."""
    return factors(TimeResponses(values=responses.T[:, None], dt=1.0))[0]


def _factor(data: TimeResponses, inputs: Integers, samples: int) -> Factor:
    columns = data.n_outputs * len(inputs)

    def rows() -> Iterator[Floats]:
        return scaled_blocks(data, inputs, samples)

    if min(columns, samples) * samples > LARGEST:
        values, energy = _leading(rows, samples, min(LEADING, samples, columns))
        return Factor(values, columns, energy)
    if columns <= samples:
        whole = np.empty((samples, columns))
        at = 0
        for block in rows():
            whole[:, at : at + len(block)] = block.T
            at += len(block)
        return Factor.of(whole, columns)
    return Factor.of(_triangular(rows, samples, columns), columns, triangular=True)


def is_safe(width: int, energy: float, count: float) -> bool:
    """True where rounding in a matrix of squares (width, width) stays below `count` rows of unit noise."""
    return width * ROUNDING * energy < count


def _triangular(rows: Rows, width: int, count: int) -> Floats:
    """Triangular F (width, width) with F Fᵀ = WᵀW, of `count` rows of unit noise that are more than `width`."""
    gram = np.zeros((width, width))
    for block in rows():
        gram += block.T @ block
    # Orthogonal steps cost four times as much: they are for data whose rounding, once squared, reaches the noise.
    if is_safe(width, float(np.trace(gram)), count):
        try:
            return np.asarray(np.linalg.cholesky(gram), np.float64)
        except np.linalg.LinAlgError:  # only for responses of less than full rank
            pass
    right = np.zeros((0, width))
    for block in rows():
        right = np.asarray(np.linalg.qr(np.concatenate([right, block]), mode="r"))
    return np.ascontiguousarray(right.T)


def _leading(rows: Rows, width: int, rank: int) -> tuple[Floats, float]:
    """The leading part of F (width, rank), the weakest first, and ||W||², of rows that cannot be held twice."""
    # N. Halko, P. G. Martinsson and J. A. Tropp, "Finding structure with randomness", SIAM Review 53(2), 2011,
    # algorithm 4.4, one power iteration. What is left out holds noise; its energy is counted all the same.
    generator = np.random.default_rng(0)
    sketch, energy = np.zeros((width, rank)), 0.0
    for block in rows():
        sketch += block.T @ generator.standard_normal((len(block), rank))
        energy += float(np.einsum("ok,ok->", block, block))
    q, _ = np.linalg.qr(sketch)
    powered = np.zeros((width, rank))
    for block in rows():
        powered += block.T @ (block @ q)
    q, _ = np.linalg.qr(powered)
    inner = np.zeros((rank, rank))
    for block in rows():
        seen = block @ q
        inner += seen.T @ seen
    values, vectors = np.linalg.eigh(inner)
    return q @ (vectors * np.sqrt(np.maximum(values, 0.0))), energy


def compress(data: TimeResponses, *, rank_one: bool = False) -> TimeResponses:
    r"""The principal responses: the weighted responses seen along orthogonal directions of the outputs.

    .. math:: W = \big[\,Y_1/\sigma_1 \;\cdots\; Y_I/\sigma_I\,\big] = U S V^T, \qquad C = U^T W = S V^T

    with a row an output and the inputs side by side in time. The change of outputs Uᵀ is common to all inputs, so C
    holds free responses of the same system, their poles the same. Since WᵀW = CᵀC, sums of squares and the Gram matrix
    over time are those of the data. So are singular values of spectral matrices and the MAC of noise-weighted residues.
    20,000 outputs become as many responses as there are samples, at the cost of the Gram matrix.

    For what is too large to be held twice, the number of responses is cut to the leading directions by a randomised
    range finder (Halko, Martinsson and Tropp 2011, algorithm 4.4, one power iteration). A mode can be significant and
    yet lead no direction of its own, when its energy is spread over outputs that are mostly noise.

    They are (responses, inputs, samples) in units of the noise of one output. `noise` is √(outputs/responses) for all,
    so that the energy of white noise stays what it is; it is exactly white if there are no more outputs than samples.

    `data` are the responses and their noise. With `rank_one` residues of several inputs stay of rank one: the weights
    are then the product of one number an output and one an input that is nearest to the noise. Other weights turn the
    shape of a mode a little with each input.
    """
    if rank_one:
        data = TimeResponses(values=data.values, dt=data.dt, noise=product_noise(data.noise), lengths=data.lengths)

    def blocks() -> Iterator[Floats]:
        return weighted_blocks(data)

    width = int(data.lengths.sum())
    whole = min(data.n_outputs, width)
    if whole * width <= LARGEST:
        few = data.n_outputs <= width
        rows = np.concatenate(list(blocks())) if few else _triangular(blocks, width, data.n_outputs).T
        _, strengths, along = np.linalg.svd(rows, full_matrices=False)
        rows = strengths[:, None] * along
    else:
        rows = _leading(blocks, width, min(LEADING, whole))[0].T[::-1]
    values = np.zeros((len(rows), data.n_inputs, data.values.shape[2]))
    ends = np.cumsum(data.lengths)
    for i, (end, length) in enumerate(zip(ends, data.lengths, strict=True)):
        values[:, i, :length] = rows[:, end - length : end]
    values.flags.writeable = False
    noise = np.full(values.shape[:2], np.sqrt(data.n_outputs / whole))
    return TimeResponses(values=values, dt=data.dt, noise=noise, lengths=data.lengths)
