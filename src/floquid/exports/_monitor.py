"""Monitored records for other programs: a row a record, and `monitor.json`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from floquid._json import for_json
from floquid.exports._survey import Columns
from floquid.monitoring import Monitor


def monitor_records(found: Monitor) -> list[dict[str, Any]]:
    """The records of `found`, a mapping each: charts with limits, alarms, and how periodic they are."""
    rows: list[dict[str, Any]] = []
    charts, amounts = found.charts, found.amounts
    nothing = np.full(len(found.files), np.nan)
    columns: Mapping[str, Any] = {
        "t2": nothing if charts is None else charts.t2,
        "t2_limit": nothing if charts is None else charts.t2_limit,
        "ewma": nothing if charts is None else charts.ewma,
        "ewma_limit": nothing if charts is None else charts.ewma_limit,
        "directed": nothing if charts is None else charts.directed,
        "directed_limit": nothing if charts is None else charts.directed_limit,
        "leverage": nothing if charts is None else charts.leverage,
        "periodic_amount": nothing if amounts is None else amounts.value,
        "periodic_amount_std": nothing if amounts is None else amounts.std,
        "periodic_amount_low": nothing if amounts is None else amounts.low,
        "periodic_amount_high": nothing if amounts is None else amounts.high,
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
    return {
        name: [None if isinstance(cell, float) and not np.isfinite(cell) else cell for cell in column]
        for name, column in {**columns, "reason": reasons}.items()
    }


def monitor_summary(found: Monitor) -> dict[str, Any]:
    """The content of `monitor.json`: the records of `found`, the change, the trend; None where there is nothing."""
    change, amounts = found.change, found.amounts
    parts = [] if change is None else change.carried_by
    carried = [{"feature": own.feature, "unit": own.unit, "size": own.size, "std": own.std} for own in parts]
    whole = None
    if change is not None:
        whole = {"index": change.index, "interval": change.interval, "kind": change.kind, "carried_by": carried}
    trend = None
    if amounts is not None and amounts.trend is not None:
        own = amounts.trend
        of = "amount" if amounts.along else "energy"
        trend = {"of": of, "over": found.over, "slope": own.slope, "std": own.std, "p_value": own.p_value}
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
