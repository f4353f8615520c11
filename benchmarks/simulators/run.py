"""One draw identified as a user would, and held against the machine's own exponents."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.chain.run import OutOfTime, limited
from benchmarks.simulators import others, turbines, walker
from benchmarks.simulators.machine import SEEN, Complexes, Machine
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from threadpoolctl import threadpool_limits

import floquid
from floquid import FloquidError, Record

WITHIN = 4.0
"""Deviations within which an exponent is found."""

NEAR = 1e-3
"""The share of the fundamental within which no exponent is called false."""

SLOW = 10.0
"""Times the lifted fit's processor seconds that an identification may take."""

LIMIT = 120.0
"""Processor seconds after which an identification is ended."""

TOLD = 140
"""Characters that are kept of each reason for a verdict."""

MACHINES: dict[str, Callable[[], Machine]] = {
    "soft_blade": turbines.soft_blade,
    "two_blades": turbines.two_blades,
    "gravity": turbines.gravity,
    "walker": walker.walker,
    "walker_pushed": walker.walker_pushed,
    "converter": others.converter,
    "cracked": others.cracked,
    "strip": others.strip,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Outcome of one draw.

    `outcome` is "passed", "failed" (the verdict), "refused" or "no answer". `must` counts the true exponents that the
    bound lets be seen, `found` those of them within four deviations, `false` the confident exponents that are none.
    `bounds` are the least deviations of the true exponents over their decays, `off` their distances to those of the
    model over the same, `pulls` the errors in deviations of the model, the larger of both parts; infinite without any.
    """

    machine: str
    noise: float
    seed: int
    outcome: str
    message: str = ""
    codes: tuple[str, ...] = ()
    order: int = 0
    true: int = 0
    must: int = 0
    found: int = 0
    false: int = 0
    misfit: float | None = None
    seconds: float = 0.0
    lifted: str = ""
    lifted_order: int = 0
    lifted_seconds: float = 0.0
    exponents: tuple[tuple[float, float], ...] = ()
    bounds: tuple[float, ...] = ()
    off: tuple[float, ...] = ()
    pulls: tuple[float, ...] = ()
    model: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def slow(self) -> bool:
        """Whether it took more than ten times as long as the lifted fit."""
        return self.seconds > SLOW * self.lifted_seconds

    def __str__(self) -> str:
        name = f"{self.machine}, {self.noise:.1%}, {self.seed}: {self.outcome}"
        counts = f"order {self.order} ({self.true}), {self.found} of {self.must} found, {self.false} false"
        times = f"{self.seconds:.1f} s, lifted {self.lifted_seconds:.1f} s ({self.lifted}, order {self.lifted_order})"
        return f"{name}, {counts}, {times} {' '.join(self.codes)} {self.message}"


def timed(records: list[Record], **options: object) -> tuple[floquid.Analysis | None, str, str, float]:
    """The analysis of records on one thread, its outcome, a message, and its processor seconds."""
    begin, analysis, message = time.process_time(), None, ""
    try:
        with threadpool_limits(limits=1), limited(LIMIT):
            analysis = floquid.identify(records, **options)
            outcome = "passed" if analysis.passed else "failed"
            message = " | ".join(reason[:TOLD] for reason in analysis.reasons) if not analysis.passed else ""
    except OutOfTime:
        outcome = "no answer"
    except FloquidError as error:
        outcome, message = "refused", str(error)
    return analysis, outcome, message, time.process_time() - begin


def judged(name: str, noise: float, seed: int) -> Row:
    """The row of one draw."""
    machine = MACHINES[name]()
    records, starts, sigma = machine.records(noise, seed)
    truth, least = machine.least(starts, sigma)
    bounds = np.maximum(least.real, np.abs(least.imag)) / np.abs(truth.real)
    must = bounds < SEEN
    analysis, outcome, message, seconds = timed(records)
    plain, lifted, _, lifted_seconds = timed(records, constrained=False)
    common = {
        "machine": name,
        "noise": noise,
        "seed": seed,
        "outcome": outcome,
        "message": message,
        "true": len(truth),
        "must": int(must.sum()),
        "seconds": seconds,
        "lifted": lifted,
        "lifted_order": 0 if plain is None else plain.model.order,
        "lifted_seconds": lifted_seconds,
        "exponents": tuple((float(each.real), float(each.imag)) for each in truth),
        "bounds": tuple(float(each) for each in bounds),
    }
    if analysis is None:
        return Row(**common)
    model = analysis.model
    std = model.exponent_std
    std = np.full(model.order, np.inf * (1.0 + 1.0j)) if std is None else std
    pulls, gaps = pulls_of(truth, model.exponents, std, machine.fundamental)
    partner = assigned(pulls <= WITHIN, gaps)
    pull = np.array([pulls[i, j] if j >= 0 else np.inf for i, j in enumerate(partner)])
    off = np.array([gaps[i, j] if j >= 0 else np.inf for i, j in enumerate(partner)])
    return Row(
        order=model.order,
        found=int(np.sum(must & (pull <= WITHIN))),
        false=false_of(machine.exponents, model.exponents, std, machine.fundamental),
        codes=tuple(sorted({each.code for each in analysis.findings if each.severity.name != "NOTE"})),
        misfit=analysis.misfit,
        off=tuple(float(each) for each in off / np.abs(truth.real)),
        pulls=tuple(float(each) for each in pull),
        model=tuple(
            (float(e.real), float(e.imag), float(s.real), float(s.imag))
            for e, s in zip(model.exponents, std, strict=True)
        ),
        **common,
    )


def pulls_of(
    truth: Complexes, exponents: Complexes, std: Complexes, fundamental: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors in deviations, the larger of both parts, and distances, modulo iω (true, exponents)."""
    gap = np.subtract.outer(truth, exponents)
    parts = np.abs(gap.real), np.abs(wrapped(gap.imag, fundamental))
    pulls = []
    for part, deviation in zip(parts, (std.real, std.imag), strict=True):
        # A real multiplier has no deviation off its axis.
        exact = part < 1e-9 * fundamental
        with np.errstate(divide="ignore", invalid="ignore"):
            pulls.append(np.where(np.isfinite(deviation), np.where(exact, 0.0, part / deviation), np.inf))
    return np.maximum(*pulls), np.hypot(*parts)


def assigned(right: NDArray[np.bool_], gaps: NDArray[np.float64]) -> NDArray[np.intp]:
    """The column of each row, -1 for none: as many right ones as can be, then the nearest."""
    cost = np.where(right, 0.0, 1.0) + 1e-3 * gaps / gaps.max(initial=1e-300)
    rows, columns = linear_sum_assignment(cost)
    found = np.full(len(gaps), -1)
    found[rows] = columns
    return found


def false_of(truth: Complexes, exponents: Complexes, std: Complexes, fundamental: float) -> int:
    """Count exponents of small deviations that are no true one; each true one stands for one alone."""
    pulls, gaps = pulls_of(truth, exponents, std, fundamental)
    right = (pulls <= WITHIN) | (gaps < NEAR * fundamental)
    partner = assigned(right.T, gaps.T)
    held = np.array([j >= 0 and right[j, i] for i, j in enumerate(partner)], bool)
    confident = np.maximum(std.real, std.imag) < SEEN * np.abs(exponents.real)
    return int(np.sum(confident & ~held))
