"""`python -m tests.fuzz [--reader NAME ...] [--seconds S | --inputs N]`: a coverage-guided fuzzer of every reader.

Each target runs in a process of its own, one after the other. A finding is an input that breaks a promise (see
`promise`), or that ends the process; it is kept in the folder `--findings`, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.targets import TARGETS

_DONE = re.compile(r"stat::number_of_executed_units:\s*(\d+)")
_PULSE = re.compile(r"^#(\d+)\s.*?cov: (\d+)", re.MULTILINE)
_MOST_CRASHES = 20
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where a small file costs a tenth of what it costs on a disk."""


@dataclass(slots=True, kw_only=True)
class Tally:
    """What has been done for one target."""

    inputs: int = 0
    seconds: float = 0.0
    edges: int = 0
    crashes: int = 0


def main() -> int:
    """Fuzz the targets that were named, or all, and print one line for each."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz the readers.")
    parser.add_argument("--reader", action="append", choices=sorted(TARGETS), help="one target; several times for more")
    parser.add_argument("--seconds", type=float, default=60.0, help="time for each target [s]")
    parser.add_argument("--inputs", type=int, default=0, help="stop a target after so many inputs")
    parser.add_argument("--findings", type=Path, help="a folder for inputs that break a promise")
    given = parser.parse_args()
    kept = given.findings or Path(tempfile.mkdtemp(prefix="floquid-findings-"))
    kept.mkdir(parents=True, exist_ok=True)
    _say(f"{'target':10s} {'inputs':>9s} {'seconds':>8s} {'inputs/s':>9s} {'edges':>6s} {'findings':>9s}")
    total = 0
    for name in given.reader or TARGETS:
        tally = fuzz(name, kept, given.seconds, given.inputs)
        found = len(list(kept.glob(f"{name}-*.json"))) + tally.crashes
        total += found
        rate = tally.inputs / max(tally.seconds, 1e-9)
        _say(f"{name:10s} {tally.inputs:9d} {tally.seconds:8.0f} {rate:9.0f} {tally.edges:6d} {found:9d}")
    if total:
        _say(f"The findings are in {kept}.")
    return int(total > 0)


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def fuzz(name: str, kept: Path, seconds: float, inputs: int) -> Tally:
    """Run one target for so long, in a new process after each crash."""
    tally = Tally()
    with tempfile.TemporaryDirectory(prefix="floquid-fuzz-", dir=_MEMORY) as place:
        corpus, work = Path(place, "corpus"), Path(place, "work")
        for folder in (corpus, work, work / "home"):
            folder.mkdir()
        for number, data in enumerate(TARGETS[name].seeds()):
            (corpus / f"seed{number:03d}").write_bytes(data)
        while tally.crashes < _MOST_CRASHES:
            left = round(seconds - tally.seconds)
            if left < 1 or (inputs and tally.inputs >= inputs):
                break
            _round(name, kept, corpus, work, left, max(inputs - tally.inputs, 0), tally)
        strays = [path for path in work.rglob("*") if path.is_file() and not path.name.startswith("input.")]
        if strays:
            words = {"target": name, "key": "files written", "words": [str(path) for path in strays]}
            (kept / f"{name}-strays.json").write_text(json.dumps(words, indent=1), encoding="utf-8")
    return tally


def _round(name: str, kept: Path, corpus: Path, work: Path, seconds: int, inputs: int, tally: Tally) -> None:
    began = time.monotonic()
    prefix = f"{kept}/{name}-ended-{tally.crashes}-"
    words = [sys.executable, "-m", "tests.fuzz.worker", name, str(kept), str(work)]
    words += [f"-max_total_time={seconds}", f"-runs={inputs or -1}", f"-artifact_prefix={prefix}", str(corpus)]
    with (kept / f"{name}.log").open("wb") as log:
        ended = subprocess.run(words, stdout=log, stderr=log, env=_environment(work), check=False)
    said = (kept / f"{name}.log").read_text(encoding="utf-8", errors="replace")
    pulses = _PULSE.findall(said)
    done = _DONE.search(said)
    tally.inputs += int(done[1]) if done else int(pulses[-1][0]) if pulses else 0
    tally.edges = max([tally.edges, *(int(cov) for _, cov in pulses)])
    tally.seconds += time.monotonic() - began
    if ended.returncode != 0:
        (kept / f"{name}.log").rename(kept / f"{name}-ended-{tally.crashes}.log")
        tally.crashes += 1


def _environment(work: Path) -> dict[str, str]:
    """A home of its own, so that nothing that is written there goes unseen."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return os.environ | one | {"HOME": str(work / "home"), "PYTHONDONTWRITEBYTECODE": "1"}


if __name__ == "__main__":
    sys.exit(main())
