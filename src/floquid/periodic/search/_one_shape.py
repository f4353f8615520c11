"""One shape for all hits after a search with residues free in each: taken where the hits agree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes
from floquid.errors import IdentificationError
from floquid.periodic.expansion import GAP
from floquid.periodic.least_squares import (
    Block,
    ModeParameters,
    OneShape,
    eliminated,
    least_noise,
    linearise,
    residuals_of,
)
from floquid.periodic.search._additions import EXPECTED
from floquid.periodic.search._final import LOOSE
from floquid.periodic.search._objective import FARTHEST
from floquid.periodic.search._peaks import strongest
from floquid.periodic.search._result import Disagreement, SearchResult

QUIET = 1e-4
"""The noise over the largest value below which hits are not said to disagree: a weak nonlinearity does that."""

GROWTHS = 8  # harmonics on each side by which bands may grow beyond those of the start
ROUNDS = 3  # fits, each with the noise that the one before it leaves: weights settle at once


def with_one_shape(found: SearchResult, false_alarm: float) -> SearchResult:
    r"""The result with one shape for all hits, if noise explains what that leaves more; else how much they differ.

    .. math:: \Delta\chi^2 \sim \chi^2_n, \qquad n = n_{\text{free residues}} - n_{\text{shapes}} - n_{\text{states}}

    Pairs near an axis keep free residues: their functions are no exponentials.
    """
    entries = found.solution.entries
    hits = {block.hit for block in found.blocks}
    if len(hits) < 2 or found.as_read or not (~entries.fixed).any():
        return found
    with suppress(IdentificationError, np.linalg.LinAlgError):
        one = OneShape.at(found.blocks, entries, found.solution.linear).solved()
        probability = one.agreement(found.solution.cost)
        away = np.abs(one.entries.exponents - entries.exponents) * 2.0 * np.pi / entries.fundamental
        if probability > false_alarm and (away < FARTHEST).all():
            return replace(found, one=one)
        if all((block.noise < QUIET * block.largest).all() for block in found.blocks):
            return found
        entry, share = one.difference()
        value = complex(entries.exponents[entry] + 1j * entries.fundamental * entries.offsets[entry])
        return replace(found, disagreement=Disagreement(value, share, probability))
    return found


def of_shapes(
    blocks: Sequence[Block], entries: ModeParameters, values: Sequence[Complexes], floor: float, most: int
) -> SearchResult:
    """The fit of one shape for all hits, from coefficients of each block, with the harmonics that noise does not explain.

    Hits that are over in a few periods do not determine residues of their own: none are fitted. The noise of each
    channel and hit is what the fit leaves, corrected for the numbers that it uses of them. Up to `most` fundamentals of
    the axis can be seen.
    """
    least = least_noise(blocks, linearise(blocks, entries.picked([])), floor)
    one = OneShape.near(blocks, entries, eliminated(blocks, entries), values).with_states()
    for _ in range(ROUNDS):
        one = one.with_noise(least).solved()
    bands = one.narrowed(LOOSE)
    for _ in range(GROWTHS):
        wide = one.with_bands(replace(entries, bands=bands).padded(GAP + 1, most).bands).solved().with_noise(least)
        kept = wide.narrowed(LOOSE)
        if (kept[:, 0] >= bands[:, 0]).all() and (kept[:, 1] <= bands[:, 1]).all():
            break
        one, bands = wide, kept
    one = one.with_bands(bands).solved().with_noise(least).solved()
    solution = one.as_solution()
    rest = residuals_of(one.blocks, solution, floor)
    peak = strongest(one.blocks, rest, 2.0 * np.pi / entries.fundamental, EXPECTED)
    # Of a brief hit alone the level is known to a tenth: all hits of a channel tell it together.
    excess, count = np.zeros((2, one.n_channels))
    for block, each in zip(one.blocks, rest, strict=True):
        excess[block.rows] += (block.noise / each.noise) ** 2
        count[block.rows] += 1
    misfit = float(np.sqrt(np.max(excess / count)))
    return SearchResult(one.blocks, solution, one.entries.bands, peak, tuple(rest), misfit, one=one)
