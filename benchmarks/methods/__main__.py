"""Methods of the literature on the same records: `python -m benchmarks.methods --out docs/methods`."""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.methods import measure, tables
from threadpoolctl import threadpool_limits

PACKAGES = ("numpy", "scipy", "pyOMA_2")


def say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def commit() -> str:
    """The commit that was measured, and whether anything was changed since."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout.strip()

    return git("rev-parse", "--short=7", "HEAD") + (", and changes" if git("status", "--porcelain", "src") else "")


def write(folder: Path, rows: list[dict[str, Any]], seeds: int) -> None:
    """All numbers, the tables that the documentation includes, and the picture; kinds not run stay as they were."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "methods.json"
    before = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.exists() else []
    cases = {row["case"] for row in rows}
    rows = [row for row in before if row["case"] not in cases] + rows
    measured = {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
    whole = {"format": "floquid-methods/1", "commit": commit(), "seeds": seeds, "machine": measured, "rows": rows}
    path.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    for kind in tables.KINDS:
        if any(row["case"].startswith(kind) for row in rows):
            (folder / f"{kind}.txt").write_text(tables.table(rows, kind, seeds), encoding="utf-8")
    (folder / "commit.txt").write_text(
        f"Measured at commit `{commit()}`, {seeds} records each, fewer of methods that are slow.\n", encoding="utf-8"
    )
    tables.figure(rows, folder / "methods.svg")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.methods", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="records of each case, fewer of methods that are slow")
    parser.add_argument(
        "--seconds", type=float, default=measure.SECONDS, help="of each case, after which a method ends"
    )
    parser.add_argument("--only", default="", help="cases whose names hold these words, as free or driven, rotor")
    parser.add_argument("--out", type=Path, help="a folder for methods.json, the tables and the picture")
    options = parser.parse_args(arguments)
    with threadpool_limits(limits=1):
        rows = measure.all_rows(options.seeds, options.only, say, options.seconds)
    for kind in tables.KINDS:
        if any(row["case"].startswith(kind) for row in rows):
            sys.stdout.write(tables.table(rows, kind, options.seeds) + "\n")
    if options.out is not None:
        write(options.out, rows, options.seeds)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
