"""Result files of the other benchmarks as numbers by group, and two such summaries compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]

Summary = dict[str, dict[str, float]]
"""Of each group of rows, numbers by name."""

GOOD = ("right", "found")
BAD = ("false", "wrong", "silent", "lost", "extra", "defects", "error")
"""Numbers of which more is better, or worse; of others a change is no more than that."""

NEAR = 0.05
"""The relative change within which errors over a bound, and shares of intervals, are alike: they vary with rounding."""

TIMES = ("seconds", "longest")


def _count(rows: Sequence[Mapping[str, Any]], of: Callable[[Mapping[str, Any]], Any]) -> int:
    return sum(int(of(row)) for row in rows)


def _times(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The sum of seconds of all runs, and the longest one."""
    seconds = [row["seconds"] or 0.0 for row in rows]
    return {"runs": len(rows), "seconds": round(sum(seconds), 2), "longest": round(max(seconds), 2)}


def _chain(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    return {
        "right": _count(rows, lambda row: row["right"]),
        "found": _count(rows, lambda row: row["found"]),
        "false": _count(rows, lambda row: row["false"]),
        "refused": _count(rows, lambda row: row["outcome"] == "refused"),
        "defects": _count(rows, lambda row: row["outcome"] in ("failed", "no answer")),
        "linearisations": _count(rows, lambda row: row["linearisations"]),
    }


def _adversary(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    answers = [row for row in rows if row["outcome"] in ("passed", "failed")]
    return {
        "right": _count(answers, lambda row: not row["wrong"]),
        "found": _count(rows, lambda row: row["found"]),
        "silent": _count(rows, lambda row: row["silent"]),
        "wrong": _count(answers, lambda row: row["wrong"]),
        "refused": _count(rows, lambda row: row["outcome"] == "refused"),
        "defects": _count(rows, lambda row: row["outcome"] in ("no answer", "error")),
        "intervals": _share(_count(answers, lambda row: row["inside"]), _count(answers, lambda row: row["intervals"])),
    }


def _drawn(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    from benchmarks.drawn.__main__ import OFF

    def correct(row: Mapping[str, Any]) -> bool:
        return row["order"] > 0 and row["worst"] < OFF and not row["false"]

    passed = [row for row in rows if row["outcome"] == "passed"]
    return {
        "right": _count(passed, correct),
        "found": _count(passed, lambda row: correct(row) and row["order"] == row["states"]),
        "silent": _count(passed, lambda row: not correct(row) and not row["codes"]),
        "wrong": _count(passed, lambda row: not correct(row)),
        "failed though right": _count(rows, lambda row: row["outcome"] == "failed" and correct(row)),
        "refused": _count(rows, lambda row: row["outcome"] == "refused"),
    }


def _turbine(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    from benchmarks.turbine.__main__ import WITHIN

    passed = [row for row in rows if row["outcome"] == "passed"]
    of = {"right": _count(rows, lambda row: row["right"]), "passed": len(passed)}
    for name in ("frequency", "damping"):
        off = np.array([value for row in passed for value in row[name]])
        of[f"intervals of {name}"] = _share(int(np.count_nonzero(off < WITHIN)), off.size)
    return of


def _order(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    squares = np.concatenate([row["squares"] for row in rows])
    return {
        "right": _count(rows, lambda row: row["right"]),
        "lost": _count(rows, lambda row: row["lost"]),
        "silent": _count(rows, lambda row: row["silent"]),
        "extra": _count(rows, lambda row: row["extra"] > 0),
        "ambiguous": _count(rows, lambda row: row["ambiguous"]),
        "error": round(float(np.sqrt(squares.mean())), 4) if squares.size else 0.0,
    }


def _methods(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    (row,) = rows
    names = ("runs", "lost", "seconds", "error", "z", "transfer")
    return {name: float(f"{row[name]:.4g}") for name in names if row[name] is not None}


def _share(part: int, whole: int) -> float:
    return round(part / whole, 4) if whole else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A result file: where its own command writes it, how its rows are grouped, and what is said of a group.

    Parameters
    ----------
    path, committed
        Of the file under the folder of results, and of the one taken where that is not there, if any.
    group
        The group of a row.
    of
        The numbers of the rows of a group.
    """

    path: str
    group: Callable[[Mapping[str, Any]], str]
    of: Callable[[Sequence[Mapping[str, Any]]], dict[str, float]]
    committed: str = ""

    def rows(self, folder: Path) -> list[dict[str, Any]] | None:
        """The rows in a folder of results, or those committed; None where there are none."""
        for path in (folder / self.path, ROOT / self.committed):
            if path.is_file():
                text = path.read_text(encoding="utf-8")
                if path.suffix == ".jsonl":
                    return [json.loads(line) for line in text.splitlines()]
                kept = json.loads(text)
                return kept["rows"] if isinstance(kept, dict) else kept
        return None


TABLES: dict[str, Table] = {
    "chain": Table(
        path="chain.json", group=lambda row: row["record"], of=_chain, committed="benchmarks/chain/after.json"
    ),
    "adversary": Table(path="adversary.json", group=lambda row: row["kind"], of=_adversary),
    "drawn, inputs": Table(path="drawn_inputs.json", group=lambda row: f"{row['states']} states", of=_drawn),
    "drawn, ambient": Table(path="drawn_ambient.json", group=lambda row: f"{row['states']} states", of=_drawn),
    "turbine": Table(path="turbine.json", group=lambda _: "all", of=_turbine),
    "order": Table(path="order/order.jsonl", group=lambda row: row["case"], of=_order),
    "methods": Table(
        path="methods/methods.json",
        group=lambda row: f"{row['case']}, {row['method']}",
        of=_methods,
        committed="docs/methods/methods.json",
    ),
}
"""The tables by name; those without a committed file are there after their commands have run."""


def summaries(folder: Path) -> dict[str, Summary]:
    """Of each table whose file is there, the numbers of its groups."""
    found = {}
    for name, table in TABLES.items():
        rows = table.rows(folder)
        if not rows:
            continue
        groups: dict[str, list[dict[str, Any]]] = {}
        for row in rows:
            groups.setdefault(table.group(row), []).append(row)
        found[name] = {group: _times(of) | table.of(of) for group, of in sorted(groups.items())}
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A number of a group that changed."""

    table: str
    group: str
    number: str
    then: float
    now: float

    @property
    def name(self) -> str:
        """The key by which a reason stands beside it."""
        return f"{self.table}, {self.group}"

    @property
    def worse(self) -> bool:
        """True of fewer that are right, or more that are wrong."""
        return (self.now < self.then and self.number in GOOD) or (self.now > self.then and self.number in BAD)

    def __str__(self) -> str:
        known = self.number in (*GOOD, *BAD)
        said = "worse" if self.worse else "better" if known else "other"
        return f"{self.name}: {said}: {self.number} {self.then:g} → {self.now:g}"


def changes(then: Mapping[str, Summary], now: Mapping[str, Summary]) -> list[Change]:
    """The numbers that changed, times aside; of groups of another number of runs that number alone."""
    found = []
    for table, group in [(name, group) for name in then if name in now for group in then[name]]:
        before, after = then[table][group], now[table].get(group, {"runs": 0})
        names = [name for name in before if name not in TIMES]
        if before["runs"] != after["runs"]:
            names = ["runs"]
        for name in names:
            old, new = before[name], after.get(name, float("nan"))
            counted = float(old).is_integer() and float(new).is_integer()
            if old != new and (counted or not abs(new - old) <= NEAR * abs(old)):
                found.append(Change(table=table, group=group, number=name, then=old, now=new))
    return found


def times(then: Mapping[str, Summary], now: Mapping[str, Summary]) -> str:
    """The seconds of each table, as they were measured: not scaled, since its file has no calibration."""
    lines = ["| table | s then | s now |", "|---|---|---|"]
    for name in (name for name in then if name in now):
        sums = [sum(group["seconds"] for group in of[name].values()) for of in (then, now)]
        lines.append(f"| {name} | {sums[0]:.0f} | {sums[1]:.0f} |")
    return "\n".join(lines)
