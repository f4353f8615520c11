"""Exponents across the edges of locks: how often their intervals hold the truth, and whether any passes far off."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.edge.systems import FAMILIES, Family
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from threadpoolctl import threadpool_limits

import floquid
from floquid import FloquidError, Record, floquet

STEPS = (0.001, 0.003, 0.01, 0.03)
"""Distances from the edge, over the parameter there, on either side."""

NOISE = 0.01
WITHIN, FAR = 1.96, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Outcome of one draw.

    `pulls` are the errors of both parts of each true exponent that has one of the model, over their deviations. `told`
    says that a single real multiplier stands for two, that a warning says that one is missing, and that the one found
    is no farther off than a note says noise may hide.
    """

    family: str
    step: float
    seed: int
    outcome: str
    order: int = 0
    true: int = 0
    pulls: tuple[float, ...] = ()
    told: bool = False
    message: str = ""
    seconds: float = 0.0

    @property
    def wrong(self) -> bool:
        """True of a result that passes with an exponent far off, or with another order, and does not tell."""
        off = max(self.pulls, default=0.0) > FAR or self.order != self.true
        return self.outcome == "passed" and off and not self.told

    def __str__(self) -> str:
        pulls = " ".join(f"{pull:.1f}" for pull in self.pulls)
        order = f"order {self.order} ({self.true})"
        name = f"{self.family} {self.step:+.3f} {self.seed}"
        return f"{name}: {self.outcome}, {order}, {pulls}, {self.seconds:.1f} s {self.message}"


def judged(family: Family, step: float, seed: int, excitation: str = "free") -> Row:
    """Identify one draw as a user would, on one thread: a free response, or one to a measured force."""
    parameter = family.edge() * (1.0 + step)
    matrix, _ = family.system(parameter)
    truth = floquet.exponents(matrix)
    generator = np.random.default_rng([seed, FAMILIES.index(family), int(1e4 * (1.0 + step))])
    start, driven = generator.standard_normal(matrix.shape[0]), excitation == "inputs"
    force = generator.standard_normal(family.phases * family.cycles) * driven
    clean = family.forced(parameter, start, force)
    noise = NOISE * (clean.std(axis=1, keepdims=True) if driven else np.abs(clean).max(axis=1, keepdims=True))
    values = clean + noise * generator.standard_normal(clean.shape)
    record = Record(
        values=np.concatenate([values, force[None]]) if driven else values,
        sample_rate=family.phases / matrix.period,
        channels=[*(f"x{k}" for k in range(len(clean))), *(["force"] if driven else [])],
    )
    common = {"family": family.name, "step": step, "seed": seed, "true": len(truth)}
    begin = time.process_time()
    try:
        with threadpool_limits(limits=1):
            if driven:
                analysis = floquid.identify(record, period=matrix.period, inputs=["force"])
            else:
                analysis = floquid.identify(record, period=matrix.period)
    except FloquidError as error:
        return Row(outcome="refused", message=str(error).splitlines()[0][:150], **common)
    model = analysis.model
    gaps = np.subtract.outer(truth, model.exponents)
    gaps = gaps.real + 1j * wrapped(gaps.imag, model.fundamental)
    rows, columns = linear_sum_assignment(np.abs(gaps))
    errors, std = gaps[rows, columns], model.exponent_std[columns]
    with np.errstate(divide="ignore", invalid="ignore"):
        pulls = [
            *np.where(np.abs(errors.real) < 1e-9, 0.0, np.abs(errors.real) / std.real),
            *np.where(np.abs(errors.imag) < 1e-9, 0.0, np.abs(errors.imag) / std.imag),
        ]
    return Row(
        outcome="passed" if analysis.passed else "failed",
        order=model.order,
        pulls=tuple(float(min(pull, 1e6)) for pull in pulls),
        told=model.order == len(truth) - 1 and _told(analysis, truth),
        seconds=time.process_time() - begin,
        message=" ".join(map(str, [*analysis.reasons][:1] if not analysis.passed else []))[:150],
        **common,
    )


def _told(analysis: floquid.Analysis, truth: NDArray[np.complex128]) -> bool:
    """Whether a warning says that a multiplier is missing, and the one found is as near a true one as a note says."""
    notes = [found.numbers for found in analysis.fit.findings if found.code == "hidden_partner"]
    if len(notes) != 1 or "partner_missing" not in {found.code for found in analysis.findings}:
        return False
    model, alone = analysis.model, int(np.flatnonzero(analysis.model.real)[0])
    gaps = truth - model.exponents[alone]
    gaps = np.abs(gaps.real + 1j * wrapped(gaps.imag, model.fundamental))
    return bool(gaps.min() < float(notes[0]["apart"]) + FAR * float(model.exponent_std[alone].real))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every family, step and draw, print a summary, and write the rows."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.edge", description=__doc__)
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--records", choices=("free", "inputs"), default="free", help="responses of a kind")
    parser.add_argument("--only", default="", help="families whose names begin so")
    parser.add_argument("--out", type=Path, default=None)
    asked = parser.parse_args(arguments)
    families = [family for family in FAMILIES if family.name.startswith(asked.only)]
    cases = [
        (f, sign * step, seed) for f in families for step in STEPS for sign in (-1, 1) for seed in range(asked.draws)
    ]
    rows: list[Row] = []
    with ProcessPoolExecutor(asked.jobs) as pool:
        for row in pool.map(judged, *zip(*cases, strict=True), repeat(asked.records)):
            rows.append(row)
            if row.wrong or row.outcome != "passed":
                sys.stdout.write(f"{row}\n")
    for name in [family.name for family in families]:
        own = [row for row in rows if row.family == name]
        sys.stdout.write(f"{name}: {_summary(own)}\n")
    sys.stdout.write(f"all: {_summary(rows)}\n")
    if asked.out:
        asked.out.write_text(json.dumps([asdict(row) for row in rows]))
    return 0


def _summary(rows: Sequence[Row]) -> str:
    """Counts, and the share of intervals that hold the truth among models of the right order."""
    answered = [row for row in rows if row.pulls]
    pulls = np.array([pull for row in answered if row.order == row.true for pull in row.pulls])
    right = sum(row.order == row.true for row in rows)
    held = float(np.mean(pulls < WITHIN)) if len(pulls) else np.nan
    outcomes = {what: sum(row.outcome == what for row in rows) for what in ("passed", "failed", "refused")}
    return (
        f"{len(rows)} draws, {outcomes}, order right {right}, one told of two {sum(row.told for row in rows)}, "
        f"wrong and passed {sum(row.wrong for row in rows)}, "
        f"intervals hold {held:.3f}, worst {pulls.max(initial=0.0):.1f}, "
        f"{np.median([row.seconds for row in answered]):.2f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
