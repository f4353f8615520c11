"""A fit that is done, with what is left beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.periodic.least_squares import Block, Residual, Solution
from floquid.periodic.search._peaks import Peak


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The blocks with the noise that is left, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    solution: Solution
    bands: NDArray[np.int64]
    peak: Peak
    residuals: tuple[Residual, ...]
    """Residual of each block."""
    misfit: float = 1.0
    """The rms of what is left over the level of its noise, the largest of all responses."""
    clusters: tuple[int, ...] = ()
    """The entries whose harmonics do not have one exponent."""
