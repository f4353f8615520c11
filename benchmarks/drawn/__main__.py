"""Systems drawn at random, with measured inputs or of outputs alone: how often models are right, or wrong untold."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.draws import add_options, judged_rows, seeds
from scipy.optimize import linear_sum_assignment
from tests.driven import Driven, ambient_of, record_of
from threadpoolctl import threadpool_limits

from floquid import IdentificationError, Record, identify

OFF = 5.0
"""Deviations from which on an exponent is wrong."""

UNCLAIMED = ("ambient_kind", "ambient_kind_apart")
"""Findings on modes of which nothing is claimed: the record does not tell a pair from two real multipliers."""

LASTS = 30.0
"""Nepers by which the slowest mode decays within a record, at least."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """A system of some masses on springs that vary, and how it is measured."""

    system: Driven
    periods: int
    phases: int
    noise: float

    def __str__(self) -> str:
        """What is measured, and the true exponents over 2π, in revolutions."""
        of = ", ".join(f"{one:.4f}" for one in sorted(self.system.exponents(), key=abs) if one.imag >= 0.0)
        shape = f"{len(self.system.C(0.0))} outputs, {self.system.B(0.0).shape[1]} inputs"
        return f"{self.periods} periods of {self.phases}, {shape}, {self.noise:.1%} noise; {of}"


def drawn(seed: int, excitation: str) -> Draw:
    """A stable system of one to three masses; springs, forces and sensors vary with the period, which is 2π s."""
    generator = np.random.default_rng((seed, excitation == "ambient"))

    def of(least: float, most: float) -> float:
        return float(np.exp(generator.uniform(np.log(least), np.log(most))))

    while True:
        n = int(generator.integers(1, 4))
        turn, _ = np.linalg.qr(generator.standard_normal((n, n)))
        natural = np.array([of(0.15, 3.5) for _ in range(n)])
        own = turn @ np.diag(natural**2) @ turn.T
        root = turn @ np.diag(natural) @ turn.T
        damping = 2.0 * root @ np.diag([of(0.005, 0.2) for _ in range(n)])
        damping = 0.5 * (damping + damping.T)
        moved = [generator.uniform(-1.0, 1.0, (n, n)) * of(0.03, 0.8) for _ in range(2)]
        moved = [root @ (part + part.T) @ root / 2.0 for part in moved]
        shift = generator.uniform(0.0, 2.0 * np.pi, 2)

        def spring(t: float, own=own, moved=moved, shift=shift):
            return own + moved[0] * np.cos(t + shift[0]) + 0.5 * moved[1] * np.cos(2.0 * t + shift[1])

        def a(t: float, n=n, spring=spring, damping=damping):
            return np.block([[np.zeros((n, n)), np.eye(n)], [-spring(t), -damping]])

        inputs, outputs = int(generator.integers(1, n + 1)), int(generator.integers(1, 4))
        forces = generator.standard_normal((2, n, inputs)) * np.array([1.0, of(0.01, 0.8)])[:, None, None]
        seen = generator.standard_normal((2, outputs, 2 * n)) * np.array([1.0, of(0.01, 0.8)])[:, None, None]
        if generator.random() < 0.7:
            seen[:, :, n:] = 0.0
        phases = int(generator.choice([12, 16, 20, 32, 50]))
        periods = int(of(40, 300) if excitation == "inputs" else of(200, 1200))
        system = Driven(
            A=a,
            B=lambda t, n=n, forces=forces: np.concatenate(
                [np.zeros_like(forces[0]), forces[0] + forces[1] * np.cos(t)]
            ),
            C=lambda t, seen=seen: seen[0] + seen[1] * np.sin(t),
            period=2.0 * np.pi,
        )
        slowest = -system.exponents().real.max()
        if slowest * system.period * periods > LASTS:
            return Draw(system=system, periods=periods, phases=phases, noise=of(0.002, 0.1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one draw.

    `outcome` is "passed", "failed" or "refused". Of the modes of which something is claimed, `worst` is the most
    deviations that an exponent is off the true one assigned to it; `false` counts those with no true one left.
    """

    seed: int
    states: int
    outcome: str
    order: int = 0
    worst: float = 0.0
    false: int = 0
    codes: tuple[str, ...] = ()
    seconds: float

    @property
    def correct(self) -> bool:
        """Whether every mode of the model is one of the system, whatever the verdict."""
        return self.order > 0 and self.worst < OFF and not self.false

    def __str__(self) -> str:
        wrong = self.outcome == "passed" and not self.correct
        untold = " WRONG" + ("" if self.codes else " UNTOLD") if wrong else ""
        of = f"order {self.order} of {self.states}, worst {self.worst:.1f}"
        return f"{self.seed}: {self.outcome}{untold}, {of}, {self.seconds:.1f} s {' '.join(self.codes)}"


