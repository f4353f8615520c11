"""Ours and other people's identifiers on the same responses: `python -m benchmarks.peers --out docs/peers`."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.peers import cases, tables
from benchmarks.peers.entries import Entry, entries
from benchmarks.peers.growth import in_its_own_process
from benchmarks.peers.measure import judged, timed
from threadpoolctl import threadpool_limits

PARTS = ("paper", "modes", "growth")
NUMBERS = (2, 5, 10, 20)
SIZES = ((200, 1024), (2_000, 1024), (20_000, 1024), (200, 256), (200, 4096), (200, 16_384))
GROWING = (tables.UNKNOWN, "PyDMD BOPDMD", "PyDMD DMD", "PyDMD HODMD", "pyMOR ERA", "sdypy-EMA LSCF")
"""Ours and the quickest of others. Those of DMD and ERA are set to a few hundred cycles, however many there are."""

ROUNDS = 2
"""Rounds of timing on the paper's record after the first."""

PACKAGES = ("numpy", "scipy", "pydmd", "pymor", "control", "sdypy-EMA", "pyOMA_2")


def say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def of_paper(chosen: list[Entry], seeds: int, rounds: int) -> list[dict[str, Any]]:
    """The first table: rows on the paper's record, timed in rounds."""
    of = [cases.paper(seed) for seed in range(seeds)]
    rows = []
    for entry in chosen:
        rows.append(judged(entry, of))
        say(f"paper: {entry.name}: lost {rows[-1]['lost']} of {seeds}, error {rows[-1]['error']}")
    for number in range(rounds):
        say(f"paper: round {number + 2} of timing")
        for entry, row in zip(chosen, rows, strict=True):
            if row["seconds"] is not None and not row["slow"]:
                timed(row, entry, of[0])
    return rows


def of_modes(chosen: list[Entry], seeds: int) -> dict[str, list[dict[str, Any]]]:
    """The second table: rows for each number of modes."""
    table: dict[str, list[dict[str, Any]]] = {}
    slow: set[str] = set()
    for number in NUMBERS:
        of = [cases.modes(number, seed) for seed in range(seeds)]
        rows = []
        for entry in chosen:
            if entry.name in slow:
                continue
            row = judged(entry, of)
            if row["slow"]:
                slow.add(entry.name)
            say(f"{number} modes: {entry.name}: lost {row['lost']} of {row['runs']}, error {row['error']}")
            rows.append(row)
        table[str(number)] = rows
    return table


def of_growth(chosen: list[Entry], sizes: tuple[tuple[int, int], ...]) -> list[dict[str, Any]]:
    """The third table: each entry and size in a process of its own."""
    rows = []
    for entry in chosen:
        if entry.name not in GROWING:
            continue
        for outputs, cycles in sizes:
            row = in_its_own_process(entry.name, outputs, cycles)
            say(f"{outputs} × {cycles}: {entry.name}: {row['seconds']} s")
            rows.append(row)
    return rows


def warmed(chosen: list[Entry]) -> None:
    """Let each run once on little, so that no time is that of loading its package."""
    small = cases.modes(2, 0)
    for entry in chosen:
        with suppress(Exception):  # what fails here fails again where it counts
            entry.run(small.data, small.order)


def machine() -> dict[str, Any]:
    """What the numbers were measured with."""
    told: dict[str, Any] = {"python": platform.python_version(), "machine": platform.machine(), "cores": os.cpu_count()}
    for name in PACKAGES:
        try:
            told[name] = version(name)
        except PackageNotFoundError:
            told[name] = None
    return told


def asked(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help="records of the rotor, and draws of each number of modes")
    parser.add_argument("--only", default="", help="those whose names hold one of these words, comma-separated")
    parser.add_argument("--parts", default=",".join(PARTS), help="of paper, modes, growth, comma-separated")
    parser.add_argument("--quick", action="store_true", help="time once, and grow through two small sizes only")
    parser.add_argument("--out", type=Path, help="a folder for peers.json, the tables and the figure")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> int:
    options = asked(arguments)
    words = [word.strip().lower() for word in options.only.split(",") if word.strip()]
    everyone = entries()
    chosen = [e for e in everyone if not words or any(word in e.name.lower() for word in words)]
    parts = [part.strip() for part in options.parts.split(",") if part.strip()]
    if options.seeds < 1 or not chosen or not set(parts) <= set(PARTS):
        say(f"Nothing to run. Parts: {', '.join(PARTS)}. Entries: {'; '.join(e.name for e in everyone)}.")
        return 2
    result: dict[str, Any] = {"format": "floquid-peers/1", "seeds": options.seeds, "machine": machine()}
    texts: dict[str, str] = {}
    with threadpool_limits(limits=1):
        warmed(chosen if set(parts) != {"growth"} else [])
        if "paper" in parts:
            result["paper"] = of_paper(chosen, options.seeds, 0 if options.quick else ROUNDS)
            texts["paper"] = tables.paper(result["paper"])
        if "modes" in parts:
            result["modes"] = of_modes(chosen, options.seeds)
            texts["modes"] = tables.modes(result["modes"])
    if "growth" in parts:
        result["growth"] = of_growth(chosen, SIZES[:1] + SIZES[3:4] if options.quick else SIZES)
        texts["growth"] = tables.growth(result["growth"])
    sys.stdout.write("\n".join(texts.values()))
    if options.out is not None:
        write(options.out, result, texts)
    return 0


def write(folder: Path, result: dict[str, Any], texts: dict[str, str]) -> None:
    """The tables that the documentation includes, the figure, and all numbers; parts not run stay as they were."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "peers.json"
    before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    path.write_text(json.dumps(before | result, indent=1) + "\n", encoding="utf-8")
    for name, text in texts.items():
        (folder / f"{name}.txt").write_text(text, encoding="utf-8")
    if result.get("growth"):
        tables.figure(result["growth"], folder / "growth.svg")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
