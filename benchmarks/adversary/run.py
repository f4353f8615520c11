"""One record identified and judged: right or wrong, and whether the verdict or a finding says so."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

import numpy as np
from benchmarks.adversary.kinds import KINDS
from benchmarks.chain.case import Case
from benchmarks.chain.run import OutOfTime, compared, limited

import floquid
from floquid import FloquidError
from floquid.findings import Severity

OFF = 5.0
"""Deviations from which on an exponent is wrong."""

LIMIT = 120.0
"""Processor seconds after which a run is ended."""

WITHIN = 1.96
"""Deviations of a 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one record.

    `outcome` is "passed" or "failed" (the verdict), "refused", "no answer" or "error". `wrong`: a confident exponent is
    no true one, or a must-find is missing or more than five deviations off. `told`: a warning stands beside it.
    `inside` of `intervals` 95 % intervals of must-finds hold the truth, both parts counted.
    """

    kind: str
    seed: int
    outcome: str
    message: str
    seconds: float
    must: int
    found: int
    false: int
    worst: float
    order: int
    true: int
    wrong: bool
    told: bool
    codes: tuple[str, ...]
    inside: int
    intervals: int

    @property
    def silent(self) -> bool:
        """Whether it is wrong, passed, and without a warning."""
        return self.wrong and self.outcome == "passed" and not self.told

    def as_json(self) -> dict:
        """The row with what follows from it."""
        return {**asdict(self), "silent": self.silent}


def case_of(kind: str, seed: int) -> Case:
    """The case of one seed of a kind."""
    return KINDS[kind].make(np.random.default_rng([sum(kind.encode()), seed]))


def judged(kind: str, seed: int) -> Row:
    """The row of one record: `identify` as a user would call it."""
    case = case_of(kind, seed)
    analysis, outcome, message = None, "", ""
    begin = time.process_time()
    try:
        with limited(LIMIT):
            analysis = floquid.identify(list(case.records), **case.options)
    except OutOfTime:
        outcome = "no answer"
    except FloquidError as error:
        outcome, message = "refused", str(error)
    except Exception as error:  # noqa: BLE001  # a defect is a row of its own, not the end of the table
        outcome, message = "error", f"{type(error).__name__}: {error}"
    said = {"seconds": time.process_time() - begin, "must": int(case.must.sum()), "true": len(case.exponents)}
    nothing = {"found": 0, "false": 0, "worst": 0.0, "order": 0, "codes": (), "inside": 0, "intervals": 0}
    if analysis is None:
        return Row(kind=kind, seed=seed, outcome=outcome, message=message, wrong=False, told=True, **said, **nothing)
    own = compared(case, analysis.model)
    pulls = np.array(own["pulls"])
    said_all = (*analysis.findings, *analysis.validation.findings)
    warned = [each for each in said_all if each.severity is not Severity.NOTE]
    codes = sorted({each.code for each in warned})
    return Row(
        kind=kind,
        seed=seed,
        outcome="passed" if analysis.passed else "failed",
        message="; ".join(analysis.reasons),
        wrong=bool(own["false"] or (pulls > OFF).any()),
        told=bool(warned),
        codes=tuple(codes),
        inside=int((pulls < WITHIN).sum()),
        intervals=len(pulls),
        worst=float(max(own["worst"], pulls.max(initial=0.0))),
        **said,
        **{name: own[name] for name in ("found", "false", "order")},
    )
