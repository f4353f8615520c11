"""Fewer responses that say the same: an orthogonal change of outputs, the strongest first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from floquid._checks import integer
from floquid.lti._factor import BLOCK, LARGEST, LEADING, SAFE
from floquid.lti._noise import product_noise
from floquid.lti._types import TimeResponses


def compress(data: TimeResponses, most: int | None = None, *, rank_one: bool = False) -> TimeResponses:
    r"""The principal responses: the weighted responses seen along orthogonal directions of the outputs.

    .. math:: W = \big[\,Y_1/\sigma_1 \;\cdots\; Y_I/\sigma_I\,\big] = U S V^T, \qquad C = U^T W = S V^T

    with a row an output and the inputs side by side in time. The change of outputs Uᵀ is common to all inputs, so C
    holds free responses of the same system, their poles the same. Since WᵀW = CᵀC, sums of squares, the Gram matrix
    over time, the singular values of spectral matrices and the MAC of noise-weighted residues are those of the data.
    20,000 outputs become as many responses as there are samples, at the cost of the Gram matrix.

    The number of responses is only cut below that for what is too large to be held twice, to the leading directions by
    a randomised range finder (Halko, Martinsson and Tropp 2011, algorithm 4.4, one power iteration). A mode can be
    significant and yet lead no direction of its own, when its energy is spread over outputs that are mostly noise.

    Parameters
    ----------
    data
        The responses and their noise.
    most
        The most principal responses; None for as many as there are.
    rank_one
        Keep residues of several inputs of rank one: the weights are then the product of one number an output and one
        an input that is nearest to the noise. Other weights turn the shape of a mode a little with each input.

    Returns
    -------
    TimeResponses
        The principal responses (responses, inputs, samples), in units of the noise of one output. Their `noise` is
        √(outputs/responses) for all, so that the energy of white noise stays what it is; it is exactly white where
        there are no more outputs than samples.

    Raises
    ------
    InputError
        `most` is not a positive integer.
    """
    if most is not None:
        integer(most, "most", "compress", at_least=1)
    if rank_one:
        data = replace_noise(data, product_noise(data.noise))
    width = int(data.lengths.sum())
    whole = min(data.n_outputs, width)
    if whole * width <= LARGEST:
        _, strengths, along = np.linalg.svd(_rows(data, width), full_matrices=False)
        rows = strengths[:, None] * along
    else:
        rows = _leading(data, width, min(most or LEADING, whole))
    rows = rows[:most]
    values = np.zeros((len(rows), data.n_inputs, data.values.shape[2]))
    ends = np.cumsum(data.lengths)
    for i, (end, length) in enumerate(zip(ends, data.lengths, strict=True)):
        values[:, i, :length] = rows[:, end - length : end]
    values.flags.writeable = False
    noise = np.full(values.shape[:2], np.sqrt(data.n_outputs / whole))
    return TimeResponses(values=values, dt=data.dt, noise=noise, lengths=data.lengths)


def replace_noise(data: TimeResponses, noise: NDArray[np.float64]) -> TimeResponses:
    """The same responses with another noise; nothing is copied."""
    return TimeResponses(values=data.values, dt=data.dt, noise=noise, lengths=data.lengths)


def weighted_blocks(data: TimeResponses) -> Iterator[NDArray[np.float64]]:
    """The responses in `data` over their noise, the inputs side by side (outputs, Σ lengths), part by part."""
    step = max(1, BLOCK // int(data.lengths.sum()))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield np.concatenate(
            [data.values[part, i, :length] / data.noise[part, i, None] for i, length in enumerate(data.lengths)], axis=1
        )


def _rows(data: TimeResponses, width: int) -> NDArray[np.float64]:
    """Rows C with CᵀC = WᵀW: the weighted responses, or a triangle where they are more than `width`."""
    if data.n_outputs <= width:
        return np.concatenate(list(weighted_blocks(data)))
    gram = np.zeros((width, width))
    for block in weighted_blocks(data):
        gram += block.T @ block
    if width * np.finfo(float).eps * np.trace(gram) < SAFE * data.n_outputs:
        try:
            return np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64)
        except np.linalg.LinAlgError:  # only for responses of less than full rank
            pass
    triangle = np.zeros((0, width))
    for block in weighted_blocks(data):
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, block]), mode="r"))
    return triangle


def _leading(data: TimeResponses, width: int, rank: int) -> NDArray[np.float64]:
    """The leading principal responses (rank, width)."""
    generator = np.random.default_rng(0)
    sketch = np.zeros((width, rank))
    for block in weighted_blocks(data):
        sketch += block.T @ generator.standard_normal((len(block), rank))
    inner = np.zeros((rank, rank))
    q = sketch
    for _ in range(2):
        q, _ = np.linalg.qr(sketch)
        sketch, inner = np.zeros((width, rank)), np.zeros((rank, rank))
        for block in weighted_blocks(data):
            seen = block @ q
            sketch += block.T @ seen
            inner += seen.T @ seen
    strengths, vectors = np.linalg.eigh(inner)
    return np.sqrt(np.maximum(strengths[::-1], 0.0))[:, None] * (q @ vectors[:, ::-1]).T
