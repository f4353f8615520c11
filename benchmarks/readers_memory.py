"""How much memory reading a file takes, for each format: the peak of a process of its own, over the decoded samples.

Run: python benchmarks/readers_memory.py [channels samples]

Each format is written from one record of noise, 8 channels of a million samples (text: 200 000) unless said otherwise.
A child process imports floquid and the format's library, reads the file, and tells by how much its peak of resident
memory grew. "Decoded" is channels times samples times 8 bytes. Linux only: the peak is that of /proc/self/status.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from floquid.core import Record
from floquid.readers import FORMATS, write

TEXT = (".csv", ".out")
CHILD = """
import sys, time
from pathlib import Path
import numpy, scipy.io, h5py, floquid
from floquid.readers import read

def status(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key))

small, large = sys.argv[1:]
read(small)
Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
before, began = status("VmRSS"), time.perf_counter()
record = read(large)
took = time.perf_counter() - began
print(status("VmHWM") - before, took)
"""


def main(n_channels: int, n_samples: int) -> None:
    """Write, read in a child, print one row a format."""
    out = sys.stdout.write
    out("| format | decoded [MB] | file [MB] | peak [MB] | peak over decoded | time [s] |\n")
    out("|---|---|---|---|---|---|\n")
    rng = np.random.default_rng(0)
    for kind in (kind for kind in FORMATS if kind.save):
        rows = n_samples // 5 if kind.suffix in TEXT else n_samples
        names = [f"x{row}" for row in range(n_channels)]
        record = Record(values=rng.standard_normal((n_channels, rows)), sample_rate=51200.0, channels=names)
        with tempfile.TemporaryDirectory() as folder:
            small, large = (Path(folder) / f"{size}{kind.suffix}" for size in ("small", "large"))
            write(Record(values=record.values[:, :10], sample_rate=51200.0, channels=names), small)
            write(record, large)
            decoded, size = record.values.nbytes / 1e6, large.stat().st_size / 1e6
            del record
            command = [sys.executable, "-c", CHILD, str(small), str(large)]
            peak, took = map(float, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
        peak *= 1024 / 1e6
        out(f"| {kind.suffix} | {decoded:.0f} | {size:.0f} | {peak:.0f} | {peak / decoded:.1f} | {took:.1f} |\n")


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]] or [8, 1_000_000]
    main(*numbers)
