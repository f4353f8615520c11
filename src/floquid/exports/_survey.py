"""A survey for other programs: a row a mode a point, a row an edge, and `survey.json`."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np

from floquid._json import for_json
from floquid.surveys import Edge, Survey, Track

Columns = dict[str, list[Any]]
"""Columns of a table by their names, None where there is nothing."""


def survey_columns(found: Survey) -> Columns:
    """The modes of a survey `found`, a row a mode a point: of a couple both, then modes on no track, lost points."""
    rows = [row for number, track in enumerate(found.tracks) for row in _rows_of(found, number, track)]
    rows += [_unlinked(found, point, mode) for point, mode in found.unlinked]
    seen = {row["point"] for row in rows}
    rows += [_place(found, number) for number in range(len(found.points)) if number not in seen]
    rows.sort(key=lambda row: row["point"])
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [_plain(row.get(name)) for row in rows] for name in names}


def edge_columns(found: Survey) -> Columns:
    """The edges of a survey `found`, a row each."""
    rows = [_edge(found, edge) for edge in found.edges]
    names = ("value", "std", "low", "high", "kind", "direction", "tracks")
    return {name: [row[name] for row in rows] for name in names}


def columns_text(columns: Mapping[str, Sequence[Any]]) -> str:
    """The `columns` as comma-separated values, with a line of names; nothing stands for None."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["" if cell is None else f"{cell:.10g}" if isinstance(cell, float) else cell for cell in row])
    return stream.getvalue()


def survey_summary(found: Survey) -> dict[str, Any]:
    """The content of `survey.json`: lists of a track in `found` go over its points, None where there is nothing."""
    points = [
        {
            **point.values,
            "files": point.files,
            "passed": point.passed,
            "order": None if point.model is None else point.model.order,
            "reason": point.reason,
        }
        for point in found.points
    ]
    edges = [
        {
            "value": edge.value,
            "std": edge.std,
            "interval": edge.interval,
            "kind": edge.kind,
            "direction": edge.direction,
            "tracks": edge.tracks,
        }
        for edge in found.edges
    ]
    return for_json(
        {
            "format": "floquid-survey/1",
            "over": found.over,
            "points": points,
            "tracks": [_track(track) for track in found.tracks],
            "edges": edges,
            "unlinked": found.unlinked,
            "notes": found.notes,
            "warnings": found.warnings,
        }
    )


def _track(track: Track) -> dict[str, Any]:
    return {
        "name": track.name,
        "points": track.points,
        "mode": [[mode for mode in modes if mode >= 0] for modes in track.modes.tolist()],
        "frequency_rad_s": track.frequency,
        "frequency_std_rad_s": track.frequency_std,
        "decay": track.decay,
        "decay_std": track.decay_std,
        "growth": track.growth,
        "growth_std": track.growth_std,
        "damping_ratio": track.damping_ratio,
        "whirl": track.whirl,
        "whirl_std": track.whirl_std,
        "names": track.names,
        "name_share": track.name_share,
        "leak": track.leak,
        "leak_std": track.leak_std,
        "locked": track.locked,
        "weak": track.weak,
        "confidence": track.confidence,
        "mac": track.mac,
    }


def _rows_of(found: Survey, number: int, track: Track) -> list[dict[str, Any]]:
    """The rows of a track, two where it is locked."""
    rows = []
    for place, point in enumerate(track.points.tolist()):
        model = found.points[point].model
        assert model is not None
        for half, mode in enumerate(track.modes[place].tolist()):
            if mode < 0:
                continue
            lam, std = complex(track.exponents[place, half]), complex(track.exponent_std[place, half])
            size = float(np.exp(lam.real * model.period))
            free = not track.locked[place] and lam.imag != 0.0
            rows.append(
                _place(found, point)
                | {
                    "track": number,
                    "name": track.name,
                    "mode": mode,
                    "decay": lam.real,
                    "decay_std": std.real,
                    "frequency_hz": abs(lam.imag) / (2.0 * np.pi),
                    "frequency_std_hz": std.imag / (2.0 * np.pi),
                    "damping_ratio": float(-lam.real / abs(lam)) if free else None,
                    "log_dec": float(-2.0 * np.pi * lam.real / abs(lam.imag)) if free else None,
                    "multiplier_abs": size,
                    "multiplier_std": size * model.period * std.real,
                    "branch": int(track.shifts[place]),
                    "mirrored": bool(track.mirrored[place]),
                    "whirl": float(track.whirl[place]),
                    "whirl_std": float(track.whirl_std[place]),
                    "pattern": track.names[place] or None,
                    "name_share": float(track.name_share[place]),
                    "leak": float(track.leak[place]),
                    "leak_std": float(track.leak_std[place]),
                    "locked": bool(track.locked[place]),
                    "weak": bool(track.weak[place]),
                    "link_confidence": float(track.confidence[place]),
                    "mac": float(track.mac[place]),
                }
            )
    return rows


def _unlinked(found: Survey, point: int, mode: int) -> dict[str, Any]:
    """A mode on no track."""
    model = found.points[point].model
    assert model is not None
    lam = complex(model.exponents[mode])
    return _place(found, point) | {
        "mode": mode,
        "decay": lam.real,
        "frequency_hz": abs(lam.imag) / (2.0 * np.pi),
        "multiplier_abs": float(np.exp(lam.real * model.period)),
    }


def _place(found: Survey, number: int) -> dict[str, Any]:
    """Cells of the point of a row."""
    point = found.points[number]
    return {"point": number, "file": "; ".join(point.files), **point.values, "reason": point.reason}


def _edge(found: Survey, edge: Edge) -> dict[str, Any]:
    low, high = edge.interval
    names = " and ".join(found.tracks[track].name for track in edge.tracks)
    return {
        "value": edge.value, "std": edge.std, "low": low, "high": high, "kind": edge.kind,
        "direction": edge.direction, "tracks": names,
    }  # fmt: skip


def _plain(cell: Any) -> Any:
    """A cell without NaN."""
    return None if isinstance(cell, float) and not np.isfinite(cell) else cell
