"""Time and memory of every reader on a file of 100 MB that its own library wrote: `python -m benchmarks.readers`.

The files are those of `tests/contracts/test_readers_libraries.py`, made as long as it takes. A child process imports
floquid and the format's library, reads the file, and tells by how much the peak of resident memory grew, that of the
process that guards decoders with it. "Decoded" is
channels times samples times 8 bytes: what a record holds. Linux only: the peak is that of /proc/self/status.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tests.contracts.test_readers_libraries import KINDS, Content
from tests.unit.readers import test_recorders as recorders
from tests.unit.readers.test_xlsx import workbook

CHANNELS, RATE, FEW = 8, 1000.0, 2000  # of the records; samples of the first file, by which the length of the other is
CHILD = """
import json, sys, time
from pathlib import Path
import numpy, scipy.io, h5py, floquid
from floquid.readers import read

def processes():  # this one, and the child that guards decoders
    children = [word for path in Path("/proc/self/task").glob("*/children") for word in path.read_text().split()]
    return [Path("/proc/self"), *(Path("/proc", word) for word in children)]

def status(key):
    texts = [path.joinpath("status").read_text().splitlines() for path in processes()]
    return sum(int(line.split()[1]) for lines in texts for line in lines if line.startswith(key))

small, large, options = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
read(small, **options)
for path in processes():
    path.joinpath("clear_refs").write_text("5")  # the peaks count from here
before, began = status("VmRSS"), time.perf_counter()
record = read(large, **options)
print((status("VmHWM") - before) * 1024, time.perf_counter() - began, record.values.nbytes)
"""

Made = tuple[Path, dict[str, Any]]


def written(name: str, folder: Path, samples: int) -> Made:
    """A file of one kind with these `samples`, and the options of `read` for it."""
    if name in OTHERS:
        return OTHERS[name](folder, samples)
    values = np.random.default_rng(0).standard_normal((CHANNELS, samples))
    record = Content([f"x{row}" for row in range(CHANNELS)], ["V"] * CHANNELS, RATE, values)
    path, _, options = KINDS[name](folder, record)
    return path, options


def _recorded(samples: int) -> None:
    """Give the recorders of the tests as many `samples`."""
    recorders.N, recorders.WAVES = samples, np.random.default_rng(0).standard_normal((2, samples))


def _relay(form: str) -> Callable[[Path, int], Made]:
    def make(folder: Path, samples: int) -> Made:
        path = recorders.comtrade(folder, form, ((50.0, samples),))
        counts, numbers = np.random.default_rng(0).integers(-30000, 30000, (2, samples)), np.arange(1, samples + 1)
        columns = [numbers, np.zeros(samples, int), *counts, np.zeros(samples, int)]
        if form == "ASCII":
            np.savetxt(path.with_suffix(".dat"), np.transpose(columns), fmt="%d", delimiter=",", newline="\r\n")
        else:
            names = dict(zip("ntabd", ("<u4", "<u4", "<i2", "<i2", "<u2"), strict=True))
            np.rec.fromarrays(columns, dtype=list(names.items())).tofile(path.with_suffix(".dat"))
        return path, {}

    return make


def _hawc2(form: str) -> Callable[[Path, int], Made]:
    def make(folder: Path, samples: int) -> Made:
        _recorded(samples)
        return recorders.hawc2(folder, form)[0], {}

    return make


def _xlsx(folder: Path, samples: int) -> Made:
    values = np.random.default_rng(0).standard_normal((samples, CHANNELS)).tolist()
    names = ["time [s]", *(f"x{row} [V]" for row in range(CHANNELS))]
    workbook(folder / "run.xlsx", run=[names, *([k / RATE, *row] for k, row in enumerate(values))])
    return folder / "run.xlsx", {}


OTHERS: dict[str, Callable[[Path, int], Made]] = {
    "comtrade_text": _relay("ASCII"),
    "comtrade_binary": _relay("BINARY"),
    "hawc2_binary": _hawc2("BINARY"),
    "hawc2_text": _hawc2("ASCII"),
    "workbook": _xlsx,
}
"""Kinds whose records the tests fix."""


def size_of(path: Path) -> int:
    """The bytes of a file, with those beside it of its name."""
    return sum(file.stat().st_size for file in path.parent.glob(f"{path.stem}.*") if file.suffix != ".tdms_index")


def measured(name: str, megabytes: float) -> str:
    """One row of the table."""
    with TemporaryDirectory() as folder:
        few, many = Path(folder) / "few", Path(folder) / "many"
        few.mkdir()
        many.mkdir()
        small, options = written(name, few, FEW)
        long, _ = written(name, many, 10 * FEW)
        grows = (size_of(long) - size_of(small)) / (9 * FEW)
        for file in many.iterdir():
            file.unlink()
        large, _ = written(name, many, max(int(1e6 * megabytes / grows), FEW))
        command = [sys.executable, "-c", CHILD, str(small), str(large), json.dumps(options)]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode:
            return f"| `{large.suffix}` | {name.replace('_', ' ')} | {run.stderr.strip().splitlines()[-1][:80]} |"
        peak, seconds, decoded = map(float, run.stdout.split())
        sizes = f"{size_of(large) / 1e6:.0f} | {decoded / 1e6:.0f} | {peak / 1e6:.0f} | {peak / decoded:.1f}"
        return f"| `{large.suffix}` | {name.replace('_', ' ')} | {sizes} | {seconds:.1f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=float, default=100.0, help="the size of each file")
    parser.add_argument("kinds", nargs="*", help="kinds by name; all when none is given")
    given = parser.parse_args()
    left = {"comtrade_fractions_in_one_file"}  # the same library, by another head
    names = given.kinds or [name for name in dict.fromkeys([*KINDS, *OTHERS]) if name not in left]
    out = sys.stdout
    out.write("| | written as | file [MB] | decoded [MB] | peak [MB] | peak over decoded | time [s] |\n")
    out.write("|---|---|---|---|---|---|---|\n")
    for name in names:
        began = time.monotonic()
        out.write(f"{measured(name, given.megabytes)}\n")
        out.flush()
        sys.stderr.write(f"{name}: {time.monotonic() - began:.0f} s\n")


if __name__ == "__main__":
    main()
