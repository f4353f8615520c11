"""One shape for all hits after a search with residues free in each: taken where the hits agree."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid.errors import IdentificationError
from floquid.periodic.least_squares import OneShape
from floquid.periodic.search._objective import FARTHEST
from floquid.periodic.search._result import Disagreement, SearchResult

QUIET = 1e-4
"""The noise over the largest value below which hits are not said to disagree: a weak nonlinearity does that."""


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
