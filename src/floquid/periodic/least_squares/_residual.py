"""Residual of a fit: its noise, the grids on which its spectrum is searched, and the filter that whitens it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid.fit import LAGS, NOT_WHITE, ROUNDING
from floquid.lifting import filters_of
from floquid.periodic.least_squares._sample_block import Block, complex_of
from floquid.periodic.least_squares._solver import Solution

BANDS = 8  # bands whose median is the level of the noise


@dataclass(frozen=True, slots=True)
class Residual:
    """Residual of one block, on the grid it was sampled on: missing samples are zero."""

    values: Floats  # (rows, grid)
    taken: Integers  # mask of the samples on the grid (samples,)
    step: float  # the sampling interval [s]
    noise: Floats  # the median level over the bands (rows,)
    levels: Floats  # the level of each band (rows, bands)

    @staticmethod
    def of(times: Floats, residual: Floats, least: Floats) -> Residual:
        """From what is left at times [s]; the noise is at least `least` (rows,)."""
        step = float(np.median(np.diff(times)))
        taken = np.rint((times - times[0]) / step).astype(np.int64)
        values = residual
        if len(taken) <= taken[-1]:
            values = np.zeros((len(residual), int(taken[-1]) + 1))
            values[:, taken] = residual
        levels = np.empty((len(values), min(BANDS, values.shape[1] // 2)))
        # A channel at a time: a spectrum of all would be twice as large as they are.
        for row, low in enumerate(least):
            parts = np.array_split(_power(values[row : row + 1], taken)[0], levels.shape[1])
            # The power of a line of white noise is exponentially distributed: its median is ln 2 of its mean.
            levels[row] = np.maximum(np.sqrt([np.median(part) / np.log(2.0) for part in parts]), low)
        return Residual(values, taken, step, np.median(levels, axis=1), levels)

    def level(self) -> Residual:
        """Residual with one level for all bands."""
        return replace(self, levels=np.broadcast_to(self.noise[:, None], self.levels.shape))

    def between(self, rates: Complexes) -> tuple[Floats, Integers]:
        """Level of each band (rows, bands) by lines apart from exponentials `rates` [1/s], and their number (bands,).

        A fit takes noise away where it has exponentials: nearly all of it in a band that is full of them. That has
        the lowest level of its row.
        """
        power, grid = _power(self.values, self.taken), self.values.shape[1] * self.step
        omega = 2.0 * np.pi / grid * np.arange(1, power.shape[1] + 1)
        apart = np.ones(len(omega), bool)
        for rate in rates:
            # A line under Hann's window is two lines wide on each side.
            apart &= np.abs(omega - abs(rate.imag)) > abs(rate.real) + 4.0 * np.pi / grid
        bands = np.array_split(np.arange(len(omega)), min(BANDS, len(omega)))
        kept = [band[apart[band]] for band in bands]
        levels = [
            np.sqrt(np.median(power[:, lines_of_band], axis=1) / np.log(2.0)) if len(lines_of_band) else 0.0
            for lines_of_band in kept
        ]
        full = np.stack([np.broadcast_to(level, len(power)) for level in levels], axis=1)
        return np.maximum(full, self.levels.min(axis=1, keepdims=True)), np.array(
            [len(lines_of_band) for lines_of_band in kept]
        )

    @property
    def span(self) -> float:
        """The time between the first and the last sample [s]."""
        return float(self.taken[-1] - self.taken[0]) * self.step


def _power(values: Floats, taken: Integers) -> Floats:
    """The power of each line but the zeroth under a Hann window (rows, lines)."""
    window = _hann(values.shape[1])
    return squared(np.fft.rfft(values * window, axis=1)[:, 1:]) / np.sum(window[taken] ** 2)


@lru_cache(maxsize=8)
def _hann(samples: int) -> Floats:
    """Hann's window without the zeros at its ends (samples,): as dear as a transform, and asked for again and again."""
    window = np.hanning(samples + 2)[1:-1]
    window.flags.writeable = False
    return window


