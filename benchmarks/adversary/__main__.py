"""Runs the kinds, prints a line a kind, and writes a row a run as JSON."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.adversary.kinds import KINDS
from benchmarks.adversary.run import Row, judged
from threadpoolctl import threadpool_limits

LONG = 20.0
"""Processor seconds that no run shall take."""

HEADS = (
    "kind", "runs", "right", "refused", "no answer", "wrong, silent", "wrong, warned", "wrong, failed",
    "right, failed", "intervals that hold", "seconds: median, most",
)  # fmt: skip


def one(kind: str, seed: int) -> Row:
    """One run, on one thread."""
    with threadpool_limits(limits=1):
        return judged(kind, seed)


def line(name: str, rows: Sequence[Row]) -> list[str]:
    """The counts of some rows."""
    seconds = sorted(row.seconds for row in rows)
    answers = [row for row in rows if row.outcome in ("passed", "failed")]
    wrong = [row for row in answers if row.wrong]
    counts = (
        len(answers) - len(wrong),
        sum(row.outcome == "refused" for row in rows),
        len(rows) - len(answers) - sum(row.outcome == "refused" for row in rows),
        sum(row.silent for row in rows),
        sum(row.outcome == "passed" and not row.silent for row in wrong),
        sum(row.outcome == "failed" for row in wrong),
        sum(row.outcome == "failed" and not row.wrong for row in rows),
    )
    intervals = sum(row.intervals for row in answers)
    held = f"{sum(row.inside for row in answers) / intervals:.0%} of {intervals}" if intervals else "-"
    return [name, str(len(rows)), *map(str, counts), held, f"{seconds[len(seconds) // 2]:.1f}, {seconds[-1]:.1f}"]


def table(rows: Sequence[Row]) -> str:
    """One line a kind, and sums of all and of those in which nothing is amiss and a mode can be determined."""
    kinds = [name for name in KINDS if any(row.kind == name for row in rows)]
    lines = [list(HEADS), ["---"] * len(HEADS)]
    lines += [line(name, [row for row in rows if row.kind == name]) for name in kinds]
    sound = [row for row in rows if KINDS[row.kind].benign and row.must]
    lines += [line("all", rows)] + ([line("nothing amiss", sound)] if sound else [])
    long = sum(row.seconds > LONG for row in rows)
    return "\n".join(["| " + " | ".join(each) + " |" for each in lines] + ["", f"{long} runs over {LONG:g} s."])


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.adversary", description=__doc__)
    parser.add_argument("--kinds", default="", help=f"comma-separated, of: {', '.join(KINDS)}; all by default")
    parser.add_argument("--share", type=float, default=1.0, help="the share of each kind's runs")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a JSON file, written anew after every run")
    options = parser.parse_args(arguments)
    names = [name.strip() for name in options.kinds.split(",") if name.strip()] or list(KINDS)
    if unknown := [name for name in names if name not in KINDS]:
        parser.error(f"no kinds: {', '.join(unknown)}")
    work = [
        (name, options.first + seed)
        for name in names
        for seed in range(max(1, round(options.share * KINDS[name].runs)))
    ]
    rows: list[Row] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for row in pool.map(one, *zip(*work, strict=True)):
            rows.append(row)
            ending = "SILENTLY WRONG" if row.silent else ("wrong, " if row.wrong else "") + row.outcome
            found = f"{row.found} of {row.must}, {row.false} false, order {row.order} ({row.true})"
            sys.stderr.write(
                f"{len(rows)} of {len(work)}: {row.kind}, {row.seed}: {ending}, {found}, {row.seconds:.1f} s\n"
            )
            if options.out is not None:
                options.out.write_text(json.dumps([each.as_json() for each in rows], indent=1) + "\n", encoding="utf-8")
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
