"""Free responses of simulated machines, identified and held against their equations: a line a machine and noise."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from benchmarks.draws import add_options, judged_rows, seeds
from benchmarks.simulators.machine import SEEN
from benchmarks.simulators.run import MACHINES, Row, judged
from benchmarks.simulators.turbines import LINEARISED

HEADS = (
    "machine", "noise", "draws", "refused", "failed", "passed", "order (true)", "found of seen", "false",
    "worst deviation", "seconds", "lifted fit", "times",
)  # fmt: skip


def line(rows: Sequence[Row]) -> list[str]:
    """Counts and medians of the draws of one machine at one noise."""
    answers = [row for row in rows if row.pulls]
    pulls = [p for row in answers for p, b in zip(row.pulls, row.bounds, strict=True) if b < SEEN and np.isfinite(p)]
    seconds, lifted = (np.array([getattr(row, name) for row in rows]) for name in ("seconds", "lifted_seconds"))
    return [
        rows[0].machine,
        f"{rows[0].noise:.1%}",
        str(len(rows)),
        *(str(sum(row.outcome in own for row in rows)) for own in (("refused", "no answer"), ("failed",), ("passed",))),
        f"{', '.join(str(row.order) for row in rows)} ({rows[0].true})",
        f"{sum(row.found for row in rows)} of {sum(row.must for row in rows)}",
        str(sum(row.false for row in rows)),
        f"{max(pulls):.1f}" if pulls else "",
        f"{np.median(seconds):.1f}",
        f"{np.median(lifted):.1f}",
        f"{np.median(seconds / lifted):.1f}",
    ]


def table(rows: Sequence[Row]) -> str:
    """A line a machine and noise."""
    lines = [list(HEADS), ["---"] * len(HEADS)]
    keys = dict.fromkeys((row.machine, row.noise) for row in rows)
    lines += [line([row for row in rows if (row.machine, row.noise) == key]) for key in keys]
    return "\n".join("| " + " | ".join(each) + " |" for each in lines)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulators", description=__doc__)
    add_options(parser, draws=10)
    parser.add_argument("--only", default="", help=f"comma-separated, of: {', '.join(MACHINES)}; all by default")
    parser.add_argument("--noise", default="0.01,0.001", help="shares of each channel's largest free response")
    options = parser.parse_args(arguments)
    names = [name.strip() for name in options.only.split(",") if name.strip()] or list(MACHINES)
    if unknown := [name for name in names if name not in MACHINES]:
        parser.error(f"no machines: {', '.join(unknown)}")
    if "soft_blade" in names and not LINEARISED.is_dir():
        sys.stderr.write("soft_blade is left out: its linearisations are not here\n")
        names.remove("soft_blade")
    noises = [float(share) for share in options.noise.split(",")]
    work = [(name, noise, seed) for name in names for noise in noises for seed in seeds(options)]
    rows = judged_rows(judged, work, options)
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
