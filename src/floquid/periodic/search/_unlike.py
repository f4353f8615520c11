"""Near modes that are one whose exponent differs between hits."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid.errors import IdentificationError
from floquid.fit import AT_REST, chi2_limit
from floquid.periodic.least_squares import ModeParameters, OneShape
from floquid.periodic.search._folds import folds, with_all_lines
from floquid.periodic.search._moves import without
from floquid.periodic.search._objective import Point
from floquid.periodic.search._one_shape import chance
from floquid.periodic.search._several_shapes import degrees_of


def as_one_of_hits(point: Point, false_alarm: float) -> tuple[Point, bool]:
    """The fit with one mode in place of two near ones where one shape with an exponent for each hit has a lower J.

    And whether there is one. Free residues let each of two modes ring in the hits that decay like it. Modes that have
    a shape each stay.
    """
    hits = {block.hit for block in point.blocks}
    for fold in folds(point.entries, wanders=point.wanders) if len(hits) > 1 else ():
        entries = without(with_all_lines(point.entries, fold), [fold.second])
        entry = fold.first - (fold.second < fold.first)
        value = np.inf
        with suppress(IdentificationError, np.linalg.LinAlgError):  # a hit too brief for a fit of its own says nothing
            value = _of_each_hit(point, entries, entry, false_alarm)
        if value < point.value:
            return as_one_of_hits(point.with_entries(entries).settled(rest=AT_REST), false_alarm)[0], True
    return point, False


def _of_each_hit(point: Point, entries: ModeParameters, entry: int, false_alarm: float) -> float:
    """J with exponents for each hit; infinite where the hits do not share the shape of one entry."""
    # All are free: those of the others were bent where one mode was fitted as two.
    hits = sorted({block.hit for block in point.blocks})
    parts = [point.of_hit(hit, entries).settled(rest=AT_REST) for hit in hits]
    more = chi2_limit((len(hits) - 1) * len(entries.ties()), point.price.mode_alarm)
    value = sum(part.misfit for part in parts) + point.price.of(entries) + more
    if value >= point.value:
        return np.inf
    fixed = np.arange(len(entries.exponents)) != entry
    blocks = [block for part in parts for block in part.blocks]
    linear = [each for part in parts for each in part.solution.linear]
    shared = OneShape.at(blocks, replace(entries, fixed=fixed), linear)
    rise, degrees = shared.cost - sum(part.solution.cost for part in parts), degrees_of(shared, shared.entries)
    # A shape of one number is that of any mode.
    return value if degrees > 0 and chance(rise, degrees) > false_alarm else np.inf