def record_of_draw(draw: Draw, seed: int, excitation: str) -> Record:
    """The record of a draw: channels y…, then inputs u… where they are measured."""
    system = draw.system
    if excitation == "inputs":
        values = np.concatenate(record_of(system, draw.periods, draw.phases, draw.noise, seed))
    else:
        values = ambient_of(system, draw.periods, draw.phases, draw.noise, seed)
    outputs = len(system.C(0.0))
    names = [f"y{k}" for k in range(outputs)] + [f"u{k}" for k in range(len(values) - outputs)]
    return Record(values=values, sample_rate=draw.phases / system.period, channels=names)


def inputs_of(record: Record) -> list[str]:
    """The names of its inputs, which begin with u."""
    return [channel.name for channel in record.channels if channel.name.startswith("u")]


def judged(seed: int, excitation: str) -> Row:
    """The row of one draw, identified on one thread as a user would."""
    draw = drawn(seed, excitation)
    system, begin = draw.system, time.process_time()
    record, states = record_of_draw(draw, seed, excitation), len(system.A(0.0))
    try:
        with threadpool_limits(limits=1):
            if excitation == "inputs":
                found = identify(record, period=system.period, inputs=inputs_of(record))
            else:
                found = identify(record, period=system.period, excitation="ambient")
    except IdentificationError:
        return Row(seed=seed, states=states, outcome="refused", seconds=time.process_time() - begin)
    seconds, model = time.process_time() - begin, found.model
    told = [one for own in found.findings if own.code in UNCLAIMED for one in own.numbers["frequencies"]]
    claimed = ~np.isin(np.abs(model.exponents) / (2.0 * np.pi), told)
    gap = model.exponents[claimed, None] - system.exponents()
    gap.imag -= np.rint(gap.imag)
    rows, near = linear_sum_assignment(np.abs(gap))
    off, std = gap[rows, near], model.exponent_std[claimed][rows]
    # A real multiplier has no deviation off its axis: a pair that is on it within that of the decay is the same.
    worst = np.maximum(np.abs(off.real) / std.real, np.abs(off.imag) / np.where(std.imag > 0.0, std.imag, std.real))
    return Row(
        seed=seed,
        states=states,
        outcome="passed" if found.passed else "failed",
        order=model.order,
        worst=float(worst.max(initial=0.0)),
        false=int(claimed.sum()) - len(rows),
        codes=tuple(sorted({own.code for own in found.findings if own.severity.name != "NOTE"})),
        seconds=seconds,
    )


def table(rows: Sequence[Row]) -> str:
    """Counts of what passed and was right."""
    passed = [row for row in rows if row.outcome == "passed"]
    wrong = [row for row in passed if not row.correct]
    lines = [
        ("passed", f"{len(passed)} of {len(rows)}"),
        ("all modes", f"{sum(row.order == row.states for row in passed if row.correct)}"),
        ("fewer, all right", f"{sum(row.order < row.states for row in passed if row.correct)}"),
        ("wrong, with a warning", ", ".join(str(row.seed) for row in wrong if row.codes) or "none"),
        ("wrong, without", ", ".join(str(row.seed) for row in wrong if not row.codes) or "none"),
        ("failed though right", f"{sum(row.outcome == 'failed' and row.correct for row in rows)}"),
        ("seconds: median, most", "{:.1f}, {:.1f}".format(*np.quantile([row.seconds for row in rows], [0.5, 1.0]))),
    ]
    head = (("draws", f"{rows[0].seed} to {rows[-1].seed}"), ("---", "---"))
    return "\n".join(f"| {name} | {value} |" for name, value in (*head, *lines))


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drawn", description=__doc__)
    parser.add_argument(
        "excitation", choices=("inputs", "ambient"), help="what is measured: inputs too, or outputs alone"
    )
    add_options(parser, draws=100)
    options = parser.parse_args(arguments)
    if options.draws < 1 or options.jobs < 1:
        parser.error("--draws and --jobs are 1 or more")
    rows = judged_rows(judged, [(seed, options.excitation) for seed in seeds(options)], options)
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
