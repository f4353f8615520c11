"""A survey in words: rows of tables for the terminal and the page."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Floats
from floquid.shapes import WORDS
from floquid.surveys._types import Edge, Survey, Track
from floquid.views import Ink, with_error

DOUBTFUL = 0.8
"""Confidence below which a link is told and drawn as doubtful: most wrong ones are below it."""

KINDS = {"lock": "{}, locked with itself", "sum": "{}, locked with each other", "single": "{}, alone"}
"""Ways to turn unstable."""


def track_rows(found: Survey) -> list[tuple[str, ...]]:
    """Rows of the tracks of a survey `found`: points, ends of frequency and decay, whirl, where locked and unstable.

    The whirl is there where pairs of channels were read.
    """
    rows: list[tuple[str, ...]] = []
    for track in found.tracks:
        hertz, std = np.abs(track.frequency) / (2.0 * np.pi), track.frequency_std / (2.0 * np.pi)
        values, ends = found.values[track.points], [0, -1]
        low, high = int(track.decay.argmin()), int(track.growth.argmax())
        decays = [(track.decay[low], track.decay_std[low]), (track.growth[high], track.growth_std[high])]
        rows.append(
            (
                track.name,
                f"{len(track.points)} of {len(found.points)}",
                " … ".join(with_error(float(hertz[k]), float(std[k])) for k in ends),
                " … ".join(with_error(float(value), float(spread)) for value, spread in decays),
                *([" … ".join(_signed(track.whirl[k]) for k in ends)] if found.shapes.pairs else []),
                _spans(values, track.locked),
                _spans(values, track.growth > 0.0),
            )
        )
    return rows


def _signed(value: float) -> str:
    return f"{value:+.2f}" if np.isfinite(value) else "?"


def edge_words(found: Survey, edge: Edge) -> tuple[str, str, str, str]:
    """Value, interval, direction and kind of an `edge` of a survey `found`."""
    low, high = edge.interval
    kind = KINDS[edge.kind].format(" and ".join(found.tracks[track].name for track in edge.tracks))
    if edge.value is None or edge.std is None:
        return "not determined", f"between points at {low:g} and {high:g}", edge.direction, kind
    digits = max(0, 1 - int(np.floor(np.log10(max(edge.std, 0.5 * (high - low), 1e-12)))))
    value = with_error(edge.value, edge.std) if edge.std > 0.0 else f"{edge.value:.{digits}f}"
    return value, f"{low:.{digits}f} to {high:.{digits}f}", edge.direction, kind


def point_rows(found: Survey) -> list[tuple[str, ...]]:
    """Rows of the modes of each point of a survey `found`, where none are followed: the point, frequency and decay."""
    rows: list[tuple[str, ...]] = []
    for point, model in ((point, point.model) for point in found.points if point.model is not None):
        std = model.exponent_std
        for mode in model.upper_modes:
            lam, bar = complex(model.exponents[mode]), complex(np.nan, np.nan) if std is None else complex(std[mode])
            hertz = with_error(abs(lam.imag) / (2.0 * np.pi), bar.imag / (2.0 * np.pi))
            rows.append((f"{point.values[found.over]:g}", hertz, with_error(lam.real, bar.real)))
    return rows


def _spans(values: Floats, inside: np.ndarray) -> str:
    """Stretches of points that are `inside`, by their values."""
    places = np.flatnonzero(inside)
    parts = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []
    return ", ".join(f"{values[p[0]]:g}" if len(p) == 1 else f"{values[p[0]]:g} to {values[p[-1]]:g}" for p in parts)


def link_runs(track: Track) -> Iterator[tuple[slice, bool]]:
    """Stretches of the places of a `track` whose links are alike, and whether these are doubtful."""
    doubtful = track.confidence[1:] < DOUBTFUL
    first = 0
    for k in range(1, len(doubtful) + 1):
        if k == len(doubtful) or doubtful[k] != doubtful[first]:
            yield slice(first, k + 1), bool(doubtful[first])
            first = k


Damping: TypeAlias = Literal["decay", "ratio", "decrement"]

DAMPING = {"decay": "Re λ [1/s]", "ratio": "damping ratio ζ [%]", "decrement": "logarithmic decrement δ"}
"""Labels of an axis of damping."""

FAMILIES = {
    "flap": ("#009E73", ("flap",)),
    "edge": ("#D55E00", ("edge", "lag", "lead")),
    "drive train": ("#8C510A", ("drive", "gen", "shaft", "torsion")),
    "tower": ("#0072B2", ()),
}
"""Colours of families of a turbine, and parts of the names of their channels; any other in the fixed frame is tower."""

OTHER = "#CC79A7"
STANDING = ("differential", "reactionless")
DASHES = ("solid", "dashed", "dashdot")
"""Lines of what does not turn, turns against the rotor, and turns with it."""


def look_of(track: Track, found: Survey) -> tuple[str, str] | None:
    """Colour and dash of a `track` by the family and the direction that it has at most points of `found`."""
    seen = Counter(word for word in track.names if word)
    if not seen:
        return (OTHER, "dotted") if any(word for own in found.tracks for word in own.names) else None
    words = WORDS[found.shapes.words]
    pattern = seen.most_common(1)[0][0].removeprefix("mixed: ")
    told = re.match(rf"(.+?) ({'|'.join(words + STANDING)})\b", pattern)
    name = (pattern if told is None else told[1]).lower()
    known = [colour for colour, parts in FAMILIES.values() if any(part in name for part in parts)]
    other = FAMILIES["tower"][0] if told is None else OTHER
    return (known or [other])[0], DASHES[words.index(told[2])] if told and told[2] in words else "solid"


COLOURS = (Ink.BLUE, Ink.VERMILION, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.SKY, Ink.BLACK)
OTHER_DASHES = ("solid", "dashdot", "dotted")
"""Colours of tracks without names, and the dashes of those behind the first seven."""


def looks(found: Survey) -> list[tuple[str, str, str]]:
    """Colour and dash of each track, and the dash of its doubtful links: by its name, or by its number."""
    made = []
    for number, track in enumerate(found.tracks):
        by_name = look_of(track, found)
        round_, place = divmod(number, len(COLOURS))
        by_number = COLOURS[place], OTHER_DASHES[round_ % len(OTHER_DASHES)], "dashed"
        made.append(by_number if by_name is None else (*by_name, "dotted"))
    return made


def unstable_spans(found: Survey) -> list[tuple[float, float]]:
    """Spans of the operating point in which a track is unstable, between its edges, or else half way between points."""
    spans = []
    for number, track in enumerate(found.tracks):
        x, unstable = found.values[track.points], track.growth > 0.0
        turns = np.flatnonzero(np.diff(np.concatenate([[False], unstable, [False]]).astype(int)))
        ends = [_end(found, number, k, x) for k in turns.tolist()]
        spans += list(zip(ends[::2], ends[1::2], strict=True))
    return spans


def _end(found: Survey, number: int, place: int, x: Floats) -> float:
    """The end of an unstable span before a place of a track: that of its edge, else the middle of both points."""
    if 0 < place < len(x):
        first, last = found.tracks[number].points[place - 1 : place + 1].tolist()
        own = [edge for edge in found.edges if number in edge.tracks and edge.between == (first, last)]
        known = [edge.value for edge in own if edge.value is not None]
        return known[0] if known else float(x[place - 1 : place + 1].mean())
    return float(x[min(place, len(x) - 1)])


def order_lines(found: Survey, orders: tuple[int, ...] | None = None) -> list[tuple[str, Floats]]:
    """Whole `orders` of the speed over the points (points,) [Hz], with labels: 1×, or 1P of a rotor with blades.

    By default they are 1, 2 and 3, and of a rotor with n blades 1, n, 2n and 3n. Without a `speed_rpm` the period is
    that of a revolution where blades were read; else there are none.
    """
    models = [point.model for point in found.points if point.model is not None]
    groups = [len(own.rows) for own in found.shapes.families(models[0].channels) if not own.is_fixed] if models else []
    hertz = np.array([point.values.get("speed_rpm", np.nan) for point in found.points]) / 60.0
    if groups and not np.isfinite(hertz).any():
        hertz = np.array([np.nan if point.model is None else 1.0 / point.model.period for point in found.points])
    if not np.isfinite(hertz).any():
        return []
    default = (1, 2, 3) if not groups else (1, groups[0], 2 * groups[0], 3 * groups[0])
    sign = "P" if groups else "×"
    return [(f"{order}{sign}", order * hertz) for order in (default if orders is None else orders)]


def order_end(found: Survey, hertz: Floats, top: float) -> tuple[float, float] | None:
    """The end of the line of an order, at the right or the `top` [Hz] of a figure; None where it begins above."""
    x, inside = found.values, np.flatnonzero(hertz < top)
    if not len(inside):
        return None
    if inside[-1] == len(x) - 1:
        return float(x[-1]), float(hertz[-1])
    ends = slice(int(inside[-1]), int(inside[-1]) + 2)
    return float(np.interp(top, hertz[ends], x[ends])), top


def damping_of(track: Track, unit: Damping) -> tuple[Floats, Floats]:
    """Values and deviations of the damping of a `track` in a `unit`; NaN of a couple where that needs a frequency."""
    if unit == "decay":
        return track.decay, track.decay_std
    size = np.where(track.locked, np.nan, np.abs(track.frequency))
    if unit == "ratio":
        return 100.0 * track.damping_ratio, 100.0 * track.decay_std / size
    return -2.0 * np.pi * track.decay / size, 2.0 * np.pi * track.decay_std / size
