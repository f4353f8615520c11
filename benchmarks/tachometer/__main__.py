"""Identifies runs by their tachometer, prints a row a speed, and writes a row a run as JSON."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.chain.run import OutOfTime, limited
from benchmarks.tachometer.rig import Rig
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import floquid
from floquid import FloquidError, PeriodicModel

SPEEDS = (600, 750, 900, 1050, 1200, 1500, 1800, 2100, 2400, 2505, 2700, 3000)  # [rpm]
WIDTHS = (0.05, 0.1, 0.2)
RATES = (1024, 10240)  # [Hz]
WANDERS = (0.0, 0.001)
NEAR = 0.1
"""The share of its decay rate that an exponent may be off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one run.

    `outcome` is "passed" or "failed" (the verdict), "refused" or "no answer" (out of time). `found` of the four modes
    are within `NEAR`, `false` ones are not; `message` is the reason or the refusal.
    """

    rpm: float
    width: float
    rate: float
    wander: float
    seed: int = 0
    outcome: str
    found: int = 0
    false: int = 0
    seconds: float
    period_fitted: bool = False
    message: str = ""

    @property
    def right(self) -> bool:
        """True with every mode, no false one, and passed."""
        return self.outcome == "passed" and self.found == 4 and not self.false

    @property
    def brief(self) -> str:
        """Modes found, false ones behind a plus, and the seconds; in brackets where the model failed."""
        if self.outcome in ("refused", "no answer"):
            return f"{self.outcome}, {self.seconds:.0f} s"
        words = f"{self.found}{f' + {self.false}' if self.false else ''}, {self.seconds:.1f} s"
        return words if self.outcome == "passed" else f"({words})"


def judged(rig: Rig, limit: float) -> Row:
    """The row of one run: `identify` as a user would call it, on one thread."""
    own, record = {"rpm": rig.rpm, "width": rig.width, "rate": rig.rate, "wander": rig.wander}, rig.record()
    own["seed"] = rig.seed
    begin, analysis, outcome, message = time.process_time(), None, "no answer", ""
    try:
        with threadpool_limits(limits=1), limited(limit):
            analysis = floquid.identify(record)
    except OutOfTime:
        pass
    except FloquidError as error:
        outcome, message = "refused", str(error)
    seconds = time.process_time() - begin
    if analysis is None:
        return Row(**own, outcome=outcome, seconds=seconds, message=message)
    found, false = compared(rig.exponents(), analysis.model)
    return Row(
        **own,
        outcome="passed" if analysis.passed else "failed",
        found=found,
        false=false,
        seconds=seconds,
        period_fitted=not analysis.shafts,
        message=" ".join(analysis.reasons),
    )


def compared(truth: NDArray[np.complex128], model: PeriodicModel) -> tuple[int, int]:
    """The true modes (one of each pair) that a model has within `NEAR`, and how many it has that are none."""
    both = np.concatenate([truth, truth.conj()])
    gaps = np.subtract.outer(model.exponents[list(model.upper_modes)], both)
    near = np.abs(gaps.real + 1j * wrapped(gaps.imag, model.fundamental)) < NEAR * np.abs(both.real)
    seen = near.any(axis=0).reshape(2, -1).any(axis=0)
    return int(seen.sum()), int(near.shape[0] - near.any(axis=1).sum())


def table(rows: Sequence[Row]) -> str:
    """A line a speed, a column a width of the pulse, for each rate and wander; what is right is counted."""
    said = []
    for rate, wander in sorted({(row.rate, row.wander) for row in rows}):
        part = [row for row in rows if (row.rate, row.wander) == (rate, wander)]
        widths = sorted({row.width for row in part})
        right = sum(row.right for row in part)
        speed = f"speed wandering by {100.0 * wander:g} %" if wander else "steady speed"
        said += [f"{rate:g} Hz, {speed}: {right} of {len(part)} with 4 modes, none false, passed", ""]
        said += ["| rpm | " + " | ".join(f"pulse of {100.0 * width:g} %" for width in widths) + " |"]
        said += ["|---" * (len(widths) + 1) + "|"]
        for rpm in sorted({row.rpm for row in part}):
            alike = ([row.brief for row in part if (row.rpm, row.width) == (rpm, width)] for width in widths)
            cells = ["; ".join(briefs) for briefs in alike]
            said.append(f"| {rpm:g} | " + " | ".join(cells) + " |")
        said.append("")
    return "\n".join(said)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all, print the table, and write the rows."""
    text = f"{__doc__} A cell has the modes found of four, false ones behind a plus; in brackets where the model fails."
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tachometer", description=text)
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS, help="[rpm]")
    parser.add_argument("--widths", type=float, nargs="+", default=WIDTHS, help="of the pulse, shares of a revolution")
    parser.add_argument("--rates", type=float, nargs="+", default=RATES, help="[Hz]")
    parser.add_argument("--wanders", type=float, nargs="+", default=WANDERS, help="of the speed, rms over its mean")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of the noise")
    parser.add_argument("--limit", type=float, default=120.0, help="processor seconds after which a run is ended")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a JSON file, written anew after every run")
    asked = parser.parse_args(arguments)
    cases = product(asked.seeds, asked.rates, asked.wanders, asked.widths, asked.speeds)
    rigs = [Rig(rpm=rpm, width=width, rate=rate, wander=wander, seed=seed) for seed, rate, wander, width, rpm in cases]
    rows: list[Row] = []
    with ProcessPoolExecutor(asked.jobs) as pool:
        for row in pool.map(judged, rigs, [asked.limit] * len(rigs)):
            rows.append(row)
            sys.stderr.write(f"{len(rows)} of {len(rigs)}: {row}\n")
            if asked.out:
                asked.out.write_text(json.dumps([asdict(each) for each in rows], indent=1) + "\n", encoding="utf-8")
    sys.stdout.write(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
