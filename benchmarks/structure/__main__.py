"""Runs the seeds, prints the coverage by block and by how the structure found stands to the true one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import get_args

import numpy as np
from benchmarks.structure.run import BLOCKS, Block, Row, judged
from benchmarks.structure.systems import Family
from threadpoolctl import threadpool_limits

HEADS = ("A(t)", "block", "records", "intervals that hold", "their mean a record", "worst", "deviation", "error")


def one(case: tuple[int, Family, str]) -> Row | None:
    """One seed of a family and a kind of record, on one thread."""
    with threadpool_limits(limits=1):
        return judged(*case)


def lines(words: str, found: Sequence[dict[str, Block]]) -> list[list[str]]:
    """A line a block: coverage of all intervals, and the median record's mean deviation and error."""
    said = []
    for name in BLOCKS:
        own = [each[name] for each in found]
        held = sum(each.inside for each in own) / sum(each.intervals for each in own)
        each = np.mean([each.inside / each.intervals for each in own])
        middle = [np.median([getattr(each, what) for each in own]) for what in ("deviation", "error")]
        worst = max(each.worst for each in own)
        said.append([words, name, str(len(own)), f"{held:.1%}", f"{each:.1%}", f"{worst:.1f}"])
        said[-1] += [f"{value:.2%}" for value in middle]
    return said


def table(rows: Sequence[Row]) -> str:
    """The free A(t), that of the structure found, and the latter by how it stands to the true one."""
    found = [row for row in rows if row.auto]
    whole = [list(HEADS), ["---"] * len(HEADS), *lines("free", [row.free for row in rows])]
    whole += lines("structure found", [row.auto for row in found])
    for relation in ("right", "wider", "narrow"):
        if own := [row.auto for row in found if row.relation == relation]:
            whole += lines(f"... {relation}", own)
    seconds = np.sum([row.seconds for row in rows])
    last = (
        f"{len(rows) - len(found)} of {len(rows)} without a structure; {seconds:.0f} s of processor time in the search."
    )
    return "\n".join(["| " + " | ".join(each) + " |" for each in whole] + ["", last])


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.structure", description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--family", choices=get_args(Family), default="springs", help="the equations of motion")
    parser.add_argument("--kind", choices=("free", "inputs", "ambient"), default="free", help="the excitation")
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.runs)
    with ProcessPoolExecutor(options.jobs) as pool:
        rows = [
            row for row in pool.map(one, [(seed, options.family, options.kind) for seed in seeds]) if row is not None
        ]
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