def squared(lines: NDArray[np.complexfloating]) -> NDArray[np.floating]:
    """Squared sizes of lines, without the roots that `abs` takes."""
    return lines.real**2 + lines.imag**2


def residuals_of(blocks: Sequence[Block], solution: Solution, floor: float = ROUNDING) -> list[Residual]:
    """Residual of each block, its noise at least `least_noise`."""
    columns = solution.entries.columns()
    return [
        Residual.of(*block.residual(columns, complex_of(linear.coefficients)), least)
        for block, linear, least in zip(blocks, solution.linear, least_noise(blocks, solution, floor), strict=True)
    ]


def least_noise(blocks: Sequence[Block], solution: Solution, floor: float) -> list[Floats]:
    """Least noise of each block (rows,): a share of the largest free response, and rounding."""
    columns, least = solution.entries.columns(), []
    fixed = solution.entries.fixed[columns.modes]
    for block, linear in zip(blocks, solution.linear, strict=True):
        free = block.largest
        if fixed.any():
            free = np.abs(block.residual(columns, complex_of(linear.coefficients) * fixed[:, None])[1]).max(axis=1)
        least.append(np.maximum(floor * free, ROUNDING * block.largest))
    return least


def noise_of(blocks: Sequence[Block], solution: Solution, floor: float) -> Floats:
    """The deviation of what is left (channels, hits), at least `least_noise`."""
    noise = noise_left(blocks, solution)
    for block, least in zip(blocks, least_noise(blocks, solution, floor), strict=True):
        noise[block.rows, block.hit] = np.maximum(noise[block.rows, block.hit], least)
    return noise


def noise_left(blocks: Sequence[Block], solution: Solution) -> Floats:
    """The deviation of what is left (channels, hits), corrected for the parameters used."""
    columns = int(solution.entries.sines().sum()) + len(solution.entries.sines())
    squares = np.zeros((1 + max(int(b.rows.max()) for b in blocks), 1 + max(b.hit for b in blocks)))
    free = np.zeros(squares.shape)
    for block, linear in zip(blocks, solution.linear, strict=True):
        squares[block.rows, block.hit] += linear.left
        free[block.rows, block.hit] += max(block.n_samples - columns, 1)
    # Sums over all samples less those over missing ones may round to less than nothing.
    return np.sqrt(np.maximum(squares, 0.0) / np.maximum(free, 1.0))


def residual_filter(blocks: Sequence[Block], solution: Solution) -> Floats | None:
    """The filter of each channel that whitens what a fit leaves (channels, taps); None where that is white.

    By the Yule-Walker equations for the residual of all hits together; of a wandering speed one for all channels, since
    there the columns themselves go through it. White is what has squared correlations of less than `NOT_WHITE` in sum.
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
    correlations = sums / np.maximum(pairs, 1.0)
    if any(block.wanders for block in blocks):
        correlations = np.broadcast_to(correlations.mean(axis=0), correlations.shape)
        numbers = np.full(len(numbers), numbers.sum())
    level = correlations[:, :1]
    correlations = correlations / np.where(level > 0.0, level, 1.0)
    if np.sum(correlations[:, 1:] ** 2, axis=1).max() < NOT_WHITE:
        return None
    return filters_of(correlations, numbers)


def through(blocks: Sequence[Block], taps: Floats | None) -> Sequence[Block]:
    """The blocks after a filter of each channel; as they are without one, or where too few samples would be left."""
    after = None if taps is None else filtered_blocks(blocks, taps)
    return blocks if after is None else after


def filtered_blocks(blocks: Sequence[Block], taps: Floats) -> tuple[Block, ...] | None:
    """The blocks after a filter of each channel; None where samples are missing and too few would be left."""
    filtered = [block.filtered(taps[block.rows]) for block in blocks]
    return None if any(block is None for block in filtered) else tuple(block for block in filtered if block is not None)
