"""Time and memory of `identify` against the size of a record, for each kind of record: `python -m benchmarks.slopes`.

One size grows, the others stay at those of `BASE`: masses on springs that vary with the period, each with white noise
of 1 %. Every run is a process of its own. Time is that of the processor; memory is by how much the peak of resident
memory grew. A slope is the exponent p of value ~ sizeᵖ, by least squares of logarithms over the three largest sizes.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from tests.driven import Driven, ambient_of, record_of

from floquid import ConstantPeriod, IdentificationError, Record, identify

PERIOD = 2.0 * np.pi
SIZES = ("periods", "phases", "channels", "modes", "hits", "inputs")


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """The sizes of a record: `phases` are the samples a period, `hits` free responses of as many periods each."""

    kind: str = "free"
    periods: int = 256
    phases: int = 32
    channels: int = 4
    modes: int = 3
    hits: int = 1
    inputs: int = 2


BASE = {kind: Size(kind=kind) for kind in ("free", "inputs", "ambient")}
LADDERS = {
    "free": {
        "periods": (256, 1024, 4096, 16384),
        "phases": (16, 32, 64, 128),
        "channels": (4, 16, 64, 256),
        "modes": (3, 6, 12, 24),
        "hits": (1, 2, 4, 8),
    },
    "inputs": {
        "periods": (128, 256, 512, 1024),
        "phases": (16, 32, 64),
        "channels": (4, 8, 16, 32),
        "modes": (2, 4, 6, 8),
        "inputs": (1, 2, 4, 8),
    },
    "ambient": {
        "periods": (256, 512, 1024, 2048),
        "phases": (16, 32, 64),
        "channels": (2, 4, 8),
        "modes": (1, 2, 3, 4),
    },
}
LONGEST = 600.0
"""Seconds that a run may take."""


def system_of(size: Size) -> Driven:
    """Masses on springs of like damping, whose frequencies lie apart folded, the largest below 2.5 [rad/s]."""
    n, generator = size.modes, np.random.default_rng(size.modes)
    turn, _ = np.linalg.qr(generator.standard_normal((n, n)))
    natural = 0.5 * (np.arange(n) + 0.5) / n + np.arange(n) % 3
    stiffness, damping = (turn * natural**2) @ turn.T, (turn * (0.03 * natural)) @ turn.T
    varied = 0.1 * (turn * natural) @ generator.standard_normal((n, n)) @ (turn * natural).T / np.sqrt(n)
    varied = 0.5 * (varied + varied.T)
    forces = np.vstack([np.zeros((n, size.inputs)), generator.standard_normal((n, size.inputs))])
    seen = np.hstack([generator.standard_normal((size.channels, n)), np.zeros((size.channels, n))])

    def matrix(t: float) -> np.ndarray:
        return np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness - np.cos(t) * varied, -damping]])

    return Driven(matrix, lambda t: forces, lambda t: seen, PERIOD)


def records_of(size: Size) -> tuple[list[Record], dict]:
    """The records of a size, and the options they are identified with."""
    system, clock, names = system_of(size), ConstantPeriod(period=PERIOD), [f"y{k}" for k in range(size.channels)]
    rate, records, options = size.phases / PERIOD, [], {}
    for hit in range(size.hits):
        if size.kind == "ambient":
            values, options = ambient_of(system, size.periods, size.phases, 0.01, hit), {"excitation": "ambient"}
        elif size.kind == "inputs":
            parts = record_of(system, size.periods, size.phases, 0.01, hit)
            forces = [f"F{k}" for k in range(size.inputs)]
            values, names, options = np.concatenate(parts), [*names, *forces], {"inputs": forces}
        else:
            start = np.random.default_rng(hit).standard_normal(2 * size.modes)
            silence = np.zeros((size.inputs, size.periods * size.phases))
            values, _ = record_of(system, size.periods, size.phases, 0.0, hit, silence, start)
            noise = 0.01 * np.abs(values).max(axis=1, keepdims=True)
            values = values + noise * np.random.default_rng(hit + 99).standard_normal(values.shape)
        records.append(Record(values=values, sample_rate=rate, channels=names, clock=clock))
    return records, options


def measured(size: Size) -> dict:
    """Seconds of the processor, growth of the peak of memory [MB], order and verdict of one record in this process."""
    records, options = records_of(Size(kind=size.kind, periods=64, phases=16, channels=2, modes=1, inputs=1))
    identify(records, **options)  # what is imported at the first use is no cost of the size
    records, options = records_of(size)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak counts from here
    before, began = _peak(), time.process_time()
    try:
        found = identify(records, seconds=LONGEST, **options)
        answer = {"order": found.model.order, "answer": found.answer}
    except IdentificationError as error:
        answer = {"order": 0, "answer": str(error)[:80]}
    took = time.process_time() - began
    data = sum(record.values.nbytes for record in records) / 1e6
    return {**asdict(size), **answer, "seconds": round(took, 3), "memory": round(_peak() - before, 1), "data": data}


def _peak() -> float:
    """Peak of resident memory [MB]."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def slope(sizes: list[float], values: list[float]) -> float:
    """The exponent p of value ~ sizeᵖ over the three largest sizes."""
    if min(values[-3:]) <= 0.0 or len(values) < 2:
        return float("nan")
    return float(np.polyfit(np.log(sizes[-3:]), np.log(values[-3:]), 1)[0])


def table(rows: list[dict]) -> str:
    """A row a kind and a size, in Markdown."""
    lines = ["| kind | grows | sizes | seconds | slope | memory [MB] | slope |", "|---|---|---|---|---|---|---|"]
    for kind, ladders in LADDERS.items():
        for name in ladders:
            own = [row for row in rows if row["kind"] == kind and row["grows"] == name]
            if not own:
                continue
            sizes = [row[name] for row in own]
            cells = [kind, name, ", ".join(map(str, sizes))]
            for part in ("seconds", "memory"):
                values = [row[part] for row in own]
                cells += [", ".join(f"{value:.3g}" for value in values), f"{slope(sizes, values):.2f}"]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Run the ladders, a process a record; write slopes.json and slopes.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slopes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/slopes"), help="a folder")
    parser.add_argument("--kinds", default=",".join(LADDERS), help="comma-separated")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        sys.stdout.write(json.dumps(measured(Size(**json.loads(options.one)))))
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict] = []
    for kind in options.kinds.split(","):
        for name, sizes in LADDERS[kind].items():
            for number in sizes:
                size = json.dumps(asdict(replace(BASE[kind], **{name: number})))
                command = [sys.executable, "-m", "benchmarks.slopes", "--one", size]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                rows.append({"grows": name, **json.loads(done.stdout)})
                own = rows[-1]
                sys.stderr.write(
                    f"{kind}, {name} {number}: {own['seconds']} s, {own['memory']} MB, order {own['order']}, "
                    f"{own['answer']}\n"
                )
                (options.out / "slopes.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    (options.out / "slopes.md").write_text(table(rows), encoding="utf-8")
    sys.stdout.write(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
