"""Time and error of one entry on one case."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmarks.peers.cases import Case
from benchmarks.peers.entries import Entry
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

OFF = 10.0
"""The bounds by which a pole may be off before the run counts as lost."""

PATIENCE = 2.0
"""Seconds: an entry that takes longer is run on two cases, and left out where there are more modes."""


def pulls(found: NDArray[np.complex128], case: Case) -> NDArray[np.float64] | None:
    """Errors over the bound's deviations (2, modes) of the poles nearest to the true ones; None if there are too few.

    Poles are paired one to one; of those that are too many, the rest is not looked at.
    """
    found = found[np.isfinite(found) & (found != 0)]
    off = np.subtract.outer(np.log(found), case.logs)
    off = off.real + 1j * (np.mod(off.imag + np.pi, 2.0 * np.pi) - np.pi)
    if len(found) < len(case.logs):
        return None
    rows, columns = linear_sum_assignment(np.abs(off) / np.hypot(*case.std))
    nearest = np.empty(len(case.logs), complex)
    nearest[columns] = off[rows, columns]
    return np.stack([nearest.real, nearest.imag]) / case.std


def fastest(action: Callable[[], Any], *, least: int = 3, seconds: float = 1.5) -> float:
    """The shortest of at least `least` runs [s], or of as many as `seconds` hold; one where a run takes longer."""
    best, spent, runs = np.inf, 0.0, 0
    while runs == 0 or (spent < seconds and (runs < least or spent < 0.5 * seconds)):
        start = time.perf_counter()
        action()
        once = time.perf_counter() - start
        best, spent, runs = min(best, once), spent + once, runs + 1
    return best


def judged(entry: Entry, cases: list[Case]) -> dict[str, Any]:
    """Time on the first case [s], error over the bound of the runs not lost, and how many were lost.

    Of an entry that takes longer than `PATIENCE`, two runs are enough.
    """
    row: dict[str, Any] = {"name": entry.name, "chosen": entry.chosen, "ours": entry.ours}
    row |= {"seconds": None, "extract_seconds": None, "slow": False}
    squares, lost, failures, runs = [], 0, set(), 0
    for case in cases:
        if row["slow"] and runs >= 2:
            break
        runs += 1
        start = time.perf_counter()
        try:
            pull = pulls(entry.run(case.data, case.order), case)
        except Exception as error:  # noqa: BLE001 - whatever another's code raises is a run lost
            failures.add(f"{type(error).__name__}: {error}"[:200])
            pull = None
        else:
            keep(row, "seconds", time.perf_counter() - start)
        row["slow"] = row["slow"] or time.perf_counter() - start > PATIENCE
        if pull is None or np.abs(pull).max() > OFF:
            lost += 1
        else:
            squares.append(np.mean(pull**2))
    row |= {"runs": runs, "lost": lost, "failures": sorted(failures)}
    row["error"] = float(np.sqrt(np.mean(squares))) if squares else None
    if row["seconds"] is not None and row["seconds"] < PATIENCE:
        timed(row, entry, cases[0])
    return row


def timed(row: dict[str, Any], entry: Entry, case: Case) -> None:
    """Time an entry again; the row keeps the shorter. Rounds over all share out what else the machine does."""
    keep(row, "seconds", fastest(lambda: entry.run(case.data, case.order)))
    if entry.parts is not None:
        keep(row, "extract_seconds", fastest(entry.parts(case.data, case.order)))


def keep(row: dict[str, Any], name: str, seconds: float) -> None:
    """The shorter of two times."""
    row[name] = seconds if row[name] is None else min(row[name], seconds)
