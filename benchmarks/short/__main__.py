"""Identifies every case for some seeds and prints what was found, what was not there, deviations and seconds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from benchmarks.short.run import Row, judged
from benchmarks.short.systems import Case, cases
from threadpoolctl import threadpool_limits

HEADS = ("case", "hits", "periods", "found", "false", "refused", "worst deviation", "rms", "error", "passed", "seconds")


def line(case: Case, rows: Sequence[Row]) -> list[str]:
    """Sums over the seeds of one case."""
    pulls = np.concatenate([row.pulls for row in rows])
    some = bool(len(pulls))
    found, must = (sum(getattr(row, name) for row in rows) for name in ("found", "must"))
    return [
        case.name,
        str(case.hits),
        str(case.revolutions),
        f"{found}/{must}",
        str(sum(row.false for row in rows)),
        str(sum(not len(row.pulls) for row in rows)),
        f"{pulls.max():.1f}" if some else "",
        f"{np.sqrt(np.mean(pulls**2)):.2f}" if some else "",
        f"{np.nanmedian([row.error for row in rows]):.2g}" if some else "",
        f"{sum(row.passed for row in rows)}/{len(rows)}",
        f"{np.median([row.seconds for row in rows]):.1f}",
    ]


def table(chosen: Sequence[Case], seeds: Sequence[int]) -> str:
    """A line a case."""
    lines = [list(HEADS), ["---"] * len(HEADS)]
    with threadpool_limits(limits=1):
        lines += [line(case, [judged(case, seed) for seed in seeds]) for case in chosen]
    return "\n".join("| " + " | ".join(each) + " |" for each in lines)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.short", description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--only", default="", help="beginning of the names of the cases")
    options = parser.parse_args(arguments)
    chosen = [case for case in cases() if case.name.startswith(options.only)]
    sys.stdout.write(table(chosen, range(options.first, options.first + options.runs)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
