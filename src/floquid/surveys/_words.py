"""A survey in words: rows of tables for the terminal and the page."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats
from floquid.surveys._types import Edge, Survey
from floquid.views import with_error

KINDS = {"lock": "{}, locked with itself", "sum": "{}, locked with each other", "single": "{}, alone"}
"""Ways to turn unstable."""


def track_rows(found: Survey) -> list[tuple[str, ...]]:
    """Rows of the tracks of a survey `found`: points, ends of frequency and decay, where locked, where unstable."""
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
                _spans(values, track.locked),
                _spans(values, track.growth > 0.0),
            )
        )
    return rows


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
