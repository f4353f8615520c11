"""Runs the cases and the random systems, several processes at a time, and prints the tables."""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from benchmarks.order.cases import CASES, RANDOM, system_of
from benchmarks.order.run import Row, judged
from benchmarks.order.table import order, robustness
from threadpoolctl import threadpool_limits

FEWER = {"20 modes, 2 %": 20 / 50}
"""Cases with fewer draws than the others."""


def one(case: str, number: int) -> tuple[str, Row]:
    """One draw of one case; the arrays are small, and threads inside BLAS would only wait for each other."""
    with threadpool_limits(limits=1, user_api="blas"):
        return case, judged(system_of(case, number), 0)


def asked(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.order", description=__doc__)
    parser.add_argument("--draws", type=int, default=50, help="draws of each case; 0 leaves the cases out")
    parser.add_argument("--systems", type=int, default=1000, help="random systems; 0 leaves them out")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--cases", default="", help="cases whose names hold one of these words, comma-separated")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a folder for order.md and for order.jsonl, a line a run as they end")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> int:
    options = asked(arguments)
    words = [word.strip() for word in options.cases.split(",") if word.strip()]
    chosen = [name for name in CASES if not words or any(word in name for word in words)]
    if options.draws < 0 or options.systems < 0 or options.jobs < 1 or (options.draws and not chosen):
        sys.stderr.write(f"Nothing to run. The cases are: {'; '.join(CASES)}.\n")
        return 2
    work = [(name, n) for name in chosen for n in range(max(1, round(options.draws * FEWER.get(name, 1.0))))]
    work = work if options.draws else []
    work += [(RANDOM, n) for n in range(options.systems)]
    rows: dict[str, list[Row]] = {name: [] for name in [*chosen, RANDOM]}
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "order.jsonl").write_text("", encoding="utf-8")
    with ProcessPoolExecutor(options.jobs) as pool:
        running = [pool.submit(one, name, options.first + number) for name, number in work]
        for done, future in enumerate(as_completed(running), start=1):
            name, row = future.result()
            rows[name].append(row)
            if options.out is not None:
                with (options.out / "order.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"case": name, **row.as_json()}) + "\n")
            sys.stderr.write(f"\r{done} of {len(work)}: {name}, seed {row.seed}".ljust(70))
            sys.stderr.flush()
    sys.stderr.write("\n")
    for of in rows.values():
        of.sort(key=lambda row: row.seed)
    parts = []
    if any(rows[name] for name in chosen):
        parts.append("## Robustness\n\n" + robustness({name: rows[name] for name in chosen}))
    if rows[RANDOM]:
        parts.append("## Order of random systems\n\n" + order(rows[RANDOM]))
    text = "\n\n".join(parts) + "\n"
    sys.stdout.write(text)
    if options.out is not None:
        (options.out / "order.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
