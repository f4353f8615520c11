"""What a fit leaves of the samples: its noise, and the grids on which its spectrum is searched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.periodic._blocks import Block, complex_of
from floquid.periodic._constrained import Held
from floquid.periodic._peaks import Rest

FLOOR = 1e-12
"""The share of the largest free response that the noise is taken to be at least, unless told."""

ROUNDING = 1e-13
"""The share of a channel's largest value below which what is left of it is rounding."""


def rests_of(blocks: Sequence[Block], held: Held, floor: float = FLOOR) -> list[Rest]:
    """What a fit leaves of each block, its noise at least `least_noise`."""
    columns = held.entries.columns()
    return [
        Rest.of(*block.rest(columns, complex_of(linear.coefficients)), least)
        for block, linear, least in zip(blocks, held.linear, least_noise(blocks, held, floor), strict=True)
    ]


def least_noise(blocks: Sequence[Block], held: Held, floor: float) -> list[NDArray[np.float64]]:
    """What the noise of each block is at least (rows,): a share of the largest free response, and rounding."""
    columns, least = held.entries.columns(), []
    fixed = held.entries.fixed[columns.modes]
    for block, linear in zip(blocks, held.linear, strict=True):
        free = block.largest
        if fixed.any():
            free = np.abs(block.rest(columns, complex_of(linear.coefficients) * fixed[:, None])[1]).max(axis=1)
        least.append(np.maximum(floor * free, ROUNDING * block.largest))
    return least


def noise_of(blocks: Sequence[Block], held: Held, floor: float) -> NDArray[np.float64]:
    """The deviation of what is left (channels, hits), at least `least_noise`."""
    noise = noise_left(blocks, held)
    for block, least in zip(blocks, least_noise(blocks, held, floor), strict=True):
        noise[block.rows, block.hit] = np.maximum(noise[block.rows, block.hit], least)
    return noise


def noise_left(blocks: Sequence[Block], found: Held) -> NDArray[np.float64]:
    """The deviation of what is left (channels, hits), corrected for the parameters used."""
    columns = int(found.entries.sines().sum()) + len(found.entries.sines())
    squares = np.zeros((1 + max(int(b.rows.max()) for b in blocks), 1 + max(b.hit for b in blocks)))
    free = np.zeros(squares.shape)
    for block, linear in zip(blocks, found.linear, strict=True):
        squares[block.rows, block.hit] += linear.left
        free[block.rows, block.hit] += max(block.n_samples - columns, 1)
    return np.sqrt(squares / np.maximum(free, 1.0))
