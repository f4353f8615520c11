"""Time and memory of one entry at one size, in a process of its own: `python -m benchmarks.peers.growth`."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.peers.cases import growing, modes
from benchmarks.peers.entries import _over_noise, entries
from benchmarks.peers.measure import fastest
from threadpoolctl import threadpool_limits

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def measured(name: str, outputs: int, cycles: int) -> dict[str, float]:
    """The time [s] and the peak of memory beyond the data and what was there before [bytes]."""
    entry = next(e for e in entries() if e.name == name)
    with threadpool_limits(limits=1):
        warm = modes(2, 0)
        entry.run(warm.data, warm.order)
        case = growing(outputs, cycles)
        if not entry.ours:
            _over_noise(case.data)
        before = _reset_peak()
        entry.run(case.data, case.order)
        peak = _peak() - before
        seconds = fastest(lambda: entry.run(case.data, case.order), seconds=3.0)
    return {"seconds": seconds, "peak_bytes": float(peak), "data_bytes": float(case.data.values.nbytes)}


def _reset_peak() -> int:
    """Forget the peak, where the system can, and give what it is now [bytes]."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _peak()


def _peak() -> int:
    """The peak of the resident memory [bytes]."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(row for row in status.read_text(encoding="ascii").splitlines() if row.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def in_its_own_process(name: str, outputs: int, cycles: int) -> dict[str, Any]:
    """`measured` in a new process: another's memory is not counted."""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-W", "ignore", "-m", "benchmarks.peers.growth", name, str(outputs), str(cycles)]
    run = subprocess.run(command, cwd=root, env=os.environ | ONE_THREAD, capture_output=True, text=True, check=False)
    size = {"name": name, "outputs": outputs, "cycles": cycles}
    if run.returncode:
        return size | {"seconds": None, "failure": run.stderr.strip().splitlines()[-1][:200]}
    return size | json.loads(run.stdout.splitlines()[-1])


def slope(sizes: list[int], seconds: list[float]) -> float:
    """The exponent p of time ∝ size^p, by least squares on logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measured(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))) + "\n")
