"""Surveys, monitored records, comparisons and shapes over a path for other programs: rows of tables, and JSON."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid._json import attributes, for_json
from floquid.comparison import Comparison
from floquid.core import PeriodicModel
from floquid.monitoring import Monitor
from floquid.shapes import PathShapes
from floquid.surveys import Edge, Survey, Track

Columns = dict[str, list[Any]]  # columns of a table by their names, None where there is nothing


def survey_columns(found: Survey) -> Columns:
    """The modes of a survey `found`, a row a mode a point: of a couple both, then modes on no track, lost points."""
    rows = [row for number, track in enumerate(found.tracks) for row in _rows_of(found, number, track)]
    rows += [_unlinked(found, point, mode) for point, mode in found.unlinked]
    seen = {row["point"] for row in rows}
    rows += [_place(found, number) for number in range(len(found.points)) if number not in seen]
    rows.sort(key=lambda row: row["point"])
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [for_json(row.get(name)) for row in rows] for name in names}


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
            **attributes(point, "files", "passed"),
            "order": None if point.model is None else point.model.order,
            "reason": point.reason,
        }
        for point in found.points
    ]
    edges = [attributes(edge, "value", "std", "interval", "kind", "direction", "tracks") for edge in found.edges]
    return for_json(
        {
            "format": "floquid-survey/1",
            "over": found.over,
            "confidence": found.confidence,
            "points": points,
            "tracks": [_track(track) for track in found.tracks],
            "edges": edges,
            **attributes(found, "unlinked", "notes", "warnings"),
        }
    )


def _track(track: Track) -> dict[str, Any]:
    return {
        **attributes(track, "name", "points"),
        "mode": [[mode for mode in modes if mode >= 0] for modes in track.modes.tolist()],
        "frequency_rad_s": track.frequency,
        "frequency_std_rad_s": track.frequency_std,
        **attributes(track, "decay", "decay_std", "growth", "growth_std", "damping_ratio"),
        **attributes(track, "whirl", "whirl_std", "whirl_interval"),
        "names": [name or None for name in track.names],
        **attributes(track, "name_share", "leak", "leak_std", "leak_interval", "locked", "weak", "confidence", "mac"),
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
                    "harmonics": _harmonics(model, mode, track, place),
                    "branch": int(track.shifts[place]),
                    "mirrored": bool(track.mirrored[place]),
                    "whirl": float(track.whirl[place]),
                    "whirl_std": float(track.whirl_std[place]),
                    **_ends("whirl", track.whirl_interval, place),
                    "pattern": track.names[place] or None,
                    "name_share": float(track.name_share[place]),
                    "leak": float(track.leak[place]),
                    "leak_std": float(track.leak_std[place]),
                    **_ends("leak", track.leak_interval, place),
                    "locked": bool(track.locked[place]),
                    "weak": bool(track.weak[place]),
                    "link_confidence": float(track.confidence[place]),
                    "mac": float(track.mac[place]),
                }
            )
    return rows


def _harmonics(model: PeriodicModel, mode: int, track: Track, place: int) -> str:
    """The first and the last harmonic that a mode has, on the branch of its track."""
    kept = model.harmonics[(model.coefficients[mode] != 0.0).any(axis=(0, 1))]
    own = np.sort((-kept if track.mirrored[place] else kept) - track.shifts[place])
    return "…".join(dict.fromkeys(map(str, own[[0, -1]].tolist()))) if len(own) else ""


def _ends(name: str, interval: Floats | None, place: int) -> dict[str, float | None]:
    """Cells of the ends of an interval (places, 2) at a place."""
    low, high = (None, None) if interval is None else interval[place].tolist()
    return {f"{name}_low": low, f"{name}_high": high}


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


def monitor_records(found: Monitor) -> list[dict[str, Any]]:
    """The records of `found`, a mapping each: charts with limits, alarms, and how periodic they are."""
    rows: list[dict[str, Any]] = []
    charts, amounts = found.charts, found.amounts
    nothing = np.full(len(found.files), np.nan)
    columns: Mapping[str, Any] = {
        name: nothing if charts is None else getattr(charts, name)
        for name in ("t2", "t2_limit", "ewma", "ewma_limit", "directed", "directed_limit", "leverage")
    } | {
        f"periodic_amount{end}": nothing if amounts is None else getattr(amounts, name)
        for end, name in (("", "value"), ("_std", "std"), ("_low", "low"), ("_high", "high"))
    }
    for k, file in enumerate(found.files):
        numbers = {name: float(own[k]) for name, own in columns.items()}
        row: dict[str, Any] = {"file": file, found.over: float(found.x[k])}
        row |= dict(zip(found.covariates, found.conditions[k].tolist(), strict=True))
        row |= {"baseline": bool(found.baseline[k]), **numbers, "alarm": bool(found.alarm[k])}
        row["extrapolated"] = charts is not None and bool(charts.extrapolated[k])
        rows.append({**row, "reason": found.reasons[k]})
    return rows


def monitor_columns(found: Monitor) -> Columns:
    """The records of `found` as columns, and their features, deviations and residuals."""
    rows, charts = monitor_records(found), found.charts
    columns: Columns = {name: [row[name] for row in rows] for name in rows[0]}
    for k, name in enumerate(() if charts is None else charts.features):
        assert charts is not None
        word = f"{name.replace(' ', '_')}_{charts.units[k].replace('/', '_')}"
        for ending, values in (("", charts.values), ("_std", charts.std), ("_residual", charts.residual)):
            columns[word + ending] = values[:, k].tolist()
    reasons = columns.pop("reason")
    return {name: [for_json(cell) for cell in column] for name, column in {**columns, "reason": reasons}.items()}


def monitor_summary(found: Monitor) -> dict[str, Any]:
    """The content of `monitor.json`: the records of `found`, the change, the trend; None where there is nothing."""
    change, amounts = found.change, found.amounts
    parts = [] if change is None else change.carried_by
    carried = [attributes(own, "feature", "unit", "size", "std") for own in parts]
    whole = None
    if change is not None:
        whole = attributes(change, "index", "interval", "kind") | {"carried_by": carried}
    trend = None
    if amounts is not None and amounts.trend is not None:
        own = amounts.trend
        of = "amount" if amounts.along else "energy"
        trend = {"of": of, "over": found.over, **attributes(own, "slope", "std", "p_value")}
    return for_json(
        {
            "format": "floquid-monitor/1",
            "over": found.over,
            "covariates": found.covariates,
            "features": [] if found.charts is None else found.charts.features,
            "terms": [] if found.charts is None else found.charts.terms,
            "records": monitor_records(found),
            "change": whole,
            "trend": trend,
            "warnings": found.warnings,
        }
    )


def comparison_summary(found: Comparison) -> dict[str, Any]:
    """The content of `comparison.json` of a comparison `found`, modes counted from 0.

    Of several points missing modes are [point, mode].
    """
    several = found.over is not None
    pairs = [
        {
            **({"point": pair.point} if several else {}),
            **attributes(pair, "a", "b"),
            "difference": np.complex128(pair.difference),
            "std": np.complex128(pair.std),
            **attributes(pair, "z", "mac", "mac_noise", "counted"),
        }
        for pair in found.pairs
    ]
    missing = {
        f"missing_in_{side}": [place if several else place[1] for place in places]
        for side, places in (("a", found.missing_in_a), ("b", found.missing_in_b))
    }
    points = {"over": found.over, "points": [point.value for point in found.points]} if several else {}
    return for_json(
        {
            "format": "floquid-comparison/1",
            "compared": [found.a, found.b],
            **points,
            "pairs": pairs,
            **missing,
            **attributes(found, "chi2", "dof", "p", "warnings"),
        }
    )


def comparison_columns(found: Comparison) -> dict[str, list[Any]]:
    """The pairs of a comparison `found`, a row each, then the modes that one side alone has."""
    rows: list[dict[str, Any]] = []
    for pair in found.pairs:
        (hertz_a, hertz_b), (ratio_a, ratio_b) = pair.frequencies_hz, pair.damping_ratios
        rows.append(
            {
                found.over or "point": found.points[pair.point].value, "a": pair.a, "b": pair.b,
                "re_a": pair.exponent_a.real, "im_a": pair.exponent_a.imag,
                "re_b": pair.exponent_b.real, "im_b": pair.exponent_b.imag,
                "re_difference": pair.difference.real, "im_difference": pair.difference.imag,
                "re_std": pair.std.real, "im_std": pair.std.imag, "z": pair.z, "mac": pair.mac,
                "frequency_difference_hz": hertz_a - hertz_b, "damping_ratio_difference": ratio_a - ratio_b,
                "counted": pair.counted,
            }
        )  # fmt: skip
    for side, places in (("b", found.missing_in_a), ("a", found.missing_in_b)):
        for number, mode in places:
            point = found.points[number]
            lam = (point.model_a if side == "a" else point.model_b).exponents[mode]
            exponent = {f"re_{side}": lam.real, f"im_{side}": lam.imag}
            rows.append({found.over or "point": point.value, side: mode, **exponent})
    names = dict.fromkeys(name for row in rows for name in row)
    cells = {name: [row.get(name) for row in rows] for name in names}
    return {name: [for_json(cell) for cell in column] for name, column in cells.items()}


_POSITIONS = 201  # a hundredth of the path's amplitude apart


def path_columns(found: PathShapes) -> dict[str, list[Any]]:
    """Positions x on the path, and real and imaginary part of each shape `found` of each channel there."""
    positions = np.linspace(-1.0, 1.0, _POSITIONS)
    columns = {"x": positions.tolist()}
    for exponent, shapes in zip(found.exponents.tolist(), found.at(positions), strict=True):
        for channel, values in zip(found.channels, shapes, strict=True):
            name = f"{channel.label} at {abs(exponent) / (2.0 * np.pi):.6g} Hz"
            columns |= {f"{name}, real": values.real.tolist(), f"{name}, imag": values.imag.tolist()}
    return columns
