"""A fit that is done, with what is left beside it."""

from __future__ import annotations

from dataclasses import dataclass

from floquid._arrays import Integers
from floquid.periodic.least_squares import Block, Residual, Solution
from floquid.periodic.search._peaks import Peak


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The blocks with the noise that is left, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    solution: Solution
    bands: Integers
    peak: Peak
    residuals: tuple[Residual, ...]  # residual of each block
    misfit: float = 1.0  # the rms of what is left over the level of its noise, the largest of all responses
    clusters: tuple[int, ...] = ()  # the entries whose harmonics do not have one exponent
