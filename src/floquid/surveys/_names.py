"""Names of tracks by patterns over the blades, and their branch in the fixed frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.shapes import ordinal
from floquid.surveys._types import Track

SEVERAL = (":", ";")
"""Signs in the name of several patterns."""


def named(tracks: Sequence[Track]) -> tuple[Track, ...]:
    """The tracks with names: the pattern that they have at most points and an ordinal by frequency, else a number."""
    counts: Counter[str] = Counter()
    found = []
    for number, track in enumerate(tracks, start=1):
        name = f"mode {number}"
        seen = Counter(word for word in track.names if word)
        if seen:
            pattern = seen.most_common(1)[0][0]
            counts[pattern] += 1
            several = any(sign in pattern for sign in SEVERAL)
            name = f"{name}, {pattern}" if several else f"{ordinal(counts[pattern])} {pattern}"
        found.append(replace(track, name=name))
    return tuple(found)


def in_fixed_frame(track: Track, branches: Floats, fundamentals: Floats) -> Track:
    """The track on the branch of the fixed frame, by that of its modes (`branches`, places,) at most points.

    λ of the track is that of the model or its mirror image, moved by `shifts`: the line k of the model is k - shift of
    the track, of a mirror image -k - shift. Without any branch it stays as it is.
    """
    own = np.where(track.mirrored, -branches, branches) - track.shifts
    own = own[np.isfinite(own)].astype(int)
    if not len(own):
        return track
    turns = Counter(own.tolist()).most_common(1)[0][0]
    exponents = track.exponents + 1j * turns * fundamentals[:, None]
    shifts, mirrored = track.shifts + turns, track.mirrored
    if np.median(exponents[:, 0].imag) < 0.0:
        exponents, shifts, mirrored = exponents.conj(), -shifts, ~mirrored
    return replace(track, exponents=exponents, shifts=shifts, mirrored=mirrored)
