"""Noise that is coloured along a record as it was sampled, and blocks after the filter that whitens it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats
from floquid.fit import LAGS
from floquid.lifting import filters_of
from floquid.periodic.least_squares._record_block import RecordBlock
from floquid.periodic.least_squares._sample_block import Block, complex_of
from floquid.periodic.least_squares._solver import Solution

FEWEST = 256  # samples of a channel below which noise is not told from what was not fitted


def residual_filter(blocks: Sequence[Block], solution: Solution, *, least: float = 0.0) -> Floats | None:
    """The filter of each channel that whitens what a fit leaves (channels, taps); None where that is white.

    By the Yule-Walker equations for the residual of all hits together; of a wandering speed one for all channels, since
    there the columns themselves go through it. White is what has squared correlations of less than `least` in sum.
    """
    columns = solution.entries.columns()
    sums = np.zeros((1 + max(int(block.rows.max()) for block in blocks), LAGS + 1))
    pairs, numbers = np.zeros(sums.shape), np.zeros(len(sums))
    for block, linear in zip(blocks, solution.linear, strict=True):
        times, residual = block.residual(columns, complex_of(linear.coefficients))
        grid = np.rint((times - times[0]) / np.median(np.diff(times))).astype(np.int64)
        there, values = np.zeros(grid[-1] + 1), np.zeros((len(residual), grid[-1] + 1))
        there[grid], values[:, grid] = 1.0, residual / block.noise[:, None]
        n = len(there)
        for lag in range(min(LAGS, n - 1) + 1):
            sums[block.rows, lag] += np.einsum("rt,rt->r", values[:, : n - lag], values[:, lag:])
            pairs[block.rows, lag] += float(there[: n - lag] @ there[lag:])
        numbers[block.rows] += block.n_samples
    if numbers.min() < FEWEST:
        return None
    correlations = sums / np.maximum(pairs, 1.0)
    if any(block.wanders for block in blocks):
        correlations = np.broadcast_to(correlations.mean(axis=0), correlations.shape)
        numbers = np.full(len(numbers), numbers.sum())
    level = correlations[:, :1]
    correlations = correlations / np.where(level > 0.0, level, 1.0)
    if np.sum(correlations[:, 1:] ** 2, axis=1).max() < least:
        return None
    return filters_of(correlations, numbers)


def through(blocks: Sequence[Block], taps: Floats | None) -> Sequence[Block]:
    """The blocks after a filter of each channel; as they are without one, or where too few samples would be left."""
    after = None if taps is None else filtered_blocks(blocks, taps)
    return blocks if after is None else after


def filtered_blocks(blocks: Sequence[Block], taps: Floats) -> tuple[Block, ...] | None:
    """The blocks after a filter of each channel; None where samples are missing and too few would be left."""
    filtered = [block.filtered(taps[block.rows]) if isinstance(block, RecordBlock) else None for block in blocks]
    return None if any(block is None for block in filtered) else tuple(block for block in filtered if block is not None)
