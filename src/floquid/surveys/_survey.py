"""Modes over an operating point: from results, or from known systems, to tracks, links and edges."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from os import PathLike
from types import MappingProxyType
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import counted, input_error, integer, positive, wrong_value
from floquid._show import late
from floquid.checks import repeats_of
from floquid.shapes import APART, Blades, Pairs, ShapeOptions, Words, ordinal
from floquid.surveys._edges import Crossing, Followed, crossings
from floquid.surveys._objects import Seen, similarities
from floquid.surveys._points import OF, check_points, known_modes, objects_of, point_of
from floquid.surveys._tracking import Path, tracked
from floquid.surveys._types import Edge, Point, Survey, Track
from floquid.surveys._words import DOUBTFUL

FEWEST = 3  # points for tracks
MOST = 4  # links that are named in a warning
GRID = 41  # points of a known system, by default


def survey(
    results: Iterable[Any] | Callable[[float], Any],
    *,
    over: str = "speed_rpm",
    pairs: Pairs = (),
    blades: Blades = (),
    fixed: Sequence[str] = (),
    scales: Mapping[str, float] = MappingProxyType({}),
    words: Words = "en",
    between: tuple[float, float] | None = None,
    points: int = GRID,
    edge_tolerance: float = 1e-9,
    gap: int = 2,
    confidence: float = 0.95,
) -> Survey:
    r"""Follow modes over an operating point, and find where they turn unstable.

    Modes are followed by their shapes, whose likeness does not depend on the branch that is reported:

    .. math:: \max_{s, k} |\langle A_m, B^{(k)}_{m+s} \rangle|^2 / (\|A\|^2 \|B\|^2)

    over shifts by whole fundamentals and the mirror image, channels over their noise; two real multipliers of a lock
    are one object. Edges come from μ = (λ_a + λ_b)/2 and q = ((λ_a - λ_b)/2)² of what meets, which are smooth where
    exponents have a kink: Re(μ ± √q) = 0 of a Wiener process integrated twice through the nearest points.

    Raises InputError where a result has no value of `over` or two have the same, their periods are not one part of a
    revolution, they share less than two channels, or a channel has two units.

    Parameters
    ----------
    results
        What `identify` found at each point, files of such, known systems or their modes, or points; or a function of
        the operating point that gives a known system. That is a matrix A(t) with its period, A and the period, a
        turbine as `floquet.read_openfast` gives it, a system with outputs, or its modes.
    over
        The quantity of the operating point, such as "speed_rpm".
    pairs
        Pairs of channels "x:y" at right angles, from x to y being the sense of rotation: modes have a whirl then.
    blades, fixed, scales, words
        Groups of channels, one a blade, and what else `read_shapes` takes: tracks have names then, and frequencies
        in the fixed frame.
    between
        The range, of a function.
    points
        How many points a function is evaluated at before its edges are halved.
    edge_tolerance
        The largest error of an edge of a known system, as a share of the range.
    gap
        Points that a mode may be missing at.
    confidence
        The probability that an interval holds the edge.
    """
    missed = integer(gap, "gap", OF, at_least=0)
    if not 0.0 < positive(confidence, "confidence", OF) < 1.0:
        raise input_error("confidence", OF, "lie between 0 and 1", f"is {confidence:g}")
    shapes = ShapeOptions(pairs=pairs, blades=blades, fixed=fixed, scales=dict(scales), words=words)
    if callable(results):
        if between is None or not between[0] < between[1]:
            raise wrong_value("between", OF, "hold the two ends of the range", between, "Such as between=(0.4, 1.2).")
        grid = np.linspace(*between, integer(points, "points", OF, at_least=FEWEST))
        known = [_known(results, over, value, shapes) for value in grid.tolist()]
        found = replace(_surveyed(known, over, missed, confidence), shapes=shapes)
        step = positive(edge_tolerance, "edge_tolerance", OF) * (between[1] - between[0])
        edges = tuple(_halved(edge, found, results, step) for edge in found.edges)
        return replace(found, edges=edges)
    given = [late("store", "load")(one) if isinstance(one, (str, PathLike)) else one for one in results]
    found = _surveyed([point_of(one, shapes) for one in given], over, missed, confidence)
    return replace(found, shapes=shapes)


def _known(system: Callable[[float], Any], over: str, value: float, shapes: ShapeOptions) -> Point:
    return replace(point_of(known_modes(system(value)), shapes), values={over: value}, files=())


def _halved(edge: Edge, found: Survey, system: Callable[[float], Any], tolerance: float) -> Edge:
    """An edge of a known system, its bracket halved to a tolerance."""
    low, high = (found.points[k].values[found.over] for k in edge.between)
    rising = edge.direction == "onset"

    def unstable(value: float) -> bool:
        return bool(known_modes(system(value)).exponents.real.max() > 0.0)

    if (unstable(low), unstable(high)) != (not rising, rising):
        return edge  # another mode is unstable there
    while high - low > tolerance and low < (middle := 0.5 * (low + high)) < high:
        if unstable(middle) == rising:
            high = middle
        else:
            low = middle
    return replace(edge, value=0.5 * (low + high), std=0.0, interval=(low, high))


def _surveyed(given: Sequence[Point], over: str, gap: int, confidence: float) -> Survey:
    """The survey of points."""
    from threadpoolctl import threadpool_limits

    # The matrices are many and small: threads inside BLAS would wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        return _followed(given, over, gap, confidence)


def _followed(given: Sequence[Point], over: str, gap: int, confidence: float) -> Survey:
    """The survey of points, by one thread."""
    points = check_points(given, over)
    if not points:
        raise input_error("results", OF, "hold a result", "none was given", "Pass what `identify` gave at each point.")
    values = np.array([point.values[over] for point in points])
    objects = objects_of(points)
    there = [k for k, point in enumerate(points) if point.model is not None]
    warnings = [_reason(point, over) for point in points if point.reason is not None]
    paths: list[Path] = []
    if len(there) < FEWEST:
        warnings.append(f"{counted(len(there), 'point')} with a result: {FEWEST} at least are needed to follow modes.")
    else:
        paths = tracked([objects[k] for k in there], values[there], gap)
    alone = [path for path in paths if len(path.places) == 1]
    both = [(_track(path, there, points), path) for path in paths if len(path.places) > 1]
    both.sort(key=lambda own: float(np.median(np.abs(own[0].frequency))))
    tracks, paths = named([track for track, _ in both]), [path for _, path in both]
    followed = [{there[at]: held.own for at, held in zip(path.places, path.objects, strict=True)} for path in paths]
    notes, doubts = meetings(tracks, followed, values, over)
    edges = tuple(_edge(crossing, values, confidence) for crossing in crossings(followed, values))
    warnings += [*_repeated([points[k] for k in there]), *_doubts(tracks, values)]
    return Survey(
        over=over,
        points=points,
        tracks=tracks,
        edges=edges,
        unlinked=tuple((there[path.places[0]], mode) for path in alone for mode in path.objects[0].own.modes),
        confidence=confidence,
        notes=tuple(notes),
        warnings=(*warnings, *doubts),
    )


def _reason(point: Point, over: str) -> str:
    state = "no result" if point.model is None else "the model fails"
    first = (point.reason or "").partition(". ")[0].rstrip(".")
    return f"{over} = {point.values[over]:g}: {state}. {first}."


def _track(path: Path, there: Sequence[int], points: Sequence[Point]) -> Track:
    """A path as a track, without a name; on the branch of the fixed frame where blades were read."""
    count = len(path.places)
    exponents, std = np.full((2, count, 2), complex(np.nan, np.nan))
    modes = np.full((count, 2), -1)
    for place, held in enumerate(path.objects):
        own, size = held.own, len(held.own.modes)
        modes[place, :size], exponents[place, :size] = own.modes, own.exponents
        spread = np.sqrt(np.maximum(np.diag(own.covariance), 0.0))
        std[place, :size] = spread[:size] + 1j * spread[size:]
    read = [(points[there[at]], mode) for at, mode in zip(path.places, modes[:, 0].tolist(), strict=True)]
    whirl, blades, whirl_interval, leak_interval = (
        np.array(
            [np.full(size, np.nan) if (values := getattr(own, name)) is None else values[mode] for own, mode in read]
        )
        for name, size in (("whirl", 2), ("blades", 4), ("whirl_interval", 2), ("leak_interval", 2))
    )
    found = Track(
        name="",
        points=np.array([there[at] for at in path.places]),
        modes=modes,
        exponents=exponents,
        exponent_std=std,
        whirl=whirl[:, 0],
        whirl_std=whirl[:, 1],
        whirl_interval=whirl_interval,
        names=tuple(own.names[mode] if own.names else "" for own, mode in read),
        name_share=blades[:, 0],
        leak=blades[:, 1],
        leak_std=blades[:, 2],
        leak_interval=leak_interval,
        shifts=np.array([held.shift for held in path.objects]),
        mirrored=np.array([held.mirrored for held in path.objects]),
        weak=np.array([held.own.weak for held in path.objects]),
        **{
            name: np.array([np.nan, *(getattr(step, name) for step in path.steps)])
            for name in ("confidence", "mac", "cost", "runner_up")
        },
    )
    return in_fixed_frame(found, blades[:, 3], np.array([held.own.fundamental for held in path.objects]))


def _repeated(points: Sequence[Point]) -> list[str]:
    """A sentence where the system repeats several times in the period at most points: modes are then found twice."""
    counts = Counter(repeats_of(point.model) for point in points if point.model is not None)
    times, number = counts.most_common(1)[0] if counts else (1, 0)
    if times == 1 or 2 * number <= len(points):
        return []
    seen = f"At {number} of {counted(len(points), 'point')} the system repeats {times} times within its period."
    speeds = [(point.model, point.values.get("speed_rpm")) for point in points if point.model is not None]
    given = float(np.median([60.0 / (model.period * abs(speed)) for model, speed in speeds if speed] or [0.0]))
    # Periods are whole parts of a revolution already, or the speed is that of another shaft.
    if given > 0.5 and abs(given - round(given)) < APART:
        return [f"{seen} Identify with that part of it: `--periods-per-rev {times * round(given)}`."]
    return [f"{seen} Identify with that part of it: where it is a revolution, `--periods-per-rev {times}`."]


def _doubts(tracks: Sequence[Track], values: Floats) -> list[str]:
    """A sentence on the links of low confidence, if there are any."""
    doubtful = [
        f"{track.name} to {value:g}"
        for track in tracks
        for value, sure in zip(values[track.points], track.confidence, strict=True)
        if sure < DOUBTFUL
    ]
    count = sum(len(track.points) - 1 for track in tracks)
    where = ", ".join(doubtful[:MOST]) + (f" and {len(doubtful) - MOST} more" if len(doubtful) > MOST else "")
    return [f"{len(doubtful)} of {count} links have a confidence below {DOUBTFUL}: {where}."] if doubtful else []


def _edge(crossing: Crossing, values: Floats, confidence: float) -> Edge:
    """A crossing with its interval, which the misfit of the process widens."""
    bracket = (float(values[crossing.between[0]]), float(values[crossing.between[1]]))
    value, std, interval = None, None, bracket
    if len(crossing.draws):
        ends = [0.5 - 0.5 * confidence, 0.1587, 0.5, 0.8413, 0.5 + 0.5 * confidence]
        low, inner, value, outer, high = np.quantile(crossing.draws, ends).tolist()
        std = crossing.widening * 0.5 * (outer - inner)
        interval = (value + crossing.widening * (low - value), value + crossing.widening * (high - value))
    return Edge(
        value=value, std=std, interval=interval, between=crossing.between, kind=crossing.kind, tracks=crossing.tracks,
        direction="onset" if crossing.onset else "end",
    )  # fmt: skip


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
