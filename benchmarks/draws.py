"""Draws judged in processes: their options, and their rows, written as they end."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

Row = TypeVar("Row")


def add_options(parser: argparse.ArgumentParser, draws: int) -> None:
    """Add the options of a benchmark over draws, with the number of draws where none is given."""
    parser.add_argument("--draws", type=int, default=draws, help="systems")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a JSON file, written anew after every draw")


def seeds(options: argparse.Namespace) -> range:
    """The seeds that the options name."""
    return range(options.first, options.first + options.draws)


def judged_rows(judged: Callable[..., Row], cases: Iterable[tuple], options: argparse.Namespace) -> list[Row]:
    """The rows of the cases in their order; each goes to stderr, and all so far to the file asked for, as it ends."""
    rows: list[Row] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for ended in [pool.submit(judged, *case) for case in cases]:
            row = ended.result()
            rows.append(row)
            sys.stderr.write(f"{row}\n")
            if options.out is not None:
                options.out.parent.mkdir(parents=True, exist_ok=True)
                options.out.write_text(json.dumps([asdict(each) for each in rows], indent=1) + "\n", encoding="utf-8")
    return rows
