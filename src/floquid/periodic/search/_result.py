"""The result of a search: the fit with its noise, the bands that are reported, and the residual."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from floquid._arrays import Integers, Mask
from floquid.periodic.least_squares import Block, OneShape, Residual, Solution
from floquid.periodic.search._peaks import Peak


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Hits that do not share their shapes: the mode that differs most, and its difference over its response."""

    exponent: complex
    share: float
    probability: float


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The blocks with the noise of the residual, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    solution: Solution
    bands: Integers
    peak: Peak
    residuals: tuple[Residual, ...]  # residual of each block
    misfit: float = 1.0  # the rms of the residual over the level of its noise, the largest of all channels and hits
    clusters: tuple[int, ...] = ()  # the entries whose harmonics do not have one exponent
    as_read: dict[int, complex] = field(default_factory=dict)  # deviations of exponents near an axis, by entry
    apart: dict[int, float] = field(default_factory=dict)  # of pairs of open kind how far apart both exponents may be
    one: OneShape | None = None  # the same fit with one shape for all hits, where they agree
    disagreement: Disagreement | None = None  # of the hits, where they do not


def kept_with(result: SearchResult, kept: Mask, solution: Solution) -> SearchResult:
    """The result with some entries, and their fit: fixed ones are no parameters, what was added to variances stays."""
    places = tuple(int(kept[:entry].sum()) for entry in result.clusters)
    solution = replace(solution, further=result.solution.further)
    return replace(result, solution=solution, bands=result.bands[kept], clusters=places)
