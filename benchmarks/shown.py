"""Times that were asked for, beside those of this machine, a row each: `python -m benchmarks.shown`.

Seconds are those of the processor with one thread of BLAS. Those of commands are over an import of numpy, the median of
pairs that are run one after the other. Machines have a benchmark of their own (`benchmarks.simulators`).
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.slopes import Size, measured, slope

from floquid import identify
from floquid.lti import MaximumLikelihood
from floquid.systems import JeffcottRotor

ROOT = Path(__file__).parents[1]
PAIRS = 9  # runs of each command, after one that keeps bytecode


def rotor() -> list[str]:
    """The paper's rotor with validation, and its maximum likelihood with the order unknown."""
    record = JeffcottRotor().simulate()
    found = identify(record)
    data, method = found.lifted.responses, MaximumLikelihood()
    whole = statistics.median(spent(lambda: identify(record)) for _ in range(PAIRS))
    alone = statistics.median(spent(lambda: method.extract(method.prepare(data))) for _ in range(PAIRS))
    return [
        f"the paper's rotor, with validation | 0.17 s | {whole:.3g} s",
        f"its maximum likelihood | 15 ms | {1e3 * alone:.3g} ms",
    ]


def long() -> list[str]:
    """A free record of 1e7 values."""
    found = measured(Size(periods=78_125))
    return [f"1e7 values of a free response | 2 s, 250 MB | {found['seconds']:.3g} s, {found['memory']:.0f} MB"]


def inputs() -> list[str]:
    """Measured inputs by the number of modes: the exponent of the growth."""
    took = {modes: measured(Size(kind="inputs", modes=modes))["seconds"] for modes in (2, 4, 8)}
    words = ", ".join(f"{seconds:.3g} s" for seconds in took.values())
    power = slope([float(modes) for modes in took], list(took.values()))
    return [f"exponent in the modes, measured inputs | 2 at most | {power:.2f} ({words} for 2, 4, 8 modes)"]


def ambient() -> list[str]:
    """Outputs alone."""
    found = measured(Size(kind="ambient", periods=1200, modes=4))
    return [f"outputs alone, 4 × 38,400 samples, 4 modes | 15 s | {found['seconds']:.3g} s (order {found['order']})"]


def commands() -> list[str]:
    """Commands over an import of numpy, and `identify --out` over `identify`."""
    hit = str(ROOT / "examples" / "rotor" / "hit1.npz")
    record = [*_floquid("identify", hit), "--period", "0.015789473684210523"]
    numpy = [sys.executable, "-c", "import numpy"]
    with tempfile.TemporaryDirectory() as folder:
        return [
            f"`--version` over an import of numpy | 1.5 | {over(_floquid('--version'), numpy):.2f}",
            f"`info` over an import of numpy | 4 | {over(_floquid('info', hit), numpy):.2f}",
            f"`identify --out` over `identify` | 3 | {over([*record, '--out', folder], record, 3):.2f}",
        ]


def _floquid(*words: str) -> list[str]:
    return [sys.executable, "-m", "floquid", *words]


def over(command: Sequence[str], other: Sequence[str], pairs: int = PAIRS) -> float:
    """The processor time of one command over that of another."""
    each = [(_child(command), _child(other)) for _ in range(pairs + 1)]
    return statistics.median(a / b for a, b in each[1:])


def _child(command: Sequence[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def spent(work: Callable[[], object]) -> float:
    """Processor time of some work [s]."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


LINES = {own.__name__: own for own in (rotor, long, inputs, ambient, commands)}


def main(arguments: list[str]) -> int:
    """Print the rows, each measured in a process of its own."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.shown", description=__doc__)
    parser.add_argument("--only", default=",".join(LINES), help="comma-separated")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        sys.stdout.write("".join(f"| {row} |\n" for row in LINES[options.one]()))
        return 0
    sys.stdout.write("| | asked for | measured |\n|---|---|---|\n")
    for name in options.only.split(","):
        sys.stdout.flush()
        subprocess.run([sys.executable, "-m", "benchmarks.shown", "--one", name], check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
