"""The rows as tables, a line a record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from benchmarks.chain.run import Row

HEADS = (
    "record",
    "seeds",
    "processor s: min, median, max",
    "linearisations",
    "must-finds found",
    "their worst pull",
    "worst pull",
    "false",
    "order (true)",
    "refused",
    "right",
    "error over bound",
    "within 95 %",
)
"""The last: must-finds with both parts within their 95 % intervals: 90 % if all deviations are right."""

NORMAL = 1.96
"""Deviations of a 95 % interval."""


def table(rows: Sequence[Row]) -> str:
    """One line a record, and what the first refusal of each said."""
    names = list(dict.fromkeys(row.record for row in rows))
    groups = [[row for row in rows if row.record == name] for name in names]
    text = _markdown([list(HEADS), *(_line(of) for of in groups)])
    lines = []
    for of in groups:
        counts = Counter(row.outcome for row in of if row.message)
        first = {row.outcome: row.message for row in reversed(of)}
        lines += [f"- {of[0].record}, {n} {outcome}, the first: {first[outcome]}" for outcome, n in counts.items()]
    return "\n".join([text, *(["", *lines] if lines else [])])


def periods(rows: Sequence[Row]) -> str:
    """What came of periods that are off: a line a record, outcomes and how many of them were right."""
    names = list(dict.fromkeys(row.record for row in rows))
    lines = [["record", "outcomes", "right", "believed wrongly"]]
    for name in names:
        of = [row for row in rows if row.record == name]
        counts = Counter(row.outcome for row in of)
        said = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
        wrong = sum(row.outcome in ("believed", "mended") and not row.right for row in of)
        lines.append([name, said, f"{sum(row.right for row in of)} of {len(of)}", str(wrong)])
    return _markdown(lines)


def _line(rows: Sequence[Row]) -> list[str]:
    answers = [row for row in rows if row.order]
    seconds = [row.seconds for row in rows]
    counts = Counter(row.order for row in answers)
    orders = ", ".join(f"{order}" + (f" x{n}" if len(counts) > 1 else "") for order, n in sorted(counts.items()))
    refused = Counter(row.outcome for row in rows if not row.order)
    ratios = np.concatenate([row.ratios for row in answers]) if answers else np.zeros(0)
    pulls = np.concatenate([row.pulls for row in answers]) if answers else np.zeros(0)
    return [
        rows[0].record,
        str(len(rows)),
        f"{min(seconds):.2f}, {np.median(seconds):.2f}, {max(seconds):.2f}",
        f"{np.median([row.linearisations for row in rows]):.0f}",
        f"{sum(row.found for row in rows)} of {sum(row.must for row in rows)}",
        _number(max((pull for row in answers for pull in row.pulls), default=np.nan)),
        _number(max((row.worst for row in answers), default=np.nan)),
        str(sum(row.false for row in rows)),
        f"{orders or '-'} ({rows[0].true})",
        ", ".join(f"{n} {outcome}" for outcome, n in refused.items()) or "0",
        f"{sum(row.right for row in rows)} of {len(rows)}",
        f"{np.sqrt(np.mean(ratios**2)):.2f}" if len(ratios) else "-",
        f"{np.mean(pulls < NORMAL):.0%}" if len(pulls) else "-",
    ]


def _number(value: float) -> str:
    if np.isnan(value):
        return "-"
    return f"{value:.2f}" if value < 100.0 else f"{value:.2g}"


def _markdown(lines: Sequence[Sequence[str]]) -> str:
    lines = [lines[0], ["---"] * len(lines[0]), *lines[1:]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
