"""Identifies all records again and says which decisions differ from those kept; `freeze` keeps those of today."""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from statistics import median

from benchmarks.frozen.compare import EQUAL, WORSE, compared, sums
from benchmarks.frozen.records import CHAINS, RECORDS
from benchmarks.frozen.run import Decision, calibration, decided
from benchmarks.frozen.tables import changes, summaries, times

FOLDER = Path(__file__).parent
WARM = {"free": "adversary, plain", "inputs": "inputs, lag", "ambient": "ambient, Mathieu", "lines": "lines, lag"}
"""A cheap record of each kind: what a process loads for the first of it counts for none."""


def asked(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frozen", description=__doc__)
    parser.add_argument("do", nargs="?", choices=("compare", "freeze"), default="compare", help="compare by default")
    parser.add_argument("--records", default="", help="beginnings of names, semicolon-separated; all by default")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--tables",
        type=Path,
        nargs="?",
        const=Path("build"),
        help="in place of records, result files of other benchmarks in this folder, build by default",
    )
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of then.json, tables.json and reasons.toml")
    options = parser.parse_args(arguments)
    if options.jobs < 1 or not chosen(options.records):
        parser.error(f"nothing to run; the records are: {'; '.join(RECORDS)}")
    return options


def chosen(words: str) -> list[tuple[str, int]]:
    """Records whose names, or names and seeds, begin with one of the words."""
    begins = tuple(word.strip() for word in words.split(";") if word.strip()) or ("",)
    work = [(name, seed) for name, frozen in RECORDS.items() for seed in frozen.seeds]
    return [(name, seed) for name, seed in work if f"{name}, {seed}".startswith(begins)]


def warm(kinds: Sequence[str]) -> None:
    """One record of each kind, of which nothing is kept."""
    calibration()
    for kind in kinds:
        decided(WARM[kind], RECORDS[WARM[kind]].seeds[0])


def decisions(work: list[tuple[str, int]], jobs: int) -> Iterator[tuple[Decision, float]]:
    """The decisions in the order of the work, as they end, each with the calibration before it."""
    kinds = [kind for kind in CHAINS if any(RECORDS[name].kind == kind for name, _ in work)]
    if jobs == 1:
        warm(kinds)
        yield from (decided(*each) for each in work)
        return
    with ProcessPoolExecutor(jobs, initializer=warm, initargs=(kinds,)) as pool:
        yield from pool.map(decided, *zip(*work, strict=True))


def freeze(path: Path, work: list[tuple[str, int]], jobs: int) -> None:
    """Writes the decisions of today, anew after every one; records that are not run stay as they are.

    Beside those the seconds are scaled to the calibration of their day.
    """
    present = [f"{name}, {seed}" for name, seed in chosen("")]
    new = {f"{name}, {seed}" for name, seed in work}
    kept, pace = read(path) if path.exists() else ({}, None)
    kept = {name: row for name, row in kept.items() if name in present and name not in new}
    found, paces = {}, []
    for decision, now in decisions(work, jobs):
        found[decision.name] = decision
        paces.append(now)
        sys.stderr.write(f"{len(paces)} of {len(work)}: {shown(decision)}\n")
        own = median(paces)
        by = pace / own if kept and pace else 1.0
        rows = kept | {name: replace(row, seconds=round(by * row.seconds, 3)) for name, row in found.items()}
        _write(path, [rows[name] for name in present if name in rows], by * own)


def _write(path: Path, rows: Sequence[Decision], pace: float) -> None:
    """A line a decision."""
    lines = ",\n".join(json.dumps(row.as_json(), ensure_ascii=False, separators=(",", ":")) for row in rows)
    head = f'{{"format": "floquid-frozen/1", "calibration": {pace:.4g},\n"decisions": [\n'
    path.write_text(f"{head}{lines}\n]}}\n", encoding="utf-8")


def shown(decision: Decision) -> str:
    """One line of a decision."""
    verdict = {True: ", passed", False: ", did not pass", None: ""}[decision.passed]
    said = f"{decision.name}: {decision.outcome}{verdict}, order {decision.order}, {decision.seconds:.1f} s"
    return f"{said}, {decision.found} of {decision.must}, {decision.false} false"


def read(path: Path) -> tuple[dict[str, Decision], float]:
    """The decisions kept, by their names, and the calibration of that day."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    rows = [Decision.of_json(row) for row in kept["decisions"]]
    return {row.name: row for row in rows}, kept["calibration"]


def reasons_of(folder: Path) -> Mapping[str, str]:
    """Why a decision may be worse, by the name of its record, with its seed or without."""
    path = folder / "reasons.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def compare(folder: Path, work: list[tuple[str, int]], jobs: int) -> bool:
    """Prints what differs and the sums; True where a decision is worse and nobody says why."""
    then, pace = read(folder / "then.json")
    reasons, differences, paces, unexplained = reasons_of(folder), [], [], 0
    missing = [f"{name}, {seed}" for name, seed in work if f"{name}, {seed}" not in then]
    for decision, now in decisions([each for each in work if f"{each[0]}, {each[1]}" in then], jobs):
        difference = compared(then[decision.name], decision)
        differences.append(difference)
        paces.append(now)
        sys.stderr.write(f"{len(paces)} of {len(work)}: {shown(decision)}\n")
        if difference.verdict != EQUAL:
            why = reasons.get(decision.name, reasons.get(decision.record, ""))
            unexplained += difference.verdict == WORSE and not why
            sys.stdout.write(f"{difference}" + (f" ({why})" if why else "") + "\n")
    if missing:
        sys.stdout.write(f"Not frozen: {'; '.join(missing)}.\n")
    if differences:
        sys.stdout.write(f"\n{sums(differences, median(paces) / pace)}\n")
    if unexplained:
        sys.stdout.write(f"\n{unexplained} worse without a reason in reasons.toml.\n")
    return unexplained > 0


def freeze_tables(path: Path, results: Path) -> None:
    """Writes the summaries of the result files that are there; others stay as they are."""
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    found = summaries(results)
    kept |= found
    path.write_text(json.dumps(kept, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    sys.stdout.write(f"Frozen: {'; '.join(found) or 'nothing'}.\n")


def compare_tables(folder: Path, results: Path) -> bool:
    """Prints which numbers of the tables differ; True where one is worse and nobody says why."""
    then = json.loads((folder / "tables.json").read_text(encoding="utf-8"))
    now, reasons, unexplained = summaries(results), reasons_of(folder), 0
    for change in changes(then, now):
        why = reasons.get(change.name, "")
        unexplained += change.worse and not why
        sys.stdout.write(f"{change}" + (f" ({why})" if why else "") + "\n")
    absent = [name for name in then if name not in now]
    sys.stdout.write(f"\n{times(then, now)}\n" + (f"\nNo results of: {'; '.join(absent)}.\n" if absent else ""))
    if unexplained:
        sys.stdout.write(f"\n{unexplained} worse without a reason in reasons.toml.\n")
    return unexplained > 0


def main(arguments: list[str]) -> int:
    options = asked(arguments)
    freezing, work = options.do == "freeze", chosen(options.records)
    if options.tables is not None:
        if freezing:
            freeze_tables(options.folder / "tables.json", options.tables)
            return 0
        return int(compare_tables(options.folder, options.tables))
    if freezing:
        freeze(options.folder / "then.json", work, options.jobs)
        return 0
    return int(compare(options.folder, work, options.jobs))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
