"""Meetings of two tracks: they cross, and keep their shapes, or they veer, and exchange them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from floquid._arrays import Floats
from floquid.surveys._edges import Followed
from floquid.surveys._objects import Seen, similarities
from floquid.surveys._types import Track

TELL = 0.2  # difference of similarity below which shapes are neither kept nor exchanged
CLOSE = 0.1  # of ω: frequencies that may veer
AROUND = 2  # points on either side between which shapes are compared


def meetings(
    tracks: Sequence[Track], followed: Sequence[Followed], x: Floats, over: str
) -> tuple[list[str], list[str]]:
    """Sentences on tracks that cross or veer, and warnings where points are too far apart to tell."""
    notes, warnings = [], []
    heights = [dict(zip(own.points.tolist(), np.abs(own.frequency).tolist(), strict=True)) for own in tracks]
    for (i, a), (j, b) in combinations(enumerate(followed), 2):
        both, shared = f"{tracks[i].name} and {tracks[j].name}", sorted(a.keys() & b.keys())
        gaps = np.array([heights[i][point] - heights[j][point] for point in shared])
        for k in np.flatnonzero(gaps[:-1] * gaps[1:] < 0.0):
            first, last = shared[k], shared[k + 1]
            kept, swapped = _alike(a, b, first, last)
            place = f"between {over} = {x[first]:g} and {x[last]:g}"
            if kept - swapped < TELL:
                words = f"similarity {kept:.2f} as they are, {swapped:.2f} exchanged"
                warnings.append(
                    f"{place}, {both} meet: points are too far apart to tell crossing from veering ({words})."
                )
            else:
                notes.append(f"{both} cross {place}: their shapes are kept (similarity {kept:.2f}).")
        for k in _nearest(gaps):
            ends = shared[max(k - AROUND, 0)], shared[min(k + AROUND, len(shared) - 1)]
            kept, swapped = _alike(a, b, *ends)
            if abs(gaps[k]) < CLOSE * a[shared[k]].fundamental and swapped > kept + TELL:
                apart = abs(gaps[k]) / (2.0 * np.pi)
                notes.append(
                    f"{both} veer at {over} = {x[shared[k]]:g}, {apart:.3g} Hz apart: their shapes are exchanged."
                )
    return notes, [words[0].upper() + words[1:] for words in warnings]


def _nearest(gaps: Floats) -> Iterator[int]:
    """Places where two frequencies are nearest without crossing."""
    for k in range(1, len(gaps) - 1):
        here = np.abs(gaps[k - 1 : k + 2])
        if here.argmin() == 1 and np.ptp(np.sign(gaps[k - 1 : k + 2])) == 0:
            yield k


def _alike(a: Followed, b: Followed, first: int, last: int) -> tuple[float, float]:
    """Similarity of shapes between two points, the lesser of both tracks: as they are, and exchanged."""

    def least(*pairs: tuple[Seen, Seen]) -> float:
        return min(float(similarities(one, other).max()) for one, other in pairs)

    return least((a[first], a[last]), (b[first], b[last])), least((a[first], b[last]), (b[first], a[last]))
