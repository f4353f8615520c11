"""Runs the cases, prints a line a record, and writes a row a run as JSON."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.chain.records import RECORDS
from benchmarks.chain.run import Row, judged
from benchmarks.chain.table import periods, table
from threadpoolctl import threadpool_limits

LIMIT = 240.0
"""Seconds of the processor that one identification may take."""

OFF = "period_off"


def one(name: str, noise: float, seed: int, limit: float) -> Row:
    """One case of one seed, on one thread."""
    with threadpool_limits(limits=1):
        return judged(name, RECORDS[name](noise, seed), seed, limit)


def asked(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.chain", description=__doc__)
    parser.add_argument("--records", default="", help="names, or beginnings of names, comma-separated; all by default")
    parser.add_argument("--seeds", type=int, default=3, help="draws of each record")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--noise", type=float, default=0.01, help="the noise as a share of the largest free response")
    parser.add_argument("--limit", type=float, default=LIMIT, help="processor seconds that a run may take")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a JSON file, written anew after every run")
    return parser.parse_args(arguments)


def chosen(words: str) -> list[str]:
    """The records named; a name that is one itself does not stand for longer ones."""
    asked_for = [word.strip() for word in words.split(",") if word.strip()]
    found = []
    for word in asked_for or [""]:
        found += [word] if word in RECORDS else [name for name in RECORDS if name.startswith(word)]
    return list(dict.fromkeys(found))


def results(work: list[tuple[str, float, int, float]], jobs: int) -> Iterator[Row]:
    """The rows in the order of the work, as they end."""
    if jobs == 1:
        yield from (one(*each) for each in work)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(one, *zip(*work, strict=True))


def main(arguments: list[str]) -> int:
    options = asked(arguments)
    names = chosen(options.records)
    if not names or options.seeds < 1 or options.jobs < 1:
        sys.stderr.write(f"Nothing to run. The records are: {', '.join(RECORDS)}.\n")
        return 2
    work = [(name, options.noise, options.first + n, options.limit) for name in names for n in range(options.seeds)]
    rows: list[Row] = []
    for row in results(work, options.jobs):
        rows.append(row)
        said = f"{len(rows)} of {len(work)}: {row.record}, seed {row.seed}: {row.outcome}, {row.seconds:.1f} s"
        sys.stderr.write(f"{said}, {row.found} of {row.must}, {row.false} false\n")
        if options.out is not None:
            kept = {"noise": options.noise, "limit": options.limit, "rows": [each.as_json() for each in rows]}
            options.out.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    off = [row for row in rows if row.record.startswith(OFF)]
    sys.stdout.write(table(rows) + "\n" + (f"\n{periods(off)}\n" if off else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
