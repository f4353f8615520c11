"""Monitoring in words: rows of a table, the change, and sentences for the terminal and the page."""

from __future__ import annotations

import numpy as np

from floquid._checks import counted
from floquid.monitoring._types import Monitor, Part
from floquid.views import shortened, with_error

HERTZ = "rad/s"
LONGEST = 40
"""Characters of the name of a file in a sentence or a row."""

LEAST = 1e-3
"""A chart over its limit below which nothing is shown."""

CHARTED = (
    "T²: how far the modes of a record are from the baseline, in deviations squared; average: the same of a running "
    "average, which sees slow changes. Above its limit a record is an alarm."
)
"""The columns of charts, for people."""


def feature_change(part: Part) -> str:
    """The change of a feature in a `part` of a change: frequencies in Hz, decays in 1/s, with the deviation."""
    scale, unit = (2.0 * np.pi, "Hz") if part.unit == HERTZ else (1.0, part.unit)
    sign = "+" if part.size >= 0.0 else ""
    return f"{part.feature} {sign}{with_error(part.size / scale, part.std / scale)} {unit}"


def change_words(found: Monitor) -> tuple[str, ...]:
    """The change that `found` holds, a sentence each: when, of what kind, and what carries it; empty without one."""
    change = found.change
    if change is None:
        return ()
    low, high = change.interval
    kind = "at once" if change.kind == "step" else "more and more"
    span = f"record {low}" if low == high else f"records {low} to {high}"
    return (
        f"It changes {kind} from record {change.index} ({_file(found, change.index)}) on; 95 % interval: {span}.",
        f"Carried by {', '.join(feature_change(part) for part in change.carried_by)}.",
    )


def sentences(found: Monitor) -> tuple[str, ...]:
    """The findings of `found`, a sentence each: the baseline, alarms, the change, and how periodic the records are."""
    out = []
    charts, later = found.charts, ~found.baseline
    if charts is not None:
        depends = [term for term in charts.terms if term != "constant"]
        words = f"depends on {', '.join(depends)}" if depends else "depends on no covariate"
        out.append(f"Baseline: {counted(int(found.baseline.sum()), 'record')}; it {words}.")
        alarms, first = int(found.alarm.sum()), found.first_alarm
        looked = int(np.count_nonzero(later & np.isfinite(charts.t2)))
        if first is None:
            out.append(f"No alarm in {counted(looked, 'later record')}.")
        else:
            words = f"{counted(alarms, 'alarm')} in {counted(looked, 'later record')}"
            out.append(f"{words}, the first at record {first} ({_file(found, first)}).")
    return (*out, *change_words(found), *_periodic(found))


def _file(found: Monitor, record: int) -> str:
    return shortened(found.files[record], LONGEST) or "no file"


def _periodic(found: Monitor) -> tuple[str, ...]:
    """Sentences on the periodic amount and its trend."""
    amounts = found.amounts
    if amounts is None or not np.isfinite(amounts.value).any():
        return ()
    last = int(np.flatnonzero(np.isfinite(amounts.value))[-1])
    value, low, high = (100.0 * own[last] for own in (amounts.value, amounts.low, amounts.high))
    if amounts.along:
        share = with_error(value, 100.0 * amounts.std[last])
        words = f"Sidebands in record {last} have {share} % of the change that is looked for"
    else:
        most = f", most in {amounts.carried_by[last]}" if low > 0.0 else ""
        interval = f"95 %: {low:.3g} to {high:.3g}"
        words = f"Sidebands in record {last}: {value:.3g} % of the response ({interval}){most}"
    trend, out = amounts.trend, [f"{words}."]
    if trend is not None:
        way = "They grow" if trend.slope > 0.0 else "They fall"
        if amounts.along:
            way = "It grows" if trend.slope > 0.0 else "It falls"
        said = f"{way} over the records" if trend.p_value < 0.01 else "No trend over the records"
        out.append(f"{said} (p = {trend.p_value:.2g}).")
    return tuple(out)


def record_heads(found: Monitor) -> list[str]:
    """Names of the columns of `record_rows` of `found`."""
    names = ["record", "file"]
    if found.charts is not None:
        names += ["T² / limit", "average / limit"]
        names += ["directed / limit"] if np.isfinite(found.charts.directed).any() else []
    if found.amounts is not None:
        amount = "of the change" if found.amounts.along else "sidebands"
        names.append(f"{amount} [%] (95 % interval)")
    return [*names, ""]


def record_rows(found: Monitor) -> list[tuple[str, ...]]:
    """Rows of all records of `found`: number, file, T², average, amount, and what is to be said of it."""
    rows: list[tuple[str, ...]] = []
    for k, file in enumerate(found.files):
        charts, amounts = found.charts, found.amounts
        cells = [str(k), shortened(file, LONGEST)]
        if charts is not None:
            cells += [_of(charts.t2[k], charts.t2_limit[k]), _of(charts.ewma[k], charts.ewma_limit[k])]
            if np.isfinite(charts.directed).any():
                cells.append(_of(charts.directed[k], charts.directed_limit[k]))
        if amounts is not None:
            value, low, high = 100.0 * amounts.value[k], 100.0 * amounts.low[k], 100.0 * amounts.high[k]
            cells.append(f"{value:.3g} ({low:.2g} to {high:.2g})" if np.isfinite(value) else "")
        words = ["baseline"] if found.baseline[k] else ["ALARM"] if found.alarm[k] else []
        if charts is not None and charts.extrapolated[k]:
            words.append(f"extrapolated, leverage {charts.leverage[k]:.2g}")
        words += [found.reasons[k] or ""] if found.reasons[k] else []
        rows.append((*cells, ", ".join(words)))
    return rows


def _of(value: float, limit: float) -> str:
    return f"{float(f'{value:.3g}'):g} of {float(f'{limit:.3g}'):g}" if np.isfinite(value) else ""
