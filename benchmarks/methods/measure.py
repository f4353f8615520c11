"""Error and time of one method on the records of one case."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.methods.entries import METHODS, Found, Method
from benchmarks.methods.records import CASES, Case, driven_bound, free_bound, sampled_transfer, truth
from numpy.typing import NDArray

from floquid.testing import pair_exponents

SECONDS, FEWEST = 75.0, 4
"""Seconds of the processor after which no further record is taken by default, and records that always are."""


def applies(method: Method, case: Case) -> bool:
    """True where a method is run on a case."""
    return method.kind == case.kind and method.only in case.name


def errors_of(found: Found, case: Case) -> tuple[NDArray[np.complex128], NDArray[np.complex128] | None] | None:
    """Errors of the upper exponents, and the deviations given of them (modes,); None where some are missing."""
    exponents, true = found.exponents, truth(case.system)
    if exponents is None or not np.isfinite(exponents).all() or len(exponents) < len(true):
        return None
    pairing = pair_exponents(exponents, true, case.system.period)
    return pairing.differences, None if found.std is None else found.std[pairing.permutation]


def transfer_error(found: Found, case: Case) -> float | None:
    """The rms error of G over all lines, harmonics and paths, over its largest value."""
    if found.transfer is None:
        return None
    own = found.transfer
    true = sampled_transfer(case.system, case.phases, own.frequencies_hz, own.harmonics.tolist())
    return float(np.sqrt(np.nanmean(np.abs(own.values - true) ** 2)) / np.abs(true).max())


def measured(method: Method, cases: list[Case], most: float = SECONDS) -> dict[str, Any]:
    """Errors, deviations and times over records that differ in their noise; imports are done before.

    No further record is taken after `most` seconds of the processor.
    """
    case = cases[0]
    row: dict[str, Any] = {"method": method.name, "case": f"{case.kind}, {case.name}"}
    errors, given, transfers, seconds, failures, lost, order = [], [], [], [], set(), 0, []
    for count, own in enumerate(cases, start=1):
        row["runs"] = count
        _ = own.data, own.samples, own.experiments if method.source == "liu1997" else None
        start = time.process_time()
        try:
            found = method.run(own)
        except Exception as error:  # noqa: BLE001 - whatever a method raises is a run lost
            failures.add(f"{type(error).__name__}: {error}"[:160])
            lost += 1
            continue
        seconds.append(time.process_time() - start)
        both, transfer = errors_of(found, own), transfer_error(found, own)
        if found.exponents is not None:
            order.append(len(found.exponents))
            lost += both is None
        if both is not None:
            errors.append(both[0])
            given += [both[1]] if both[1] is not None else []
        transfers += [transfer] if transfer is not None else []
        if sum(seconds) > most and len(seconds) >= FEWEST:
            break
    row |= {"lost": lost, "failures": sorted(failures)}
    row["seconds"] = float(np.median(seconds)) if seconds else None
    row["orders"] = sorted(set(order))
    row["transfer"] = float(np.sqrt(np.mean(np.square(transfers)))) if transfers else None
    row["errors"] = [[[own.real, own.imag] for own in one.tolist()] for one in errors]
    row["given"] = [[[own.real, own.imag] for own in one.tolist()] for one in given]
    return row


def over_bounds(rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Rows with errors over the bound of their case, the rms of all and the worst run, and over their own deviations.

    The bound is Cramér and Rao's; of outputs alone the mean deviation that floquid's chain gives.
    """
    bounds: dict[str, NDArray[np.float64]] = {}
    for row in rows:
        name, case = row["case"], CASES[row["case"]]
        if name not in bounds:
            if case.kind == "ambient":
                own = next(r for r in rows if r["case"] == name and r["method"].startswith("floquid"))
                bounds[name] = np.sqrt(np.mean(np.square(own["given"]), axis=0))
            else:
                bounds[name] = (free_bound(case) if case.kind == "free" else driven_bound(case)).T
        errors = np.array(row.pop("errors")).reshape(-1, *bounds[name].shape)
        given = np.array(row.pop("given")).reshape(-1, *bounds[name].shape)
        runs = np.sqrt(np.mean((errors / bounds[name]) ** 2, axis=(1, 2)))
        row["bound"] = bounds[name].tolist()
        row["error"] = float(np.sqrt(np.mean(runs**2))) if len(runs) else None
        row["worst"] = float(runs.max()) if len(runs) else None
        row["z"] = float(np.sqrt(np.mean((errors / given) ** 2))) if len(given) else None
        yield row


def all_rows(seeds: int, only: str, say: Callable[[str], None], most: float = SECONDS) -> list[dict[str, Any]]:
    """A row a method and case."""
    rows, warm = [], set()
    for case in CASES.values():
        cases = [replace(case, seed=seed) for seed in range(seeds)]
        for method in METHODS:
            if not applies(method, case) or only not in f"{case.kind}, {case.name}":
                continue
            if method.name not in warm:
                warm.add(method.name)
                measured(method, cases[:1])  # packages are loaded
            rows.append(measured(method, cases, most))
            own = rows[-1]
            say(f"{own['case']}: {own['method']}: {own['runs']} runs, {own['lost']} lost, {own['seconds']} s")
    return list(over_bounds(rows))
